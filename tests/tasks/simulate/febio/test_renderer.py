"""The rendering process of a worker: its limits, and that it is kept."""

import os
import signal
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from threading import Timer

import numpy as np
import pytest

from sinew.runner.evaluation.external import Stopped
from sinew.runner.store.schema import STATUSES
from sinew.tasks.simulate.febio.renderer import _Renderer, render, render_input
from sinew.tasks.simulate.febio.rendering import program
from sinew.tasks.simulate.row_by_row import Failed
from tests.tasks.simulate.febio.dogbone import BAR, OWN, RELAX, dogbone
from tests.tasks.simulate.febio.fake_solver import BUILT_IN


@pytest.mark.parametrize(
    ("text", "told"),
    {
        "time": ("{% for a in range(99999) %}{% for b in range(99999) %}{% endfor %}{% endfor %}", "more than 1 s"),
        "a constant": ("{{ 10 ** (10 ** 10) }}", "more than 1 s|more than 1 GB"),
        "memory": ("{{ 'x' * 10 ** 11 }}", "more than 1 GB"),
        "doubling": (
            "{% set ns = namespace(x='x' * 99) %}{% for i in range(99) %}{% set ns.x = ns.x ~ ns.x %}{% endfor %}",
            "more than 1 GB|more than 1 s",
        ),
        "endless macro": ("{% macro m() %}{{ m() }}{% endmacro %}{{ m() }}", "recursion"),
    }.values(),
)  # fmt: skip
def test_a_template_is_bounded_in_time_and_memory(tmp_path, monkeypatch, text, told):
    """In its own process; one second of processor time instead of ten, so that the test does not take that long."""
    monkeypatch.setattr(program, "SECONDS", 1)
    simulator = dogbone(tmp_path, f"<febio_spec>{{{{ E_matrix }}}}{text}</febio_spec>")
    found = simulator.simulate(OWN, BAR, RELAX, OWN.reference[np.newaxis])
    assert STATUSES[found.status[0]] == "bad_input"
    assert any(each in found.messages[0] for each in told.split("|")), found.messages


FILES = {"a": "<febio_spec><E>{{ E }}</E></febio_spec>"}
DECLARATION = '<?xml version="1.0" encoding="UTF-8"?>'


def text(files: dict[str, str] = FILES, **variables) -> str:
    (found,) = render(files, "a", [variables], None)["texts"]
    return without_declaration(found)


def without_declaration(found: str) -> str:
    assert found.startswith(DECLARATION)
    return found.removeprefix(DECLARATION).strip()


@pytest.fixture
def own(monkeypatch) -> Iterator[_Renderer]:
    """A renderer for one test, in place of that of this process."""
    renderer = _Renderer()
    monkeypatch.setattr("sinew.tasks.simulate.febio.renderer._renderer", renderer)
    yield renderer
    renderer.close()


def test_one_process_renders_many_rows(own):
    processes = set()
    for value in (1.5, 2.5, -0.0):
        assert text(E=value) == f"<febio_spec><E>{value}</E></febio_spec>"
        processes.add(own._process.pid)
    with pytest.raises(Failed, match="division by zero"):
        text({"a": "<febio_spec>{{ 1 / E }}</febio_spec>"}, E=0)
    assert text(E=3) == "<febio_spec><E>3</E></febio_spec>", "the files of the job before are not used"
    assert processes == {own._process.pid}


def test_nothing_of_a_row_reaches_the_next(own):
    library = "{% set ns = namespace(n=0) %}{% macro count() %}{% set ns.n = ns.n + 1 %}{{ ns.n }}{% endmacro %}"
    files = {"a": "{% from 'b' import count %}<febio_spec>{{ count() }}{{ count() }}</febio_spec>", "b": library}
    assert [text(files) for _ in range(3)] == ["<febio_spec>12</febio_spec>"] * 3


def test_a_process_that_took_much_memory_is_replaced(own):
    text(E=1)
    first = own._process.pid
    large = {"a": "{% set x = 'x' * n %}<febio_spec>{{ x | length }}</febio_spec>"}
    assert text(large, n=700_000_000) == "<febio_spec>700000000</febio_spec>"
    text(E=1)
    assert own._process.pid != first


def test_a_process_that_is_gone_is_replaced(own):
    text(E=1)
    own._process.kill()
    own._process.wait()
    assert text(E=2) == "<febio_spec><E>2</E></febio_spec>"


ENDLESS = {"a": "{% for a in range(99999) %}{% for b in range(99999) %}{% endfor %}{% endfor %}<febio_spec/>"}


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_process_that_a_batch_system_ends_fails_no_row(own, number):
    text(E=1)
    Timer(0.3, own._process.send_signal, [number]).start()
    with pytest.raises(Stopped, match=f"ended by {number.name}"):
        text(ENDLESS)


def test_a_process_that_dies_is_a_crash(own):
    text(E=1)
    Timer(0.3, own._process.send_signal, [signal.SIGSEGV]).start()
    with pytest.raises(Failed, match="rendering a ended by SIGSEGV") as failed:
        text(ENDLESS)
    assert failed.value.status == "crashed"


