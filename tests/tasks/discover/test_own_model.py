"""`sinew discover` on a model of a user's own: effects of the machine, around the study's template."""

import json
import xml.etree.ElementTree as ElementTree
from pathlib import PurePosixPath

import numpy as np
import pytest
import yaml

from sinew.runner.store.schema import STATUSES
from sinew.tasks.data.cohort import write_cohort
from sinew.tasks.model.effects import library
from sinew.tasks.report.crate.contents import strangers, template_files
from sinew.tasks.simulate import Simulated
from sinew.tasks.simulate.build import simulator_of
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


def bar_of(simulator):
    return OwnBar(inside=simulator.template.effects)


@pytest.fixture
def study(tmp_path, monkeypatch):
    """A study whose template is solved in this process; returns a function of what to hide in the measurements."""
    monkeypatch.setattr(Workspace, "client", lambda _: None)
    monkeypatch.setattr(pipeline, "_draw", lambda *_: None)
    monkeypatch.setattr(
        FEBio, "simulate", lambda own, *arguments, **options: bar_of(own).simulate(*arguments, **options)
    )
    text = DOGBONE.read_text().replace("{{ nu }}", "0.3")
    for name, own in {"E_matrix": "E", "g_1": "nu_m", "tau_1": "tau"}.items():
        text = text.replace(f"{{{{ {name} }}}}", f"{{{{ {own} }}}}")
    (tmp_path / "bone").mkdir()
    (tmp_path / "bone" / "dogbone.feb.j2").write_text(text)

    def make(*hidden, wrong_N=0.0, **changes):
        write_cohort(tmp_path / "cohort", [pulled(*hidden, wrong_N=wrong_N)])
        path = tmp_path / "study.yaml"
        content = yaml.safe_load(STUDY.replace("PROGRAM", str(stand_in(tmp_path))))
        for section, fields in changes.items():
            content[section] |= fields
        path.write_text(yaml.safe_dump(content))
        return trusted(path)

    return make


def test_a_machine_that_lags_is_named_through_a_template(study, tmp_path, capsys):
    out = tmp_path / "out"
    effects = {"effects": ["time-lag", "force-drift"]}
    sinew("discover", study((library()["time-lag"],), (LAG,), discover=effects), "--out", out)
    result = json.loads((out / "discover.json").read_text())
    assert (result["verdict"], result["effects"]) == ("NAMED", ["time-lag"])
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


def test_an_effect_is_named_beside_what_no_effect_explains(study, tmp_path, capsys):
    out = tmp_path / "out"
    effects = {"effects": ["time-lag", "force-drift"]}
    sinew("discover", study((library()["time-lag"],), (LAG,), wrong_N=0.6, discover=effects), "--out", out)
    result = json.loads((out / "discover.json").read_text())
    assert (result["verdict"], result["effects"]) == ("PARTLY", ["time-lag"])
    (part,) = result["parts"]
    low, high = part["interval"]
    assert low < part["share"] < high < 1.0
    assert result["remainder"]["share"] == pytest.approx(1.0 - result["explained"], abs=0.02)
    (form,) = read_study(out / result["model"]["path"]).model.effects
    assert form.startswith("time-lag"), "with a filter it may come nearer"
    assert "has not been counted" in " ".join(capsys.readouterr().out.split())


TISSUE = {"fibre": "tissue", "matrix": "tissue.elastic"}
SOFTENING = (library()["softening"],), (0.3, 2.0, 0.02)


