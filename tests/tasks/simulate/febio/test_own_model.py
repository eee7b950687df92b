"""Whole studies with a user's own template, from the study file to what is in the store."""

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

import sinew
from sinew.runner.errors import BadInput
from sinew.runner.store.schema import STATUSES
from sinew.tasks.cli import main as cli
from sinew.tasks.drawing.formats import FORMATS
from sinew.tasks.report.page import build
from sinew.tasks.study import pipeline
from sinew.tasks.study.resources import resource
from sinew.tasks.study.workspace import Workspace
from tests.tasks.simulate.febio.dogbone import stand_in
from tests.trusting import trusted

NAMES = ["E_matrix", "nu", "g_1", "tau_1"]
TRUTH = (20.0, 0.3, 0.8, 8.0)


def command(*words: object, expect: int | None = None) -> None:
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
def settings(tmp_path, monkeypatch) -> dict:
    """The example's study with the stand-in for its solver, fewer points and fewer rows; it starts no cluster."""
    monkeypatch.setattr(Workspace, "client", lambda _: None)
    shutil.copytree(resource("configs/dogbone"), tmp_path / "dogbone")
    found = yaml.safe_load(resource("configs/dogbone.yaml").read_text())
    found["simulator"]["executable"] = str(stand_in(tmp_path))
    found["protocols"]["relaxation"]["points"] = 21
    found["sobol"] = {"base_samples": 4, "resamples": 20}
    found["importance"] = {"trees": 10, "repeats": 2}
    return found


def written(folder: Path, settings: dict) -> Path:
    (folder / "study.yaml").write_text(yaml.safe_dump(settings, sort_keys=False))
    return trusted(folder / "study.yaml")


def with_cohort(folder: Path, settings: dict) -> dict:
    """The same study with a measured curve instead, which the model itself made at known parameters."""
    rows = folder / "truth.csv"
    rows.write_text(f"{','.join(NAMES)}\n{','.join(map(str, TRUTH))}\n")
    command("simulate", written(folder, settings), "--parameters", rows, "--out", folder / "truth", "--quiet")
    (folder / "cohort" / "made").mkdir(parents=True)
    curve = pd.read_csv(folder / "truth" / "dogbone.relaxation.csv").rename(columns={"row_0": "force_N"})
    curve.to_csv(folder / "cohort" / "made" / "relaxation.csv", index=False)
    (folder / "cohort" / "made" / "specimen.json").write_text(json.dumps(settings["specimen"]))
    left = {name: value for name, value in settings.items() if name not in ("protocols", "specimen")}
    return left | {"cohort": "cohort"}


@pytest.mark.figures
@pytest.mark.thorough
def test_sobol_and_importance_of_any_output(tmp_path, settings, capsys, monkeypatch):
    study = written(tmp_path, settings)
    command("run", study, "--out", tmp_path / "out")
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
    _check_store_and_figures(tmp_path / "out")
    _check_results(tmp_path / "out", result)
    monkeypatch.setattr(pipeline, "_draw", lambda *_: None)  # once is enough
    _check_page(tmp_path)
    capsys.readouterr()
    command("watch", tmp_path / "out", "--once")
    assert "dogbone" in capsys.readouterr().out

    settings["sobol"]["output"] = "narrowing"
    command("run", written(tmp_path, settings), "--out", tmp_path / "out")
    assert "sobol: 0 new evaluations" in capsys.readouterr().out
    other = json.loads((tmp_path / "out" / "sobol.json").read_text())
    assert other["ST"] == pytest.approx(result["outputs"]["narrowing"]["ST"])


def _check_store_and_figures(out: Path) -> None:
    (table,) = sinew.results(out).xarray()["evaluations"].children.values()
    assert table["gauge_stress_relaxation"].dims == ("row", "time_relaxation")
    assert table["gauge_stress_relaxation"].attrs["units"] == "MPa"
    assert table["summary_narrowing"].dims == ("row", "protocol")
    assert table["parameters"].sizes["row"] == 24
    assert "objective" not in table
    assert np.allclose(table["summary_force"].squeeze(), table["force_relaxation"].max("time_relaxation"))
    along = xr.open_zarr(out / "store.zarr", group=f"sobol_time/{table.name}", consolidated=False)
    assert along["ST_narrowing_relaxation"].dims == ("parameter", "time_relaxation")
    figures = {path.name for path in (out / "figures").glob("*")}
    drawn = {f"sobol_time_{table.name}{ending}" for ending in ("", "_gauge_stress", "_shoulder_stress", "_narrowing")}
    assert {f"{name}.{kind}" for name in ("sobol", "importance", *drawn) for kind in FORMATS} <= figures
    shown = pd.read_csv(out / "figures" / f"sobol_time_{table.name}_narrowing.csv")
    assert shown.columns.to_list() == ["protocol", "parameter", "time_s", "displacement_mm", "ST", "ST_conf"]


