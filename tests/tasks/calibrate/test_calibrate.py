"""`sinew calibrate` from end to end: down to the noise, resumed for nothing, the same every time."""

import csv
import json
import shutil
from dataclasses import replace

import pytest

from sinew.tasks.calibrate import figures
from sinew.tasks.calibrate.show import bound_advice
from sinew.tasks.data.cohort import write_cohort
from sinew.tasks.data.noise import noise_of
from sinew.tasks.data.virtual import virtual_cohort
from sinew.tasks.study import pipeline
from sinew.tasks.study.workspace import Workspace
from tests.runner.stores import contents
from tests.tasks.calibrations import calibration_of, fit_of
from tests.tasks.measured import NOISE, study_of, write_measured
from tests.tasks.study.test_pipeline import new_simulations, sinew

STUDY = """
name: fitted
seed: 11
cohort: cohort
tasks: [calibrate]
calibrate:
  methods: [bayesian, hybrid, least_squares]
  starts: 2
  evaluations: 250
  bayesian: {evaluations: 16, initial: 8}
"""


@pytest.fixture
def study(tmp_path):
    specimens, truth = virtual_cohort(seed=1, per_site=1, rate_hz=10.0)
    write_cohort(tmp_path / "cohort", specimens[::2], truth)
    (tmp_path / "study.yaml").write_text(STUDY)
    return tmp_path / "study.yaml"


@pytest.fixture
def here(monkeypatch):
    """Evaluates in this process, and draws no figures of the whole cohort, which take longer than all the rest."""
    monkeypatch.setattr(Workspace, "client", lambda self: None)
    monkeypatch.setattr(figures, "_draw_typical", lambda *_: [])


@pytest.mark.figures
def test_specimens_are_calibrated_down_to_their_noise(study, tmp_path, capsys, here, monkeypatch):
    out = tmp_path / "out"
    sinew("run", study, "--out", out)
    monkeypatch.setattr(pipeline, "_draw", lambda *_: None)
    told = capsys.readouterr().out
    result = json.loads((out / "calibrate.json").read_text())
    assert set(result["specimens"]) == {"distal/1", "proximal/1"}
    for name, found in result["specimens"].items():
        assert name in told
        assert found["above_noise"] < 0.1
        assert found["total_N"] == pytest.approx(sum(found["rmse_N"].values()))
        assert "nu_m" not in found["determined"], "the force says nothing of it"
        assert "E_f" in found["determined"]
        methods = found["methods"]
        assert set(methods) == {"bayesian", "hybrid", "least_squares"}
        assert found["total_N"] == min(method["total_N"] for method in methods.values())
        assert methods["hybrid"]["total_N"] < methods["bayesian"]["total_N"], "polishing helps"
        assert methods["bayesian"]["evaluations"] == 16
        for method in methods.values():
            assert method["evaluations"] <= 250
            totals = [total for _, total in method["trace"]]
            assert totals == sorted(totals, reverse=True)
            assert totals[-1] == method["total_N"]
        assert methods["hybrid"]["trace"][: len(methods["bayesian"]["trace"])] == methods["bayesian"]["trace"]
        for suffix in ("png", "pdf"):
            assert (out / "figures" / f"calibrate_{name.replace('/', '_')}.{suffix}").stat().st_size > 5000
    rows = list(csv.DictReader((out / "calibrate.csv").read_text().splitlines()))
    assert [row["specimen"] for row in rows] == list(result["specimens"])
    assert float(rows[0]["E_f"]) == pytest.approx(result["specimens"]["distal/1"]["parameters"]["E_f"], rel=1e-5)
    first = (out / "calibrate.json").read_bytes()

    sinew("calibrate", study, "--out", out, "--quiet")
    assert new_simulations(out)[-1] == 0
    for gone in ("calibrate.json", "calibrate.csv", "calibrate_sites.csv", "store.zarr/calibrate/distal_1"):
        path = out / gone
        shutil.rmtree(path) if path.is_dir() else path.unlink()
        sinew("calibrate", study, "--out", out, "--quiet")
        assert new_simulations(out)[-1] == 0, "its rows are in the store"
        assert path.exists(), gone
        assert (out / "calibrate.json").read_bytes() == first
    shutil.rmtree(out / "calibrate")  # what was proposed is proposed again, and is the same
    study.write_text(STUDY.replace("initial: 8", "initial: 8, seeds: 0"))
    sinew("calibrate", study, "--out", out, "--quiet")
    assert new_simulations(out)[-1] == 0
    assert json.loads((out / "calibrate.json").read_text())["specimens"] == result["specimens"]


