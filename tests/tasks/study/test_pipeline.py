"""The command from end to end on small cohorts: what it leaves behind, what it pays for, how it tells of failures."""

import json
import os
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from sinew.runner.store.schema import STATUSES
from sinew.tasks.cli import main as cli
from sinew.tasks.data.cohort import read_cohort, write_cohort
from sinew.tasks.data.virtual import virtual_cohort
from sinew.tasks.model import Model
from sinew.tasks.report.page_head import head
from sinew.tasks.simulate.uniaxial import Uniaxial
from sinew.tasks.study import pipeline, provenance
from sinew.tasks.study.resources import resource
from sinew.tasks.study.study import read_study
from sinew.tasks.study.workspace import Workspace
from tests.conftest import SHARED

STUDY = """
name: small
seed: 11
cohort: cohort
sobol: {base_samples: 32, resamples: 50}
importance: {trees: 20, repeats: 3}
store: {points_per_curve: 16}
"""


@pytest.fixture
def study(tmp_path) -> Path:
    """A study of two specimens, sampled twice a second."""
    specimens, truth = virtual_cohort(seed=1, per_site=1, rate_hz=2.0)
    write_cohort(tmp_path / "cohort", specimens[:2], truth)
    (tmp_path / "study.yaml").write_text(STUDY)
    return tmp_path / "study.yaml"


def sinew(*words: object) -> None:
    """Run the command in this process; it ends by returning or by SystemExit."""
    argv, sys.argv = sys.argv, ["sinew", *map(str, words)]
    try:
        cli.main()
    finally:
        sys.argv = argv


def new_simulations(out: Path) -> list[int]:
    lines = [json.loads(line) for line in (out / "log.jsonl").read_text().splitlines()]
    return [line["new_simulations"] for line in lines if line["message"] == "task finished"]


@pytest.mark.page
@pytest.mark.figures
def test_a_run_leaves_results_arrays_figures_and_a_log(study, tmp_path, capsys):
    out = tmp_path / "out"
    old = out / "attempts" / "states" / "of a row that nobody asks for.state"
    old.parent.mkdir(parents=True)
    old.touch()
    sinew("run", study, "--out", out, "--workers", 2)
    said = capsys.readouterr().out
    assert "E_f" in said
    assert not old.parent.exists()
    assert "points asked" not in said  # base samples were given, nothing was rounded

    sobol = json.loads((out / "sobol.json").read_text())
    names = [parameter.name for parameter in Model().parameters]
    assert sobol["names"] == names
    assert (sobol["rows"], sobol["failed"], sobol["base_samples"]) == (32 * 18, 0, 32)
    for values in (sobol, *sobol["protocols"].values(), *sobol["specimens"].values()):
        for key in ("S1", "S1_conf", "ST", "ST_conf"):
            assert len(values[key]) == 16
    assert set(sobol["protocols"]) == {"one_step", "two_step", "cyclic"}
    assert sobol["protocols"]["cyclic"]["rows"] == 32 * 18
    assert sobol["ST"][names.index("nu_m")] == 0.0
    assert sobol["ST"][names.index("E_f")] > 0.1

    importance = json.loads((out / "importance.json").read_text())
    assert importance["new_simulations"] == 0
    assert sum(importance["impurity_percent"]) == pytest.approx(100)
    assert new_simulations(out) == [2 * 32 * 18, 0]

    tree = xr.open_datatree(out / "store.zarr", engine="zarr", consolidated=False)
    assert tree["sobol"]["ST"].sel(output="total", parameter="E_f").item() == pytest.approx(sobol["ST"][0])
    assert tree["importance"]["permutation"].dims == ("output", "parameter")
    table = next(iter(tree["evaluations"].children.values())).to_dataset()
    assert table["force_cyclic"].dims == ("row", "time_cyclic")
    assert table["objective"].attrs["units"] == "N"
    along = next(iter(tree["sobol_time"].children.values())).to_dataset()
    assert along["ST_cyclic"].dims == ("parameter", "time_cyclic")
    assert np.isnan(along["ST_cyclic"].isel(time_cyclic=0)).all()  # no force, nothing to explain
    assert np.isfinite(along["ST_cyclic"].isel(time_cyclic=slice(5, None))).all()

    figures = {path.name for path in (out / "figures").iterdir()}
    assert {"sobol.png", "sobol.pdf", "sobol_convergence.png", "importance.pdf"} <= figures
    drawn = {name.removesuffix(".png") for name in figures if name.endswith(".png")}
    assert {f"{name}.{kind}" for name in drawn for kind in ("png", "pdf", "csv")} == figures - {".drawn.json"}
    shown = pd.read_csv(out / "figures" / "sobol.csv").set_index(["objective", "parameter"])
    assert shown.loc[("total", "E_f"), "ST"] == pytest.approx(sobol["ST"][names.index("E_f")], rel=1e-6)
    page = (out / "report.html").read_text()
    assert "cannot be shown" not in page
    assert f"E_f {sobol['ST'][0]:.2f}" in page
    assert not list((out / "journal").rglob("*.safetensors"))


