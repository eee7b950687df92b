"""Indices of parameters that depend on each other, against answers that are known."""

from itertools import combinations
from math import factorial

import numpy as np
import pytest

from sinew.tasks.model import Model
from sinew.tasks.model.parameters import own_parameter
from sinew.tasks.simulate.inputs import Inputs, Normal
from sinew.tasks.simulate.saltelli import saltelli
from sinew.tasks.sobol.estimate import estimator
from sinew.tasks.sobol.method import Intervals

INTERVALS = Intervals(50, 0.95, 1)


def model_of(size):
    return Model(tuple(own_parameter(f"x{j}", "1", -9.0, 9.0) for j in range(size)))


def normal_inputs(covariance, groups=None):
    """Normal parameters with a covariance, as the study would give them."""
    sd = np.sqrt(np.diag(covariance))
    rank = 6.0 / np.pi * np.arcsin(covariance / np.outer(sd, sd) / 2.0)
    pairs = {f"x{i}": {f"x{j}": rank[i, j] for j in range(i + 1, len(sd)) if rank[i, j]} for i in range(len(sd))}
    distributions = {f"x{j}": Normal(0.0, each) for j, each in enumerate(sd)}
    return Inputs(groups or {}, distributions, {one: others for one, others in pairs.items() if others})


def linear_truth(slopes, covariance, factors):
    """S1, ST and Shapley effects of a sum of normal parameters (Owen and Prieur 2017, SIAM/ASA JUQ 5, 986)."""
    total = slopes @ covariance @ slopes

    def known(which):
        """The part of the variance that goes away when these factors become known."""
        at = [place for factor in which for place in factors[factor]]
        if not at:
            return 0.0
        of = covariance[:, at] @ np.linalg.solve(covariance[np.ix_(at, at)], covariance[at])
        return slopes @ of @ slopes / total

    every = range(len(factors))
    first = [known([j]) for j in every]
    last = [1.0 - known([i for i in every if i != j]) for j in every]
    shapley = []
    for j in every:
        others = [i for i in every if i != j]
        shapley.append(
            sum(
                factorial(size) * factorial(len(others) - size) / factorial(len(factors))
                * (known([*some, j]) - known(some))
                for size in range(len(factors))
                for some in combinations(others, size)
            )
        )  # fmt: skip
    return {"S1": np.array(first), "ST": np.array(last), "Sh": np.array(shapley)}


def estimated(model, inputs, function, base=4096, seed=5, scrambles=8):
    design = saltelli(model, base, False, seed, scrambles, inputs)
    outcomes = function(design.free_rows)
    ok = np.isfinite(outcomes)
    return design, estimator(design, design.features(), ok, INTERVALS).of(outcomes[:, np.newaxis])


COVARIANCES = {
    2: np.array([[1.0, 0.6], [0.6, 0.8]]),
    3: np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.8], [0.0, 0.8, 1.44]]),
    4: np.array([[1.0, 0.5, -0.3, 0.0], [0.5, 1.0, 0.2, 0.0], [-0.3, 0.2, 0.7, 0.4], [0.0, 0.0, 0.4, 1.0]]),
    5: 0.6 * np.eye(5) + 0.4,
}


@pytest.mark.parametrize("size", COVARIANCES)
def test_indices_of_a_sum_of_normal_parameters_are_those_that_are_known(size):
    covariance, slopes = COVARIANCES[size], np.array([1.0, -0.5, 2.0, 0.3, 0.0])[:size]
    _, found = estimated(model_of(size), normal_inputs(covariance), lambda rows: rows @ slopes)
    truth = linear_truth(slopes, covariance, [(j,) for j in range(size)])
    for key, value in truth.items():
        np.testing.assert_allclose(found[key][:, 0], value, atol=0.03, err_msg=key)
        assert (np.abs(found[key][:, 0] - value) <= 2.0 * found[f"{key}_conf"][:, 0] + 1e-12).all()
    assert found["Sh"].sum() == pytest.approx(1.0, abs=1e-12)


def test_groups_may_depend_on_each_other():
    covariance, slopes = COVARIANCES[5], np.array([1.0, -0.5, 2.0, 0.3, 1.0])
    inputs = normal_inputs(covariance, {"both": ("x1", "x3")})
    design, found = estimated(model_of(5), inputs, lambda rows: rows @ slopes)
    assert design.names == ("x0", "both", "x2", "x4")
    truth = linear_truth(slopes, covariance, [(0,), (1, 3), (2,), (4,)])
    for key, value in truth.items():
        np.testing.assert_allclose(found[key][:, 0], value, atol=0.03, err_msg=key)