@pytest.mark.page
def test_noise_that_the_model_follows_is_told_as_unknown(study, tmp_path, capsys, here):
    """Cycles alone, of few points each: their sharp toe looks like noise to who has no model."""
    specimens, truth = virtual_cohort(seed=1, per_site=1, rate_hz=4.0)
    cycles = tuple(curve for curve in specimens[0].curves if curve.name == "cyclic")
    shutil.rmtree(tmp_path / "cohort")
    write_cohort(tmp_path / "cohort", [replace(specimens[0], curves=cycles)], truth)
    study.write_text(
        STUDY.replace("[bayesian, hybrid, least_squares]", "[least_squares]").replace("starts: 2", "starts: 1")
    )
    sinew("run", study, "--out", tmp_path / "out")
    (found,) = json.loads((tmp_path / "out" / "calibrate.json").read_text())["specimens"].values()
    assert found["total_N"] < 0.3 * noise_of(*cycles).sd_N
    assert found["noise_N"] is None
    assert found["above_noise"] is None
    assert found["methods"]["least_squares"]["above_noise"] is None
    assert "unknown" in capsys.readouterr().out
    assert "do not tell their noise" in (tmp_path / "out" / "report.html").read_text()


def test_a_parameter_that_is_often_on_a_bound_is_named_with_advice():
    names = {"E_f": 1.0, "g_1f": 1.0, "nu_m": 0.3}
    ends = [(["E_f", "nu_m"], ["E_f"]), (["E_f", "g_1f"], ["E_f", "g_1f"]), ([], ["E_f", "g_1f"])]
    specimens = {str(i): fit_of(names, on_bound=on, determined=known) for i, (on, known) in enumerate(ends)}
    assert "specimens or more: E_f. Widen the range of E_f (model.parameters" in bound_advice(calibration_of(specimens))
    assert bound_advice(calibration_of({"2": specimens["2"]})) == ""
    one = bound_advice(calibration_of({"0": specimens["0"]}))
    assert one.startswith("Determined by the curves, and at an end of their range: E_f. Widen the range of E_f (")


def test_a_parameter_at_zero_is_not_to_be_widened():
    at_zero = {"1": fit_of({"E_f": 0.0, "g_1f": 1.0}, on_bound=["E_f"], determined=["E_f", "g_1f"])}
    found = replace(calibration_of(at_zero), bounds=[(0.0, 300.0), (0.0, 1.0)])
    assert "E_f: at or near 0, the lower end of its range: the model fits as well without it" in bound_advice(found)
    assert "Widen" not in bound_advice(found)
    above = {"1": replace(at_zero["1"], parameters={"E_f": 10.0, "g_1f": 1.0})}
    assert "Widen the range" in bound_advice(replace(found, specimens=above, bounds=[(10.0, 300.0), (0.0, 1.0)]))
    both = {"1": replace(at_zero["1"], on_bound=["E_f", "g_1f"])}
    assert "E_f, g_1f. Widen the range of g_1f (" in bound_advice(replace(found, specimens=both)), "E_f is at 0"


@pytest.mark.thorough
def test_the_store_does_not_depend_on_where_rows_are_evaluated(study, tmp_path, monkeypatch):
    monkeypatch.setattr(pipeline, "_draw", lambda *_: None)
    change = {
        "evaluations: 250": "evaluations: 40",
        "[bayesian, hybrid, least_squares]": "[hybrid]",
        "evaluations: 16, initial: 8": "evaluations: 10, initial: 6",
    }
    text = STUDY
    for old, new in change.items():
        text = text.replace(old, new)
    study.write_text(text)
    sinew("calibrate", study, "--out", tmp_path / "cluster", "--workers", 2, "--quiet")
    monkeypatch.setattr(Workspace, "client", lambda self: None)
    sinew("calibrate", study, "--out", tmp_path / "here", "--quiet")
    assert contents(tmp_path / "cluster" / "store.zarr") == contents(tmp_path / "here" / "store.zarr")
    assert (tmp_path / "cluster" / "calibrate.json").read_bytes() == (tmp_path / "here" / "calibrate.json").read_bytes()


