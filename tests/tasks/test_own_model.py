"""Whole studies with a user's own template, from the study file to what is in the store."""

import copy
import html
import json
import re
import shlex
import shutil
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr
import yaml

import tasks
from runner.store import STATUSES
from tasks import cli
from tasks.report.figures import FORMATS
from tasks.report.page import build
from tasks.resources import resource
from tests.tasks.simulate.test_template import stand_in

NAMES = ["E_matrix", "nu", "g_1", "tau_1"]
TRUTH = (20.0, 0.3, 0.8, 8.0)


def sinew(*words: object, expect: int | None = None) -> None:
    """Run the command in this process; it ends by returning or by SystemExit."""
    argv, sys.argv = sys.argv, ["sinew", *map(str, words)]
    try:
        cli.main()
    except SystemExit as end:
        assert end.code == expect
    else:
        assert expect is None
    finally:
        sys.argv = argv


@pytest.fixture
def settings(tmp_path) -> dict:
    """The example's study with the stand-in for its solver, fewer points and fewer rows."""
    shutil.copytree(resource("configs/dogbone"), tmp_path / "dogbone")
    found = yaml.safe_load(resource("configs/dogbone.yaml").read_text())
    found["simulator"]["executable"] = str(stand_in(tmp_path))
    found["protocols"]["relaxation"]["points"] = 21
    found["sobol"] = {"base_samples": 4, "resamples": 20}
    found["importance"] = {"trees": 10, "repeats": 2}
    return found


def written(folder: Path, settings: dict) -> Path:
    (folder / "study.yaml").write_text(yaml.safe_dump(settings, sort_keys=False))
    return folder / "study.yaml"


def with_cohort(folder: Path, settings: dict) -> dict:
    """The same study with a measured curve instead, which the model itself made at known parameters."""
    rows = folder / "truth.csv"
    rows.write_text(f"{','.join(NAMES)}\n{','.join(map(str, TRUTH))}\n")
    sinew("simulate", written(folder, settings), "--parameters", rows, "--out", folder / "truth", "--quiet")
    (folder / "cohort" / "made").mkdir(parents=True)
    curve = pd.read_csv(folder / "truth" / "dogbone.relaxation.csv").rename(columns={"row_0": "force_N"})
    curve.to_csv(folder / "cohort" / "made" / "relaxation.csv", index=False)
    (folder / "cohort" / "made" / "specimen.json").write_text(json.dumps(settings["specimen"]))
    left = {name: value for name, value in settings.items() if name not in ("protocols", "specimen")}
    return left | {"cohort": "cohort"}


