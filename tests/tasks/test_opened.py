"""``import tasks``: results that print and plot, and open as the objects of the libraries that others work with."""

import json
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from matplotlib import pyplot as plt
from matplotlib.figure import Figure

import tasks
from runner.errors import SinewError
from runner.store import STATUSES
from tasks.cohort import virtual_cohort, write_cohort
from tasks.model import Model
from tasks.study import NEEDS
from tasks.workspace import Workspace, read_result, write_json

FREE = ("E_f", "alpha_f", "tau_3f")
FIXED = "".join(f"    {p.name}: {{fixed: {p.reference}}}\n" for p in Model().parameters if p.name not in FREE)
STUDY = f"""
name: small
seed: 11
cohort: cohort
model:
  parameters:
{FIXED}
sobol: {{base_samples: 16, resamples: 20}}
importance: {{trees: 10, repeats: 2}}
calibrate: {{evaluations: 30, starts: 1, bayesian: {{evaluations: 12, initial: 6, seeds: 10}}}}
infer: {{population: 10, generations: 2, epsilon: 2.0}}
predict: {{draws: 5}}
discover: {{effects: [toe-slack], starts: 2, specimens: [distal/1]}}
"""
TASKS = ("sobol", "importance", "calibrate", "infer", "predict", "compare", "discover")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Results of every task over two specimens of two sites; nothing is drawn, and no process started."""
    here = tmp_path_factory.mktemp("notebook")
    specimens, truth = virtual_cohort(seed=1, per_site=1, rate_hz=2.0)
    write_cohort(here / "cohort", specimens[:2], truth)
    (here / "study.yaml").write_text(STUDY)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Workspace, "client", lambda self: None)
        tasks.run(tasks.read_study(here / "study.yaml"), *TASKS, out=here / "out")
    return here / "out"


@pytest.fixture
def results(folder: Path) -> tasks.Results:
    return tasks.results(folder)


@pytest.fixture(autouse=True)
def no_figures_left_open():
    yield
    plt.close("all")


def test_importing_the_package_imports_no_library():
    code = "import sys, tasks; print(sorted({'numpy', 'pandas', 'distributed', 'matplotlib'} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize("name", tasks.__all__)
def test_every_public_name_is_there_and_says_what_it_is(name):
    assert getattr(tasks, name).__doc__
    assert name in dir(tasks)


def test_a_name_that_is_not_there():
    with pytest.raises(AttributeError, match="no attribute 'sobols'"):
        tasks.sobols  # noqa: B018


@pytest.mark.parametrize("task", TASKS)
def test_every_task_prints_and_plots(results, task):
    one = getattr(results, task)
    assert task in repr(one)
    assert len(one.table)
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
    assert results.finished == TASKS
    for words in (repr(results), results._repr_html_()):
        assert "small" in words
        assert "largest total indices" in words
        assert results.discover.told["verdict"] in words


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
        tasks.results(tmp_path / "nowhere")
    with pytest.raises(SinewError, match="neither a store nor results"):
        tasks.results(tmp_path)
    for call in (results.arviz, results.abc_history):
        with pytest.raises(SinewError, match=r"no posterior of '\.\./x'; expected one of distal, middle"):
            call("../x")
    with pytest.raises(SinewError, match="expected one of distal/1, middle/1"):
        results.skopt_result("nobody")
    with pytest.raises(SinewError, match="expected one of total, "):
        results.salib_result("nothing")


def test_an_unfinished_folder_opens(tmp_path):
    write_json(tmp_path / "importance.json", {"names": ["E_f"]})
    partial = tasks.results(tmp_path)
    assert partial.finished == ("importance",)
    with pytest.raises(SinewError, match=r"importance\.json: lacks or garbles something .*r2_on_unseen"):
        partial.importance  # noqa: B018
    with pytest.raises(SinewError, match=r"sobol\.json: is not there; expected a finished `sinew sobol`"):
        partial.sobol  # noqa: B018


def test_words_from_a_result_cannot_become_html(tmp_path):
    evil = "<script>alert(1)</script>"
    told = {"specimens": {evil: {"parameters": {evil: 1.0}, "total_N": 1.0, "noise_N": 1.0, "above_noise": 0.0,
                                 "site": evil, "method": evil}}, "names": [evil]}  # fmt: skip
    write_json(tmp_path / "calibrate.json", told)
    one = tasks.results(tmp_path)
    assert "<script" not in one._repr_html_() + one.calibrate._repr_html_()
    assert "&lt;script" in one.calibrate._repr_html_()


def test_run_refuses_what_the_command_refuses(folder, tmp_path):
    study = tasks.read_study(folder.parent / "study.yaml")
    with pytest.raises(tasks.BadInput, match="some of sobol, importance"):
        tasks.run(study, "sobols", out=tmp_path)
    for task, before in NEEDS.items():
        with pytest.raises(tasks.BadInput, match=f"`sinew {before}` on this study first"):
            tasks.run(study, task, out=tmp_path)
    assert not list(tmp_path.iterdir())


def test_running_again_evaluates_nothing(folder, monkeypatch):
    monkeypatch.setattr(Workspace, "client", lambda self: pytest.fail("a cluster was started"))
    before = (folder / "sobol.json").read_bytes()
    again = tasks.run(
        tasks.read_study(folder.parent / "study.yaml"), "sobol", "importance", out=str(folder), figures=True
    )
    assert again == tasks.results(folder)
    assert before == (folder / "sobol.json").read_bytes()
    assert {"sobol.png", "importance.png"} <= {path.name for path in again.figures}


# ---- other libraries


def test_the_store_opens_in_xarray(results, folder):
    tree = results.xarray()
    assert tree["sobol"]["ST"].sel(output="total", parameter="E_f").item() == results.sobol.told["ST"][0]
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
    stored = results.sobol.told["specimens"]["distal/1"]
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
    told = read_result(folder / "calibrate.json")["specimens"]["distal/1"]["methods"]["bayesian"]
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