def _check_results(out: Path, result: dict) -> None:
    results = sinew.results(out)
    (table,) = results.xarray()["evaluations"].children.values()
    assert results.sobol.table.loc["narrowing", "ST"].idxmax() == "nu"
    assert set(results.sobol.plots["time"]) == set(result["outputs"])
    results.sobol.plot("time", "narrowing")
    _, values = results.salib_samples("dogbone")
    assert values == pytest.approx(table["summary_force"].to_numpy()[:, 0])
    assert results.salib_result("narrowing")["ST"] == pytest.approx(result["outputs"]["narrowing"]["ST"])
    assert "summary_narrowing_relaxation" in results.samples(table.name)


def _check_page(folder: Path) -> None:
    built = build(folder / "out")
    assert built.trouble == ()
    assert all(words in built.path.read_text() for words in ("Nothing was measured", "narrowing", "it needs measured"))
    again = re.search("sinew (run .*)AGAIN", html.unescape(built.path.read_text()))
    command(*shlex.split(again[1]), folder / "again")
    assert (folder / "again" / "sobol.json").read_bytes() == (folder / "out" / "sobol.json").read_bytes()


@pytest.mark.thorough
def test_from_a_curve_to_its_parameters_and_predictions(tmp_path, settings):
    settings["model"]["parameters"]["nu"] = {"fixed": 0.3}  # of a bar in tension it hardly matters to the force
    settings["calibrate"] = {"methods": ["least_squares"], "evaluations": 32, "starts": 1}
    settings["infer"] = {"population": 4, "generations": 1, "epsilon": 3.0, "pending": 4}
    settings["predict"] = {"draws": 2}
    settings["tasks"] = ["calibrate", "infer", "predict"]
    sited = with_cohort(tmp_path, settings)
    (tmp_path / "cohort" / "here").mkdir()
    shutil.move(tmp_path / "cohort" / "made", tmp_path / "cohort" / "here" / "made")
    command("run", written(tmp_path, sited), "--out", tmp_path / "out", "--quiet")
    results = sinew.results(tmp_path / "out")
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
    assert "Not run yet: <code>sinew discover" in built.path.read_text()


@pytest.mark.thorough
def test_an_output_that_was_measured_is_compared_beside_the_force(tmp_path, settings, capsys):
    settings["calibrate"] = {"methods": ["least_squares"], "evaluations": 48, "starts": 1}
    settings["measured"] = {"force": {"noise": 0.05}, "narrowing": {"column": "width_loss_mm", "noise": 0.001}}
    settings["tasks"] = ["sobol", "importance", "calibrate"]
    unmeasured = {name: value for name, value in settings.items() if name != "measured"}
    sited = with_cohort(tmp_path, unmeasured) | {"measured": settings["measured"]}
    (tmp_path / "cohort" / "made" / "note.txt").write_text("not read")
    file = tmp_path / "cohort" / "made" / "relaxation.csv"
    seen = pd.read_csv(tmp_path / "truth" / "dogbone.relaxation.narrowing.csv")["row_0"]
    noise = np.random.default_rng(1).standard_normal((2, len(seen))) * [[0.05], [0.001]]
    table = pd.read_csv(file)
    table["force_N"] += noise[0]
    table["width_loss_mm"] = (seen + noise[1]).where(np.arange(len(seen)) % 2 == 0)
    table.to_csv(file, index=False)
    command("run", written(tmp_path, sited), "--out", tmp_path / "out")
    told = capsys.readouterr().out
    assert "the sum of RMSE / noise over protocols and quantities" in told
    (fit,) = json.loads((tmp_path / "out" / "calibrate.json").read_text())["specimens"].values()
    assert fit["parameters"]["nu"] == pytest.approx(TRUTH[1], abs=0.02)
    assert "nu" in fit["determined"]
    assert fit["quantities"]["narrowing"]["unit"] == "mm"
    assert fit["quantities"]["narrowing"]["rmse"]["relaxation"] == pytest.approx(0.001, rel=0.5)
    assert 0.5 < fit["objective"] / 2 < 1.5
    sobol = json.loads((tmp_path / "out" / "sobol.json").read_text())
    assert sobol["objective"] == "sum over protocols and quantities of RMSE over noise"
    assert set(sobol["outputs"]) >= {"force", "narrowing"}
    assert set(json.loads((tmp_path / "out" / "importance.json").read_text())["outputs"]) == set(sobol["outputs"])
    stored = max(
        sinew.results(tmp_path / "out").xarray()["evaluations"].children.values(), key=lambda t: t.sizes["row"]
    )
    assert stored["rmse_narrowing"].attrs["units"] == "mm"
    assert stored["objective"].attrs["units"] == "1"
    sums = stored["rmse_force"] / 0.05 + stored["rmse_narrowing"] / 0.001
    np.testing.assert_allclose(stored["objective"], sums)
    (row,) = pd.read_csv(tmp_path / "out" / "calibrate.csv").to_dict("records")
    assert row["rmse_narrowing_mm"] == pytest.approx(fit["quantities"]["narrowing"]["rmse"]["relaxation"], rel=1e-4)


