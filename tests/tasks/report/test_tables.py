"""The CSV beside a figure: the numbers that it shows, with names and units."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from matplotlib import pyplot as plt
from matplotlib.text import Text

from sinew.runner.store.store import open_store
from sinew.tasks.calibrate import show as calibrate
from sinew.tasks.calibrate.figures import calibration_convergence
from sinew.tasks.calibrate.result import CalibrateResult
from sinew.tasks.compare import show as compare
from sinew.tasks.compare.result import CompareResult
from sinew.tasks.discover import figures as discovery
from sinew.tasks.discover import show as discover
from sinew.tasks.discover.result import DiscoverResult
from sinew.tasks.drawing import figures
from sinew.tasks.importance import show as importance_show
from sinew.tasks.importance.result import ImportanceResult
from sinew.tasks.infer.abc.figures import figure_tables, marginals
from sinew.tasks.infer.abc.result import AbcResult
from sinew.tasks.predict import show as predict
from sinew.tasks.predict.result import PredictResult
from sinew.tasks.sobol import show as sobol_show
from sinew.tasks.sobol.result import SobolResult
from tests.tasks.calibrations import calibration_of, fit_of, method_of


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


def test_indices_and_importance_by_output(whole_run):
    sobol, importance = SobolResult.read(whole_run), ImportanceResult.read(whole_run)
    for found, table, key in (
        (sobol, sobol_show.table(sobol), "ST"),
        (importance, importance_show.table(importance), "permutation"),
    ):
        assert list(table.index.get_level_values("output").unique()) == ["total", *found.protocols]
        np.testing.assert_array_equal(table.loc["total", key], getattr(found, key))
        name, last = list(found.protocols.items())[-1]
        np.testing.assert_array_equal(table.loc[name, key], getattr(last, key))
        assert list(table.loc[name].index) == found.names
    settled = sobol_show.convergence_table(sobol)
    last = settled[settled["base_samples"] == sobol.convergence.base_samples[-1]]
    np.testing.assert_array_equal(last["ST"], sobol.convergence.ST[-1])


def test_searches_end_at_the_objective_of_their_method(whole_run):
    calibrated = CalibrateResult.read(whole_run)
    table = calibrate.searches_table(calibrated)
    lowest = table.groupby(["specimen", "method"])["objective_N"].min()
    for name, specimen in calibrated.specimens.items():
        for method, found in specimen.methods.items():
            assert lowest[name, method] == pytest.approx(found.total_N, rel=1e-6)


def test_densities_are_those_of_the_figure(whole_run):
    inferred = AbcResult.read(whole_run)
    site = next(iter(inferred.sites))
    particles = open_store(whole_run).read_result(f"infer/{site}")
    table = figure_tables(particles, inferred, site)["marginals"]
    figure = marginals(particles, inferred, site)
    for name, axis in zip(inferred.names, figure.axes, strict=False):
        mine = table[table["parameter"] == name]
        for line, column in zip(axis.lines, ("prior_density", "posterior_density"), strict=False):
            np.testing.assert_array_equal(line.get_xdata(), mine["value"])
            np.testing.assert_array_equal(line.get_ydata(), mine[column])


def test_bands_curves_and_cells_are_all_there(whole_run):
    store, predicted, found = open_store(whole_run), PredictResult.read(whole_run), DiscoverResult.read(whole_run)
    for site, prediction in predicted.sites.items():
        dataset = store.read_result(f"predict/{site}")
        table = predict.points_table(dataset)
        assert list(table.columns[:3]) == ["specimen", "protocol", "time_s"]
        assert len(table) == dataset.sizes["point"]
        inside = (table["measured_N"] >= table["hdi_low_N"]) & (table["measured_N"] <= table["hdi_high_N"])
        assert inside.mean() == pytest.approx(prediction.coverage["hdi"].all)
    cells = discover.cells_table(found)
    assert len(cells) == sum(map(len, [*found.cells.values(), *(found.after or {}).values()]))
    name = next(iter(found.cells))
    kept = store.read_result(f"discover/{name.replace('/', '_')}")
    curves = discover.curves_table(kept)
    figure = discovery.before_and_after(kept, found, name)
    drawn = {line.get_ydata().size for axis in figure.axes for line in axis.lines if line.get_label() == "measured"}
    assert drawn == set(curves.groupby("protocol").size())


def test_separation_has_its_three_panels(whole_run):
    compared = CompareResult.read(whole_run)
    table = compare.separation_table(compared)
    assert set(table["panel"]) == {"roc", "density", "loading"}
    loadings = table[table["panel"] == "loading"].set_index("series")["x"]
    assert loadings.to_dict() == pytest.approx(compared.component.loadings)


@pytest.mark.parametrize(
    ("name", "shown"),
    [
        ("tau_1f", r"$\tau_{1f}$"),
        ("nu", r"$\nu$"),
        ("E_matrix", "$E_{matrix}$"),
        ("E_1_2", "E_1_2"),
        ("g_", "g_"),
        ("k", "k"),
        (r"$\frac{$", r"\$\frac{\$"),
    ],
)
def test_names_of_parameters_are_formulas_where_they_can_be(name, shown):
    assert figures.symbol(name) == shown
    Text(0, 0, figures.symbol(name), figure=plt.figure()).get_window_extent()
    plt.close()


@pytest.mark.parametrize("noise", [None, 0.5])
def test_fits_are_drawn_whether_or_not_the_noise_is_known(tmp_path, noise):
    short = fit_of({"E_f": 1.0}, noise_N=noise, methods={"least_squares": method_of([(1, 2.0), (5, 1.0)])})
    found = calibration_of({"short": short}, methods=["least_squares"])
    figures.save(calibration_convergence(found), tmp_path, "fits", calibrate.searches_table(found))
    assert (tmp_path / "fits.png").is_file()
