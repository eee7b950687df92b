"""Bayesian optimisation of what follows from curves: down to the noise, around failures, asynchronously."""

import pickle

import numpy as np
import pytest

from sinew.tasks.data.virtual import virtual_cohort
from sinew.tasks.fitting.bayesian import Search, Surrogate, bayesian, components, propose, totals_of
from sinew.tasks.fitting.fits import residuals_of
from sinew.tasks.model import Model
from sinew.tasks.model.parameters import from_unit
from sinew.tasks.simulate.evaluation import SpecimenEvaluation
from sinew.tasks.simulate.uniaxial import Uniaxial

TIMES = np.linspace(0, 1, 40)
TRUTH = np.array([0.7, 0.3, 0.45, 0.6])
NOISE = 0.01
NOTHING = Search(np.empty((0, 4)), np.empty(0), np.empty((0, 0, 0)))


def curves(point):
    """Two of them ``[p, k]``: a relaxation and a ramp."""
    relaxed = 5 * point[0] * np.exp(-4 * point[1] * TIMES) + point[2]
    return np.array([relaxed, (1 + 4 * point[3]) * np.expm1(2 * point[0] * TIMES)])


def residuals(point):
    noise = NOISE * np.random.default_rng(1).normal(size=(2, TIMES.size))
    return (curves(point) - curves(TRUTH) - noise) / np.sqrt(TIMES.size)


def total(point):
    return float(np.linalg.norm(residuals(point), axis=1).sum())


def searched(*, budget=30, initial=6, pending=1, seeds=NOTHING, fails=lambda point: False, propose_one=None):
    asked = []

    def next_result():
        point = asked.pop(0)
        if fails(point):
            return np.inf, np.full((2, TIMES.size), np.nan)
        return total(point), residuals(point)

    return bayesian(
        lambda points: asked.extend(points),
        next_result,
        propose_one or (lambda number, surrogate: propose(surrogate, (3, number))),
        size=4,
        budget=budget,
        initial=initial,
        pending=pending,
        seeds=seeds,
        rng=np.random.default_rng(3),
    )


def test_the_search_ends_at_the_noise():
    seen = searched()
    assert len(seen.points) == len(seen.totals) == len(seen.residuals) == 30
    assert seen.totals.min() < 1.1 * total(TRUTH)
    assert seen.points[np.argmin(seen.totals)] == pytest.approx(TRUTH, abs=0.05)
    random = [total(point) for point in np.random.default_rng(4).random((30, 4))]
    assert min(random) > 10 * total(TRUTH)


def test_a_search_is_the_same_every_time():
    first, again = searched(budget=10), searched(budget=10)
    assert np.array_equal(first.points, again.points)


@pytest.mark.parametrize("pending", [1, 3])
def test_a_proposal_knows_all_but_the_last_pending(pending):
    known = {}

    def propose_one(number, surrogate):
        known[number] = surrogate
        return propose(surrogate, (3, number))

    seen = searched(budget=14, pending=pending, propose_one=propose_one)
    assert list(known) == list(range(6, 14))
    for number, surrogate in known.items():
        heard = number - pending + 1
        assert np.array_equal(surrogate.points, seen.points[:heard])
        assert np.array_equal(surrogate.pending, seen.points[heard:number])
        assert totals_of(surrogate.scores, surrogate.roots) == pytest.approx(seen.totals[:heard])
    apart = np.linalg.norm(seen.points[6:, np.newaxis] - seen.points[np.newaxis, 6:], axis=-1)
    assert apart[~np.eye(8, dtype=bool)].min() > 1e-3, "what is pending is not proposed again"


def test_known_evaluations_inform_the_first_proposal():
    points = np.random.default_rng(5).random((30, 4))
    seeds = Search(points, np.array([total(p) for p in points]), np.array([residuals(p) for p in points]))
    known, bare = searched(budget=9, initial=1, seeds=seeds), searched(budget=9, initial=1)
    assert np.array_equal(known.points[0], bare.points[0])
    assert known.totals[1] < seeds.totals.min() / 2
    assert known.totals.min() < bare.totals.min() / 2


def test_failures_keep_away():
    """Of the cube without failures the search knows nothing before; of a random design half fails."""

    def fails(point):
        return point[0] < 0.5

    seen = searched(fails=fails)
    failed = np.isinf(seen.totals)
    assert failed[:6].any()
    assert failed[6:].mean() < 0.2
    assert seen.totals.min() < 1.1 * total(TRUTH)


def test_where_everything_fails_points_are_random():
    seen = searched(fails=lambda point: True, budget=12)
    assert np.isinf(seen.totals).all()
    assert len(np.unique(seen.points, axis=0)) == 12


def test_components_give_the_objective_back():
    rng = np.random.default_rng(0)
    along = rng.normal(size=(40, 7)) @ rng.normal(size=(7, 3 * 20)) + rng.normal(size=60)
    along = along.reshape(40, 3, 20)
    along[:, 1, 15:] = 0.0  # a curve with fewer points
    scores, roots = components(along)
    expected = np.linalg.norm(along, axis=-1).sum(axis=-1)
    assert totals_of(scores, roots) == pytest.approx(expected)
    few, roots = components(along[:2])
    assert totals_of(few, roots) == pytest.approx(expected[:2])


def test_a_surrogate_is_small_enough_to_travel():
    rng = np.random.default_rng(0)
    scores, roots = components(rng.normal(size=(1000, 3, 96)))
    surrogate = Surrogate(rng.random((1000, 16)), scores, roots, np.empty((0, 16)), np.empty((0, 16)), None, True)
    assert len(pickle.dumps(surrogate)) < 500_000


@pytest.fixture(scope="module")
def specimen():
    specimens, _ = virtual_cohort(seed=1, per_site=1, rate_hz=10.0)
    return specimens[0]


@pytest.mark.parametrize("kept", [40, 96, "all"])
def test_the_norm_of_residuals_is_about_the_rmse(specimen, kept):
    evaluation = SpecimenEvaluation(Model(), specimen, Uniaxial(), kept)
    values = evaluation(from_unit(Model(), np.random.default_rng(0).random((6, 16)))).values
    along = residuals_of(evaluation, tuple(values[f"force_{curve.name}"] for curve in specimen.curves))
    assert along.shape == (6, 3, 40 if kept == 40 else 96)
    assert np.linalg.norm(along, axis=-1) == pytest.approx(values["objective"], rel=0.1 if kept == 40 else 0.05)
