"""What is told of parameters that belong to the machine."""

from pathlib import Path

import numpy as np
import pytest

from tasks.discover.explore import Explorer
from tasks.discover.fit import Fitted
from tasks.discover.told import _shared
from tasks.model import Model
from tasks.model.effects import library

LAG, SLACK = library()["time-lag"], library()["toe-slack"]


def fits(*values: float, error: float = 0.01) -> list[Fitted]:
    size = Explorer(None, Model(), Path()).candidate((LAG,)).size
    return [Fitted(np.full(size, value), 1.0, 10, np.full(size, error)) for value in values]


@pytest.mark.parametrize(("values", "one"), [((0.20, 0.21), True), ((0.20, 0.40), False)])
def test_one_value_for_all_specimens_and_whether_there_is_one(values, one):
    told = _shared((LAG,), Explorer(None, Model(), Path()).candidate((LAG,)), fits(*values))["force_lag"]
    assert told["value"] == pytest.approx(np.mean(values))
    low, high = told["interval"]
    assert (high - low) / 2 == pytest.approx(1.645 * 0.01 / np.sqrt(2.0))
    assert (told["p"] > 0.05) is one


def test_a_specimens_own_parameters_are_not_shared():
    assert _shared((SLACK,), Explorer(None, Model(), Path()).candidate((SLACK,)), fits(0.2, 0.3)) == {}
