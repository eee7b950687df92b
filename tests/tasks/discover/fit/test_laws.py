"""The search for laws: units from the tests, and what counts as a prediction."""

import numpy as np
import pytest

from sinew.tasks.discover.fit.laws import predicts, units_of
from sinew.tasks.discover.result import Gain
from sinew.tasks.model import Curve, Protocol, Specimen


def test_units_of_drivers_are_the_powers_of_ten_nearest_to_what_the_tests_reach():
    time = np.linspace(0.0, 40.0, 401)
    moved = np.interp(time, [0.0, 10.0, 20.0, 30.0, 40.0], [0.0, 0.4, 0.0, 0.4, 0.0])
    there_and_back = Curve(Protocol("cyclic", time, moved), 900.0 * moved)
    units = units_of([Specimen("one", 10.0, 8.0, 4.0, (there_and_back,))])
    assert units == {
        "strain": pytest.approx(0.1),  # 0.0408
        "rate": pytest.approx(0.01),  # 0.0042: its logarithm is nearer to that of 0.01
        "path": pytest.approx(0.1),  # 0.163
        "time": pytest.approx(100.0),  # 40
        "force": pytest.approx(1000.0),  # 360
    }


def test_a_specimen_that_nothing_moved_has_units_too():
    still = Curve(Protocol("rest", np.arange(5.0), np.zeros(5)), np.zeros(5))
    assert all(unit > 0.0 for unit in units_of([Specimen("one", 10.0, 8.0, 4.0, (still,))]).values())


@pytest.mark.parametrize(
    ("held", "enough"),
    [
        ({"protocol": Gain(21.0, 10.0), "later cycles": Gain(21.0, 10.0), "specimen": Gain(-5.0, 1.0)}, True),
        ({"protocol": Gain(21.0, 10.0), "later cycles": Gain(19.0, 10.0), "specimen": Gain(-5.0, 1.0)}, False),
        ({"protocol": Gain(21.0, 10.0), "later cycles": Gain(19.0, 10.0)}, False),
        ({"protocol": Gain(21.0, 10.0)}, True),
        ({"protocol": Gain(19.0, 10.0)}, False),
        ({}, False),
    ],
)
def test_a_law_predicts_when_two_kinds_of_data_that_were_not_fitted_are_predicted_better(held, enough):
    assert predicts(held) is enough