def test_damage_inside_the_model_is_named_and_written_into_it(study, tmp_path, capsys):
    """What the solver has only by name is left out: in this one, damage by the largest energy does nothing."""
    out = tmp_path / "out"
    effects = {"effects": ["softening", "time-lag"]}
    sinew("discover", study(*SOFTENING, simulator=TISSUE, discover=effects), "--out", out)
    result = json.loads((out / "discover.json").read_text())
    assert (result["verdict"], result["effects"]) == ("NAMED", ["softening"])
    assert list(result["left_out"]) == ["softening/simo"]
    told = " ".join(capsys.readouterr().out.split())
    assert "softening/simo is no candidate: it does next to nothing here" in told
    low, high = result["candidates"][0]["parameters"]["bone/1"]["softening_loss"]["interval"]
    assert low - 0.05 < 0.3 < high + 0.05
    assert result["model"]["checks"]["at_null_N"] < 1e-6
    new = read_study(trusted(out / result["model"]["path"]))
    assert new.model.effects == ["softening"]
    assert new.simulator.constituents == TISSUE
    inputs = [ElementTree.parse(out / path) for path in result["model"]["febio"]["inputs"]]
    assert len(inputs) == 3
    for one in inputs:
        damaged = one.find("Material/material/elastic")
        assert (damaged.get("type"), damaged.find("elastic").get("type")) == ("elastic damage", "neo-Hookean")
        assert float(damaged.findtext("damage/Dmax")) == pytest.approx(0.3, abs=0.1)
    built = simulator_of(new, None, tmp_path / "scratch")
    assert [effect.name for effect in built.template.effects] == ["softening"], "the study with the effect runs with it"
    before = (out / "discover.json").read_bytes()
    sinew("discover", tmp_path / "study.yaml", "--out", out)
    assert (out / "discover.json").read_bytes() == before


@pytest.mark.parametrize(
    ("tissue", "told"),
    [
        ({}, "discover.effects: softening: not with this template; expected some of area-error, buckling, "),
        ({"matrix": "tissue"}, "discover.effects: softening: simulator.fibre does not say which material is the fibre"),
    ],
)
def test_an_effect_that_the_template_cannot_have_is_refused(study, tmp_path, capsys, tissue, told):
    with pytest.raises(SystemExit) as ended:
        sinew("discover", study(simulator=tissue, discover={"effects": ["softening"]}), "--out", tmp_path / "out")
    assert ended.value.code == 2
    assert told in capsys.readouterr().err


def test_a_material_that_is_named_later_is_looked_at(study, tmp_path):
    out, verdicts, fits = tmp_path / "out", [], []
    path = study(*SOFTENING, simulator={"fibre": "tissue"}, discover={"effects": ["softening", "time-lag"]})
    for tissue in ({}, {"matrix": "tissue"}, {}):
        content = yaml.safe_load(path.read_text())
        content["simulator"] |= tissue
        path.write_text(yaml.safe_dump(content))
        sinew("discover", trusted(path), "--out", out)
        verdicts.append(json.loads((out / "discover.json").read_text())["inputs"])
        fits.append({one.name: one.stat().st_mtime_ns for one in (out / "discover").glob("*.jsonl")})
    assert verdicts[0] != verdicts[1] == verdicts[2]
    assert fits[0] == fits[1], "fits that it changes nothing of are not made again"


def test_where_no_effect_does_anything_there_is_no_verdict(study, tmp_path, capsys):
    with pytest.raises(SystemExit) as ended:
        sinew("discover", study(simulator=TISSUE, discover={"effects": ["permanent-set"]}), "--out", tmp_path / "out")
    assert ended.value.code == 2
    assert "discover.effects: permanent-set: it does next to nothing here: " in capsys.readouterr().err


def test_a_parameter_of_the_model_is_no_parameter_of_an_effect(study, tmp_path):
    path = study(simulator=TISSUE, discover={"effects": ["softening", "time-lag"]})
    content = yaml.safe_load(path.read_text())
    content["model"]["parameters"]["force_lag"] = content["model"]["parameters"].pop("tau")
    path.write_text(yaml.safe_dump(content))
    template = tmp_path / "bone" / "dogbone.feb.j2"
    template.write_text(template.read_text().replace("{{ tau }}", "{{ force_lag }}"))
    sinew("discover", trusted(path), "--out", tmp_path / "out")
    left_out = json.loads((tmp_path / "out" / "discover.json").read_text())["left_out"]
    assert left_out["time-lag"] == "the model has a parameter force_lag"


def test_where_the_model_is_true_nothing_is_named(study, tmp_path):
    out = tmp_path / "out"
    sinew("discover", study(), "--out", out)
    result = json.loads((out / "discover.json").read_text())
    assert result["verdict"] == "NONE"
    assert result["effects"] == []
    assert {slug for one in result["candidates"] for slug in one["effects"]} == {
        slug for slug, effect in library().items() if effect.around
    }, "all that can act around it, and nothing else"
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
