"""``import sinew``: results that print and plot, and open as the objects of the libraries that others work with."""

import json
import shutil
import subprocess
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from matplotlib import pyplot as plt
from matplotlib.figure import Figure

import sinew
from sinew.runner.errors import BadInput, SinewError
from sinew.runner.store.schema import STATUSES
from sinew.tasks.model import Model
from sinew.tasks.registry import TASKS
from sinew.tasks.study.files import read_json, write_json
from sinew.tasks.study.workspace import Workspace
from tests.golden.study import FREE
from tests.tasks.calibrations import calibration_of, fit_of


@pytest.fixture(scope="module")
def folder(golden_run: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Results of every task over two specimens of two sites, with their study."""
    return Path(shutil.copytree(golden_run.parent, tmp_path_factory.mktemp("notebook") / "golden")) / "out"


@pytest.fixture
def results(folder: Path) -> sinew.Results:
    return sinew.results(folder)


@pytest.fixture
def copied_run(folder: Path, tmp_path: Path) -> Path:
    """A folder of results that a test may damage."""
    return Path(shutil.copytree(folder, tmp_path / "out"))


@pytest.fixture(autouse=True)
def no_figures_left_open():
    yield
    plt.close("all")


def test_importing_the_package_imports_no_library():
    code = "import sys, sinew; print(sorted({'numpy', 'pandas', 'distributed', 'matplotlib'} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize("name", sinew.__all__)
def test_every_public_name_is_there_and_says_what_it_is(name):
    assert getattr(sinew, name).__doc__
    assert name in dir(sinew)


def test_a_name_that_is_not_there():
    with pytest.raises(AttributeError, match="no attribute 'sobols'"):
        sinew.sobols  # noqa: B018


@pytest.mark.parametrize("task", TASKS)
def test_every_task_prints_and_plots(results, task):
    one = getattr(results, task)
    assert task in repr(one)
    assert len(one.table)
    assert isinstance(one.plot(), Figure)
    html = one._repr_html_()
    assert html.count("<table") == html.count("</table>") == 1
    for name, each in one.plots.items():
        if (task, name) == ("calibrate", "correlations"):
            continue
        figure = one.plot(name, each[-1] if each else None)
        assert isinstance(figure, Figure)
        figure.canvas.draw()
    assert not plt.get_fignums(), "a notebook would show them twice"


def test_results_tell_what_is_there(results):
    assert results.finished == tuple(TASKS)
    for words in (repr(results), results._repr_html_()):
        assert "golden" in words
        assert "largest total indices" in words
        assert results.discover.content["verdict"] in words


def test_tables_hold_the_numbers_of_the_files(results, folder):
    told = json.loads((folder / "sobol.json").read_text())
    assert results.sobol.table.loc[("total", "E_f"), "ST"] == told["ST"][0]
    assert list(results.sobol.table.index.get_level_values("output").unique()) == ["total", *told["protocols"]]
    csv = pd.read_csv(folder / "calibrate.csv", index_col="specimen").astype(float)
    pd.testing.assert_frame_equal(results.calibrate.table[list(csv)].astype(float), csv, rtol=1e-5)
    table3 = pd.read_csv(folder / "infer.csv", index_col="parameter")
    assert results.infer.table.loc[("distal", "E_f"), "mean"] == pytest.approx(table3.loc["E_f", "distal_mean"], 1e-5)


def test_what_is_missing_is_said(results, tmp_path):
    with pytest.raises(SinewError, match="one of indices, convergence, time"):
        results.sobol.plot("pie")
    with pytest.raises(SinewError, match="of 'nobody'; expected one of distal/1, middle/1"):
        results.sobol.plot("time", "nobody")
    with pytest.raises(SinewError, match="expected nothing"):
        results.sobol.plot("indices", "distal/1")
    with pytest.raises(SinewError, match="holds no correlations"):
        results.calibrate.plot("correlations")
    with pytest.raises(SinewError, match="is not there"):
        sinew.results(tmp_path / "nowhere")
    with pytest.raises(SinewError, match="neither a store nor results"):
        sinew.results(tmp_path)
    for call in (results.arviz, results.abc_history):
        with pytest.raises(SinewError, match=r"no posterior of '\.\./x'; expected one of distal, middle"):
            call("../x")
    with pytest.raises(SinewError, match="expected one of distal/1, middle/1"):
        results.skopt_result("nobody")
    with pytest.raises(SinewError, match="expected one of total, "):
        results.salib_result("nothing")


def test_an_unfinished_folder_opens(tmp_path):
    write_json(tmp_path / "importance.json", {"names": ["E_f"]})
    partial = sinew.results(tmp_path)
    assert partial.finished == ("importance",)
    with pytest.raises(SinewError, match=r"importance\.json: impurity_percent: missing; expected what this version's"):
        partial.importance  # noqa: B018
    with pytest.raises(SinewError, match=r"sobol\.json: is not there; expected a finished `sinew sobol`"):
        partial.sobol  # noqa: B018


def test_words_from_a_result_cannot_become_html(tmp_path):
    evil = "<script>alert(1)</script>"
    calibration_of({evil: fit_of({evil: 1.0}, site=evil, method=evil)}).write(tmp_path)
    one = sinew.results(tmp_path)
    assert "<script" not in one._repr_html_() + one.calibrate._repr_html_()
    assert "&lt;script" in one.calibrate._repr_html_()
    for html in (
        one._repr_html_(),
        one.calibrate._repr_html_(),
    ):  # no formula is set, as one may hold a link to a script
        assert html.startswith('<div class="tex2jax_ignore mathjax_ignore">')
        assert html.endswith("</div>")
        assert html.count("<div") == html.count("</div>") == html.count("tex2jax_ignore") + html.count("<div>")


def test_paths_may_be_texts(folder, tmp_path):
    cohort = sinew.read_cohort(str(folder.parent / "cohort"))
    sinew.write_cohort(str(tmp_path / "again"), cohort.specimens)
    assert sinew.read_cohort(tmp_path / "again").specimens[0].name == cohort.specimens[0].name
    with pytest.raises(sinew.BadInput, match=r"gone\.yaml: is not there"):
        sinew.run(str(tmp_path / "gone.yaml"))
    with pytest.raises(sinew.BadInput, match=r"gone\.csv: "):
        sinew.read_exports(str(tmp_path / "gone.csv"))
    with pytest.raises(sinew.BadInput, match="paths: no files"):
        sinew.read_exports([])
    with pytest.raises(sinew.BadInput, match="is not there"):
        sinew.results("a" * 5000)


def test_run_refuses_what_the_command_refuses(folder, tmp_path):
    study = sinew.read_study(folder.parent / "study.yaml")
    with pytest.raises(sinew.BadInput, match="some of sobol, importance"):
        sinew.run(study, "sobols", out=tmp_path)
    for task, before in {name: task.needs for name, task in TASKS.items() if task.needs}.items():
        with pytest.raises(sinew.BadInput, match=f"`sinew {before}` on this study first"):
            sinew.run(study, task, out=tmp_path)
    assert not list(tmp_path.iterdir())


@pytest.mark.figures
def test_running_again_evaluates_nothing(folder, monkeypatch):
    monkeypatch.setattr(Workspace, "client", lambda self: pytest.fail("a cluster was started"))
    before = (folder / "sobol.json").read_bytes()
    again = sinew.run(
        sinew.read_study(folder.parent / "study.yaml"), "sobol", "importance", out=str(folder), figures=True
    )
    assert again == sinew.results(folder)
    assert before == (folder / "sobol.json").read_bytes()
    assert {"sobol.png", "importance.png"} <= {path.name for path in again.figures}


# ---- other libraries


def test_the_store_opens_in_xarray(results, folder):
    tree = results.xarray()
    assert tree["sobol"]["ST"].sel(output="total", parameter="E_f").item() == results.sobol.content["ST"][0]
    tables = [name for name in tree["evaluations"].children if name.startswith("distal-1")]
    one = xr.open_zarr(folder / "store.zarr", group=f"evaluations/{tables[0]}", consolidated=False)
    assert one["force_cyclic"].attrs["units"] == "N"


def test_salib_analyses_the_sample_and_finds_the_indices(results):
    from SALib import ProblemSpec
    from SALib.analyze import sobol

    problem = results.salib_problem()
    assert problem["names"] == list(FREE)
    by_name = {parameter.name: parameter for parameter in Model().parameters}
    assert problem["bounds"] == [[by_name[name].minimum, by_name[name].maximum] for name in FREE]
    x, y = results.salib_samples("distal/1")
    assert x.shape == (16 * 5, 3)
    found = sobol.analyze(problem, y, calc_second_order=False, num_resamples=20, seed=1)
    stored = results.sobol.content["specimens"]["distal/1"]
    assert np.allclose(found["S1"], stored["S1"])
    assert np.allclose(found["ST"], stored["ST"])
    spec = ProblemSpec(problem).set_samples(x).set_results(y)
    assert np.allclose(spec.analyze_sobol(calc_second_order=False, num_resamples=20).analysis["ST"], stored["ST"])


def test_salib_results_plot_themselves(results):
    for output in ("total", "cyclic"):
        found = results.salib_result(output)
        total, first = found.to_df()
        assert list(total.index) == list(FREE)
        assert np.allclose(first["S1"], results.sobol.table.loc[output, "S1"])
        axes = found.plot()
        assert len(axes) == 2


def test_the_history_is_pyabcs_own(results):
    import pyabc.visualization as visualization

    history = results.abc_history("distal")
    frame, weight = history.get_distribution(m=0)
    kept = results.xarray()["infer/distal"]
    assert np.array_equal(frame[list(FREE)].to_numpy(), kept["parameters"].values[-1])
    assert weight.sum() == pytest.approx(1)
    assert history.max_t == 1
    visualization.plot_epsilons(history)
    visualization.plot_kde_1d(frame, weight, x="E_f")


def test_the_posterior_is_arvizs_own(results):
    data = results.arviz("distal")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FutureWarning)
        import arviz
    told = arviz.summary(data, kind="stats")
    for name in FREE:
        assert told.loc[name, "mean"] == pytest.approx(results.infer.table.loc[("distal", name), "mean"], rel=0.05)


def test_the_search_is_skopts_own(results, folder):
    from skopt.plots import plot_convergence, plot_evaluations, plot_objective

    found = results.skopt_result("distal/1")
    totals = found.func_vals
    assert len(found.x_iters) == totals.size == 12
    assert found.fun == totals.min()
    assert found.space.dimension_names == list(FREE)
    assert all(
        low <= value <= high for x in found.x_iters for value, (low, high) in zip(x, found.space.bounds, strict=True)
    )
    plot_convergence(found)
    plot_evaluations(found)
    told = read_json(folder / "calibrate.json")["specimens"]["distal/1"]["methods"]["bayesian"]
    assert found.fun == pytest.approx(told["total_N"])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of a process that is fitted to few points
        learned = results.skopt_result("distal/1", surrogate=True)
    plot_objective(learned, n_points=5, n_samples=5)


@pytest.mark.parametrize("format", ["csv", "parquet"])
def test_tables_go_into_files_and_come_back(results, tmp_path, format):
    paths = results.export(tmp_path / "tables", format)
    assert {path.suffix for path in paths} == {f".{format}"}
    assert {path.stem for path in paths} == set(results.tables())
    read = {"csv": pd.read_csv, "parquet": pd.read_parquet}[format]
    found = {path.stem: read(path) for path in paths}
    particles = found["particles_distal"]
    assert particles.groupby("generation")["weight"].sum().to_numpy() == pytest.approx(1)
    assert np.allclose(particles["E_f"], results.particles("distal")["E_f"], rtol=1e-14)
    name = next(name for name in found if name.startswith("samples_distal-1"))
    samples = found[name]
    assert set(samples["status"]) <= {"pending", *STATUSES}
    protocols = [column for column in samples if column.startswith("rmse_")]
    assert samples[protocols].sum(axis=1).to_numpy() == pytest.approx(samples["total_N"].to_numpy())
    assert "E_f" in set(found["sobol"]["parameter"])


def test_a_format_that_is_not_there(results, tmp_path):
    with pytest.raises(SinewError, match="csv or parquet"):
        results.export(tmp_path, "pickle")
    with pytest.raises(SinewError, match="no evaluations 'x'"):
        results.samples("x")


def edit(path: Path, change: Callable[[dict[str, Any]], object]) -> None:
    content = json.loads(path.read_text())
    change(content)
    path.write_text(json.dumps(content))


CONTRADICTIONS = {
    "compare": ("infer", lambda one: one.update(names=["x"] * len(one["names"]))),
    "predict": ("infer", lambda one: [site.update(specimens=[]) for site in one["sites"].values()]),
    "infer": ("calibrate", lambda one: [fit["parameters"].pop("E_f") for fit in one["specimens"].values()]),
}


@pytest.mark.parametrize("task", CONTRADICTIONS)
def test_a_result_that_contradicts_itself_is_one_line_where_another_task_uses_it(folder, copied_run, task, monkeypatch):
    monkeypatch.setattr(Workspace, "client", lambda self: pytest.fail("a cluster was started"))
    of, change = CONTRADICTIONS[task]
    (copied_run / f"{task}.json").unlink()
    edit(copied_run / f"{of}.json", change)
    with pytest.raises(BadInput, match=rf"{of}\.json: .*; expected what .*`sinew {of}` writes; run it again"):
        sinew.run(sinew.read_study(folder.parent / "study.yaml"), task, out=str(copied_run))


def test_a_result_that_contradicts_itself_is_one_line_in_a_notebook(copied_run, monkeypatch):
    monkeypatch.setattr("sinew.tasks.sobol.show.headline", lambda result: result.protocols["of another study"])
    with pytest.raises(BadInput, match=r"sobol\.json: contradicts itself, or the store \(KeyError"):
        repr(sinew.results(copied_run).sobol)
    edit(copied_run / "sobol.json", lambda one: one.update(ST=[]))
    with pytest.raises(BadInput, match=r"sobol\.json: content: ST: 0 numbers for 3 names"):
        repr(sinew.results(copied_run).sobol)


IMPOSSIBLE = [
    ("compare", lambda one: one["pairs"][0].update(auc=7.3), r"pairs\.0\.auc: 7\.3: expected 0 to 1"),
    (
        "compare",
        lambda one: one["pairs"][0]["interval"].__setitem__(1, -4.0),
        r"pairs\.0\.interval: .*: expected 0 to 1",
    ),
    ("compare", lambda one: one["pairs"][0].update(sites=["a", "b"]), "content: sites a, b, which are not compared"),
    ("compare", lambda one: one["component"].update(explained_variance=42), "explained_variance: 42: expected 0 to 1"),
    ("predict", lambda one: one["coverage"]["hdi"].update(all=4.2), "all: 4.2: expected 0 to 1"),
    ("predict", lambda one: one["coverage"]["hdi"].update(points=-7), "points: -7: expected at least 0"),
    ("predict", lambda one: one.update(failed=one["rows"] + 1), "content: [0-9]+ of [0-9]+ simulations failed"),
    ("calibrate", lambda one: first_fit(one).update(r2=dict.fromkeys(first_fit(one)["r2"], 55)), "r2.*: 55: expected"),
    ("calibrate", lambda one: first_fit(one).update(total_N=-3), "total_N: -3: expected at least 0"),
    (
        "calibrate",
        lambda one: first_fit(one)["parameters"].update(E_f=-1e9),
        "content: E_f -1e.09 of distal/1, outside",
    ),
    ("infer", lambda one: one.update(names=["x"]), "content: units: 3 of 1 parameters"),
    ("calibrate", lambda one: one.update(free=["x"] * 1001), "free: 1,001 entries; expected at most 1,000"),
    (
        "predict",
        lambda one: first_site(one).update(stresses_of="\ud800"),
        "itself, or the store .UnicodeEncodeError",
    ),
    (
        "compare",
        lambda one: first_site(one).update(particles=10**400),
        "contradicts itself, .* .OverflowError",
    ),
    ("sobol", lambda one: one["S1"].pop(), "content: S1: 2 numbers for 3 names"),
    ("sobol", lambda one: one["protocols"]["cyclic"]["ST_conf"].append(0.1), "content: ST_conf: 4 numbers for 3 names"),
    ("sobol", lambda one: one["convergence"]["S1"].pop(), "content: convergence: not one number for each size"),
    ("surrogate", lambda one: first_fit(one).update(errors=5), "errors: 5: expected a list of numbers"),
]


def first_site(one):
    return next(iter(one["sites"].values()))


def first_fit(one):
    return next(iter(one["specimens"].values()))


@pytest.mark.parametrize(("task", "change", "problem"), IMPOSSIBLE)
def test_a_result_that_cannot_be_is_one_line(copied_run, task, change, problem):
    edit(copied_run / f"{task}.json", change)
    with pytest.raises(BadInput, match=rf"{task}\.json: .*{problem}"):
        getattr(sinew.results(copied_run), task)


def test_a_result_that_cannot_be_drawn_is_one_line_in_a_notebook(copied_run, monkeypatch):
    monkeypatch.setattr("sinew.tasks.sobol.figures.indices", lambda _: np.zeros(2) + np.zeros(3))
    with pytest.raises(BadInput, match=r"sobol\.json: contradicts itself, or the store \(ValueError: "):
        sinew.results(copied_run).sobol.plot()
    with pytest.raises(BadInput, match="sobol: figure"):
        sinew.results(copied_run).sobol.plot("nothing")


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ({"free": ["x"] * len(FREE)}, "content: free parameters that are named twice, or are no parameters"),
        ({"bounds": [[1.0, 0.0]] * len(FREE)}, "content: [A-Za-z_]+ [0-9.]+ of distal/1, outside its range 1 to 0"),
        ({"bounds": []}, f"content: {len(FREE)} free parameters, 0 ranges"),
    ],
)
def test_a_search_of_other_parameters_is_one_line_in_a_notebook(copied_run, change, problem):
    edit(copied_run / "calibrate.json", lambda one: one.update(change))
    with pytest.raises(BadInput, match=rf"calibrate\.json: {problem}"):
        sinew.results(copied_run).skopt_result("distal/1")
