"""The adapter of the real solver: fake solvers for every way in which a run can end, and the solver itself."""

import errno
import json
import os
import pickle
import shutil
import struct
import sys
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import defusedxml.ElementTree
import jinja2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from runner.store import STATUSES
from tasks.model import Curve, Model, Protocol, Specimen
from tasks.model.protocols import STANDARD, one_step, two_step
from tasks.problems import BadInput
from tasks.simulate import attempt, febio
from tasks.simulate.attempt import solver_version
from tasks.simulate.febio import FEBio, read_template, render, solver_steps
from tasks.simulate.uniaxial import Uniaxial
from tests.conftest import reference, reference_parameters

BAR = Specimen("bar", 10.0, 8.0, 4.0)
PULL = Protocol("pull", np.linspace(0.0, 2.0, 9), np.linspace(0.0, 0.4, 9))
TEMPLATE = read_template(Path(), None)

FAKE = """#!{python} -IS
import os, re, signal, sys, time

if sys.argv[1:] == ["-info"]:
    print("FEBio version  = 4.77.fake")
    sys.exit(0)
assert sys.argv[1:] == ["-i", "model.feb", "-o", "model.log", "-silent"], sys.argv
assert os.environ["OMP_NUM_THREADS"] == "1"
signal.signal(signal.SIGXFSZ, signal.SIG_DFL)
model = open("model.feb").read()
E_m = float(re.search("<E>(.*?)</E>", model)[1])
points = [tuple(map(float, pair)) for pair in re.findall("<pt>(.*?),(.*?)</pt>", model.split("solver steps")[0])]
NORMAL = " N O R M A L   T E R M I N A T I O N\\n"
ERROR = " E R R O R   T E R M I N A T I O N\\n"
STEP = "===== beginning time step 1 : 0.25 =====\\n"


def log(*parts):
    with open("model.log", "a") as file:
        file.write("".join(parts))


def box(*lines, kind="ERROR"):
    rule = " " + "*" * 73 + "\\n"
    return rule + f" *{{kind:^71}}*\\n" + "".join(f" * {{line:<70}}*\\n" for line in lines) + rule


def reactions(scale=E_m):
    text = ""
    for step, (at, moved) in enumerate(points[1:], 1):
        text += f"*Step  = {{step}}\\n*Time  = {{at:.9g}}\\n*Data  = reaction\\n"
        text += "".join(f"{{node}},{{scale * moved / 4!r}}\\n" for node in (5, 6, 7, 8))
    return text


def write(text):
    with open("reaction.txt", "w") as file:
        file.write(text)


"""

OK = "write(reactions()); log(STEP, NORMAL)"


def solver(folder: Path, play: str = OK) -> FEBio:
    """A simulator whose solver is a script: it gives E_m x displacement as the sum of reactions, unless ``play``."""
    program = folder / "febio4"
    program.write_text(FAKE.format(python=sys.executable) + play + "\n")
    program.chmod(0o755)
    return FEBio(str(program), "fake", TEMPLATE, folder / "attempts", timeout_s=30.0)


def rows_with(model: Model, name: str, *values: float) -> np.ndarray:
    return model.full((name,), np.array(values)[:, np.newaxis])


def attempts(simulator: FEBio) -> list[str]:
    return sorted(path.name for path in simulator.scratch.iterdir()) if simulator.scratch.is_dir() else []


def outcome(simulator: FEBio, model: Model, protocol: Protocol = PULL) -> tuple[str, str]:
    """Status and message of one row."""
    simulated = simulator.simulate(model, BAR, protocol, model.reference[np.newaxis])
    assert np.isnan(simulated.force_N).all() == bool(simulated.status[0])
    return STATUSES[simulated.status[0]], simulated.messages[0]


# ---- how a run ends


def test_the_force_is_twice_the_sum_of_the_reactions(tmp_path, model):
    simulator = solver(tmp_path)
    rows = rows_with(model, "E_m", 11.0, 20.0, 70.0)
    simulated = simulator.simulate(model, BAR, PULL, rows)
    assert not simulated.status.any()
    assert simulated.messages == ("", "", "")
    expected = 2.0 * np.array([[11.0], [20.0], [70.0]]) * PULL.displacement_mm
    assert np.allclose(simulated.force_N, expected, rtol=1e-15)
    assert attempts(simulator) == []


