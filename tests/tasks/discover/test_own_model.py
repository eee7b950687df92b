"""`sinew discover` on a model of a user's own: effects of the machine, around the study's template."""

import json
from pathlib import PurePosixPath

import numpy as np
import pytest
import yaml

from sinew.runner.store.schema import STATUSES
from sinew.tasks.data.cohort import write_cohort
from sinew.tasks.model.effects import library
from sinew.tasks.report.crate.contents import strangers, template_files
from sinew.tasks.simulate import Simulated
from sinew.tasks.simulate.febio.simulator import FEBio
from sinew.tasks.study import pipeline
from sinew.tasks.study.study import read_study
from sinew.tasks.study.workspace import Workspace
from tests.tasks.discover.own_model import OWN, TRUTH, OwnBar, pulled
from tests.tasks.simulate.febio.dogbone import DOGBONE, stand_in
from tests.tasks.study.test_pipeline import sinew
from tests.trusting import trusted

STUDY = """
name: bone
seed: 3
cohort: cohort
simulator:
  name: template
  file: bone/dogbone.feb.j2
  executable: PROGRAM
  force: force
  outputs:
    force: {data: node_data, item: Rz, set: grip, reduce: sum, scale: 4, unit: N}
model:
  parameters:
    E: {min: 5, max: 50, unit: MPa}
    nu_m: {min: 0.1, max: 1.0}
    tau: {min: 1, max: 30, unit: s}
tasks: [discover]
discover: {starts: 1}
"""
LAG = 0.35


@pytest.fixture
def study(tmp_path, monkeypatch):
    """A study whose template is solved in this process; returns a function of what to hide in the measurements."""
    monkeypatch.setattr(Workspace, "client", lambda _: None)
    monkeypatch.setattr(pipeline, "_draw", lambda *_: None)
    monkeypatch.setattr(FEBio, "simulate", lambda _, *arguments, **options: OwnBar().simulate(*arguments, **options))
    text = DOGBONE.read_text().replace("{{ nu }}", "0.3")
    for name, own in {"E_matrix": "E", "g_1": "nu_m", "tau_1": "tau"}.items():
        text = text.replace(f"{{{{ {name} }}}}", f"{{{{ {own} }}}}")
    (tmp_path / "bone").mkdir()
    (tmp_path / "bone" / "dogbone.feb.j2").write_text(text)

    def make(*hidden):
        write_cohort(tmp_path / "cohort", [pulled(*hidden)])
        path = tmp_path / "study.yaml"
        path.write_text(STUDY.replace("PROGRAM", str(stand_in(tmp_path))))
        return trusted(path)

    return make


def test_a_machine_that_lags_is_named_through_a_template(study, tmp_path, capsys):
    out = tmp_path / "out"
    sinew("discover", study((library()["time-lag"],), (LAG,)), "--out", out)
    result = json.loads((out / "discover.json").read_text())
    assert (result["verdict"], result["effects"]) == ("NAMED", ["time-lag"])
    assert {slug for one in result["candidates"] for slug in one["effects"]} == {
        slug for slug, effect in library().items() if effect.around
    }, "all that can act around it, and nothing else"
    best = result["candidates"][0]
    low, high = best["parameters"]["bone/1"]["force_lag"]["interval"]
    assert low - 0.01 < LAG < high + 0.01
    assert result["gap"]["closed"] > 0.9
    assert result["confidence"] is None
    assert "has not been counted" in " ".join(capsys.readouterr().out.split())
    assert result["model"]["checks"]["at_null_N"] < 1e-6
    assert result["model"]["checks"]["not_inert"]
    assert not result["model"]["febio"]["ran"]
    written = out / result["model"]["path"]
    new = read_study(written)
    assert new.model.effects == ["time-lag"]
    file = yaml.safe_load(written.read_text())["simulator"]["file"]
    assert (written.parent / file).read_text() == (tmp_path / "bone" / "dogbone.feb.j2").read_text()
    assert template_files(out) == {PurePosixPath("discover/template/dogbone.feb.j2")}
    (out / "discover" / "template" / "run.sh").touch()
    assert strangers(out) == ["discover/template/run.sh"], "and no file of the template"
    capsys.readouterr()
    before = (out / "discover.json").read_bytes()
    sinew("discover", tmp_path / "study.yaml", "--out", out)
    assert (out / "discover.json").read_bytes() == before
    assert strangers(out) == [], "the template is written anew"
    assert " fits in " not in capsys.readouterr().out, "a verdict that is known"


def test_where_the_model_is_true_nothing_is_named(study, tmp_path):
    out = tmp_path / "out"
    sinew("discover", study(), "--out", out)
    result = json.loads((out / "discover.json").read_text())
    assert result["verdict"] == "NONE"
    assert result["effects"] == []
    free = sum(len(OWN.names) for _ in result["cells"])
    assert result["null"]["loss"] / (result["null"]["floor"] + free) == pytest.approx(1.0, abs=0.3)
    assert TRUTH.size == free


def test_a_solver_that_never_succeeds_gives_no_verdict(study, tmp_path, monkeypatch, capsys):
    def failing(_, model, specimen, protocol, parameters, **__):
        count = len(parameters)
        nothing = np.full((count, protocol.time_s.size), np.nan)
        return Simulated(nothing, np.full(count, STATUSES.index("diverged")), ("the mesh is bad",) * count)

    path, out = study(), tmp_path / "out"
    monkeypatch.setattr(FEBio, "simulate", failing)
    with pytest.raises(SystemExit) as ended:
        sinew("discover", path, "--out", out)
    assert ended.value.code == 2
    (line,) = [line for line in capsys.readouterr().err.splitlines() if line.startswith("sinew: ")]
    told = "bone/1: the model as it is cannot be simulated along "
    assert line.startswith(f"sinew: {told}") and "'the mesh is bad'" in line
    assert not (out / "discover.json").exists()
