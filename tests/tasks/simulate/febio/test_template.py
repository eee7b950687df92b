"""Validation of a user's own template."""

import io
import json
import sys
from types import SimpleNamespace

import pytest

from sinew.runner.errors import BadInput
from sinew.tasks.model import Model
from sinew.tasks.simulate.febio import renderer
from sinew.tasks.simulate.febio.files import read_files
from sinew.tasks.simulate.febio.renderer import Allowance, included
from sinew.tasks.simulate.febio.rendering import program
from sinew.tasks.simulate.febio.template import check_template
from sinew.tasks.simulate.row_by_row import Failed
from tests.tasks.simulate.febio.dogbone import DOGBONE, OWN, dogbone


def check_dogbone(tmp_path, text: str, model: Model = OWN) -> None:
    check_template(tmp_path / "study.yaml", dogbone(tmp_path, text).template, model, sized=True, moved=True)


def test_the_dogbone_is_valid(tmp_path):
    check_dogbone(tmp_path, DOGBONE.read_text())


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("{{ nu }}", "0.3", "model.parameters.nu: not used in model.feb.j2; expected {{ nu }} where it acts"),
        ("{{ nu }}", "{{ 0 * nu + 0.3 }}", "model.parameters.nu: model.feb.j2 renders to the same input at both ends"),
        ("{{ nu }}", "0.3<!-- {{ nu }} -->", "renders to the same input at both ends"),
        ("{{ nu }}", "{{ nue }}", "model.feb.j2: unknown variable nue; expected some of"),
        ("{{ nu }}", "{{ nu / (nu - 0.45) }}", "line "),
        ("{{ displacement_points }}", "<pt>0,0</pt>", "does not follow the measured displacement"),
        ("</Mesh>", "", "renders to no XML"),
        ('name="grip">{{', 'name="crip">{{', "simulator.outputs.force: no set 'grip' of nodes"),
    ],
)
def test_validation_tells_one_line(tmp_path, old, new, told):
    text = DOGBONE.read_text()
    assert old in text
    with pytest.raises(BadInput) as wrong:
        check_dogbone(tmp_path, text.replace(old, new))
    assert told in str(wrong.value)
    assert "\n" not in str(wrong.value)


def test_all_renderings_of_a_check_have_one_bound(tmp_path, monkeypatch):
    """They are one job, whose process gets the time that is left, once. This holds on a machine of any speed."""
    jobs, limits = [], []
    ask = renderer._renderer.ask
    monkeypatch.setattr(renderer._renderer, "ask", lambda job, files: jobs.append((job, files)) or ask(job, files))
    allowance = Allowance(7.5)
    purpose = dogbone(tmp_path, DOGBONE.read_text()).template
    check_template(tmp_path / "study.yaml", purpose, OWN, sized=True, moved=True, allowance=allowance)
    ((job, files),) = jobs
    assert len(job["renders"]) == 1 + 2 * len(OWN.free)
    assert (job["seconds"], allowance.seconds < 7.5) == (7.5, True)
    monkeypatch.setattr(program, "_limit_processor", limits.append)
    monkeypatch.setattr(program.resource, "setrlimit", lambda *_: None)
    lines = io.BytesIO(json.dumps(job | {"files": files}).encode() + b"\n")
    monkeypatch.setattr(sys, "stdin", SimpleNamespace(buffer=lines))
    monkeypatch.setattr(sys, "stdout", SimpleNamespace(buffer=io.BytesIO()))
    program.main()
    assert limits == [7.5]


def test_files_that_are_read_use_the_bound_of_the_check(tmp_path, monkeypatch):
    monkeypatch.setattr(program, "SECONDS", 1)
    (tmp_path / "a.feb").write_text("{% include 'b.xml' %}")
    (tmp_path / "b.xml").write_text("{{ 1 }}" * 2_000_000)
    allowance = Allowance()
    with pytest.raises(BadInput, match="takes more than 1 s of a processor"):
        read_files(tmp_path, "a.feb", allowance)
    with pytest.raises(Failed, match="takes more than 1 s of a processor"):
        included("a.feb", "", Allowance(0.0))


def test_a_check_leaves_less_for_the_next(tmp_path):
    allowance = Allowance()
    assert included("a", "{% include 'b' %}", allowance) == ["b"]
    assert 0 < allowance.seconds < program.SECONDS