HANG = "import subprocess; subprocess.Popen(['sleep', '1000']); time.sleep(1000)"
BREAK = "log(STEP, box('Negative jacobian was detected at element 1.', 'Gauss point 3'), ERROR); sys.exit(1)"
NO_CONVERGENCE = (
    "log(STEP, box('Max nr of reformations reached.'), 'Max. nr of retries reached.\\n', ERROR); sys.exit(1)"
)
REFUSE = "log(box('Failed initializing material 1'), box('Model initialization failed')); sys.exit(1)"
ENDS = {
    "diverged": (NO_CONVERGENCE, "diverged", ["Max nr of reformations reached."]),
    "diverged after retries": (
        "for n in range(400): log(STEP, 'Retrying time step. ', box('Problem diverged.'))\nlog(ERROR); sys.exit(1)",
        "diverged",
        ["Problem diverged."],
    ),
    "diverged without a word": ("log(STEP, 'residual is 7\\n', ERROR); sys.exit(1)", "diverged", ["residual is 7"]),
    "negative jacobian": (BREAK, "negative_jacobian", ["Negative jacobian was detected at element 1. Gauss point 3"]),
    "exit code": ("log(STEP); sys.exit(3)", "crashed", ["exit code 3"]),
    "exit code and words": ("log(STEP); print('what a pity'); sys.exit(3)", "crashed", ["code 3", "what a pity"]),
    "no library": ("print('libmissing.so: cannot open'); sys.exit(127)", "crashed", ["code 127", "libmissing.so"]),
    "SIGSEGV": ("log(STEP); os.kill(os.getpid(), signal.SIGSEGV)", "crashed", ["ended by SIGSEGV"]),
    "SIGABRT": (
        "print('terminate called', flush=True); os.kill(os.getpid(), signal.SIGABRT)",
        "crashed",
        ["ended by SIGABRT", "terminate called"],
    ),
    "signal without a name": ("os.kill(os.getpid(), 40)", "crashed", ["40"]),
    "end without a word": ("write(reactions()); log(STEP)", "crashed", ["without NORMAL TERMINATION"]),
    "nothing at all": ("", "crashed", ["without NORMAL TERMINATION"]),
    "no reactions": ("log(STEP, NORMAL)", "bad_output", ["no reaction.txt"]),
    "empty reactions": ("write(''); log(NORMAL)", "bad_output", ["0 of 8 steps and 0 reactions"]),
    "half the reactions": (
        "text = reactions(); write(text[:len(text) // 2]); log(NORMAL)",
        "bad_output",
        ["reaction.txt", "of 8 steps"],
    ),
    "a step without its last line": (
        "write(reactions().rpartition('8,')[0]); log(NORMAL)",
        "bad_output",
        ["8 of 8 steps and 31 reactions"],
    ),
    "a number cut in two": ("write(reactions()[:-3]); log(NORMAL)", "bad_output", ["reaction.txt"]),
    "a node cut in two": ("write(reactions().rpartition(',')[0]); log(NORMAL)", "bad_output", ["reaction.txt"]),
    "steps without reactions": (
        "write(''.join(line + '\\n' for line in reactions().splitlines() if line[0] == '*')); log(NORMAL)",
        "bad_output",
        ["8 of 8 steps and 0 reactions"],
    ),
    "reactions of one step among another's": (
        "lines = reactions().splitlines(True); lines.insert(3, lines.pop(10)); write(''.join(lines)); log(NORMAL)",
        "bad_output",
        ["reaction.txt"],
    ),
    "words for numbers": ("write(reactions().replace('8,', '8,about ')); log(NORMAL)", "bad_output", ["about"]),
    "garbage": ("write('lorem ipsum\\n' * 50); log(NORMAL)", "bad_output", ["lorem ipsum"]),
    "binary garbage": (
        "open('reaction.txt', 'wb').write(bytes(range(256)) * 9); log(NORMAL)",
        "bad_output",
        ["not text"],
    ),
    "NaN": ("write(reactions(float('nan'))); log(NORMAL)", "bad_output", ["not finite"]),
    "one NaN": (
        "write(reactions().rpartition('8,')[0] + '8,-nan\\n'); log(NORMAL)",
        "bad_output",
        ["not finite"],
    ),
    "infinite": ("write(reactions(float('inf'))); log(NORMAL)", "bad_output", ["not finite"]),
    "infinities that cancel": (
        "write(reactions().rpartition('7,')[0] + '7,inf\\n8,-inf\\n'); log(NORMAL)",
        "bad_output",
        ["not finite"],
    ),
    "a sum that overflows": (
        "write(reactions().rpartition('7,')[0] + '7,1e308\\n8,1e308\\n'); log(NORMAL)",
        "bad_output",
        ["not finite"],
    ),
    "late": (
        "write(reactions().replace('*Time  = 0.5\\n', '*Time  = 0.51\\n')); log(NORMAL)",
        "bad_output",
        ["step 2 is at 0.51 s, not at 0.5 s"],
    ),
    "times that are no numbers": (
        "write(reactions().replace('*Time  = 0.5\\n', '*Time  = nan\\n')); log(NORMAL)",
        "bad_output",
        ["step 2"],
    ),
    "a step too many": (
        "write(reactions() + reactions()[-90:]); log(NORMAL)",
        "bad_output",
        ["reaction.txt"],
    ),
    "bad_alloc": (
        "log(STEP, \"terminate called after throwing an instance of 'std::bad_alloc'\\n\"); os.abort()",
        "out_of_memory",
        ["bad_alloc"],
    ),
    "no memory": (
        "log(STEP, box('Memory allocation failure in the linear solver'), ERROR); sys.exit(1)",
        "out_of_memory",
        ["Memory allocation failure"],
    ),
    "refused": (REFUSE, "bad_input", ["Failed initializing material 1; Model initialization failed"]),
    "refused before the first step": (
        "log(box('Invalid value for parameter E'), ERROR); sys.exit(1)",
        "bad_input",
        ["Invalid value for parameter E"],
    ),
}


@pytest.mark.parametrize("name", ENDS)
def test_a_failed_run_has_a_status_and_the_solvers_words(tmp_path, model, name):
    play, status, words = ENDS[name]
    simulator = solver(tmp_path, play)
    found, message = outcome(simulator, model)
    assert found == status
    for word in words:
        assert word in message
    (kept,) = attempts(simulator)
    assert kept.startswith(f"failed-{status}-")
    told = json.loads((simulator.scratch / kept / "failure.json").read_text())
    assert (told["status"], told["message"]) == (status, message)
    assert "\n" not in message


