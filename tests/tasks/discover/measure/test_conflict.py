"""Curves of a true model are in conflict as rarely as chance says, and those of a wrong one are."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.stats import chi2

from sinew.tasks.discover.fit.candidate import Candidate
from sinew.tasks.discover.fit.fit import fit
from sinew.tasks.discover.measure.conflict import conflict, degrees_of_freedom, rank, together
from sinew.tasks.discover.result import SpecimenConflict
from sinew.tasks.model.effects import library
from sinew.tasks.model.protocols import cyclic, one_step
from tests.tasks.discover.measurements import BAR, measurements, model_with_free

FREE = ("E_f", "E_m", "g_1f", "g_3f", "tau_3f")


def outcome(model, effects, values, seed):
    """The test of a specimen pulled with effects, by the model without."""
    true, bare = Candidate(model, tuple(library()[slug] for slug in effects)), Candidate(model)
    at = np.concatenate([np.full(len(FREE), 0.5), [true.unit(*each) for each in values.items()]])
    one = measurements(true, at, [(BAR, make(10.0, 2.0)) for make in (one_step, cyclic)], seed)
    pooled = fit(bare, one, np.full(len(FREE), 0.5))
    own = [fit(bare, one, pooled.at, [curve]) for curve in one.curves]
    return conflict(bare, one, pooled, own)


def test_linear_models_are_in_conflict_as_often_as_chance_says():
    """Three curves, one of which is blind to a parameter."""
    rng = np.random.default_rng(0)
    slopes = [rng.standard_normal((size, 4)) for size in (50, 80, 30)]
    slopes[1][:, 2] = 0.0
    none = np.zeros(4, dtype=bool)
    freedom = degrees_of_freedom(slopes, none, [none] * 3)
    assert freedom == 4 + 3 + 4 - 4
    every = np.concatenate(slopes)
    ends = np.cumsum([0, *(len(each) for each in slopes)])
    noise = rng.standard_normal((20_000, len(every)))

    def left(matrix, part):
        basis, sizes, _ = np.linalg.svd(matrix, full_matrices=False)
        basis = basis[:, sizes > 1e-9]
        return np.sum(part**2, axis=1) - np.sum((part @ basis) ** 2, axis=1)

    alone = sum(left(each, noise[:, a:b]) for each, (a, b) in zip(slopes, pairwise(ends), strict=True))
    values = chi2.sf(left(every, noise) - alone, freedom)
    assert np.mean(values < 0.05) == pytest.approx(0.05, abs=0.005)


def test_curves_of_the_model_agree():
    found = [outcome(model_with_free(*FREE), (), {}, seed) for seed in range(8)]
    assert all(one.freedom == len(FREE) for one in found)
    assert sum(one.p < 0.05 for one in found) <= 2
    assert min(one.p for one in found) > 1e-3
    cohort = together({str(number): one for number, one in enumerate(found)})
    assert cohort.freedom == 8 * len(FREE)
    assert cohort.p > 1e-2
    assert all(sum(loss for _, loss in one.by_curve) == pytest.approx(one.statistic) for one in found)


@pytest.mark.parametrize(
    ("slug", "values"),
    [
        ("cyclic-fatigue", {"fatigue_per_strain": 0.1}),
        ("softening", {"softening_loss": 0.3, "softening_shape": 2.0, "softening_strain": 0.03}),
    ],
)
def test_curves_of_an_effect_that_one_of_them_sees_do_not(slug, values):
    found = outcome(model_with_free(*FREE), (slug,), values, 0)
    assert found.p < 1e-6
    assert found.apart[0].errors > 5.0
    assert set(found.apart[0].curves) == {"one_step", "cyclic"}
    assert [one.errors for one in found.apart] == sorted((one.errors for one in found.apart), reverse=True)


def test_what_does_not_count():
    slopes = [np.eye(3), np.eye(3)]
    none, first = np.zeros(3, dtype=bool), np.array([True, False, False])
    assert degrees_of_freedom(slopes, none, [none, none]) == 3
    assert degrees_of_freedom(slopes, none, [first, none]) == 2, "on a bound in a curve's own fit"
    assert degrees_of_freedom(slopes, first, [first, first]) == 2
    assert degrees_of_freedom([np.eye(3)], none, [none]) == 0
    assert rank(np.diag([1.0, 1e-9, 0.5])) == 2
    assert rank(np.zeros((4, 2))) == 0
    alone = together({"one": SpecimenConflict(3.0, 0, 1.0, (), ())})
    assert (alone.statistic, alone.freedom, alone.p, alone.worst) == (3.0, 0, 1.0, None)
