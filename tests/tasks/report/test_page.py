"""The page of a result folder: what is on it."""

import html
import json
import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from sinew.runner.errors import StoreError
from sinew.runner.store.store import Store
from sinew.tasks.calibrate.result import CalibrateResult
from sinew.tasks.cluster.spec import cluster_of
from sinew.tasks.data.cohort import Cohort
from sinew.tasks.data.virtual import virtual_cohort
from sinew.tasks.drawing import plots
from sinew.tasks.drawing.blocks import number, percent
from sinew.tasks.model import Model
from sinew.tasks.report import folder, page
from sinew.tasks.report.comparison import compare
from sinew.tasks.report.page import build
from sinew.tasks.report.sections import data
from sinew.tasks.simulate.evaluation import SpecimenEvaluation
from sinew.tasks.simulate.uniaxial import Uniaxial
from sinew.tasks.study import pipeline
from sinew.tasks.study.curves import POINTS, keep_curves, represented
from sinew.tasks.study.study import read_study
from sinew.tasks.study.workspace import Workspace, open_workspace
from tests.tasks.measured import study_of, write_measured
from tests.tasks.report.conftest import edit
from tests.tasks.report.pages import SECTIONS, keep_only, read

pytestmark = pytest.mark.page


def test_a_run_leaves_a_page_with_every_section(whole_run):
    seen = read(whole_run)
    assert tuple(seen.sections) == ("summary", *SECTIONS)
    assert build(whole_run).trouble == ()
    for name in SECTIONS:
        assert "Not run yet" not in seen.sections[name], name
    summary = seen.sections["summary"]
    for word in ("sobol", "done", "found", "how sure", "total order indices", "effective sample size", "AUC"):
        assert word in summary
    sobol = json.loads((whole_run / "sobol.json").read_text())
    strongest = int(np.argmax(sobol["ST"]))
    assert f"{sobol['names'][strongest]} {sobol['ST'][strongest]:.2f}" in summary
    assert json.loads((whole_run / "discover.json").read_text())["verdict"] in summary


def test_peaks_of_a_compression_are_negative():
    """The largest in size counts, whichever protocol it is of."""
    bar = {"length_mm": 10.0, "width_mm": 2.0, "thickness_mm": 1.0}
    pulled = represented("pull", np.arange(3.0), np.array([0, 0.1, 0.2]), np.array([0, 0.5, 1.0]))
    pushed = represented("push", np.arange(3.0), np.array([0, -1.0, -2.0]), np.array([0, -2.0, -4.0]))
    found = SimpleNamespace(measured={"m": {"pull": pulled, "push": pushed}})
    (row,) = data._table(found, {"m": bar}, {}).rows
    assert row[-3:] == ["-4", "-2", "-20"]


def test_the_page_says_how_to_make_it_again(whole_run):
    told = read(whole_run).sections["provenance"]
    events = [json.loads(line) for line in (whole_run / "log.jsonl").read_text().splitlines()]
    run = next(event for event in events if event["message"] == "run started")
    for fact in (run["version"], run["code"], run["cohort_hash"], run["study_hash"], run["packages"]["numpy"]):
        assert fact in told
    assert "sinew run " in told
    assert "--seed 3" in told
    assert run["study_text"].strip() in told
    assert json.loads((whole_run / "sobol.json").read_text())["inputs"] in told
    assert re.search(r"core-hours in evaluations\s*[\d.e-]+", told)


def test_curves_and_numbers_are_those_of_the_store(whole_run):
    """What a picked specimen shows: measured and fitted forces, as far apart as the calibration says."""
    scripts = {found.get("id"): text for found, text in read(whole_run).scripts}
    shown = json.loads(scripts["calibration-curves-data"])["data"]
    fits = json.loads((whole_run / "calibrate.json").read_text())["specimens"]
    assert set(shown) == set(fits)
    for name, told in fits.items():
        for protocol, rmse in told["rmse_N"].items():
            columns = {key: np.array(values) for key, values in shown[name][protocol].items()}
            np.testing.assert_allclose(columns["left"], columns["measured"] - columns["model"], atol=0.2)
            assert np.sqrt(np.mean(columns["left"] ** 2)) == pytest.approx(rmse, rel=1e-3), "all points are drawn"