def test_silent_refusal_of_the_input_is_bad_input(tmp_path, model):
    """What febio4 4.11 does when it cannot read its input: with -silent it says nothing and opens no log."""
    simulator = solver(tmp_path, "print('Reading configuration file: /opt/febio/bin/febio.xml'); sys.exit(1)")
    assert outcome(simulator, model)[0] == "bad_input"


def test_a_run_that_hangs_is_a_timeout(tmp_path, model):
    simulator = replace(solver(tmp_path, f"log('half way\\n')\n{HANG}"), timeout_s=0.5)
    status, message = outcome(simulator, model)
    assert status == "timeout"
    assert message.startswith("no end after 0.5 s. half way")


def test_a_run_that_says_it_failed_but_then_hangs_is_a_timeout(tmp_path, model):
    simulator = replace(
        solver(tmp_path, f"log(STEP, box('Negative jacobian detected.'), ERROR)\n{HANG}"), timeout_s=0.5
    )
    status, message = outcome(simulator, model)
    assert status == "timeout"
    assert "Negative jacobian detected." in message


@pytest.mark.parametrize("file", ["reaction.txt", "model.log", "solver-output.txt"])
def test_a_file_that_is_too_large_is_bad_output(tmp_path, model, file):
    play = f"with open({file!r}, 'a') as file:\n    for _ in range(9000): file.write('x' * 999 + '\\n')\n{OK}"
    simulator = replace(solver(tmp_path, play), max_file_bytes=1_000_000)
    status, message = outcome(simulator, model)
    assert status == "bad_output"
    assert "larger than max_file_mb" in message
    (kept,) = simulator.scratch.iterdir()
    assert max(path.stat().st_size for path in kept.iterdir()) <= 1_000_000


def test_every_status_has_been_tried():
    tried = {status for _, status, _ in ENDS.values()} | {"ok", "timeout"}
    assert tried == set(STATUSES)


def test_impossible_parameters_never_start_the_solver(tmp_path, model):
    simulator = solver(tmp_path, f"open({str(tmp_path / 'started')!r}, 'w')\n{OK}")
    rows = np.concatenate([rows_with(model, "tau_2f", 0.0, -1.0), rows_with(model, "nu_m", 0.5)])
    rows = np.concatenate([rows, rows_with(model, "E_f", np.nan, np.inf)])
    simulated = simulator.simulate(model, BAR, PULL, rows)
    assert [STATUSES[s] for s in simulated.status] == ["bad_input"] * 5
    assert "tau_2f = 0; expected above 0 s" in simulated.messages[0]
    assert "nu_m = 0.5" in simulated.messages[2]
    assert np.isnan(simulated.force_N).all()
    assert not (tmp_path / "started").exists()
    assert attempts(simulator) == []


def test_a_failed_row_does_not_touch_its_neighbours(tmp_path, model):
    play = f"if E_m == 20:\n    {BREAK}\nif E_m == 30:\n    os.kill(os.getpid(), signal.SIGSEGV)\n{OK}"
    simulator = solver(tmp_path, play)
    rows = np.concatenate([rows_with(model, "E_m", 12.0, 20.0, 13.0, 30.0, 14.0), rows_with(model, "tau_1m", 0.0)])
    rows = np.concatenate([rows, rows_with(model, "E_m", 15.0)])
    simulated = simulator.simulate(model, BAR, PULL, rows)
    names = ["ok", "negative_jacobian", "ok", "crashed", "ok", "bad_input", "ok"]
    assert [STATUSES[s] for s in simulated.status] == names
    good = simulated.status == 0
    alone = solver(tmp_path).simulate(model, BAR, PULL, rows[good])
    assert simulated.force_N[good].tobytes() == alone.force_N.tobytes()
    assert np.isnan(simulated.force_N[~good]).all()
    assert [bool(message) for message in simulated.messages] == (~good).tolist()


def test_a_template_that_cannot_be_rendered_for_a_row_fails_that_row_only(tmp_path, model):
    template = TEMPLATE.replace("<febio_spec", "<!-- {{ 1 / parameters.alpha_f }} --><febio_spec", 1)
    simulator = replace(solver(tmp_path), template=template)
    simulated = simulator.simulate(model, BAR, PULL, rows_with(model, "alpha_f", 1.0, 0.0, 2.0))
    assert [STATUSES[s] for s in simulated.status] == ["ok", "bad_input", "ok"]
    assert "division by zero" in simulated.messages[1]
    assert not [name for name in attempts(simulator) if name.startswith("attempt-")]


# ---- what stays on the disk


@pytest.mark.parametrize("keep_failed", [0, 1, 3])
def test_failed_attempts_are_kept_up_to_a_number(tmp_path, model, keep_failed):
    simulator = replace(solver(tmp_path, f"if E_m < 50:\n    {BREAK}\n{OK}"), keep_failed=keep_failed)
    rows = rows_with(model, "E_m", 60.0, 11.0, 61.0, 12.0, 13.0, 14.0)
    simulated = simulator.simulate(model, BAR, PULL, rows)
    assert (simulated.status > 0).sum() == 4
    kept = attempts(simulator)
    assert len(kept) == keep_failed
    for name in kept:
        files = {path.name for path in (simulator.scratch / name).iterdir()}
        assert files == {"model.feb", "model.log", "solver-output.txt", "failure.json"}
    simulator.simulate(model, BAR, PULL, rows)
    assert attempts(simulator) == kept


def test_a_long_message_is_cut(tmp_path, model):
    lines = ", ".join(repr(f"line {n} of a long complaint that a solver makes") for n in range(30))
    simulator = solver(tmp_path, f"log(STEP, box({lines}), ERROR); sys.exit(1)")
    status, message = outcome(simulator, model)
    assert status == "diverged"
    assert message.startswith("line 0 of a long complaint")
    assert len(message) == 500


