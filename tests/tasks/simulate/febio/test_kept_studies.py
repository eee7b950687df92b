"""Studies that keep the runs of their solver."""

import shutil
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml

import sinew
from sinew.runner.errors import BadInput
from sinew.tasks.study import pipeline
from sinew.tasks.study.resources import resource
from sinew.tasks.study.study import read_study
from sinew.tasks.study.workspace import Workspace
from tests.tasks.simulate.febio.keeping_bar import LATERAL, keeping_bar
from tests.tasks.simulate.febio.plotting_bar import plotting_bar, runs
from tests.tasks.simulate.febio.test_kept import _no_memory
from tests.tasks.simulate.febio.test_own_model import command, with_cohort
from tests.tasks.simulate.febio.test_vtk import arrays
from tests.trusting import trusted

__all__ = ["_no_memory"]


@pytest.fixture
def settings(tmp_path, monkeypatch) -> dict:
    monkeypatch.setattr(Workspace, "client", lambda _: None)
    shutil.copytree(resource("configs/dogbone"), tmp_path / "dogbone")
    found = yaml.safe_load(resource("configs/dogbone.yaml").read_text())
    found["simulator"] |= {"executable": str(plotting_bar(tmp_path)), "keep": "fields"}
    found["protocols"]["relaxation"]["points"] = 21
    monkeypatch.setattr(pipeline, "_draw", lambda *_: None)
    found["tasks"], found["sobol"] = ["sobol"], {"base_samples": 4, "resamples": 20}
    return found


def study(folder: Path, settings: dict) -> Path:
    (folder / "study.yaml").write_text(yaml.safe_dump(settings, sort_keys=False))
    return trusted(folder / "study.yaml")


@pytest.mark.thorough
def test_an_output_that_is_added_to_a_finished_study(tmp_path, settings, capsys):
    out = tmp_path / "out"
    command("sobol", study(tmp_path, settings), "--out", out)
    assert runs(tmp_path) == 24
    settings["simulator"]["outputs"]["lateral"] = {
        "field": "displacement", "component": "x", "set": "edge", "scale": -2, "unit": "mm"}  # fmt: skip
    command("sobol", study(tmp_path, settings), "--out", out)
    assert runs(tmp_path) == 24
    (table,) = [one for one in sinew.results(out).xarray()["evaluations"].children.values() if "summary_lateral" in one]
    assert table.sizes["row"] == 24
    assert np.allclose(table["lateral_relaxation"], table["narrowing_relaxation"], rtol=2e-7, atol=1e-9)
    assert "lateral" in capsys.readouterr().out
    capsys.readouterr()
    command("fields", out, "--row", 3, "--row", 20, "--to", tmp_path / "vtk")
    told = capsys.readouterr().out.split()
    assert len(told) == 2
    (path,) = [path for path in map(Path, told) if "row000003" in path.name]
    last = arrays(sorted((tmp_path / "vtk" / path.stem).iterdir())[-1])
    (edge,) = np.flatnonzero(last["node_id"].ravel() == 4)
    assert -2 * last["displacement"][edge, 0] == np.float32(table["lateral_relaxation"][3, -1])
    command("fields", out, "--row", 99, expect=2)
    assert "its fields were not kept; the store has 24 rows" in capsys.readouterr().err
    settings["simulator"]["keep"] = "nothing"
    del settings["simulator"]["outputs"]["lateral"]
    command("sobol", study(tmp_path, settings), "--out", out)
    assert runs(tmp_path) == 24  # rows are the same with and without fields


@pytest.mark.thorough
def test_other_noise_and_another_measured_output_of_a_finished_study(tmp_path, settings):
    """Neither what was measured nor how noisy it is changes what the solver does."""
    settings["sobol"]["base_samples"] = 2
    made = with_cohort(tmp_path, settings)
    file = tmp_path / "cohort" / "made" / "relaxation.csv"
    seen = pd.read_csv(tmp_path / "truth" / "dogbone.relaxation.narrowing.csv")["row_0"]
    pd.read_csv(file).assign(narrowing=seen, width_loss_mm=seen + 0.001).to_csv(file, index=False)
    before = runs(tmp_path)
    quantities = {"force": {"noise": 0.05}, "narrowing": {"noise": 0.001}}
    command("sobol", study(tmp_path, made | {"measured": quantities}), "--out", tmp_path / "out")
    assert runs(tmp_path) == before + 12
    quantities["narrowing"]["noise"] = 0.002
    command("sobol", study(tmp_path, made | {"measured": quantities}), "--out", tmp_path / "out")
    made["simulator"]["outputs"]["lateral"] = {
        "field": "displacement", "component": "x", "set": "edge", "scale": -2, "unit": "mm"}  # fmt: skip
    quantities["lateral"] = {"column": "width_loss_mm", "noise": 0.001}
    command("sobol", study(tmp_path, made | {"measured": quantities}), "--out", tmp_path / "out")
    assert runs(tmp_path) == before + 12
    tables = sinew.results(tmp_path / "out").xarray()["evaluations"].children.values()
    assert [table.sizes["row"] for table in tables] == [12, 12, 12]
    assert any("rmse_lateral" in table for table in tables)
    command("fields", tmp_path / "out", "--row", 3)  # the rows of all tables have the same runs
    table = pd.read_csv(file)
    table.assign(displacement_mm=1.01 * table["displacement_mm"]).to_csv(file, index=False)
    command("sobol", study(tmp_path, made | {"measured": quantities}), "--out", tmp_path / "out")
    assert runs(tmp_path) == before + 24


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"field": "stress"}, "without keep: fields"),
        ({"data": "node_data", "item": "ux", "ids": [1], "component": "x"}, "without field"),
        ({"data": "node_data", "ids": [1]}, "data and item, or field"),
        ({"field": "stress", "item": "ux"}, "beside data or item"),
        ({"data": "node_data", "item": "ux", "ids": [1], "scale": 0}, "a factor other than 0"),
        ({"field": "stress", "set": "a", "ids": [1]}, "either ids or the name of a set"),
    ],
)
def test_outputs_that_cannot_be(tmp_path, settings, change, words):
    settings["simulator"]["outputs"]["new"] = change
    if change == {"field": "stress"}:
        settings["simulator"]["keep"] = "nothing"
    with pytest.raises(BadInput, match=words):
        read_study(study(tmp_path, settings))


def test_identity_names_fields_only_where_there_are_some(tmp_path):
    template = keeping_bar(tmp_path, LATERAL).template
    assert template.identity(0, 0, 0)["fields"] == [asdict(LATERAL)]
    assert "fields" not in replace(template, fields=()).identity(0, 0, 0)
