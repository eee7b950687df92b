"""Figures of a calibration: of any free parameters, with the panels and labels that belong to them."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr
from matplotlib import pyplot as plt

from sinew.tasks.calibrate import correlation_figure, figures, sample_figures, surrogate_figures
from sinew.tasks.calibrate.correlations import correlations
from sinew.tasks.calibrate.figures import _draw_typical, quantity_and_fitted
from sinew.tasks.calibrate.panels import Samples, axis_label, pairs
from sinew.tasks.calibrate.result import Correlations, PairCorrelation, QuantityFit
from sinew.tasks.calibrate.show import quantity_table, samples_table
from sinew.tasks.drawing.formats import FORMATS
from sinew.tasks.model import Curve, Model, Parameter, Protocol, Specimen
from tests.tasks.calibrations import calibration_of, fit_of, method_of

SOME = ("E_f", "tau_1f", "E_m", "bulk")


@pytest.fixture(autouse=True)
def closed():
    yield
    plt.close("all")


def samples(names=SOME, *, count=25, method="hybrid", failed=2):
    """The objective grows with the first parameter from 10 to 100 N, and depends on nothing else."""
    parameters = tuple(Parameter(name, "MPa", 10.0, 30.0, 20.0, "") for name in names)
    rng = np.random.default_rng(0)
    unit = rng.random((count, len(names)))
    totals = 10.0 * 10.0 ** unit[:, 0]
    totals[5 : 5 + failed] = np.inf
    return Samples("distal/1", parameters, 10.0 + 20.0 * unit, totals, np.full(len(names), 15.0), method)


def texts(figure):
    """Everything that is written in the axes and above them."""
    words = [text.get_text() for text in figure.findobj(plt.Text)]
    return [word for word in words if word]


def labels(axis):
    return axis.get_xlabel(), axis.get_ylabel()


def panels(figure):
    return [axis for axis in figure.axes if axis.get_label() != "<colorbar>"]


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        (
            Model().names,
            [
                ("E_m", "E_f"),
                *((f"{s}_{k}m", f"{s}_{k}f") for s in ("g", "tau") for k in (1, 2, 3)),
                ("nu_m", "alpha_f"),
            ],
        ),
        (("E_f", "E_m"), [("E_m", "E_f")]),
        (("E_f", "tau_1f", "E_m"), [("E_m", "E_f"), ("tau_1f", "E_f")]),
        (("p", "q", "r"), [("p", "q"), ("r", "p")]),
        (("E_m",), []),
    ],
)
def test_matrix_is_paired_with_fibre_and_the_rest_with_each_other(names, expected):
    assert pairs(names) == expected


@pytest.mark.parametrize("names", [Model().names, SOME, ("E_f", "E_m")])
def test_scatter_and_contours_have_a_panel_for_each_pair(names):
    seen = samples(names)
    expected = [tuple(axis_label(seen.parameters[seen.column(n)]) for n in pair) for pair in pairs(names)]
    for figure in (
        sample_figures.paired_samples(seen),
        surrogate_figures.paired_influences(seen, surrogate_figures.learned(seen)),
    ):
        assert [labels(axis) for axis in panels(figure)] == expected
        assert {"best sampled", "calibrated (hybrid)"} <= set(texts(figure))
        assert any("2 failed" in text for text in texts(figure))
    assert len(panels(figure)) == (8 if len(names) == 16 else -(-len(names) // 2))


def test_the_star_is_at_the_best_point_and_the_diamond_at_the_calibrated_one():
    seen = samples(("E_f", "E_m"))
    (axis,) = panels(sample_figures.paired_samples(seen))
    marks = {line.get_label(): (line.get_xdata()[0], line.get_ydata()[0]) for line in axis.lines}
    best = seen.points[np.argmin(seen.totals)]
    assert marks == {"best sampled": (best[1], best[0]), "calibrated (hybrid)": (15.0, 15.0)}
    failed, alive = axis.collections
    assert len(failed.get_offsets()) == 2
    coloured = alive.get_array().filled()
    assert coloured == pytest.approx(np.sort(seen.totals[np.isfinite(seen.totals)])[::-1]), "the best on top"
    (axis,) = panels(sample_figures.paired_samples(samples(("E_f", "E_m"), method="bayesian")))
    assert [line.get_label() for line in axis.lines] == ["best sampled"]


@pytest.mark.parametrize("names", [SOME, ("E_f", "E_m")])
def test_every_pair_is_in_the_triangle(names):
    seen = samples(names)
    axis = sample_figures.all_samples(seen).axes[0]
    count = len(names)
    failed, alive = axis.collections[:2]
    assert len(failed.get_offsets()) == 2 * count * (count - 1) // 2
    assert len(alive.get_offsets()) == 23 * count * (count - 1) // 2
    column, row = np.floor(np.array(alive.get_offsets())).astype(int).T
    assert {*zip(row.tolist(), column.tolist(), strict=True)} == {(i, j) for i in range(count) for j in range(i)}
    heights = np.array([bar.get_height() for bar in axis.patches]).reshape(count, 10)
    assert heights.min(axis=1) == pytest.approx(np.full(count, -0.9)), "a histogram on each place of the diagonal"
    named = [text.get_text().strip() for text in axis.get_xticklabels()]
    assert named == [axis_label(parameter) for parameter in seen.parameters]
    assert axis.yaxis_inverted(), "rows go down"
    # a point is where its values are, upwards within its panel
    k = int(np.argmin(seen.totals))
    first = 0.1 + 0.8 * (seen.points[k] - 10.0) / 20.0
    offsets = np.array(alive.get_offsets())
    assert np.abs(offsets - [first[0], 2 - first[1]]).sum(axis=1).min() < 1e-9


def test_the_partial_dependence_is_that_of_the_objective():
    seen = samples(("E_f", "E_m", "nu_m"), count=40)
    surrogate = surrogate_figures.learned(seen)
    assert surrogate.background.shape == (100, 3)
    axes = panels(surrogate_figures.influences(seen, surrogate))
    assert [axis.get_xlabel() for axis in axes] == [axis_label(parameter) for parameter in seen.parameters]
    mean = axes[0].lines[0]
    assert mean.get_ydata() == pytest.approx(10.0 * 10.0 ** ((mean.get_xdata() - 10.0) / 20.0), rel=0.05)
    for axis in axes[1:]:
        assert axis.lines[0].get_ydata() == pytest.approx(np.full(60, 10.0**1.5), rel=0.1)
    for axis, best in zip(axes, seen.best, strict=True):
        star = axis.lines[1]
        assert star.get_xdata()[0] == best
        curve = axis.lines[0]
        assert star.get_ydata()[0] == pytest.approx(np.interp(best, curve.get_xdata(), curve.get_ydata()), rel=0.02)
    # the spread is that of all other parameters: none along the only one that matters, all of it along another
    low, high = (np.quantile(surrogate.along([1], np.array([[0.5]])), q) for q in (0.1, 0.9))
    assert np.log10(high / low) == pytest.approx(0.8, abs=0.1)


def test_contours_lie_across_the_parameter_that_matters():
    seen = samples(("E_f", "E_m"))
    (axis,) = panels(surrogate_figures.paired_influences(seen, surrogate_figures.learned(seen)))
    assert labels(axis)[1].startswith("$E_{f}$")
    (contours,) = axis.collections
    assert (contours.levels[0], contours.levels[-1]) == pytest.approx((10.0, 100.0), rel=0.05), "in newton"
    middle = contours.get_paths()[7].get_extents()
    assert middle.width == pytest.approx(20.0)
    assert (middle.y0 + middle.y1) / 2 == pytest.approx(20.0, abs=1.0), "half of the logarithm in half of the range"


def test_of_many_points_the_surrogate_keeps_the_best(monkeypatch):
    monkeypatch.setattr(surrogate_figures, "LEARNED", 40)
    seen = samples(("E_f", "E_m"), count=130, failed=30)
    kept = surrogate_figures.learned(seen).process.regressor.X_train_
    assert len(kept) == 40
    best = (seen.points[np.argsort(seen.totals)[:20], 0] - 10.0) / 20.0
    assert np.sort(kept[:, 0])[:20] == pytest.approx(best)
    assert kept[:, 0].max() == pytest.approx((seen.points[seen.alive, 0].max() - 10.0) / 20.0), "and some of the others"


def fit(total, donor="1", site="distal", names=SOME, noise=8.0):
    trace = [(1, 900.0), (20, 50.0)]
    return fit_of(
        {name: 20.0 + len(name) * total * (k + 1) % 9 for k, name in enumerate(names)},
        site=site,
        donor=donor,
        determined=list(names[1:]),
        total_N=total,
        noise_N=noise,
        methods={"bayesian": method_of(trace), "hybrid": method_of([*trace, (60, total)])},
    )


def test_convergence_has_every_method_and_the_noise():
    (axis,) = figures.convergence("distal/1", fit(12.0)).axes
    assert axis.get_yscale() == "log"
    curves = {line.get_label(): line for line in axis.lines if not line.get_label().startswith("_")}
    assert set(curves) == {"bayesian: 50 N", "hybrid: 12 N", "noise: 8 N"}
    assert curves["hybrid: 12 N"].get_xydata().tolist() == [[1, 900], [20, 50], [60, 12]]
    assert set(curves["noise: 8 N"].get_ydata()) == {8.0}
    (axis,) = figures.convergence("distal/1", fit(12.0, noise=None)).axes
    assert not any("noise" in line.get_label() for line in axis.lines)


def test_correlations_are_written_starred_and_hatched():
    pairs = [
        PairCorrelation(parameters=["a", "b"], r=0.9, p=0.001, p_holm=0.002, determined=True),
        PairCorrelation(parameters=["a", "c"], r=-0.5, p=0.03, p_holm=0.06, determined=False),
        PairCorrelation(parameters=["b", "c"], reason="c does not vary within donors", determined=True),
    ]
    found = Correlations(["x", "y"], ["1", "2", "3"], 9, ["a", "b", "c"], {}, 2, pairs)
    figure = correlation_figure.correlation_matrix(found)
    axis = figure.axes[0]
    written = {text.get_position(): text.get_text() for text in axis.texts}
    assert written[(0, 1)] == "0.90\n**"
    assert written[(0, 2)] == "-0.50\n*"
    assert (1, 2) not in written
    hatched = [patch.get_xy() for patch in axis.patches if patch.get_hatch()]
    grey = [patch.get_xy() for patch in axis.patches if not patch.get_hatch()]
    assert (hatched, grey) == ([(-0.5, 1.5)], [(0.5, 1.5)])
    level = axis.images[0].get_array().filled(np.nan)
    assert level[1, 0] == 0.9
    assert np.isfinite(level).sum() == 2
    assert any("adjusted for 2 pairs" in text for text in texts(figure))


def study(tmp_path, names, specimens, methods=("bayesian", "hybrid")):
    """A workspace as far as figures look at it, and a calibration."""
    seen = samples(names)
    fixed = Parameter("fixed", "s", 1.0, 1.0, 1.0, "")
    parameters = (fixed, *seen.parameters)
    points = np.concatenate([np.ones((len(seen.points), 1)), seen.points], axis=1)
    dataset = xr.Dataset(
        {"parameters": (("evaluation", "parameter"), points), "total": ("evaluation", seen.totals)},
        coords={"parameter": [parameter.name for parameter in parameters]},
    )
    read = {f"calibrate/{name.replace('/', '_')}": dataset for name in specimens}
    model = Model(parameters=parameters)
    workspace = SimpleNamespace(out=tmp_path, model=model, store=SimpleNamespace(read_result=read.__getitem__))
    found = correlations(specimens, seen.parameters)
    return workspace, calibration_of(specimens, methods=list(methods), correlations=found)


def cohort(names=SOME):
    return {
        f"{site}/{donor}": fit(10.0 + 3.7 * donor * k, str(donor), site, names)
        for k, site in enumerate(("distal", "middle"), 1)
        for donor in (1, 2, 3)
    }


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        (
            SOME,
            {"typical_convergence", "samples", "samples_all", "surrogate", "surrogate_all", "correlations"},
        ),
        (("E_m",), {"typical_convergence", "surrogate_all"}),
    ],
)
def test_all_figures_of_a_study_are_written(tmp_path, names, expected):
    specimens = cohort(names) if len(names) > 1 else {"one": fit(12.0, None, None, names)}
    workspace, result = study(tmp_path, names, specimens)
    paths = _draw_typical(workspace, result)
    assert {path.name for path in paths} == {f"calibrate_{name}.{end}" for name in expected for end in FORMATS}
    assert set(paths) == set((tmp_path / "figures").iterdir())
    assert min(path.stat().st_size for path in paths if path.suffix != ".csv") > 3000
    assert all(len(path.read_text().splitlines()) > 1 for path in paths if path.suffix == ".csv")


def test_without_a_bayesian_search_there_is_its_convergence_only(tmp_path):
    workspace, result = study(tmp_path, SOME, {"one": fit(12.0, None, None)}, methods=["least_squares"])
    workspace.store = None
    assert {path.stem for path in _draw_typical(workspace, result)} == {"calibrate_typical_convergence"}


def test_a_search_of_which_all_points_failed_is_not_drawn(tmp_path):
    workspace, result = study(tmp_path, SOME, {"one": fit(12.0, None, None)})
    workspace.store.read_result("calibrate/one")["total"][:] = np.inf
    assert {path.stem for path in _draw_typical(workspace, result)} == {"calibrate_typical_convergence"}


def test_the_typical_specimen_has_the_median_objective():
    totals = {"a": 30.0, "b": 10.0, "c": 20.0, "d": 40.0}
    for left_out in (None, "d", "b"):
        totals.pop(left_out, None)
        assert calibration_of({name: fit(total) for name, total in totals.items()}).typical == "c"


def test_a_quantity_beside_the_force_has_a_figure_and_a_table_with_its_unit():
    time_s, seen = np.arange(5.0), np.array([0.0, np.nan, -0.2, np.nan, -0.4])
    curve = Curve(Protocol("pull", time_s, 0.1 * time_s), 10.0 * time_s, {"width_change": seen})
    bar, courses = Specimen("bar", 10.0, 8.0, 4.0, (curve,)), {"pull": -0.1 * time_s}
    table = quantity_table(bar, "width_change", "mm", courses)
    assert table.columns.to_list() == [
        "protocol", "time_s", "displacement_mm", "measured_width_change_mm", "model_width_change_mm"
    ]  # fmt: skip
    assert table["time_s"].to_list() == [0.0, 2.0, 4.0]
    assert table["model_width_change_mm"].to_list() == pytest.approx([0.0, -0.2, -0.4])
    figure = quantity_and_fitted(bar, courses, "width_change", QuantityFit("mm", 0.01, {"pull": 0.012}, {}))
    (axis,) = figure.axes
    assert axis.get_ylabel() == "width change (mm)"
    assert axis.get_title() == "pull: RMSE 0.012 mm"
    assert [line.get_label() for line in axis.lines] == ["measured", "model"]
    plt.close(figure)


def test_sums_of_errors_over_noise_are_not_called_newton():
    table = samples_table(["a"], np.zeros((2, 1)), np.array([6.0, np.inf]), np.zeros(1), "")
    assert "objective" in table
    assert "objective_N" not in table
    figure = sample_figures.all_samples(replace(samples(), unit="RMSE over noise"))
    assert "total objective (RMSE over noise)" in texts(figure)
    assert "total objective (N)" in texts(sample_figures.all_samples(samples()))
