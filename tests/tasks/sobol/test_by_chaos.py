"""Indices by surrogate: near the known ones, with intervals that hold them, from a study to its page."""

import json
from dataclasses import replace

import numpy as np
import pytest
from SALib.test_functions import Ishigami, Sobol_G

from sinew.runner.store.store import open_store
from sinew.tasks.model import Model
from sinew.tasks.simulate.growing import TURN, sizes_up_to
from sinew.tasks.simulate.inputs import Inputs
from sinew.tasks.simulate.plain_design import plain_design, shares
from sinew.tasks.simulate.saltelli import Design
from sinew.tasks.simulate.uniaxial import Uniaxial
from sinew.tasks.sobol import by_chaos
from sinew.tasks.sobol.by_chaos import ByChaos, first_and_total, second
from sinew.tasks.sobol.method import Intervals
from sinew.tasks.study.workspace import Workspace
from tests.tasks.study.test_pipeline import sinew
from tests.whole_runs import drawn_in_this_process, study_of_one

A = np.array([0.0, 1.0, 4.5, 9.0, 99.0, 99.0])
FUNCTIONS = {
    "Ishigami": (
        3,
        lambda at: Ishigami.evaluate(np.pi * (2 * at - 1)),
        [0.3139, 0.4424, 0.0],
        [0.5576, 0.4424, 0.2437],
    ),
    "g": (6, lambda at: Sobol_G.evaluate(at, A), Sobol_G.sensitivity_index(A), Sobol_G.total_sensitivity_index(A)),
}


def estimate(size, count, seed=0, *, second_order=False):
    share = shares(size, count, seed, TURN)
    names, alone = tuple(f"x{j}" for j in range(size)), tuple((j,) for j in range(size))
    design = Design(names, count, False, share, scrambles=TURN, members=alone, plain=True)
    ok = np.ones(count, dtype=bool)
    return ByChaos(design, share, ok, Intervals(10, 0.95, seed), second_order, sizes=(count // 2, count))


ALONE = ((0,), (1,), (2,))


def test_indices_are_parts_of_the_variance():
    exponents = np.array([[0, 0, 0], [1, 0, 0], [0, 2, 0], [1, 0, 1], [2, 1, 1]])
    first, total = first_and_total(exponents, np.array([7.0, 2.0, 1.0, 1.0, 2.0]), ALONE)
    np.testing.assert_allclose(first, [0.4, 0.1, 0.0])
    np.testing.assert_allclose(total, [0.9, 0.5, 0.5])
    found = second(exponents, np.array([7.0, 2.0, 1.0, 1.0, 2.0]), ALONE)
    np.testing.assert_allclose(found[np.triu_indices(3, 1)], [0.0, 0.1, 0.0])
    assert np.isnan(found[np.tril_indices(3)]).all()


def test_parameters_that_move_as_one_have_one_index():
    exponents = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 1]])
    first, total = first_and_total(exponents, np.array([1.0, 1.0, 2.0, 1.0]), ((0, 1), (2,)))
    np.testing.assert_allclose(first, [5 / 6, 0.0])
    np.testing.assert_allclose(total, [1.0, 1 / 6])


def test_an_outcome_that_does_not_vary_has_no_index():
    first, total = first_and_total(np.array([[0, 0], [1, 0]]), np.array([3.0, 0.0]), ((0,), (1,)))
    assert np.isnan(first).all() and np.isnan(total).all()


@pytest.mark.parametrize(("name", "count", "error"), [("Ishigami", 64, 0.02), ("g", 144, 0.08)])
def test_intervals_hold_the_known_indices(name, count, error):
    size, function, first, total = FUNCTIONS[name]
    held, apart = [], []
    for seed in range(10):
        one = estimate(size, count, seed)
        found = one.analysis(function(one.share))
        differences = np.abs([found.S1 - first, found.ST - total])
        held.append(differences <= [found.S1_conf, found.ST_conf])
        apart.append(differences.max())
    assert np.mean(held) > 0.93
    assert np.median(apart) < error


