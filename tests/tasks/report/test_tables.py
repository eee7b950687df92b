"""The CSV beside a figure: the numbers that it shows, with names and units."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from matplotlib import pyplot as plt
from matplotlib.mathtext import MathTextParser

from runner.store import open_store
from tasks.report import discovery, figures, tables
from tasks.report.posterior import marginals


def result(folder: Path, task: str) -> dict:
    return json.loads((folder / f"{task}.json").read_text())


@pytest.fixture(autouse=True)
def closed():
    yield
    plt.close("all")


def test_a_figure_is_three_files_of_the_same_bytes_each_time(tmp_path):
    shown = pd.DataFrame({"time_s": [0.0, 1.5], "name": ["a,b", 'c"d']})
    written = []
    for folder in ("one", "two"):
        figure, axis = plt.subplots()
        axis.plot([0, 1])
        paths = figures.save(figure, tmp_path / folder, "name", shown)
        assert [path.name for path in paths] == ["name.png", "name.pdf", "name.csv"]
        written.append([path.read_bytes() for path in paths])
    assert written[0] == written[1]
    pd.testing.assert_frame_equal(pd.read_csv(paths[2]), shown)


def test_indices_and_importance_by_objective(whole_run):
    sobol, importance = result(whole_run, "sobol"), result(whole_run, "importance")
    for told, table, key in (
        (sobol, tables.sobol(sobol), "ST"),
        (importance, tables.importance(importance), "permutation"),
    ):
        assert list(table["objective"].unique()) == ["total", *told["protocols"]]
        np.testing.assert_array_equal(table[key][: len(told["names"])], np.array(told[key], dtype=float))
        last = list(told["protocols"].values())[-1]
        np.testing.assert_array_equal(table[key][-len(told["names"]) :], np.array(last[key], dtype=float))
    settled = tables.sobol_convergence(sobol)
    last = settled[settled["base_samples"] == sobol["convergence"]["base_samples"][-1]]
    np.testing.assert_array_equal(last["ST"], np.array(sobol["convergence"]["ST"][-1], dtype=float))


def test_searches_end_at_the_objective_of_their_method(whole_run):
    told = result(whole_run, "calibrate")
    table = tables.calibration_convergence(told)
    lowest = table.groupby(["specimen", "method"])["objective_N"].min()
    for name, specimen in told["specimens"].items():
        for method, found in specimen["methods"].items():
            assert lowest[name, method] == pytest.approx(found["total_N"], rel=1e-6)


def test_densities_are_those_of_the_figure(whole_run):
    told = result(whole_run, "infer")
    site = next(iter(told["sites"]))
    particles = open_store(whole_run).read_result(f"infer/{site}")
    table = tables.posterior(particles, told, site)["marginals"]
    figure = marginals(particles, told, site)
    for name, axis in zip(told["names"], figure.axes, strict=False):
        mine = table[table["parameter"] == name]
        for line, column in zip(axis.lines, ("prior_density", "posterior_density"), strict=False):
            np.testing.assert_array_equal(line.get_xdata(), mine["value"])
            np.testing.assert_array_equal(line.get_ydata(), mine[column])


def test_bands_curves_and_cells_are_all_there(whole_run):
    store, predicted, found = open_store(whole_run), result(whole_run, "predict"), result(whole_run, "discover")
    for site in predicted["sites"]:
        dataset = store.read_result(f"predict/{site}")
        table = tables.prediction(dataset)
        assert list(table.columns[:3]) == ["specimen", "protocol", "time_s"]
        assert len(table) == dataset.sizes["point"]
        inside = (table["measured_N"] >= table["hdi_low_N"]) & (table["measured_N"] <= table["hdi_high_N"])
        assert inside.mean() == pytest.approx(predicted["sites"][site]["coverage"]["hdi"]["all"])
    cells = tables.cells(found)
    assert len(cells) == sum(map(len, [*found["cells"].values(), *found.get("after", {}).values()]))
    name = next(iter(found["cells"]))
    kept = store.read_result(f"discover/{name.replace('/', '_')}")
    curves = tables.curves(kept)
    figure = discovery.before_and_after(kept, found, name)
    drawn = {line.get_ydata().size for axis in figure.axes for line in axis.lines if line.get_label() == "measured"}
    assert drawn == set(curves.groupby("protocol").size())


def test_separation_has_its_three_panels(whole_run):
    told = result(whole_run, "compare")
    table = tables.separation(told)
    assert set(table["panel"]) == {"roc", "density", "loading"}
    loadings = table[table["panel"] == "loading"].set_index("series")["x"]
    assert loadings.to_dict() == pytest.approx(told["component"]["loadings"])


@pytest.mark.parametrize(
    ("name", "shown"),
    [
        ("tau_1f", r"$\tau_{1f}$"),
        ("nu", r"$\nu$"),
        ("E_matrix", "$E_{matrix}$"),
        ("E_1_2", "E_1_2"),
        ("g_", "g_"),
        ("k", "k"),
    ],
)
def test_names_of_parameters_are_formulas_where_they_can_be(name, shown):
    assert figures.symbol(name) == shown
    MathTextParser("path").parse(figures.symbol(name))


@pytest.mark.parametrize("noise", [None, float("nan"), 0.5])
def test_fits_are_drawn_whether_or_not_the_noise_is_known(tmp_path, noise):
    told = {"noise_N": noise, "methods": {"least_squares": {"trace": [[1, 2.0], [5, 1.0]]}}}
    found = {"methods": ["least_squares"], "specimens": {"short": told}}
    figures.save(figures.calibration_convergence(found), tmp_path, "fits", tables.calibration_convergence(found))
    assert (tmp_path / "fits.png").is_file()
