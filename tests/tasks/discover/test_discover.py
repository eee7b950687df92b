"""`sinew discover` from end to end: a hidden effect is named and added, and where nothing is hidden, nothing is."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr
import yaml

from runner.cluster import Local
from tasks.cohort import autoregressive, virtual_cohort, write_cohort
from tasks.discover.discover import _inputs, _kept
from tasks.model import Curve, Model, Specimen
from tasks.model.effects import library
from tasks.model.protocols import cyclic, one_step
from tasks.report.folder import read_folder
from tasks.simulate.effects import simulate_with
from tasks.study import read_study
from tasks.workspace import open_workspace
from tests.conftest import SHARED
from tests.tasks.test_pipeline import new_simulations, sinew

STUDY = """
name: hidden
seed: 3
cohort: cohort
tasks: [discover]
discover: {effects: [force-drift, time-lag, toe-slack], starts: 3}
"""


def pulled(bare: Specimen, truth: dict[str, float], slack: float | None, seed: int) -> Specimen:
    """The specimen pulled anew at 4 Hz, with slack fibres if wanted, and noise."""
    model, rng = Model(), np.random.default_rng(seed)
    effects = () if slack is None else (library()["toe-slack"],)
    values = np.zeros((1, 0)) if slack is None else np.array([[slack]])
    parameters = np.array([[min(truth[p.name], p.maximum) for p in model.parameters]])
    curves = []
    for make in (one_step, cyclic):
        protocol = make(bare.length_mm, 4.0)
        force = simulate_with(model, effects, bare, protocol, parameters, values)[0]
        curves.append(Curve(protocol, force + 1.5 * autoregressive(rng, force.size, 0.3)))
    return Specimen(bare.name, bare.length_mm, bare.width_mm, bare.thickness_mm, tuple(curves))


@pytest.fixture
def study(tmp_path):
    def make(slack):
        specimens, truth = virtual_cohort(seed=1, per_site=1, rate_hz=1.0)
        told = [truth["specimens"][one.name]["parameters"] for one in specimens[:2]]
        write_cohort(tmp_path / "cohort", [pulled(o, t, slack, i) for i, (o, t) in enumerate(zip(specimens, told))])  # noqa: B905
        (tmp_path / "study.yaml").write_text(STUDY)
        return tmp_path / "study.yaml"

    return make


def test_a_hidden_effect_is_named_added_and_shown(study, tmp_path, capsys):
    path, out = study(0.99), tmp_path / "out"
    sinew("discover", path, "--out", out, "--workers", 2)
    said = capsys.readouterr().out
    assert "NAMED toe-slack" in said
    assert "such verdicts were true in the blind benchmark" in " ".join(said.split())
    result = json.loads((out / "verdict.json").read_text())
    assert (result["verdict"], result["effects"], result["set"]) == ("NAMED", ["toe-slack"], [])
    assert result["confidence"]["interval"][0] > 0.5
    best = result["candidates"][0]
    assert best["effects"] == ["toe-slack"]
    for told in best["parameters"].values():
        low, high = told["slack_stretch"]["interval"]
        assert low - 0.0005 < 0.99 < high + 0.0005
    assert result["gap"]["closed"] > 0.9
    assert any(abs(cell["z"]) > cell["limit"] for cells in result["cells"].values() for cell in cells)
    after = [abs(cell["z"]) > cell["limit"] for cells in result["after"].values() for cell in cells]
    assert np.mean(after) < 0.05
    for figure in ("discover_cells", "discover_distal_1", "discover_middle_1"):
        assert (out / "figures" / f"{figure}.png").stat().st_size > 5000
    checks, solver = result["model"]["checks"], result["model"]["febio"]
    assert checks["at_null_N"] == 0.0
    assert checks["not_inert"]
    assert len(solver["inputs"]) == 2
    assert all("prestrain" in (out / path).read_text() for path in solver["inputs"])
    if solver["ran"]:
        assert all(run["deviation"] < 1e-6 < 0.01 < run["change"] for run in solver["runs"].values())
    else:
        assert "not on the PATH" in solver["why"]
    assert set(best["splits"]) == {"protocol", "later cycles", "specimen"}
    assert all(split["gain"] > 2 * split["error"] for split in best["splits"].values())
    kept = xr.open_datatree(out / "store.zarr", engine="zarr", consolidated=False)["discover/distal_1"]
    left = {name: np.std((kept["measured_cyclic"] - kept[f"{name}_cyclic"]).to_numpy()) for name in ("bare", "having")}
    assert left["having"] < 1.7 < 2.5 < left["bare"], "noise of 1.5 N is left"
    seen = read_folder(out).measured["distal/1"]
    assert sorted(seen) == ["cyclic", "one_step"]
    for protocol, curve in seen.items():
        assert np.isin(curve.displacement_mm, kept[f"displacement_{protocol}"].to_numpy()).all()
        assert curve.displacement_mm.max() == kept[f"displacement_{protocol}"].max() > 0.1

    added = out / result["model"]["path"]
    assert yaml.safe_load(added.read_text())["model"] == {"effects": ["toe-slack"]}
    assert "+  - toe-slack" in result["model"]["difference"]
    rows = tmp_path / "rows.csv"
    rows.write_text("E_f,slack_stretch\n200,1.0\n200,0.985\n")
    sinew("simulate", added, "--parameters", rows, "--out", tmp_path / "simulated", "--quiet")
    forces = np.loadtxt(tmp_path / "simulated" / "distal" / "1.one_step.csv", delimiter=",", skiprows=1)
    assert np.abs(forces[:, 2] - forces[:, 3]).max() > 10.0, "the added effect changes the force"

    first = (out / "verdict.json").read_bytes()
    (out / "verdict.json").unlink()
    sinew("discover", path, "--out", out, "--quiet")
    assert new_simulations(out)[-1] == 0
    assert (out / "verdict.json").read_bytes() == first, "its fits are kept"
    fitted = sorted((out / "discover").glob("*.jsonl"))
    for ledger in fitted:
        ledger.unlink()
    sinew("discover", path, "--out", out, "--quiet")
    assert fitted
    assert not any(ledger.exists() for ledger in fitted), "a verdict that is there is not made again"
    path.write_text(STUDY.replace("starts: 3", "starts: 2"))
    sinew("discover", path, "--out", out, "--quiet")
    assert json.loads((out / "verdict.json").read_text())["inputs"] != result["inputs"]


@pytest.mark.parametrize(
    ("spoil", "kept"),
    [
        (lambda out, work: None, True),
        (lambda out, work: (out / "model.yaml").unlink(), False),
        (lambda out, work: (out / "one.feb").unlink(), False),
        (lambda out, work: (out / "verdict.json").unlink(), False),
        (lambda out, work: (out / "verdict.json").write_text('{"inputs": "former"}'), False),
        (lambda out, work: work.store.root.clear(), False),
        (lambda out, work: setattr(work, "retry_failed", True), False),
    ],
)
def test_a_verdict_is_kept_with_all_that_goes_with_it(tmp_path, spoil, kept):
    found = {"inputs": "these", "cells": {"a/1": []}, "model": {"path": "model.yaml", "febio": {"inputs": ["one.feb"]}}}
    files = [tmp_path / name for name in ("discover.json", "verdict.json")]
    for file in (*files, tmp_path / "model.yaml", tmp_path / "one.feb"):
        file.write_text(json.dumps(found))
    work = SimpleNamespace(out=tmp_path, retry_failed=False, store=SimpleNamespace(root={"discover/a_1": None}))
    spoil(tmp_path, work)
    assert (_kept(work, files, "these") == found) is kept
    assert _kept(work, files, "others") is None


def test_another_simulator_name_or_place_is_another_verdict(study, tmp_path):
    path = study(None)
    with open_workspace(read_study(path), out=tmp_path / "out", cluster=Local(1), quiet=True) as workspace:
        first = _inputs(workspace)
        assert _inputs(workspace) == first
        (one, *others) = workspace.cohort.specimens
        other = SimpleNamespace(identity=lambda: {"name": "another"})
        renamed = replace(workspace.cohort, specimens=(replace(one, name="distal/7"), *others))
        moved = replace(workspace.cohort, folder=tmp_path)
        changed = [replace(workspace, simulator=other), replace(workspace, cohort=renamed)]
        changed.append(replace(workspace, cohort=moved))
        assert len({first, *map(_inputs, changed)}) == 4


def test_where_nothing_is_hidden_nothing_is_named(study, tmp_path):
    out = tmp_path / "out"
    sinew("discover", study(None), "--out", out, "--quiet")
    result = json.loads((out / "verdict.json").read_text())
    assert (result["verdict"], result["effects"], result["set"]) == ("NONE", [], [])
    assert result["model"] is None


@pytest.mark.shared
@pytest.mark.parametrize(("case", "effects"), [("case_18", ["toe-slack"]), ("case_07", [])])
def test_cohorts_that_others_made(tmp_path, case, effects):
    """One specimen of a development case whose truth comes from another integration."""
    path = tmp_path / "study.yaml"
    text = STUDY.replace("cohort: cohort", f"cohort: {SHARED}/hidden/dev-1/{case}").replace("time-lag, ", "")
    path.write_text(text.replace("starts: 3", "starts: 2, specimens: [s01]"))
    sinew("discover", path, "--out", tmp_path / "out", "--quiet")
    result = json.loads((tmp_path / "out" / "verdict.json").read_text())
    assert result["effects"] == effects
    assert result["verdict"] == ("NAMED" if effects else "NONE")


@pytest.mark.febio
def test_the_real_solver_names_a_hidden_effect(study, tmp_path):
    path, out = study(0.99), tmp_path / "out"
    text = STUDY.replace("[force-drift, time-lag, toe-slack], starts: 3", "[softening, toe-slack], starts: 1")
    path.write_text(
        text.replace("tasks:", "simulator: febio\ntasks:").replace("starts: 1", "starts: 1, specimens: [distal/1]")
    )
    sinew("discover", path, "--out", out, "--quiet")
    result = json.loads((out / "verdict.json").read_text())
    assert (result["verdict"], result["effects"]) == ("NAMED", ["toe-slack"])
    assert result["model"]["checks"]["at_null_N"] < 1e-3, "an effect at its null value changes nothing in the solver"
    (run, *_) = result["model"]["febio"]["runs"].values()
    assert run["deviation"] < 1e-5
    first = (out / "verdict.json").read_bytes()
    sinew("discover", path, "--out", out, "--quiet")
    assert (out / "verdict.json").read_bytes() == first, "its fits are kept"


@pytest.mark.febio
def test_effects_that_the_real_solver_does_not_have_are_one_line(study, tmp_path, capsys):
    with pytest.raises(SystemExit) as ended:
        sinew("discover", study(None), "--out", tmp_path / "out", "--simulator", "febio")
    assert ended.value.code == 2
    assert "discover.effects: force-drift, time-lag: not in FEBio; expected" in capsys.readouterr().err


def test_a_model_that_has_effects_already_is_one_line(study, tmp_path, capsys):
    path = study(None)
    path.write_text(STUDY + "model: {effects: [softening]}\n")
    with pytest.raises(SystemExit) as ended:
        sinew("discover", path, "--out", tmp_path / "out")
    assert ended.value.code == 2
    assert "model.effects" in capsys.readouterr().err
    path.write_text(STUDY.replace("time-lag", "magic"))
    with pytest.raises(SystemExit):
        sinew("discover", path, "--out", tmp_path / "out")
    assert "'magic' is no effect" in capsys.readouterr().err


def test_a_cohort_with_an_effect_that_is_told_in_its_truth_only(tmp_path, capsys):
    for name, options in (("bare", ()), ("slack", ("--effect", "toe-slack"))):
        sinew("cohort", "--out", tmp_path / name, "--per-site", 1, "--rate", 2, *options)
    told = [json.loads((tmp_path / name / "truth.json").read_text()) for name in ("bare", "slack")]
    assert "effects" not in told[0]
    assert told[1]["effects"] == {"toe-slack": {"slack_stretch": 0.99}}
    assert told[0]["specimens"].keys() == told[1]["specimens"].keys()
    forces = [np.loadtxt(tmp_path / name / "distal" / "1" / "one_step.csv", delimiter=",", skiprows=1)[:, 2]
              for name in ("bare", "slack")]  # fmt: skip
    assert forces[1].max() < 0.9 * forces[0].max()
    with pytest.raises(SystemExit) as ended:
        sinew("cohort", "--out", tmp_path / "magic", "--effect", "magic")
    assert ended.value.code == 2
    assert "--effect: 'magic' is no effect; expected one of area-error" in capsys.readouterr().err
    assert not (tmp_path / "magic").exists()