def full_disk(monkeypatch) -> None:
    nothing = shutil.disk_usage(Path.cwd())._replace(free=0)
    monkeypatch.setattr(attempt.shutil, "disk_usage", lambda path: nothing)


@pytest.mark.parametrize("name", ["half the reactions", "diverged", "end without a word", "SIGSEGV"])
def test_a_full_disk_fails_no_row(tmp_path, model, monkeypatch, name):
    full_disk(monkeypatch)
    simulator = solver(tmp_path, ENDS[name][0])
    with pytest.raises(OSError, match="No space left") as caught:
        simulator.simulate(model, BAR, PULL, model.reference[np.newaxis])
    assert caught.value.errno == errno.ENOSPC
    assert attempts(simulator) == [], "they take room on a disk that is full"


def test_a_full_disk_does_not_matter_to_a_row_that_succeeds(tmp_path, model, monkeypatch):
    full_disk(monkeypatch)
    assert outcome(solver(tmp_path), model) == ("ok", "")


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EDQUOT, errno.EIO])
def test_input_that_cannot_be_written_fails_no_row(tmp_path, model, monkeypatch, number):
    write_text = Path.write_text

    def refuse(path: Path, *arguments, **options):
        if path.name == "model.feb":
            raise OSError(number, os.strerror(number), str(path))
        return write_text(path, *arguments, **options)

    simulator = solver(tmp_path)
    monkeypatch.setattr(Path, "write_text", refuse)
    with pytest.raises(OSError) as caught:
        simulator.simulate(model, BAR, PULL, model.reference[np.newaxis])
    assert caught.value.errno == number
    assert attempts(simulator) == []


def test_a_solver_that_has_gone_fails_no_row(tmp_path, model):
    simulator = replace(solver(tmp_path), executable=str(tmp_path / "gone"))
    with pytest.raises(FileNotFoundError):
        simulator.simulate(model, BAR, PULL, model.reference[np.newaxis])
    assert attempts(simulator) == []


# ---- as a simulator


def test_comparison_is_the_rmse_over_every_point(tmp_path, model):
    simulator = solver(tmp_path, f"if E_m == 20:\n    {BREAK}\n{OK}")
    measured = 30.0 * PULL.displacement_mm + np.cos(PULL.time_s)
    rows = rows_with(model, "E_m", 15.0, 20.0, 30.0)
    compared = simulator.compare(model, BAR, Curve(PULL, measured), rows, np.array([0, 5]))
    force = 2.0 * np.array([[15.0], [np.nan], [30.0]]) * PULL.displacement_mm
    assert np.allclose(compared.rmse_N, np.sqrt(np.mean((force - measured) ** 2, axis=1)), equal_nan=True)
    assert np.allclose(compared.force_N, force[:, [0, 5]], equal_nan=True)
    assert [STATUSES[s] for s in compared.status] == ["ok", "negative_jacobian", "ok"]
    assert compared.messages[0] == ""
    assert "Negative jacobian" in compared.messages[1]


def test_it_can_be_sent_to_a_worker(tmp_path, model):
    simulator = solver(tmp_path)
    assert pickle.loads(pickle.dumps(simulator)) == simulator
    assert outcome(pickle.loads(pickle.dumps(simulator)), model) == ("ok", "")


def test_stresses_are_not_offered(tmp_path, model):
    with pytest.raises(BadInput, match="stresses"):
        solver(tmp_path).simulate(model, BAR, PULL, model.reference[np.newaxis], stresses=True)


def test_identity_follows_what_an_outcome_depends_on(tmp_path):
    simulator = solver(tmp_path)
    others = [
        replace(simulator, version="4.0"),
        replace(simulator, template=TEMPLATE + "\n"),
        replace(simulator, ramp_s=0.1),
        replace(simulator, hold_growth=0.0),
        replace(simulator, still_mm=0.001),
    ]
    identities = [str(one.identity()) for one in (simulator, *others)]
    assert len(set(identities)) == len(identities)
    same = replace(simulator, timeout_s=1.0, max_file_bytes=10, keep_failed=0, scratch=tmp_path, executable="x")
    assert same.identity() == simulator.identity()


def test_version(tmp_path):
    solver(tmp_path)
    assert solver_version(tmp_path / "febio4") == "4.77.fake"


def test_version_of_a_solver_that_does_not_say(tmp_path):
    program = tmp_path / "febio4"
    versions = set()
    for text in ("echo hello", "exit 3", "kill -SEGV $$"):
        program.write_text(f"#!/bin/sh\n{text}\n")
        program.chmod(0o755)
        versions.add(solver_version(program))
    assert len(versions) == 3
    assert all(version.startswith("unknown-") for version in versions)


def test_version_of_what_cannot_run(tmp_path):
    (tmp_path / "text").write_text("no program")
    for path in (tmp_path / "nothing", tmp_path / "text"):
        with pytest.raises(BadInput, match=f"{path.name}: cannot be run"):
            solver_version(path)


# ---- input


def bits(numbers) -> list[bytes]:
    return [struct.pack("<d", float(number)) for number in numbers]


finite = st.floats(allow_nan=False, allow_infinity=False)
positive = st.floats(min_value=0.0, exclude_min=True, allow_nan=False, allow_infinity=False)