@pytest.mark.thorough
def test_rows_that_the_store_has_inform_the_search(study, tmp_path, here, monkeypatch):
    monkeypatch.setattr(pipeline, "_draw", lambda *_: None)
    out = tmp_path / "out"
    study.write_text(
        STUDY.replace("tasks: [calibrate]", "tasks: [sobol, calibrate]\nsobol: {base_samples: 16}").replace(
            "methods: [bayesian, hybrid, least_squares]", "methods: [bayesian]"
        )
    )
    sinew("run", study, "--out", out, "--quiet")
    sobol = json.loads((out / "sobol.json").read_text())
    found = json.loads((out / "calibrate.json").read_text())["specimens"]["distal/1"]
    with_rows = found["methods"]["bayesian"]
    assert with_rows["evaluations"] == 16
    assert sobol["rows"] == 288
    sinew("calibrate", study, "--out", tmp_path / "bare", "--quiet")
    bare = json.loads((tmp_path / "bare" / "calibrate.json").read_text())["specimens"]["distal/1"]
    assert with_rows["trace"][:8] == bare["methods"]["bayesian"]["trace"][:8], "the random points are the same"
    assert with_rows["trace"][8:] != bare["methods"]["bayesian"]["trace"][8:]


def test_a_specimen_that_is_not_there_is_one_line(study, tmp_path, capsys):
    study.write_text(STUDY.replace("  starts: 2", "  specimens: [distal/7]"))
    with pytest.raises(SystemExit) as ended:
        sinew("calibrate", study, "--out", tmp_path / "out")
    assert ended.value.code == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "calibrate.specimens" in said
    assert not (tmp_path / "out").exists()


def test_the_lateral_strain_tells_poisson_s_ratio(tmp_path, capsys, here, monkeypatch):
    (truth,) = list(write_measured(tmp_path).values())[:1]
    monkeypatch.setattr(pipeline, "_draw", lambda *_: None)
    section = "tasks: [calibrate]\ncalibrate: {methods: [least_squares], starts: 2, evaluations: 200}"
    fits = {}
    for name, compared in (("both", "measured: {force: {}, lateral_strain: {}}"), ("alone", "")):
        sinew("run", study_of(tmp_path, section, compared), "--out", tmp_path / name)
        (fits[name],) = json.loads((tmp_path / name / "calibrate.json").read_text())["specimens"].values()
    both, alone = fits["both"], fits["alone"]
    assert "nu_m" not in alone["determined"]
    assert not {"objective", "quantities"} & set(alone)
    sd = both["sd_of_range"]["nu_m"] * 0.4
    assert "nu_m" in both["determined"]
    assert 0 < sd < 0.01
    assert both["parameters"]["nu_m"] == pytest.approx(truth["nu_m"], abs=2.5 * sd)
    assert alone["rmse_N"] == pytest.approx(both["rmse_N"], rel=0.2), "the force is fitted as well as alone"
    strain, force = both["quantities"]["lateral_strain"], both["quantities"]["force"]
    assert strain["unit"] == "1"
    assert strain["noise"] == pytest.approx(NOISE, rel=0.1)
    assert list(strain["rmse"].values()) == pytest.approx([NOISE] * 3, rel=0.1)
    assert force["rmse"] == both["rmse_N"]
    assert both["total_N"] == pytest.approx(sum(force["rmse"].values()))
    sums = {name: sum(one["rmse"].values()) / one["noise"] for name, one in both["quantities"].items()}
    assert both["objective"] == pytest.approx(sum(sums.values()))
    assert both["above_noise"] == pytest.approx(both["objective"] / 6 - 1)
    (row,) = csv.DictReader((tmp_path / "both" / "calibrate.csv").read_text().splitlines())
    assert float(row["rmse_lateral_strain"]) == pytest.approx(sum(strain["rmse"].values()), rel=1e-5)
    assert "lateral_strain" in capsys.readouterr().out