@pytest.mark.parametrize(
    ("quantities", "words"),
    [
        ({"force": {}, "narrowing": {"column": "width_um"}}, "'width_um' is in um, the simulator's narrowing is in mm"),
        ({"force": {}, "width": {}}, "expected force or one of its: gauge_stress, shoulder_stress, narrowing"),
    ],
)
def test_quantities_that_a_template_does_not_give_are_refused(tmp_path, settings, quantities, words):
    (tmp_path / "study.yaml").write_text(yaml.safe_dump(settings | {"measured": quantities}, sort_keys=False))
    with pytest.raises(BadInput, match="measured") as refused:
        sinew.read_study(tmp_path / "study.yaml")
    assert words in str(refused.value)


def test_a_machine_around_a_model_of_ones_own(tmp_path, settings):
    settings["model"]["effects"] = ["machine-compliance", "force-drift"]
    settings["model"]["parameters"] |= {"compliance": {"min": 0, "max": 0.02}, "force_slope": {"fixed": 0.0}}
    rows = tmp_path / "rows.csv"
    names = [*NAMES, "compliance", "force_offset", "force_slope"]
    truth = ",".join(map(str, TRUTH))
    rows.write_text(f"{','.join(names)}\n{truth},0,0,0\n{truth},0.01,0,0\n{truth},0,2,0\n")
    command("simulate", written(tmp_path, settings), "--parameters", rows, "--out", tmp_path / "out", "--quiet")
    rigid, soft, offset = pd.read_csv(tmp_path / "out" / "dogbone.relaxation.csv").filter(like="row_").to_numpy().T
    np.testing.assert_allclose(offset, rigid + 2.0, rtol=1e-9)
    assert 0.02 < 1.0 - soft.max() / rigid.max() < 0.2
    assert (soft[1:] < rigid[1:]).all()


def test_failures_are_rows_with_reasons(tmp_path, settings):
    program = Path(settings["simulator"]["executable"])
    text = program.read_text()
    program.write_text(text.replace("    E, nu = number", "    if number(root, './/elastic/E') > 30:\n"
                                    "        raise ValueError('too stiff')\n    E, nu = number", 1))  # fmt: skip
    (tmp_path / "rows.csv").write_text("E_matrix\n10\n40\n")
    study = written(tmp_path, settings)
    command("simulate", study, "--parameters", tmp_path / "rows.csv", "--out", tmp_path / "out", "--quiet")
    told = json.loads((tmp_path / "out" / "simulate.json").read_text())
    (failure,) = told["failures"]
    assert failure["row"] == 1
    assert failure["status"] in STATUSES
    assert "too stiff" in failure["message"]
    table = pd.read_csv(tmp_path / "out" / "dogbone.relaxation.narrowing.csv")
    assert table["row_0"].notna().all()
    assert table["row_1"].isna().all()


@pytest.mark.febio
def test_the_real_solver_finds_its_own_parameters_again(tmp_path, settings):
    settings["simulator"]["executable"] = "febio4"
    settings["calibrate"] = {"methods": ["least_squares"], "evaluations": 160, "starts": 1}
    study = written(tmp_path, with_cohort(tmp_path, settings))
    command("calibrate", study, "--out", tmp_path / "out", "--workers", "2", "--quiet")
    found = json.loads((tmp_path / "out" / "calibrate.json").read_text())["specimens"]["made"]
    for name, value in zip(NAMES, TRUTH, strict=True):
        assert found["parameters"][name] == pytest.approx(value, rel=0.01), name