@settings(max_examples=100, deadline=None)
@given(
    st.lists(finite, min_size=16, max_size=16),
    st.tuples(positive, positive, positive),
    st.lists(st.tuples(st.floats(-1e300, 1e300), finite), min_size=2, max_size=6),
    st.tuples(positive, positive),
)
def test_numbers_of_the_input_read_back_to_the_same_bits(values, sizes, history, constants):
    model = Model(beta=constants[0], lambda_0=constants[1])
    specimen = Specimen("any", *sizes)
    times, displacements = np.array(history).T
    root = defusedxml.ElementTree.fromstring(render(TEMPLATE, model, specimen, times, displacements, np.array(values)))
    matrix, fibre = root.iterfind("./Material/material/solid")
    read = {}
    for solid, letter in ((matrix, "m"), (fibre, "f")):
        read |= {f"g_{n}{letter}": solid.findtext(f"g{n}") for n in (1, 2, 3)}
        read |= {f"tau_{n}{letter}": solid.findtext(f"t{n}") for n in (1, 2, 3)}
        read[f"E_{letter}"] = solid.findtext("elastic/E")
    read |= {"nu_m": matrix.findtext("elastic/v"), "alpha_f": fibre.findtext("elastic/alpha")}
    assert bits(read[name] for name in model.names) == bits(values)
    assert bits([fibre.findtext("elastic/beta"), fibre.findtext("elastic/lam0")]) == bits(constants)
    moved, stops = ([pt.text.split(",") for pt in lc.iter("pt")] for lc in root.iterfind("./LoadData/load_controller"))
    assert bits(at for at, _ in moved) == bits(at for at, _ in stops) == bits(times)
    assert bits(moved for _, moved in moved) == bits(displacements)
    assert bits([root.findtext("Control/final_time")]) == bits(times[-1:])
    assert bits([root.findtext("Control/step_size")]) == bits([times[1] - times[0]])
    nodes = np.array([[float(word) for word in node.text.split(",")] for node in root.iterfind("Mesh/Nodes/node")])
    corner = [specimen.width_mm / 2, specimen.thickness_mm, specimen.length_mm]
    assert bits(nodes.max(axis=0)) == bits(corner)
    assert set(nodes.ravel().tolist()) == {0.0, *corner}


def test_unknown_variables_are_errors(model):
    for text in (
        "{{ parameters.nonsense }}",
        "{{ nonsense }}",
        "{% if nonsense %}{% endif %}",
        "{{ constants['no'] }}",
    ):
        with pytest.raises(jinja2.UndefinedError):
            render(text, model, BAR, PULL.time_s, PULL.displacement_mm, model.reference)


def template(folder: Path, text: str) -> str:
    (folder / "input.feb.j2").write_text(text)
    return "input.feb.j2"


def inside(text: str) -> str:
    return f"<febio_spec>{text}</febio_spec>"


@pytest.mark.parametrize(
    "trick",
    [
        "{{ ''.__class__.__mro__ }}",
        "{{ parameters.__class__.__base__.__subclasses__() }}",
        "{{ ''['__class__'] }}",
        "{{ '' | attr('__class__') }}",
        "{{ '{0.__class__}'.format(1) }}",
        "{{ '{0.__class__}' | format }}{{ ''.format.__self__ }}",
        "{{ self.__init__.__globals__ }}",
        "{{ cycler.__init__.__globals__.os.popen('id').read() }}",
        "{{ lipsum.__globals__['os'].popen('id').read() }}",
        "{{ namespace.__init__.__globals__ }}",
        "{% include '/etc/passwd' %}",
        "{% import '/etc/passwd' as x %}",
        "{% extends '/etc/passwd' %}",
        "{% for n in range(10**9) %}x{% endfor %}",
    ],
)
def test_templates_cannot_leave_their_sandbox(tmp_path, trick):
    with pytest.raises(BadInput, match="cannot be rendered"):
        read_template(tmp_path, template(tmp_path, inside(trick)))


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        (inside("{{ parameters.nonsense | full }}"), "nonsense"),
        (inside("{{ nonsense }}"), "nonsense"),
        (inside("\n\n{{ 1 + }}"), "line 3"),
        (inside("{% if %}"), "line 1"),
        (inside("{{ 1 | nonsense }}"), "nonsense"),
        (inside("{{ 'word' | full }}"), "'word'"),
        (inside("{{ true | full }}"), "True"),
        (inside("{{ 1 / 0 }}"), "cannot be rendered"),
        (inside("{{ [].pop() }}"), "cannot be rendered"),
        (inside("{% macro again() %}{{ again() }}{% endmacro %}{{ again() }}"), "cannot be rendered"),
        ("", "no XML"),
        ("no XML", "no XML"),
        ("<febio_spec>", "no XML"),
        ("<febio_spec/><febio_spec/>", "no XML"),
        (inside("\x0c"), "no XML"),
        ("<other/>", "<other>"),
        ('<!DOCTYPE x [<!ENTITY a "aaaa">]>' + inside("&a;"), "no XML"),
        ('<!DOCTYPE x [<!ENTITY a SYSTEM "file:///etc/passwd">]>' + inside("&a;"), "no XML"),
    ],
)
def test_templates_are_checked_before_they_are_used(tmp_path, text, problem):
    with pytest.raises(BadInput) as caught:
        read_template(tmp_path, template(tmp_path, text))
    message = str(caught.value)
    assert "input.feb.j2" in message
    assert problem in message
    assert "\n" not in message