def test_curves_have_the_indices_of_each_of_their_points():
    one = estimate(3, 64)
    time = np.linspace(0.0, 1.0, 7)
    base, decay = one.share[:, :1] + 0.3 * one.share[:, 1:2] ** 2, one.share[:, 2:] * one.share[:, :1]
    curves = np.column_stack([np.zeros(64), base + decay * time])
    found = one.of(curves)
    assert np.isnan(found["ST"][:, 0]).all(), "the first point does not vary"
    for point in (1, 4, 7):
        alone = one.analysis(curves[:, point])
        np.testing.assert_allclose(found["S1"][:, point], alone.S1, atol=0.002)
        np.testing.assert_allclose(found["ST"][:, point], alone.ST, atol=0.002)
    assert (found["ST_conf"][:, 1:] < 0.05).all()


def test_intervals_of_curves_know_that_their_polynomials_were_chosen():
    """A curve of one point is one outcome, whose polynomials are chosen anew without each scramble."""
    one = estimate(3, 64)
    outcome = np.exp(3.0 * one.share[:, 0] * one.share[:, 1]) / (0.3 + one.share[:, 2])
    found, alone = one.of(outcome[:, np.newaxis]), one.analysis(outcome)
    for key in ("S1_conf", "ST_conf"):
        np.testing.assert_allclose(found[key][:, 0], getattr(alone, key), rtol=1e-6)


def test_where_nothing_is_explained_anything_may_be():
    one = estimate(3, 64)
    found = one.analysis(np.random.default_rng(1).standard_normal(64))
    of_curves = one.of(np.random.default_rng(2).standard_normal((64, 2)))
    assert np.min([found.S1_conf, found.ST_conf]) > 0.6
    assert min(of_curves["ST_conf"].min(), of_curves["S1_conf"].min()) > 0.6
    assert np.isfinite([found.S1, found.ST]).all()


def test_the_second_order_of_ishigami():
    one = estimate(3, 216, second_order=True)
    found = one.analysis(FUNCTIONS["Ishigami"][1](one.share))
    assert found.S2[0, 2] == pytest.approx(0.2437, abs=0.01)
    assert found.S2[0, 1] == pytest.approx(0.0, abs=0.01)
    assert found.S2_conf.shape == (3, 3)


def test_the_convergence_is_that_of_smaller_designs():
    one = estimate(3, 64)
    outcome = FUNCTIONS["Ishigami"][1](one.share)
    found = one.convergence(outcome)
    assert found.base_samples == [32, 64]
    np.testing.assert_array_equal(found.ST[1], one.analysis(outcome).ST)
    np.testing.assert_array_equal(found.ST[0], estimate(3, 32).analysis(outcome[:32]).ST)


def test_designs_grow_by_adding_rows():
    model, inputs = Model(), Inputs()
    small, _ = plain_design(model, 64, 3, TURN, inputs)
    large, share = plain_design(model, 144, 3, TURN, inputs)
    np.testing.assert_array_equal(small.rows, large.rows[:64])
    assert large.block == 1 and share.shape == (144, 16)
    assert ((share >= 0) & (share <= 1)).all()
    assert sizes_up_to(400) == [64, 96, 144, 216, 320, 400]
    assert sizes_up_to(50) == [48]
    assert sizes_up_to(100, 20) == [16, 24, 32, 48, 72, 96]
    assert all(size % TURN == 0 for size in sizes_up_to(10_000))