def test_what_parameters_are_stands_beside_their_values(whole_run):
    sections, fits = read(whole_run).sections, json.loads((whole_run / "calibrate.json").read_text())
    for section in ("calibration", "posterior"):
        assert "fibre modulus in the linear region" in sections[section]
    told = fits["specimens"]["distal/1"]
    width = dict(zip(fits["free"], fits["bounds"], strict=True))["E_f"]
    sd = told["sd_of_range"]["E_f"] * (width[1] - width[0])
    value = number(told["parameters"]["E_f"], 4)
    ends = " (on a bound)" if "E_f" in told["on_bound"] else f" ± {number(sd, 2)}"
    assert value + (ends if "E_f" in told["determined"] else " (not determined)") in sections["calibration"]


def test_a_thinned_curve_keeps_its_largest_force_and_displacement():
    time = np.linspace(0.0, 100.0, 5001)
    moved, force = np.sin(0.31 * time), np.cos(0.17 * time)
    moved[1234], force[4321] = 1.5, -7.0
    columns = {"time_pull": time, "displacement_pull": moved, "measured_pull": force, "protocol": np.array(["pull"])}
    ((name, curve),) = folder._curves(SimpleNamespace(coordinate=columns.get))
    assert (name, curve.total, curve.time_s.size <= POINTS) == ("pull", 5001, True)
    assert (curve.displacement_mm.max(), curve.force_N.min()) == (1.5, -7.0)


def test_measured_curves_are_those_of_the_cohort_however_few_points_are_stored(tmp_path):
    (specimen, *_), _ = virtual_cohort(seed=3, per_site=1, rate_hz=20.0)
    with Store.writing(tmp_path, "study") as store:
        store.table(SpecimenEvaluation(Model(), specimen, Uniaxial(), 8).table())
        older = folder.read_folder(tmp_path).measured
        keep_curves(store, Cohort(tmp_path, (specimen,)))
    assert {curve.total for curve in older[specimen.name].values()} == {8}
    for curve in specimen.curves:
        drawn = folder.read_folder(tmp_path).measured[specimen.name][curve.name]
        assert (drawn.force_N.min(), drawn.force_N.max()) == (curve.force_N.min(), curve.force_N.max())


def test_the_page_tells_the_files_of_curves(whole_run, monkeypatch):
    found = folder.read_folder(whole_run)
    assert "Files that the curves were read from" not in [block.caption for block in tables_of(found)]
    name, every = next(iter(found.measured.items()))
    protocol, curve = next(iter(every.items()))
    monkeypatch.setitem(every, protocol, replace(curve, source="T1.csv: force from 'Load' in kN"))
    (table,) = (one for one in tables_of(found) if one.caption == "Files that the curves were read from")
    assert table.rows == [[name, protocol, "T1.csv: force from 'Load' in kN"]]


def tables_of(found):
    return [block for block in data.section(found).blocks if block.kind == "table"]


def test_the_largest_stress_and_strain_of_each_specimen(whole_run):
    told = " ".join(read(whole_run).sections["data"].split())
    described = json.loads((whole_run.parent / "cohort" / "distal" / "1" / "specimen.json").read_text())
    curves = [
        np.loadtxt(path, delimiter=",", skiprows=1)
        for path in (whole_run.parent / "cohort" / "distal" / "1").glob("*.csv")
    ]
    peak = max(np.abs(curve[:, 2]).max() for curve in curves)
    stress = peak / (described["width_mm"] * described["thickness_mm"])
    strain = 100 * max(curve[:, 1].max() for curve in curves) / described["length_mm"]
    assert f"{number(peak)}{number(stress)}{number(strain)}" in told, "cells beside each other"