def test_every_row_follows_the_distribution_and_its_rank_correlations():
    model, inputs = Model(), Inputs(correlations={"E_f": {"alpha_f": -0.7}, "g_1f": {"E_m": 0.4}})
    design = saltelli(model, 2048, False, 3, 8, inputs)
    names = [parameter.name for parameter in model.free]
    blocks = design.free_rows.reshape(2048, design.block, -1)
    share = (blocks - [one.minimum for one in model.free]) / [one.maximum - one.minimum for one in model.free]
    asked = np.eye(len(names))
    for one, other, rank in (("E_f", "alpha_f", -0.7), ("g_1f", "E_m", 0.4)):
        i, j = names.index(one), names.index(other)
        asked[i, j] = asked[j, i] = rank
    for row in range(design.block):
        np.testing.assert_allclose(12.0 * np.cov(share[:, row].T, bias=True), asked, atol=0.09)
        np.testing.assert_allclose(share[:, row].mean(axis=0), 0.5, atol=0.03)


def test_what_is_not_drawn_anew_stays_as_it_is():
    inputs = Inputs({"both": ("x1", "x3")}, correlations={"x0": {"x1": 0.6, "x4": -0.3}, "x3": {"x5": 0.5}})
    design = saltelli(model_of(6), 64, False, 3, 8, inputs)
    blocks = design.free_rows.reshape(64, design.block, 6)
    stays = blocks == blocks[:, :1]
    count = len(design.names)
    assert design.block == 3 * count - 1
    for number, places in enumerate(design.members):
        of = np.isin(np.arange(6), places)
        assert (stays[:, 1 + number] == ~of).all()
        assert (stays[:, 1 + count + number] == of).all()
    for length in (2, 3):
        for each, order in zip(stays[:, 2 * count + length - 1], design.orders, strict=True):
            anew = [place for factor in order[:length] for place in design.members[factor]]
            assert (each == ~np.isin(np.arange(6), anew)).all()
    assert not stays[:, -1].any()
    assert (np.sort(design.orders, axis=1) == np.arange(count)).all()
    for of_sequence in design.orders.reshape(8, 8, count).swapaxes(0, 1):  # each is first once in five base samples
        assert sorted(of_sequence[:5, 0]) == list(range(count))


def test_without_dependence_what_is_drawn_anew_is_saltellis():
    model = model_of(4)
    inputs = Inputs(correlations={"x0": {"x1": 0.0}})
    design, plain = (saltelli(model, 64, True, 3, 8, each) for each in (inputs, Inputs()))
    rows = design.free_rows.reshape(64, design.block, 4)
    known = plain.free_rows.reshape(64, plain.block, 4)
    np.testing.assert_allclose(rows[:, [*range(9), -1]], known, atol=1e-6)


def test_a_larger_design_begins_with_the_smaller_one():
    inputs = Inputs(correlations={"x0": {"x3": 0.5}})
    small, large = (saltelli(model_of(6), base, False, 3, 8, inputs) for base in (256, 512))
    np.testing.assert_array_equal(large.rows[: len(small.rows)], small.rows)
    np.testing.assert_array_equal(large.orders[:256], small.orders)


def test_rows_that_failed_leave_first_order_indices_and_a_reason():
    covariance = COVARIANCES[3]
    inputs = normal_inputs(covariance)

    def function(rows):
        return np.where(rows[:, 0] > 2.0, np.nan, rows.sum(axis=1))  # 2.3 %

    _, found = estimated(model_of(3), inputs, function)
    assert np.isfinite(found["S1"]).all()
    for key in ("ST", "Sh", "Sh_conf"):
        assert np.isnan(found[key]).all(), key

    def seldom(rows):
        return np.where(rows[:, 0] > 3.4, np.nan, rows.sum(axis=1))

    _, found = estimated(model_of(3), inputs, seldom)
    truth = linear_truth(np.ones(3), covariance, [(0,), (1,), (2,)])
    np.testing.assert_allclose(found["Sh"][:, 0], truth["Sh"], atol=0.03)


def test_one_sequence_has_bootstrap_intervals():
    covariance, slopes = COVARIANCES[4], np.array([1.0, -0.5, 2.0, 0.3])
    _, found = estimated(model_of(4), normal_inputs(covariance), lambda rows: rows @ slopes, 2048, scrambles=1)
    truth = linear_truth(slopes, covariance, [(j,) for j in range(4)])
    np.testing.assert_allclose(found["Sh"][:, 0], truth["Sh"], atol=0.06)
    assert (found["Sh_conf"] > 0).all()