@pytest.mark.parametrize("name", ["/etc/passwd", "../reaction.txt", "folder/reaction.txt", "..", ".", "", "folder/"])
@pytest.mark.parametrize("attribute", ["file", "from"])
def test_files_outside_the_attempt_are_refused(tmp_path, name, attribute):
    text = TEMPLATE.replace('file="reaction.txt"', f'{attribute}="{name}"')
    with pytest.raises(BadInput, match="a file name without a folder"):
        read_template(tmp_path, template(tmp_path, text))


@pytest.mark.parametrize("element", ["<Include>/tmp/other.feb</Include>", "<Include> ../../other.feb </Include>"])
def test_including_files_outside_the_attempt_is_refused(tmp_path, element):
    """febio4 reads an included file wherever it is, and writes what that file's own file= attributes name."""
    with pytest.raises(BadInput):
        read_template(tmp_path, template(tmp_path, TEMPLATE.replace("<Output>", f"{element}<Output>")))


def test_files_outside_the_attempt_are_refused_for_every_row(tmp_path, model):
    """A template can name another file for some parameters only."""
    elsewhere = "{% if parameters.E_m < 12 %}/tmp/{% endif %}reaction.txt"
    text = TEMPLATE.replace('file="reaction.txt"', f'file="{elsewhere}"')
    simulator = replace(solver(tmp_path), template=read_template(tmp_path, template(tmp_path, text)))
    simulated = simulator.simulate(model, BAR, PULL, rows_with(model, "E_m", 11.0, 13.0))
    assert [STATUSES[s] for s in simulated.status] == ["bad_input", "ok"]


def test_a_template_stays_inside_the_studys_folder(tmp_path):
    folder = tmp_path / "study"
    folder.mkdir()
    (tmp_path / "outside.j2").write_text(TEMPLATE)
    (folder / "link.j2").symlink_to(tmp_path / "outside.j2")
    for name in ("../outside.j2", str(tmp_path / "outside.j2"), "link.j2"):
        with pytest.raises(BadInput, match="outside"):
            read_template(folder, name)


def test_a_template_that_cannot_be_read(tmp_path, monkeypatch):
    (tmp_path / "binary").write_bytes(bytes(range(256)))
    (tmp_path / "folder").mkdir()
    for name, problem in (("nothing", "not there"), ("folder", "not there"), ("binary", "not a text file")):
        with pytest.raises(BadInput, match=f"{name}: (is )?{problem}"):
            read_template(tmp_path, name)
    monkeypatch.setattr(febio, "MAX_TEMPLATE_BYTES", 2**20)
    with pytest.raises(BadInput, match="5 MB"):
        read_template(tmp_path, template(tmp_path, " " * 5 * 2**20))


def test_a_template_of_ones_own(tmp_path):
    text = TEMPLATE.replace("tendon", "tissue")
    assert read_template(tmp_path, template(tmp_path, text)) == text


# ---- stepping

RATES = (1.0, 10.0, 100.0)


@st.composite
def histories(draw) -> Protocol:
    """Ramps and holds of random lengths, at even or uneven times."""
    parts = draw(
        st.lists(st.tuples(st.integers(1, 150), st.sampled_from([0.0, 0.0, 0.01, -0.01, 0.03])), min_size=1, max_size=8)
    )
    moves = np.concatenate([np.full(rows, move) for rows, move in parts])
    steps = np.full(moves.size, 1.0 / draw(st.sampled_from(RATES)))
    if draw(st.booleans()):
        steps *= np.random.default_rng(draw(st.integers(0, 99))).uniform(0.3, 3.0, moves.size)
    start, displaced = draw(st.sampled_from([0.0, 7.3])), draw(st.sampled_from([0.0, 0.2]))
    time_s = np.concatenate([[start], start + np.cumsum(steps)])
    return Protocol("any", time_s, np.concatenate([[displaced], displaced + np.cumsum(moves)]))


ramps = st.one_of(st.just(0.0), st.floats(0.01, 5.0))
growths = st.one_of(st.just(0.0), st.floats(0.005, 0.5))


@settings(max_examples=150, deadline=None)
@given(histories(), ramps, growths)
def test_the_solver_stops_where_it_must(history, ramp_s, growth):
    time_s, u = history.time_s, history.displacement_mm
    rows = solver_steps(history, ramp_s, growth, 0.0)
    assert (rows[0], rows[-1]) == (0, u.size - 1)
    assert (np.diff(rows) > 0).all()
    stops = set(rows.tolist())
    for row in range(1, u.size - 1):
        before, after = u[row] - u[row - 1], u[row + 1] - u[row]
        if before * after < 0 or (before == 0) != (after == 0):
            assert row in stops, "a corner of the history"
    for first, last in pairwise(rows):
        if last == first + 1:
            continue
        step = time_s[last] - time_s[first]
        if np.ptp(u[first : last + 1]) == 0:
            begin = first
            while begin and u[begin - 1] == u[first]:
                begin -= 1
            assert step <= growth * (time_s[first] - time_s[begin]) * (1 + 1e-6)
        else:
            assert step <= ramp_s * (1 + 1e-6)


@settings(max_examples=150, deadline=None)
@given(histories(), ramps, growths, st.floats(0.001, 0.1), st.integers(0, 99))
def test_the_solver_passes_over_nothing_that_matters_in_a_noisy_history(history, ramp_s, growth, still_mm, seed):
    noise = np.random.default_rng(seed).uniform(-0.45, 0.45, history.time_s.size) * still_mm
    noisy = Protocol("noisy", history.time_s, history.displacement_mm + noise)
    u = noisy.displacement_mm
    rows = solver_steps(noisy, ramp_s, growth, still_mm)
    assert (rows[0], rows[-1]) == (0, u.size - 1)
    assert (np.diff(rows) > 0).all()
    for first, last in pairwise(rows):
        moves = np.diff(u[first : last + 1])
        assert (moves > 0).all() or (moves < 0).all() or np.ptp(u[first : last + 1]) <= 2 * still_mm


