"""Which indices are given where rows failed, and what they are worth."""

import numpy as np
import pytest
import SALib.test_functions.Ishigami as ishigami

from sinew.tasks.simulate.saltelli import Design, drawn
from sinew.tasks.sobol.estimate import LIMIT, REFUSED, RULE, estimator
from sinew.tasks.sobol.method import Intervals, indices_if_failed_had
from sinew.tasks.sobol.result import KEYS

HOW = Intervals(20, 0.95, 0)
BOUNDS = [[-np.pi, np.pi]] * 3
FIRST, TOTAL = np.array([0.3139, 0.4424, 0.0]), np.array([0.5576, 0.4424, 0.2437])


def estimated(base, failed, function, bounds, scrambles=8, seed=3, *, second_order=False):
    """An estimator of a design of which rows fail, and the outcomes of the others."""
    names = tuple(f"x{j}" for j in range(len(bounds)))
    rows = drawn(names, bounds, base, seed, second_order=second_order, scrambles=scrambles)
    design = Design(names, base, second_order, rows, scrambles=scrambles)
    ok = ~failed(rows)
    features = rows.reshape(base, design.block, -1)[:, [0, -1]]
    return estimator(design, features, ok, HOW), np.where(ok, function(rows), np.nan)


def few(rows):
    failed = np.zeros(len(rows), dtype=bool)
    failed[np.random.default_rng(0).choice(len(rows), int(0.5 * LIMIT * len(rows)), replace=False)] = True
    return failed


def nothing(rows):
    return np.zeros(len(rows), dtype=bool)


def corner(rows):
    return rows[:, 0] + rows[:, 1] > 1


def curved(rows):
    return 3 * rows[:, 0] + 2 * rows[:, 1] ** 2 + 2 * rows[:, 2] * rows[:, 0] + 0.3 * rows[:, 3]


@pytest.fixture(scope="module")
def truth():
    """First order indices where x0 + x1 <= 1: variances of means in 500 parts of many random rows."""
    rows = np.random.default_rng(0).random((1_000_000, 4))
    rows = rows[~corner(rows)]
    outcome = curved(rows)
    found = []
    for column in rows.T:
        part = (column * 500).astype(int)
        count, total = np.bincount(part, minlength=500), np.bincount(part, outcome, minlength=500)
        means = total / np.maximum(count, 1)
        found.append(count @ (means - outcome.mean()) ** 2 / count.sum() / outcome.var())
    return np.array(found)


def test_few_failures_cost_little():
    estimate, output = estimated(2048, few, ishigami.evaluate, BOUNDS)
    found = estimate.of(output[:, np.newaxis])
    assert not estimate.refuses and estimate.rule == RULE
    np.testing.assert_allclose(found["S1"][:, 0], FIRST, atol=0.03)
    np.testing.assert_allclose(found["ST"][:, 0], TOTAL, atol=0.03)
    for key in ("S1", "ST"):
        assert (found[f"{key}_conf"] < 0.1).all()
    reported = indices_if_failed_had(estimate.design, output, estimate.ok, HOW)
    for value in ("smallest", "mean", "largest"):
        assert 0 < np.abs(reported[f"ST_if_{value}"] - found["ST"][:, 0]).max() < 0.2
    assert indices_if_failed_had(estimate.design, output, np.ones_like(estimate.ok), HOW) == {}


@pytest.mark.parametrize("base", [256, 1024])
def test_first_order_indices_hold_where_a_corner_fails(base, truth):
    """95 % intervals, over 40 seeds; Saltelli's would be off by 0.05 and 0.09."""
    hits, errors = [], []
    for seed in range(40):
        estimate, output = estimated(base, corner, curved, [[0, 1]] * 4, seed=seed)
        found = estimate.of(output[:, np.newaxis])
        assert estimate.refuses and estimate.rule == REFUSED
        assert np.isnan(found["ST"]).all() and np.isnan(found["ST_conf"]).all()
        errors.append(found["S1"][:, 0] - truth)
        hits.append(np.abs(errors[-1]) <= found["S1_conf"][:, 0] + 0.002)
    assert np.abs(np.mean(errors, axis=0)).max() < 0.01
    assert 0.9 <= np.mean(hits) <= 1.0


def test_one_sequence_has_the_same_indices_without_intervals(truth):
    estimate, output = estimated(1024, corner, curved, [[0, 1]] * 4, scrambles=1)
    found = estimate.of(np.column_stack([output, np.where(np.isnan(output), np.nan, 2.0)]))
    np.testing.assert_allclose(found["S1"][:, 0], truth, atol=0.03)
    assert np.isnan(found["S1_conf"]).all()
    assert np.isnan(found["S1"][:, 1]).all(), "it does not vary"


def test_one_output_and_many_agree():
    for failed in (nothing, few, corner):
        estimate, output = estimated(256, failed, ishigami.evaluate, BOUNDS, second_order=True)
        one = estimate.analysis(output)
        assert (one.S2 is None) == estimate.refuses
        if failed is not nothing:  # SALib takes other rows' mean off
            many = estimate.of(output[:, np.newaxis])
            for key in KEYS:
                np.testing.assert_array_equal(getattr(one, key), many[key][:, 0])


@pytest.mark.parametrize("unit", [1e-250, 1e200])
def test_indices_have_no_unit_where_rows_failed(unit):
    one, outcomes = estimated(64, corner, curved, [[0.0, 1.0]] * 4)
    found, other = (one.of(each[:, np.newaxis])["S1"] for each in (outcomes, unit * outcomes))
    assert np.isfinite(found).all()
    assert np.allclose(other, found)


def test_a_convergence_begins_with_32_base_samples_and_ends_with_all():
    several, output = estimated(512, nothing, ishigami.evaluate, BOUNDS)
    assert several.convergence(output).base_samples == [256, 512], "of each sequence 32"
    estimate, output = estimated(128, nothing, ishigami.evaluate, BOUNDS, scrambles=1)
    curve = estimate.convergence(output)
    assert curve.base_samples == [32, 64, 128]
    for at, size in enumerate(curve.base_samples):
        smaller, same = estimated(size, nothing, ishigami.evaluate, BOUNDS, scrambles=1)
        found = smaller.of(same[:, np.newaxis])
        for key in KEYS:
            assert np.array_equal(getattr(curve, key)[at], found[key][:, 0]), (size, key)


def test_a_convergence_of_few_base_samples_has_one_point():
    estimate, output = estimated(16, nothing, ishigami.evaluate, BOUNDS)
    assert estimate.convergence(output).base_samples == [16]


def test_a_convergence_leaves_out_sizes_of_which_too_much_failed():
    estimate, output = estimated(1024, lambda rows: np.arange(len(rows)) < 4, ishigami.evaluate, BOUNDS)
    assert not estimate.refuses
    assert estimate.convergence(output).base_samples == [256, 512, 1024]
    refused, output = estimated(128, lambda rows: np.arange(len(rows)) < 40, ishigami.evaluate, BOUNDS)
    curve = refused.convergence(output)
    assert curve.base_samples == [] and curve.ST.shape == (0, 3)