def test_a_render_that_waits_is_bounded_by_the_clock(own, monkeypatch):
    monkeypatch.setattr("sinew.tasks.simulate.febio.renderer.WALL_S", 0.3)
    with pytest.raises(Failed, match="a: takes more than 10 s of a processor") as failed:
        text(ENDLESS)
    assert failed.value.status == "bad_input"


def test_threads_take_turns(own):
    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(lambda value: text(E=value), range(40)))
    assert found == [f"<febio_spec><E>{value}</E></febio_spec>" for value in range(40)]


def test_a_forked_process_starts_its_own(own):
    text(E=1)
    owner = own._process.pid
    child = os.fork()
    if child == 0:
        os._exit(0 if text(E=5) == "<febio_spec><E>5</E></febio_spec>" and own._process.pid != owner else 1)
    assert os.waitpid(child, 0)[1] == 0
    assert text(E=2) == "<febio_spec><E>2</E></febio_spec>"
    assert own._process.pid == owner


@pytest.mark.parametrize("body", ["{{ " + "9" * 5000 + " }}", "{{ " + "x" * 10**6 + " }}", "{{ " + "(" * 3000])
def test_a_template_that_cannot_be_read_is_bad_input_in_few_words(own, body):
    """Python refuses integers of thousands of digits by an error of its own, which ended the process."""
    text(E=1)
    first = own._process.pid
    with pytest.raises(Failed) as failed:
        render({"a": f"<febio_spec>{body}</febio_spec>"}, "a", [{}], None, known=[])
    assert failed.value.status == "bad_input"
    assert len(failed.value.words) < 500
    assert own._process.pid == first, "the process goes on"


@pytest.mark.parametrize("kind", ["own", "own without outputs", "built-in"])
def test_points_that_are_put_in_afterwards_make_the_same_input(tmp_path, model, kind):
    bar = dogbone(tmp_path)
    template, of = (BUILT_IN, model) if kind == "built-in" else (bar.template, OWN)
    outputs = [asdict(output) for _, output in template.logs] if kind == "own" else None
    times, moved = RELAX.time_s, RELAX.displacement_mm
    variables = template.variables(of, BAR, RELAX, of.reference, times, moved)
    (whole,) = render(template.files, template.main, [variables], outputs)["texts"]
    assert render_input(template.files, template.main, variables, outputs) == whole
    assert str(moved[3]) in whole


def test_a_template_that_does_something_with_the_points_gets_them(own):
    files = {"a": "<febio_spec>{{ displacement_points | replace('1', '2') }}{{ step_points }}</febio_spec>"}
    given = {"displacement_points": "<pt>1,1</pt>", "step_points": "<pt>1</pt>", "E": [0.0] * 10}
    asked = []
    own_ask = own.ask
    own.ask = lambda job, files: asked.append(job) or own_ask(job, files)
    rendered = without_declaration(render_input(files, "a", given, None))
    assert rendered == "<febio_spec><pt>2,2</pt><pt>1</pt></febio_spec>"
    (sent,) = asked[-1]["renders"]
    assert sent.pop("displacement_points") == "<pt>1,1</pt>"
    assert sent.pop("step_points") != "<pt>1</pt>"
    assert not sent, "what it does not use is not sent"
    rendered = render_input({"a": "<febio_spec>{{ E[0] }}</febio_spec>"}, "a", given, None)
    assert without_declaration(rendered) == "<febio_spec>0.0</febio_spec>"


def test_points_that_are_printed_often_are_bounded(own):
    """The process that renders has limits of its own; what is put in afterwards has the same."""
    files = {"a": f"<febio_spec>{'<a>{{ step_points }}</a>' * 100}</febio_spec>"}
    assert len(render_input(files, "a", {"step_points": "<pt>1</pt>" * 10}, None)) > 10_000
    with pytest.raises(Failed, match="renders to 95 MB; expected at most 64 MB"):
        render_input(files, "a", {"step_points": "<pt>1</pt>" * 100_000}, None)


def test_points_are_put_nowhere_else(own):
    text = "<febio_spec><a>@step_points@</a>{{ step_points }}</febio_spec>"
    found = render_input({"a": text}, "a", {"step_points": "<pt>1</pt>"}, None)
    assert without_declaration(found) == "<febio_spec><a>@step_points@</a><pt>1</pt></febio_spec>"
    data = {"a": "<febio_spec><![CDATA[{{ step_points }}]]></febio_spec>"}
    assert (
        render_input(data, "a", {"step_points": "1, 2"}, [])
        == render(data, "a", [{"step_points": "1, 2"}], [])["texts"][0]
    )
    with pytest.raises(Failed, match="<febio_spec> holds '<'"):
        render_input(data, "a", {"step_points": "<pt>1</pt>"}, [])


def test_a_variable_that_is_not_there_is_named(own):
    with pytest.raises(Failed, match="'step_points' is undefined"):
        render_input({"a": "<febio_spec>{{ step_points }}</febio_spec>"}, "a", {}, None)