def test_sobol_and_importance_of_any_output(tmp_path, settings, capsys):
    study = written(tmp_path, settings)
    sinew("run", study, "--out", tmp_path / "out", "--workers", "2")
    told = capsys.readouterr().out
    assert "24 new evaluations" in told
    assert "Total order Sobol indices of each output" in told
    assert "narrowing" in told
    result = json.loads((tmp_path / "out" / "sobol.json").read_text())
    assert result["objective"] == "largest force in N"
    assert result["names"] == NAMES
    assert result["failed"] == 0
    assert set(result["outputs"]) == {"force", "gauge_stress", "shoulder_stress", "narrowing"}
    force, narrowing = (np.argmax(result["outputs"][name]["ST"]) for name in ("force", "narrowing"))
    assert (NAMES[force], NAMES[narrowing]) == ("E_matrix", "nu")
    assert result["outputs"]["force"]["ST"] == pytest.approx(result["ST"])
    forest = json.loads((tmp_path / "out" / "importance.json").read_text())
    assert NAMES[np.argmax(forest["outputs"]["narrowing"]["impurity_percent"])] == "nu"

    results = tasks.results(tmp_path / "out")
    (table,) = results.xarray()["evaluations"].children.values()
    assert table["gauge_stress_relaxation"].dims == ("row", "time_relaxation")
    assert table["gauge_stress_relaxation"].attrs["units"] == "MPa"
    assert table["summary_narrowing"].dims == ("row", "protocol")
    assert table["parameters"].sizes["row"] == 24
    assert "objective" not in table
    assert np.allclose(table["summary_force"].squeeze(), table["force_relaxation"].max("time_relaxation"))
    along = xr.open_zarr(tmp_path / "out" / "store.zarr", group=f"sobol_time/{table.name}", consolidated=False)
    assert along["ST_narrowing_relaxation"].dims == ("parameter", "time_relaxation")
    figures = {path.name for path in (tmp_path / "out" / "figures").glob("*")}
    drawn = {f"sobol_time_{table.name}{ending}" for ending in ("", "_gauge_stress", "_shoulder_stress", "_narrowing")}
    assert {f"{name}.{kind}" for name in ("sobol", "importance", *drawn) for kind in FORMATS} <= figures
    shown = pd.read_csv(tmp_path / "out" / "figures" / f"sobol_time_{table.name}_narrowing.csv")
    assert shown.columns.to_list() == ["protocol", "parameter", "time_s", "displacement_mm", "ST", "ST_conf"]

    assert results.sobol.table.loc["narrowing", "ST"].idxmax() == "nu"
    assert set(results.sobol.plots["time"]) == set(result["outputs"])
    results.sobol.plot("time", "narrowing")
    _, values = results.salib_samples("dogbone")
    assert values == pytest.approx(table["summary_force"].to_numpy()[:, 0])
    assert results.salib_result("narrowing")["ST"] == pytest.approx(result["outputs"]["narrowing"]["ST"])
    assert "summary_narrowing_relaxation" in results.samples(table.name)
    built = build(tmp_path / "out")
    assert built.trouble == ()
    assert all(words in built.path.read_text() for words in ("Nothing was measured", "narrowing", "it needs measured"))
    again = re.search("sinew (run .*)AGAIN", html.unescape(built.path.read_text()))
    sinew(*shlex.split(again[1]), tmp_path / "again")
    assert (tmp_path / "again" / "sobol.json").read_bytes() == (tmp_path / "out" / "sobol.json").read_bytes()
    capsys.readouterr()
    sinew("watch", tmp_path / "out", "--once")
    assert "dogbone" in capsys.readouterr().out

    settings["sobol"]["output"] = "narrowing"
    sinew("run", written(tmp_path, settings), "--out", tmp_path / "out", "--workers", "2")
    assert "sobol: 0 new evaluations" in capsys.readouterr().out
    other = json.loads((tmp_path / "out" / "sobol.json").read_text())
    assert other["ST"] == pytest.approx(result["outputs"]["narrowing"]["ST"])


def test_from_a_curve_to_its_parameters_and_predictions(tmp_path, settings):
    settings["model"]["parameters"]["nu"] = {"fixed": 0.3}  # of a bar in tension it hardly matters to the force
    settings["calibrate"] = {"methods": ["least_squares"], "evaluations": 32, "starts": 1}
    settings["infer"] = {"population": 4, "generations": 1, "epsilon": 3.0, "pending": 4}
    settings["predict"] = {"draws": 2}
    settings["tasks"] = ["calibrate", "infer", "predict"]
    sited = with_cohort(tmp_path, settings)
    (tmp_path / "cohort" / "here").mkdir()
    shutil.move(tmp_path / "cohort" / "made", tmp_path / "cohort" / "here" / "made")
    sinew("run", written(tmp_path, sited), "--out", tmp_path / "out", "--workers", "2", "--quiet")
    results = tasks.results(tmp_path / "out")
    assert results.calibrate.table.loc["here/made", NAMES].astype(float).to_list() == pytest.approx(TRUTH, rel=1e-3)
    free = [name for name in NAMES if name != "nu"]
    posterior = results.infer.table.loc["here"]
    assert posterior.index.to_list() == free
    for name in free:
        low, high = (settings["model"]["parameters"][name][end] for end in ("min", "max"))
        assert low <= posterior["mean"][name] <= high
    assert results.predict.table["all"].between(0, 1).all()
    table = max(results.xarray()["evaluations"].children.values(), key=lambda each: each.sizes["row"])
    assert {"objective", "gauge_stress_relaxation", "summary_narrowing"} <= set(table.data_vars)
    built = build(tmp_path / "out")
    assert built.trouble == ()
    assert "Not for a template" in built.path.read_text()


