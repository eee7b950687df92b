"""Elementary effects against known answers, with failed trajectories, and reproducible."""

import numpy as np
import pytest

from sinew.tasks.model import Model, Parameter
from sinew.tasks.morris.method import Trajectories, elementary_effects, trajectories

HOW = {"resamples": 50, "confidence": 0.95, "seed": 5}


def parameter(name: str, low: float, high: float) -> Parameter:
    return Parameter(name, "1", low, high, (low + high) / 2, "")


MODEL = Model((parameter("a", 0.0, 2.0), parameter("b", -1.0, 1.0), parameter("c", 5.0, 6.0)), law="template")


def outcomes(design: Trajectories) -> np.ndarray:
    """3 a + 4 b, and an interaction of a and c: over the ranges, effects of 6 + 2 c', 8, and 2 a'."""
    a, b, c = design.rows.T
    return 3 * a + 4 * b + a * (c - 5.0)


def test_effects_are_those_of_the_whole_range_in_units_of_the_outcome():
    design = trajectories(MODEL, 400, 4, 1)
    found = elementary_effects(design, outcomes(design), np.ones(400, dtype=bool), **HOW)
    assert found.mu_star[1] == pytest.approx(8.0)
    assert found.sigma[1] == pytest.approx(0.0, abs=1e-9)  # b does not interact
    assert found.mu[0] == pytest.approx(7.0, abs=0.1)  # c' is 0.5 on average
    assert found.mu[2] == pytest.approx(1.0, abs=0.1)
    assert found.sigma[0] > 0.3
    assert found.mu_star_conf[1] == pytest.approx(0.0, abs=1e-9)
    assert 0 < found.mu_star_conf[0] < 0.2


def test_rows_stay_within_the_ranges_and_change_one_parameter_at_a_time():
    design = trajectories(MODEL, 20, 6, 3)
    low, high = ([getattr(p, end) for p in MODEL.parameters] for end in ("minimum", "maximum"))
    assert (design.rows >= low).all()
    assert (design.rows <= high).all()
    steps = np.diff(design.rows.reshape(20, design.block, 3), axis=1) != 0
    assert (steps.sum(axis=2) == 1).all()
    assert (steps.sum(axis=1) == 1).all()


def test_the_seed_decides_the_trajectories():
    assert np.array_equal(trajectories(MODEL, 8, 4, 1).rows, trajectories(MODEL, 8, 4, 1).rows)
    assert not np.array_equal(trajectories(MODEL, 8, 4, 1).rows, trajectories(MODEL, 8, 4, 2).rows)


def test_trajectories_with_a_failed_row_are_left_out_and_nothing_else():
    design = trajectories(MODEL, 60, 4, 2)
    values = outcomes(design)
    whole = np.ones(60, dtype=bool)
    whole[[3, 40]] = False
    values.reshape(60, -1)[[3, 40], 1] = np.nan
    kept = np.repeat(whole, design.block)
    part = Trajectories(design.names, 58, 4, design.unit[kept], design.rows[kept])
    found = elementary_effects(design, values, whole, **HOW)
    expected = elementary_effects(part, values[kept], np.ones(58, dtype=bool), **HOW)
    assert np.array_equal(found.mu_star, expected.mu_star)
    with pytest.raises(ValueError, match="must be numbers"):
        elementary_effects(design, values, np.ones(60, dtype=bool), **HOW)