@pytest.mark.figures
def test_running_again_simulates_nothing_and_starts_no_cluster(study, tmp_path, in_this_process, monkeypatch):
    out = tmp_path / "out"
    sinew("run", study, "--out", out, "--quiet")
    before = {path: path.read_bytes() for path in out.glob("*.json") if path.name != "progress.json"}
    figures = {path: path.read_bytes() for path in (out / "figures").glob("*.p*")}
    monkeypatch.setattr(Workspace, "client", lambda self: pytest.fail("a cluster was started"))
    (out / "figures" / "importance.png").unlink()
    drawn = {path: path.stat().st_mtime_ns for path in figures if path.exists()}
    sinew("run", study, "--out", out, "--quiet")
    assert new_simulations(out) == [2 * 32 * 18, 0, 0, 0]
    assert before == {path: path.read_bytes() for path in before}
    assert figures == {path: path.read_bytes() for path in (out / "figures").glob("*.p*")}
    again = {path.name for path, moment in drawn.items() if path.stat().st_mtime_ns != moment}
    assert again == {"importance.pdf"}, "only the task of which a figure was missing draws again"


@pytest.fixture
def in_this_process(monkeypatch):
    """Evaluate without a cluster."""
    monkeypatch.setattr(Workspace, "client", lambda self: None)


@pytest.fixture
def shown(tmp_path, monkeypatch):
    """A result folder whose page is current; pages that are built are counted."""
    (tmp_path / "sobol.json").write_text("{}")
    workspace, built = SimpleNamespace(out=tmp_path, simulations=0), []

    def report(folder, console, **_):
        built.append(folder)
        page = folder / "report.html"
        page.write_text(str(head()))
        return page

    monkeypatch.setattr(pipeline, "report", report)
    monkeypatch.setattr(provenance, "code", lambda: "one program")
    assert pipeline._page(workspace, None) == tmp_path / "report.html"
    assert len(built) == 1
    return workspace, built


def newer(path):
    os.utime(path, ns=(time.time_ns() + 10**9,) * 2)


@pytest.mark.parametrize(
    ("change", "again"),
    [
        (lambda workspace, patch: None, False),
        (lambda workspace, patch: setattr(workspace, "simulations", 3), True),
        (lambda workspace, patch: newer(workspace.out / "sobol.json"), True),
        (lambda workspace, patch: (workspace.out / "report.html").unlink(), True),
        (lambda workspace, patch: patch.setattr(provenance, "code", lambda: "another program"), True),
        (lambda workspace, patch: pipeline._remember(workspace.out, {"report.html": None}), True),
    ],
    ids=["nothing", "new rows", "a new result", "the page is gone", "another program", "a failure"],
)
def test_a_page_is_built_again_only_when_something_changed(shown, monkeypatch, change, again):
    workspace, built = shown
    change(workspace, monkeypatch)
    assert pipeline._page(workspace, None) == workspace.out / "report.html"
    assert len(built) == 1 + again


def test_extending_pays_for_new_rows_only(study, tmp_path, in_this_process):
    out = tmp_path / "out"
    sinew("sobol", study, "--out", out, "--quiet")
    sinew("sobol", study, "--out", out, "--quiet", "--extend")
    sobol = json.loads((out / "sobol.json").read_text())
    assert sobol["base_samples"] == 64
    assert new_simulations(out) == [2 * 32 * 18, 2 * 32 * 18]
    assert sobol["convergence"]["base_samples"] == [32, 64]
    fresh = tmp_path / "fresh"
    study.write_text(STUDY.replace("base_samples: 32", "base_samples: 64, scrambles: 1"))
    sinew("sobol", study, "--out", fresh, "--quiet")
    again = json.loads((fresh / "sobol.json").read_text())
    assert again["ST"] == sobol["ST"]