STUDY = """
name: cheap
seed: 3
cohort: cohort
tasks: [sobol, importance, pawn]
sobol: {method: surrogate, error: 0.15, runs: 400, distributions: {E_f: {mean: 205, sd: 20}}}
importance: {trees: 10, repeats: 2}
pawn: {slides: 4}
store: {points_per_curve: 12}
model:
  parameters:
"""
FREE = ("E_f", "alpha_f", "E_m")


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    folder = tmp_path_factory.mktemp("cheap")
    fixed = (f"    {p.name}: {{fixed: {p.reference}}}\n" for p in Model().parameters if p.name not in FREE)
    return study_of_one(folder, STUDY + "".join(fixed))


@pytest.fixture(scope="module")
def out(study, drawing):
    with drawn_in_this_process(drawing) as patch:
        patch.setattr(by_chaos, "COMPONENTS", 2)  # polynomials of each component take most of the time
        sinew("run", study, "--out", study.parent / "out", "--quiet")
    return study.parent / "out"


def test_a_study_stops_at_the_error_that_was_asked_for(out):
    found = json.loads((out / "sobol.json").read_text())
    assert found["surrogate"]["reached"] is True
    assert found["rows"] == found["base_samples"] == 216
    every = [found, *found["protocols"].values()]
    assert max(max(one["ST_conf"] + one["S1_conf"]) for one in every) <= 0.15
    assert set(found["surrogate"]["unexplained"]) == {"total", "one_step", "two_step", "cyclic"}
    assert found["convergence"]["base_samples"] == [64, 96, 144, 216]
    assert found["distributions"] == {"E_f": {"mean": 205, "sd": 20}}
    along = open_store(out).read_result(f"sobol_time/{next(iter(found['tables'].values()))}")
    assert along["ST_cyclic"].sizes["parameter"] == 3
    for task in ("importance", "pawn"):
        assert json.loads((out / f"{task}.json").read_text())["names"] == list(FREE)
    page = (out / "report.html").read_text()
    assert "216 runs; polynomials leave at most" in page
    assert "from 216 runs" in page
    assert (out / "figures" / "sobol.png").is_file()


def test_the_indices_are_those_of_saltellis_design(study, out, tmp_path, monkeypatch):
    monkeypatch.setattr(Workspace, "client", lambda self: None)
    asked = "method: surrogate, error: 0.15, runs: 400"
    large = study.with_name("large.yaml")
    large.write_text(study.read_text().replace(asked, "base_samples: 1024"))
    sinew("sobol", large, "--out", tmp_path / "out", "--quiet")
    known, found = (json.loads((folder / "sobol.json").read_text()) for folder in (tmp_path / "out", out))
    for key in ("S1", "ST"):
        apart = np.abs(np.subtract(known[key], found[key]))
        assert (apart <= np.hypot(known[f"{key}_conf"], found[f"{key}_conf"])).all()