def test_stress_over_strain_are_force_and_displacement_by_the_sizes(whole_run):
    scripts = {found.get("id"): text for found, text in read(whole_run).scripts}
    shown = json.loads(scripts["data-curves-data"])["data"]["distal/1"]
    described = json.loads((whole_run.parent / "cohort" / "distal" / "1" / "specimen.json").read_text())
    area = described["width_mm"] * described["thickness_mm"]
    for columns in shown.values():
        np.testing.assert_allclose(columns["stress"], np.divide(columns["force"], area), rtol=1e-3)
        strain = 100 * np.divide(columns["displacement"], described["length_mm"])
        np.testing.assert_allclose(columns["strain"], strain, rtol=1e-3)


def test_the_fit_is_told_in_percent_of_the_peak_and_as_r2(whole_run):
    told = " ".join(read(whole_run).sections["calibration"].split())
    fit = CalibrateResult.read(whole_run).specimens["distal/1"]
    protocol, rmse = next(iter(fit.rmse_N.items()))
    peak = fit.peak_N[protocol]
    assert f"{protocol} {number(rmse)} N ({number(100 * rmse / peak, 2)} % of the peak, R² 0.9" in told


def test_a_specimen_without_sizes_has_no_stress(whole_run, monkeypatch):
    monkeypatch.setattr(data, "_geometry", lambda *_: {"length_mm": 10.0, "width_mm": None, "thickness_mm": None})
    found = data.section(folder.read_folder(whole_run))
    (table,) = (block for block in found.blocks if block.kind == "table")
    assert all((row[2], row[3], row[4], row[-2]) == ("10", "–", "–", "–") for row in table.rows)
    assert all(row[-1] != "–" for row in table.rows)
    drawn = [plot.name for block in found.blocks if block.kind == "plots" for plot in block.plots]
    assert drawn == ["data-time", "data-displacement"]


def test_the_summary_tells_of_few_particles_and_of_all_bands(run_folder):
    keep_only(run_folder, "infer", "predict")
    edit(run_folder / "infer.json", lambda told: told["sites"]["distal"].update(effective_sample_size=3.0))
    edit(run_folder / "infer.json", lambda told: told["sites"]["middle"].update(effective_sample_size=500.0))
    build(run_folder)
    sections = read(run_folder).sections
    assert "worth few particles: distal" in sections["summary"]
    assert "distal: the particles are worth fewer than 100 of equal weight" in sections["posterior"]
    coverage = json.loads((run_folder / "predict.json").read_text())["coverage"]
    shown = [percent(told["all"]) for told in coverage.values() if told["all"] is not None]
    assert len(shown) >= 2
    assert all(f"{part} in the band of" in sections["summary"] for part in shown)


def test_parameters_of_an_effect_are_those_of_the_candidate_that_was_judged(run_folder):
    keep_only(run_folder, "discover")
    found = json.loads((run_folder / "discover.json").read_text())
    judged = found["candidates"][-1]
    edit(run_folder / "discover.json", lambda told: told.update(shown=judged["effects"]))
    build(run_folder)
    told = " ".join(read(run_folder).sections["discovery"].split())
    assert f"Parameters of {' + '.join(judged['effects'])}, with 90 % intervals" in told
    for every in judged["parameters"].values():
        for name, parameter in every.items():
            assert name + number(parameter["value"], 4) + parameter["unit"] in told, "cells beside each other"


@pytest.mark.parametrize(
    ("names", "words"), [(("a/1", "a/2"), "it needs two sites"), (("a/1", "b/1"), "Not run yet: `sinew compare")]
)
def test_one_site_is_told_why_there_is_nothing_to_compare(run_folder, names, words):
    (run_folder / "compare.json").unlink()
    log = run_folder / "log.jsonl"
    lines = [line for line in log.read_text().splitlines() if json.loads(line).get("task") != "compare"]
    log.write_text("\n".join(lines) + "\n")
    found = folder.read_folder(run_folder)
    vars(found)["measured"] = {name: {} for name in names}
    assert words in found.missing("compare")