def test_points_are_rounded_aloud(study, tmp_path, in_this_process, capsys):
    study.write_text(STUDY.replace("base_samples: 32", "points: 100"))
    sinew("sobol", study, "--out", tmp_path / "out")
    said = " ".join(capsys.readouterr().out.split())
    assert "100 points asked; the next power of two is 8 base samples, 144 rows for 16 parameters" in said


def test_the_seed_decides_the_numbers(study, tmp_path, in_this_process):
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        sinew("sobol", study, "--out", tmp_path / name, "--seed", seed, "--quiet")
    a, b, c = ((tmp_path / name / "sobol.json").read_bytes() for name in "abc")
    assert a == b != c


@pytest.mark.page
def test_failed_rows_are_told_and_left_out(study, tmp_path, in_this_process, monkeypatch, capsys):
    real = Uniaxial.compare

    def failing(self, model, specimen, curve, parameters, keep):
        compared = real(self, model, specimen, curve, parameters, keep)
        lost = parameters[:, 0] > 270
        compared.status[lost] = STATUSES.index("diverged")
        compared.rmse_N[lost] = np.nan
        compared.force_N[lost] = np.nan
        return type(compared)(compared.rmse_N, compared.force_N, compared.status, tuple("too stiff" for _ in lost))

    monkeypatch.setattr(Uniaxial, "compare", failing)
    out = tmp_path / "out"
    sinew("run", study, "--out", out)
    said = " ".join(capsys.readouterr().out.split())
    sobol = json.loads((out / "sobol.json").read_text())
    assert 0 < sobol["failed"] < sobol["rows"]
    assert sobol["base_samples_used"] < 32
    assert sobol["failures"]["by_status"]["distal/1"] == {"diverged": sobol["failed"]}
    assert np.isfinite(sobol["S1"]).all()
    assert sobol["ST"] == [None] * 16, "a region fails, and more than 0.5 % of the rows"
    assert sobol["convergence"]["base_samples"] == []
    assert np.isfinite(sobol["failures"]["ST_if_largest"]).all()
    assert f"{sobol['failed']} of 576 rows failed; S1 is that of the rows that ran; ST is refused" in said
    assert "refused" in said.split("intervals; columns of protocols show S1")[0]
    page = (out / "report.html").read_text()
    assert "first order indices: " in page and "ST is refused, as more than 0.5 % of the rows failed" in page
    assert json.loads((out / "importance.json").read_text())["failed"] == sobol["failed"]
    sinew("status", out)
    status = capsys.readouterr().out
    assert "diverged: cyclic: too stiff" in status

    monkeypatch.setattr(Uniaxial, "compare", real)
    sinew("sobol", study, "--out", out, "--quiet", "--retry-failed")
    assert json.loads((out / "sobol.json").read_text())["failed"] == 0
    assert new_simulations(out)[-1] == 2 * sobol["failed"]


def test_status_speaks_json(study, tmp_path, in_this_process, capsys):
    sinew("sobol", study, "--out", tmp_path / "out", "--quiet")
    capsys.readouterr()
    sinew("status", tmp_path / "out", "--json")
    found = json.loads(capsys.readouterr().out)
    assert [table["done"] for table in found["tables"]] == [576, 576]
    assert found["results"] == ["sobol"]


def test_simulate_writes_every_row_at_every_measured_point(study, tmp_path, capsys):
    rows = tmp_path / "rows.csv"
    rows.write_text("E_f,tau_1m\n200,0.5\n170,1.5\n")
    sinew("simulate", study, "--parameters", rows, "--out", tmp_path / "out")
    model = Model()
    values = model.full(("E_f", "tau_1m"), np.array([[200, 0.5], [170, 1.5]]))
    for specimen in read_cohort(tmp_path / "cohort").specimens:
        for curve in specimen.curves:
            table = pd.read_csv(tmp_path / "out" / f"{specimen.name}.{curve.name}.csv")
            assert list(table) == ["time_s", "displacement_mm", "row_0", "row_1"]
            expected = Uniaxial().simulate(model, specimen, curve.protocol, values).force_N
            assert np.array_equal(table[["row_0", "row_1"]].to_numpy().T, expected)
            assert np.array_equal(table["time_s"].to_numpy(), curve.protocol.time_s)
    assert json.loads((tmp_path / "out" / "simulate.json").read_text())["failed"] == 0