@settings(max_examples=50, deadline=None)
@given(histories(), st.floats(0.0, 0.1))
def test_without_limits_the_solver_stops_at_every_row(history, still_mm):
    assert np.array_equal(solver_steps(history, 0.0, 0.0, still_mm), np.arange(history.time_s.size))


def test_a_hold_is_thinned_as_much_as_its_growth_allows():
    history = one_step(10.0, 100.0)
    hold = int(np.argmax(history.displacement_mm))
    sizes = []
    for growth in (0.005, 0.02, 0.1, 0.5):
        rows = solver_steps(history, 0.0, growth, 0.0)
        assert set(range(hold + 2)) <= set(rows.tolist()), "the ramp stays whole"
        sizes.append(rows.size - hold)
    assert sizes == sorted(sizes, reverse=True)
    assert sizes[1] < 500 < sizes[0] < 2500
    assert sizes[3] < 60


def test_a_ramp_is_thinned_to_its_longest_step():
    history = one_step(10.0, 100.0)
    rows = solver_steps(history, 0.1, 0.0, 0.0)
    hold = int(np.argmax(history.displacement_mm))
    assert np.allclose(np.diff(history.time_s[rows[rows < hold]]), 0.1)
    assert set(range(hold, history.time_s.size)) <= set(rows.tolist())


@settings(max_examples=40, deadline=None)
@given(
    st.lists(
        st.tuples(st.floats(0.0, 1.0), st.one_of(st.floats(0.1, 2.0), st.floats(2.0, 20.0), st.floats(20.0, 200.0))),
        min_size=1,
        max_size=6,
    ),
    st.floats(0.0, 2.0),
    st.sampled_from([one_step, two_step]),
    st.sampled_from([10.0, 100.0]),
)
def test_a_relaxation_is_reproduced_between_the_solvers_steps(terms, rest, make, rate_hz):
    """A sum of exponentials in each hold, as the model relaxes, from a smooth ramp."""
    history = make(10.0, rate_hz)
    time_s, u = history.time_s, history.displacement_mm
    moving = np.concatenate([[True], np.diff(u) != 0])
    last_moved = np.maximum.accumulate(np.where(moving, np.arange(u.size), 0))
    since = time_s - time_s[last_moved]
    force = u * (rest + 0.01 + sum(strength * np.exp(-since / tau) for strength, tau in terms))
    rows = solver_steps(history, 0.0, 0.02, 0.0)
    assert rows.size < u.size
    full = febio.at_every_row(history, rows, force[rows], 0.0)
    assert full[rows].tobytes() == force[rows].tobytes()
    assert np.abs(full - force).max() <= 1e-6 * force.max()


@settings(max_examples=100, deadline=None)
@given(histories(), ramps, growths, st.integers(0, 99))
def test_between_steps_the_force_keeps_what_the_solver_said(history, ramp_s, growth, seed):
    rows = solver_steps(history, ramp_s, growth, 0.0)
    force = np.random.default_rng(seed).normal(size=rows.size)
    full = febio.at_every_row(history, rows, force, 0.0)
    assert full.shape == history.time_s.shape
    assert np.isfinite(full).all()
    assert full[rows].tobytes() == force.tobytes()
    for place, (first, last) in enumerate(pairwise(rows)):
        if np.ptp(history.displacement_mm[first : last + 1]):
            low, high = sorted(force[place : place + 2])
            assert (full[first : last + 1] >= low - 1e-9).all(), "monotone in motion"
            assert (full[first : last + 1] <= high + 1e-9).all(), "monotone in motion"