@pytest.mark.thorough
def test_equal_folders_give_equal_bytes(whole_run):
    build(whole_run)
    first = (whole_run / "report.html").read_bytes()
    build(whole_run)
    assert (whole_run / "report.html").read_bytes() == first


def test_nothing_comes_from_elsewhere(whole_run):
    seen = read(whole_run)
    for tag, attributes in seen.elements:
        for name in ("src", "srcset", "action", "data", "poster", "formaction"):
            assert name not in attributes, tag
        if tag in ("a", "link"):
            assert re.match(r"#|figures/|data:,", attributes["href"])
    policy = next(found["content"] for tag, found in seen.elements if found.get("http-equiv"))
    assert "default-src 'none'" in policy
    assert "unsafe-eval" not in policy
    assert "unsafe-inline" not in policy.partition("script-src")[2].partition(";")[0]
    style = (whole_run / "report.html").read_text().partition("<style>")[2].partition("</style>")[0]
    assert "url(" not in style
    assert "@import" not in style


def test_a_page_of_27_specimens_with_long_curves_stays_small():
    """27 specimens, three protocols: as many points as a section may take of each curve."""
    columns = {
        name: np.linspace(0.0, 1234.5, 500) / 7 for name in ("time", "displacement", "measured", "model", "left")
    }
    data = {f"site/{k}": dict.fromkeys(("one", "two", "cyclic"), columns) for k in range(27)}
    block = plots.picked("curves", "", "Specimen", data, lambda sources: [])
    assert len(page._json({"data": block.data})) < 2_000_000
    assert len(bytes(page._json({"data": block.data}), "utf-8")) + sum(map(len, page.scripts())) < 15_000_000


@pytest.mark.thorough
def test_quantities_beside_the_force_have_plots_and_columns_of_their_own(tmp_path, monkeypatch):
    monkeypatch.setattr(pipeline, "_draw", lambda *_: None)
    monkeypatch.setattr(Workspace, "client", lambda self: None)
    write_measured(tmp_path, 1, 2.0)
    section = (
        "calibrate: {methods: [least_squares], evaluations: 60, starts: 1}\n"
        "infer: {paper: true, population: 6, generations: 1, epsilon: 3.0, pending: 8}\npredict: {draws: 3}\n"
    )
    study = read_study(study_of(tmp_path, section))
    with open_workspace(study, out=tmp_path / "out", cluster=cluster_of(study), quiet=True) as workspace:
        pipeline.run(workspace, ["calibrate", "infer", "predict"])
    built = build(tmp_path / "out")
    assert built.trouble == ()
    text = html.unescape(built.path.read_text())
    assert "lateral strain: RMSE" in text
    assert "lateral_strain, sum of RMSEs" in text
    assert "(noise alone: 6)" in text
    assert "times the noise" not in text
    assert "one_step: lateral_strain: measured and fitted" in text
    assert (
        "1 specimen of 1 site, 3 curves (cyclic, one_step, two_step); compared beside the force: lateral strain" in text
    )
    assert "Measured lateral strain of the picked specimen over time" in text
    both = compare(tmp_path / "out", tmp_path / "out", tmp_path / "both.html")
    assert both.trouble == ()
    words = html.unescape(both.path.read_text())
    assert "force, lateral_strain" in words
    assert "lateral_strain, sum of RMSEs" in words
    assert "The same for the lateral strain." in text
    assert "Measured points of further quantities inside the bands" in text


def test_a_specimen_has_no_protocols_without_end():
    """Each is looked for in the store, more than once."""
    names = np.array([f"p{number}" for number in range(folder.MAX_PROTOCOLS + 1)])
    few = SimpleNamespace(coordinate=lambda _: names[:-1], folder=Path("out"), title="distal/1 64")
    assert len(folder.protocols_of(few)) == folder.MAX_PROTOCOLS
    with pytest.raises(StoreError, match="distal/1 64 holds 2,001 protocols"):
        folder.protocols_of(SimpleNamespace(**{**vars(few), "coordinate": lambda _: names}))