def test_failures_are_rows_with_reasons(tmp_path, settings):
    program = Path(settings["simulator"]["executable"])
    text = program.read_text()
    program.write_text(text.replace("    E, nu = number", "    if number(root, './/elastic/E') > 30:\n"
                                    "        raise ValueError('too stiff')\n    E, nu = number", 1))  # fmt: skip
    (tmp_path / "rows.csv").write_text("E_matrix\n10\n40\n")
    study = written(tmp_path, settings)
    sinew("simulate", study, "--parameters", tmp_path / "rows.csv", "--out", tmp_path / "out", "--quiet")
    told = json.loads((tmp_path / "out" / "simulate.json").read_text())
    (failure,) = told["failures"]
    assert failure["row"] == 1
    assert failure["status"] in STATUSES
    assert "too stiff" in failure["message"]
    table = pd.read_csv(tmp_path / "out" / "dogbone.relaxation.narrowing.csv")
    assert table["row_0"].notna().all()
    assert table["row_1"].isna().all()


def changed(settings: dict, field: str, value: object) -> dict:
    *way, last = field.split(".")
    inner = settings
    for name in way:
        inner = inner.setdefault(name, {})
    if value is None:
        inner.pop(last, None)
    else:
        inner[last] = value
    return settings


WRONG = {
    "no file": ("simulator.file", None, "simulator.file: missing"),
    "file above": ("simulator.file", "../x.feb", "lies outside the study's folder"),
    "no outputs": ("simulator.outputs", {}, "simulator.outputs"),
    "unknown force": ("simulator.force", "grip", "simulator.force: 'grip'; expected one of the outputs force"),
    "force in kN": ("simulator.outputs.force.unit", "kN", "the force is in 'kN'; expected 'N', with a scale"),
    "force that is none": ("simulator.force", "narrowing", "outputs.force: is not said to be the force"),
    "set and ids": ("simulator.outputs.force.ids", [1], "ids: beside set; expected either ids or the name of a set"),
    "neither": ("simulator.outputs.force.set", None, "ids: missing; expected either"),
    "ids twice": ("simulator.outputs.q", {"data": "node_data", "item": "uz", "ids": [1, 1]}, "each id once"),
    "unknown data": ("simulator.outputs.force.data", "face_data", "expected one of 'node_data', 'element_data'"),
    "two items": ("simulator.outputs.force.item", "Rz;Rx", "'Rz;Rx'"),
    "unknown set": ("simulator.outputs.force.set", "crip", "simulator.outputs.force: no set 'crip' of nodes in dogb"),
    "missing node": ("simulator.outputs.q", {"data": "node_data", "item": "uz", "ids": [9999]}, "node 9999 is not in"),
    "many for one": ("simulator.outputs.force.reduce", "single", "set grip has 12 items; expected one, or reduce"),
    "name of an output": ("simulator.outputs.a-b", {"data": "node_data", "item": "uz", "ids": [1]}, "cannot be a name"),
    "taken output": ("simulator.outputs.time", {"data": "node_data", "item": "uz", "ids": [1]}, "cannot be a name"),
    "no range": ("model.parameters.nu", {"min": 0.1}, "model.parameters.nu.max: missing; expected min and max"),
    "name of a parameter": ("model.parameters.E m", {"fixed": 1.0}, "cannot be a name"),
    "taken parameter": ("model.parameters.time_s", {"fixed": 1.0}, "is taken"),
    "unused parameter": ("model.parameters.G", {"min": 0.1, "max": 0.2}, "model.parameters.G: not used in dogbone"),
    "unused fixed one": ("model.parameters.G", {"fixed": 0.2}, "model.parameters.G: not used in dogbone"),
    "unknown variable": ("model.parameters.nu", None, "dogbone.feb.j2: unknown variable nu; expected some of E_matrix"),
    "no parameters": ("model.parameters", {}, "no parameter with min and max"),
    "tissue's constant": ("model.beta", 3.0, "model.beta: with a template"),
    "tissue's effect": ("model.effects", ["toe-slack"], "model.effects: with a template"),
    "no size": ("specimen", None, "unknown variable specimen"),
    "protocol backwards": ("protocols.relaxation.time_s", [0, 9, 5], "times do not increase"),
    "uneven protocol": ("protocols.relaxation.time_s", [0, 9], "3 numbers beside 2 of time_s"),
    "name of a protocol": ("protocols.a/b", {"time_s": [0, 1], "displacement_mm": [0, 1]}, "cannot be a name"),
    "both": ("cohort", "cohort", "protocols: given beside cohort"),
    "nothing to follow": ("protocols", None, "given without protocols"),
    "unknown sobol output": ("sobol.output", "stretch", "sobol.output: no output 'stretch'; expected one of force"),
    "output like a protocol": (
        "simulator.outputs.relaxation",
        {"data": "node_data", "item": "uz", "ids": [1]}, "two things are called relaxation"
    ),
    "discover": ("tasks", ["discover"], "discover names effects of sinew's own tissue"),
    "calibrate nothing": ("tasks", ["calibrate"], "missing, and calibrate needs measured curves"),
    "two of a name": (
        "simulator.outputs",
        {name: {"data": "node_data", "item": "Rz", "ids": [n]} for n, name in enumerate(("gap", "gap_a"), 1)},
        "two things are called gap_a_b in the store",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", WRONG)
def test_what_is_wrong_is_told_in_one_line_before_anything_is_written(tmp_path, settings, capsys, name):
    field, value, told = WRONG[name]
    if name in ("force that is none",):
        settings["simulator"]["outputs"]["narrowing"]["unit"] = "N"
    if name == "two of a name":
        history = settings["protocols"].pop("relaxation")
        settings["protocols"] |= {"b": history, "a_b": copy.deepcopy(history)}
        del settings["simulator"]["force"]
    study = written(tmp_path, changed(settings, field, value))
    sinew("run", study, "--out", tmp_path / "out", "--quiet", expect=2)
    said = capsys.readouterr().err
    assert told in said, said
    assert said.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_other_simulators_cannot_run_a_template(tmp_path, settings, capsys):
    sinew("run", written(tmp_path, settings), "--out", tmp_path / "out", "--simulator", "uniaxial", expect=2)
    assert "--simulator: uniaxial cannot run a study with a template" in capsys.readouterr().err


def test_measured_curves_need_a_force(tmp_path, settings, capsys):
    del settings["simulator"]["force"]
    settings["simulator"]["outputs"]["pull"] = settings["simulator"]["outputs"].pop("force")
    study = written(tmp_path, settings)
    sinew("calibrate", study, "--out", tmp_path / "out", "--data", tmp_path / "cohort", expect=2)
    assert "simulator.force: missing, and calibrate needs it" in capsys.readouterr().err


@pytest.mark.febio
def test_the_real_solver_finds_its_own_parameters_again(tmp_path, settings):
    settings["simulator"]["executable"] = "febio4"
    settings["calibrate"] = {"methods": ["least_squares"], "evaluations": 160, "starts": 1}
    study = written(tmp_path, with_cohort(tmp_path, settings))
    sinew("calibrate", study, "--out", tmp_path / "out", "--workers", "2", "--quiet")
    found = json.loads((tmp_path / "out" / "calibrate.json").read_text())["specimens"]["made"]
    for name, value in zip(NAMES, TRUTH, strict=True):
        assert found["parameters"][name] == pytest.approx(value, rel=0.01), name