@pytest.mark.febio
def test_both_engines_run_the_same_study(study, tmp_path):
    rows = tmp_path / "rows.csv"
    rows.write_text("E_f,nu_m\n200,0.1\n170,0.3\n")
    for engine in ("uniaxial", "febio"):
        sinew("simulate", study, "--parameters", rows, "--out", tmp_path / engine, "--simulator", engine, "--quiet")
    for file in (tmp_path / "uniaxial").rglob("*.*.csv"):
        ours, solver = (
            pd.read_csv(tmp_path / e / file.relative_to(tmp_path / "uniaxial")) for e in ("uniaxial", "febio")
        )
        peak = ours["row_0"].abs().max()
        assert np.abs(ours - solver).to_numpy().max() < 1e-6 * peak
    study.write_text(STUDY.replace("base_samples: 32", "base_samples: 2"))
    sinew("sobol", study, "--out", tmp_path / "out", "--simulator", "febio", "--quiet")
    assert json.loads((tmp_path / "out" / "sobol.json").read_text())["failed"] == 0
    assert not list((tmp_path / "out" / "attempts").iterdir())


@pytest.mark.shared
@pytest.mark.parametrize("case", ["dev-1/case_01", "dev-null/case_01"])
def test_cohorts_without_sites_are_read(case):
    folder = SHARED / "hidden" / case
    cohort = read_cohort(folder)
    assert [specimen.name for specimen in cohort.specimens] == ["s01", "s02"]
    assert all(len(specimen.curves) == 3 for specimen in cohort.specimens)


def test_second_order_indices_are_there_when_asked_for(study, tmp_path, in_this_process):
    fixed = "".join(f"    {p.name}: {{fixed: {p.reference}}}\n" for p in Model().parameters[3:])
    second = STUDY.replace("resamples: 50", "resamples: 50, second_order: true")
    study.write_text(f"{second}model:\n  parameters:\n{fixed}")
    sinew("run", study, "--out", tmp_path / "out", "--quiet")
    sobol = json.loads((tmp_path / "out" / "sobol.json").read_text())
    assert sobol["names"] == ["E_f", "alpha_f", "g_1f"]
    assert sobol["rows"] == 32 * 8
    assert sobol["S2"][0][1] is not None
    assert sobol["S2"][1][0] is None  # SALib fills the upper triangle


@pytest.mark.parametrize("config", sorted(resource("configs").glob("*.yaml")), ids=lambda path: path.stem)
def test_ready_studies_are_valid(config):
    assert read_study(config).name == config.stem


def test_a_protocol_may_not_be_called_total(study, tmp_path, capsys):
    curve = tmp_path / "cohort" / "distal" / "1" / "cyclic.csv"
    curve.rename(curve.with_name("total.csv"))
    with pytest.raises(SystemExit):
        sinew("run", study, "--out", tmp_path / "out")
    assert "total.csv: the name 'total' is taken" in capsys.readouterr().err


def test_changed_bounds_in_one_folder_do_not_mix(study, tmp_path, in_this_process):
    out = tmp_path / "out"
    sinew("sobol", study, "--out", out, "--quiet")
    other = STUDY.replace("points_per_curve: 16", "points_per_curve: 20")
    study.write_text(other + "model: {parameters: {nu_m: {fixed: 0.2}}}\n")
    sinew("run", study, "--out", out, "--quiet")
    assert len(json.loads((out / "sobol.json").read_text())["names"]) == 15


def test_words_from_a_store_cannot_steer_the_terminal(study, tmp_path, in_this_process, monkeypatch, capsys):
    real = Uniaxial.compare

    def shouting(self, model, specimen, curve, parameters, keep):
        compared = real(self, model, specimen, curve, parameters, keep)
        compared.status[0] = STATUSES.index("diverged")
        return type(compared)(compared.rmse_N, compared.force_N, compared.status, ("\x1b[2J[/red]",) * len(parameters))

    monkeypatch.setattr(Uniaxial, "compare", shouting)
    sinew("sobol", study, "--out", tmp_path / "out", "--quiet")
    sinew("status", tmp_path / "out")
    said = capsys.readouterr().out
    assert "\x1b[2J" not in said
    assert "\\x1b[2J[/red]" in said
