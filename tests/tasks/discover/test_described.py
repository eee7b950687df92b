"""A law for what the library leaves: found, written as data, run again, and kept."""

import json
import shutil

import numpy as np
import pytest
import yaml

from sinew.tasks.data.cohort import write_cohort
from sinew.tasks.data.virtual import autoregressive, virtual_cohort
from sinew.tasks.discover.fit import laws
from sinew.tasks.discover.result import WITH_LAWS, DiscoverResult
from sinew.tasks.discover.show import of_the_law
from sinew.tasks.model import Curve, Model, Specimen
from sinew.tasks.model.effects import library
from sinew.tasks.model.protocols import cyclic, one_step
from sinew.tasks.simulate.effects import simulate_with
from sinew.tasks.study import pipeline
from sinew.tasks.study.study import read_study
from sinew.tasks.study.workspace import Workspace
from tests.tasks.discover import few
from tests.tasks.study.test_pipeline import sinew

STUDY = f"""\
name: law
cohort: cohort
seed: 3
cluster: {{name: local}}
tasks: [discover]
discover: {{effects: [time-lag], starts: 1}}
{few.SECTION}"""


@pytest.fixture
def study(tmp_path):
    """Two specimens whose fibres are damaged by the largest strain; the study asks for another effect only."""
    specimens, truth = virtual_cohort(seed=1, per_site=1, rate_hz=1.0)
    damaged = []
    for number, bare in enumerate(specimens[:2]):
        told = truth["specimens"][bare.name]["parameters"]
        row = few.row(told)
        rng, curves = np.random.default_rng(number), []
        for make in (one_step, cyclic):
            protocol, effect = make(bare.length_mm, 2.0), library()["softening"]
            force = simulate_with(Model(), (effect,), bare, protocol, row, effect.typical[np.newaxis])[0]
            curves.append(Curve(protocol, force + 1.5 * autoregressive(rng, force.size, 0.3)))
        damaged.append(Specimen(bare.name, bare.length_mm, bare.width_mm, bare.thickness_mm, tuple(curves)))
    write_cohort(tmp_path / "cohort", damaged)
    (tmp_path / "study.yaml").write_text(STUDY)
    return tmp_path / "study.yaml"


@pytest.fixture
def here(monkeypatch):
    """Evaluates in this process, draws nothing, and looks at few laws."""
    monkeypatch.setattr(Workspace, "client", lambda _: None)
    monkeypatch.setattr(pipeline, "_draw", lambda *_: None)
    for name, number in (("FITTED", 3), ("PREDICTING", 2), ("MAX_LAWS", 1)):
        monkeypatch.setattr(laws, name, number)


@pytest.mark.thorough
def test_damage_that_the_library_was_not_asked_for_becomes_a_law(study, tmp_path, here, capsys):
    out = tmp_path / "out"
    sinew("discover", study, "--out", out)
    shown = " ".join(capsys.readouterr().out.split())
    told = json.loads((out / "verdict.json").read_text())
    assert told["verdict"] == "OUTSIDE"
    law = told["law"]
    assert law["names"][0].startswith("law/fibres/largest-strain:")
    assert law["beside"] == []
    assert law["interval"][0] < law["share"] < law["interval"][1]
    assert law["share"] > 0.8
    assert law["gap"]["after"] < 0.5 * law["gap"]["before"]
    assert law["other"] == [] or law["other"] != law["names"]
    assert "A law describes the misfit: S_f -> S_f (1 +" in shown or "Two laws describe the misfit: S_f" in shown
    assert "not a mechanism" in shown and "what would refute it" in shown
    # the study with the law is data, and runs as any study does
    written = yaml.safe_load((out / WITH_LAWS).read_text())
    assert written["model"]["effects"] == law["names"]
    assert law["path"] == str(WITH_LAWS)
    assert read_study(out / WITH_LAWS).model.effects == law["names"]
    # the same study again: nothing is computed, and a lost study with the law is written again
    before = (out / "verdict.json").read_bytes()
    shutil.rmtree(out / "discover")
    (out / "discover").mkdir()
    sinew("discover", study, "--out", out, "--quiet")
    assert (out / "verdict.json").read_bytes() == before
    assert yaml.safe_load((out / WITH_LAWS).read_text()) == written
    result = DiscoverResult.read(out)
    assert of_the_law(result).endswith("not a mechanism.")


def test_no_law_is_looked_for_where_the_study_says_so(study, tmp_path, here):
    study.write_text(STUDY.replace("starts: 1", "starts: 1, laws: false"))
    sinew("discover", study, "--out", tmp_path / "out", "--quiet")
    told = json.loads((tmp_path / "out" / "verdict.json").read_text())
    assert told["verdict"] == "OUTSIDE" and "law" not in told