def test_a_study_that_comes_to_its_last_run_says_so(study, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(Workspace, "client", lambda self: None)
    strict = study.with_name("strict.yaml")
    strict.write_text(study.read_text().replace("error: 0.15, runs: 400", "error: 0.0001, runs: 96"))
    sinew("sobol", strict, "--out", tmp_path / "out")
    said = " ".join(capsys.readouterr().out.split())
    assert "intervals are wider than ± 0.0001: more sobol.runs" in said
    assert json.loads((tmp_path / "out" / "sobol.json").read_text())["convergence"]["base_samples"] == [64, 96]
    monkeypatch.setattr(Uniaxial, "compare", lambda *_: pytest.fail("a row is evaluated again"))
    monkeypatch.setattr(ByChaos, "analysis", lambda *_: pytest.fail("it is analysed again"))
    sinew("sobol", strict, "--out", tmp_path / "out", "--quiet")


@pytest.mark.thorough
def test_a_model_that_fails_in_a_corner_is_refused(study, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(Workspace, "client", lambda self: None)
    compare, edge = Uniaxial.compare, [60.0]

    def failing(self, model, specimen, curve, parameters, keep):
        found = compare(self, model, specimen, curve, parameters, keep)
        high = parameters[:, model.names.index("E_m")] > edge[0]
        found.status[high] = 1
        found.rmse_N[high] = np.nan
        return found

    monkeypatch.setattr(Uniaxial, "compare", failing)
    with pytest.raises(SystemExit) as ended:
        sinew("sobol", study, "--out", tmp_path / "out", "--quiet")
    assert ended.value.code == 2
    said = capsys.readouterr().err
    assert "of 64 rows failed; expected at most 5 % for a surrogate: narrower ranges, or method: saltelli" in said
    assert not (tmp_path / "out" / "sobol.json").exists()
    edge[0] = 69.0  # 2 % of the range
    sinew("sobol", study, "--out", tmp_path / "few")
    few = json.loads((tmp_path / "few" / "sobol.json").read_text())
    assert few["failed"] > 0
    assert min(few["ST_conf"]) > 2 * few["failed"] / few["rows"]
    assert "rows failed; the emulators were trained with the rows that ran" in " ".join(capsys.readouterr().out.split())


def test_intervals_grow_by_what_failed_rows_might_have_shown():
    one = estimate(3, 64)
    ok = np.ones(64, dtype=bool)
    ok[[5, 40]] = False
    found = replace(one, ok=ok).analysis(one.share[:, 0] + one.share[:, 1])  # which polynomials explain without error
    np.testing.assert_allclose([found.S1_conf, found.ST_conf], 2 * 2 / 64, atol=1e-6)


def test_an_outcome_that_does_not_vary_is_explained():
    one = estimate(3, 64)
    assert one.unexplained(np.full(64, 3.0)) == 0.0
    assert np.isnan(one.analysis(np.full(64, 3.0)).ST).all()


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ("method: surrogate, points: 100", "points: given with method: surrogate; expected no points"),
        ("runs: 100", "runs: given with method: saltelli; expected no runs"),
    ],
)
def test_settings_of_the_other_method_are_refused(study, tmp_path, capsys, asked, said):
    wrong = study.with_name("wrong.yaml")
    wrong.write_text(study.read_text().replace("method: surrogate, error: 0.15, runs: 400", asked))
    with pytest.raises(SystemExit) as ended:
        sinew("sobol", wrong, "--out", tmp_path / "out", "--quiet")
    assert ended.value.code == 2
    assert said in capsys.readouterr().err


def test_a_surrogate_is_not_extended(study, out, capsys):
    with pytest.raises(SystemExit):
        sinew("sobol", study, "--out", out, "--extend", "--quiet")
    assert "a smaller sobol.error, or more sobol.runs" in capsys.readouterr().err
    other = study.with_name("other.yaml")
    other.write_text(study.read_text().replace("method: surrogate, error: 0.15, runs: 400", "base_samples: 64"))
    with pytest.raises(SystemExit):
        sinew("sobol", other, "--out", out, "--extend", "--quiet")
    assert "sobol.json: is by surrogate; expected a design of Saltelli's to extend" in capsys.readouterr().err


@pytest.mark.parametrize("unit", [1e-200, 1e250, 1.7e308])
def test_outcomes_of_any_size_have_the_same_indices(unit):
    """A solver may log whatever it likes; squares of such numbers overflow, or vanish."""
    found = estimate(3, 64)
    values = np.sin(5.0 * found.share[:, 0]) + found.share[:, 1] * found.share[:, 2]
    values /= np.abs(values).max()
    curves = np.column_stack([values, values**3])
    expected, every = found.analysis(values), found.of(curves)
    again, far = found.analysis(unit * values), found.of(unit * curves)
    np.testing.assert_allclose(again.ST, expected.ST, rtol=1e-6)
    np.testing.assert_allclose(again.ST_conf, expected.ST_conf, rtol=1e-4)
    for key, known in every.items():
        np.testing.assert_allclose(far[key], known, rtol=1e-4, atol=1e-8)
    assert found.unexplained(unit * values) == pytest.approx(found.unexplained(values), rel=1e-4)
