"""Parameters that belong to the machine have one value for all specimens."""

from pathlib import Path

import numpy as np
import pytest

from sinew.tasks.data.noise import Noise
from sinew.tasks.discover.after.estimates import estimates, shared_estimates
from sinew.tasks.discover.fit.fit import Fitted
from sinew.tasks.discover.fit.specimen_fits import SpecimenFits
from sinew.tasks.fitting.measured import Measured
from sinew.tasks.model import Model, Specimen
from sinew.tasks.model.effects import library

NOTHING = Measured(Specimen("a", 10.0, 4.0, 1.0), Noise(1.0, 0.0))
LAG, SLACK = library()["time-lag"], library()["toe-slack"]


def fits(*values: float, error: float = 0.01) -> list[Fitted]:
    size = SpecimenFits(NOTHING, Model(), Path()).candidate((LAG,)).size
    return [Fitted(np.full(size, value), 1.0, 10, np.full(size, error)) for value in values]


@pytest.mark.parametrize(("values", "one"), [((0.20, 0.21), True), ((0.20, 0.40), False)])
def test_one_value_for_all_specimens_and_whether_there_is_one(values, one):
    candidate = SpecimenFits(NOTHING, Model(), Path()).candidate((LAG,))
    estimate = shared_estimates((LAG,), candidate, fits(*values))["force_lag"]
    assert estimate.value == pytest.approx(np.mean(values))
    low, high = estimate.interval
    assert (high - low) / 2 == pytest.approx(1.645 * 0.01 / np.sqrt(2.0))
    assert (estimate.p > 0.05) is one


def test_a_specimens_own_parameters_are_notshared_estimates():
    assert shared_estimates((SLACK,), SpecimenFits(NOTHING, Model(), Path()).candidate((SLACK,)), fits(0.2, 0.3)) == {}


def test_no_interval_reaches_beyond_what_is_possible():
    candidate = SpecimenFits(NOTHING, Model(), Path()).candidate((LAG,))
    low, high = (float(ends[-1]) for ends in candidate.bounds())
    for value, end in ((0.05, low), (0.95, high)):
        one = estimates((LAG,), candidate, fits(value, error=0.2)[0], None)["force_lag"]
        both = shared_estimates((LAG,), candidate, fits(value, value, error=0.2))["force_lag"]
        assert end in one.interval
        assert end in both.interval