def test_thinned_steps_give_a_force_at_every_row(tmp_path, model):
    time_s = np.linspace(0.0, 20.0, 401)
    history = Protocol("ramp and hold", time_s, 0.1 * np.minimum(time_s, 4.0))
    steps = solver_steps(history, 0.2, 0.02, 0.0).size
    assert steps < 200
    simulator = replace(solver(tmp_path, f"assert len(points) == {steps}\n{OK}"), ramp_s=0.2)
    simulated = simulator.simulate(model, BAR, history, rows_with(model, "E_m", 20.0))
    assert simulated.messages == ("",)
    assert np.allclose(simulated.force_N[0], 40.0 * history.displacement_mm, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("start", [0.0, 3.5])
@pytest.mark.parametrize("ramp_s", [0.0, 1.0])
def test_a_history_that_starts_displaced_is_relaxed_first(tmp_path, model, start, ramp_s):
    time_s = start + np.linspace(0.0, 4.0, 17)
    history = Protocol("displaced", time_s, 0.3 + 0.05 * (time_s - start))
    seen = tmp_path / "seen.json"
    simulator = replace(
        solver(tmp_path, f"import json; json.dump(points, open({str(seen)!r}, 'w'))\n{OK}"), ramp_s=ramp_s
    )
    rows = rows_with(model, "E_m", 20.0)
    rows[0, model.names.index("tau_3m")] = 150.0
    simulated = simulator.simulate(model, BAR, history, rows)
    assert simulated.messages == ("",)
    assert np.allclose(simulated.force_N[0], 40.0 * history.displacement_mm, rtol=1e-12)
    times, displacements = np.array(json.loads(seen.read_text())).T
    assert times[:2].tolist() == [0.0, 1.0]
    assert displacements[:3].tolist() == [0.0, 0.3, 0.3]
    assert times[2] >= 20 * 150.0, "long enough for all to relax"
    expected = solver_steps(history, ramp_s, 0.02, 0.0)
    assert np.allclose(times[2:] - times[2], history.time_s[expected] - start, rtol=0, atol=1e-9)
    assert displacements[2:].tolist() == history.displacement_mm[expected].tolist()


def test_a_history_that_starts_late_starts_at_zero(tmp_path, model):
    late = Protocol("late", PULL.time_s + 100.0, PULL.displacement_mm)
    simulated = solver(tmp_path).simulate(model, BAR, late, rows_with(model, "E_m", 20.0))
    assert np.allclose(simulated.force_N[0], 40.0 * PULL.displacement_mm, rtol=1e-12)


# ---- the real solver


@pytest.fixture
def real(tmp_path) -> FEBio:
    program = shutil.which("febio4")
    assert program is not None
    return FEBio(program, "real", TEMPLATE, tmp_path / "attempts", timeout_s=120.0)


def largest_error(force: np.ndarray, expected: np.ndarray) -> float:
    """The largest error of any row, as a fraction of the row's peak."""
    return float((np.abs(force - expected).max(axis=1) / np.abs(expected).max(axis=1)).max())


@pytest.mark.febio
@pytest.mark.parametrize("protocol", ["one_step", "two_step", "cyclic"])
def test_real_solver_matches_the_reference(real, model, protocol):
    history, expected = reference(protocol)
    simulated = real.simulate(model, BAR, history, reference_parameters(model))
    assert simulated.messages == ("",) * 40
    assert largest_error(simulated.force_N, expected) < 1e-6
    assert attempts(real) == []


@pytest.mark.febio
@pytest.mark.parametrize("make", STANDARD[:2])
def test_real_and_embedded_solver_are_equal_at_full_rate(real, model, make):
    history = make(10.0, 100.0)
    rows = reference_parameters(model)[:4]
    simulated = real.simulate(model, BAR, history, rows)
    assert simulated.messages == ("",) * 4
    assert largest_error(simulated.force_N, Uniaxial().simulate(model, BAR, history, rows).force_N) < 1e-7


@pytest.mark.febio
@pytest.mark.parametrize("start_mm", [0.3, 0.05, -0.2])
def test_real_and_embedded_solver_start_displaced_alike(real, model, start_mm):
    time_s = 2.0 + np.arange(2001) / 100.0
    history = Protocol("displaced", time_s, start_mm + 0.1 * np.sin(time_s - 2.0))
    rows = reference_parameters(model)[:4]
    simulated = real.simulate(model, BAR, history, rows)
    assert simulated.messages == ("",) * 4
    assert largest_error(simulated.force_N, Uniaxial().simulate(model, BAR, history, rows).force_N) < 1e-6


@pytest.mark.febio
@pytest.mark.parametrize("last_mm", [-10.5, -12.0])
def test_real_solver_turned_inside_out_has_a_negative_jacobian(real, model, last_mm):
    history = Protocol("crushed", np.array([0.0, 0.1, 0.2]), np.array([0.0, last_mm / 2, last_mm]))
    status, message = outcome(real, model, history)
    assert status == "negative_jacobian"
    assert message.startswith("Negative jacobian")


@pytest.mark.febio
def test_real_solver_crushed_almost_to_nothing(real, model):
    history = Protocol("crushed", np.array([0.0, 0.1, 0.2]), np.array([0.0, -4.95, -9.9]))
    assert outcome(real, model, history) == ("ok", "")


@pytest.mark.febio
def test_real_solver_without_iterations_diverges(real, model):
    simulator = replace(real, template=TEMPLATE.replace("<max_refs>25", "<max_refs>1"))
    status, message = outcome(simulator, model)
    assert status == "diverged"
    assert "Max nr of reformations reached" in message


@pytest.mark.febio
@pytest.mark.parametrize(
    ("right", "wrong", "word"),
    [
        ("{{ parameters.E_m | full }}", "-1", "Failed initializing material"),
        ("{{ parameters.nu_m | full }}", "0.7", "Failed initializing material"),
        ('type="solid mixture"', 'type="unobtainium"', "material"),
        ('node_set="top"', 'node_set="nowhere"', "node_set"),
        ("<Control>", "<Control><nonsense>1</nonsense>", "nonsense"),
        ("<max_refs>25", "<max_refs>many", "max_refs"),
    ],
)
def test_real_solver_refuses_broken_input(real, model, right, wrong, word):
    assert right in TEMPLATE
    status, message = outcome(replace(real, template=TEMPLATE.replace(right, wrong)), model)
    assert status == "bad_input"
    assert word in message


@pytest.mark.febio
def test_real_solver_ends_at_the_timeout(real, model):
    simulator = replace(real, timeout_s=0.05, hold_growth=0.0)
    status, message = outcome(simulator, model, one_step(10.0, 100.0))
    assert status == "timeout"
    assert message.startswith("no end after 0.05 s")


@pytest.mark.febio
def test_real_solver_ends_at_its_file_limit(real, model):
    simulator = replace(real, max_file_bytes=100_000)
    status, message = outcome(simulator, model, one_step(10.0, 100.0))
    assert status == "bad_output"
    assert "larger than max_file_mb" in message


@pytest.mark.febio
def test_real_solver_says_its_version():
    program = shutil.which("febio4")
    assert program is not None
    assert solver_version(Path(program)).startswith("4.")
