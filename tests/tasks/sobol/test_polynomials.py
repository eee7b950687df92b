"""Cheaper versions of a model: they save runs where they are like it, and change nothing that is true."""

from dataclasses import replace

import numpy as np
import pytest

from sinew.tasks.simulate.growing import TURN
from sinew.tasks.simulate.plain_design import shares
from sinew.tasks.simulate.saltelli import Design
from sinew.tasks.sobol.by_chaos import ByChaos, Version
from sinew.tasks.sobol.method import Intervals
from sinew.tasks.sobol.polynomials import Runs, Sum, fitted

RUNS, OF_CHEAPER = 32, 512


def model(at):
    """Of three parameters, with an interaction; :data:`FIRST` and :data:`TOTAL` are its indices."""
    centred = np.sqrt(12) * (at - 0.5)
    return np.exp(centred[:, 0]) * (1 + 0.3 * centred[:, 1]) + 0.5 * centred[:, 2] ** 3


def brute_force():
    """First and total order indices of the model, by an exact grid of Gauss points."""
    nodes, weights = np.polynomial.legendre.leggauss(12)
    grid = np.stack(np.meshgrid(*[(nodes + 1) / 2] * 3, indexing="ij"), axis=-1)
    values = model(grid.reshape(-1, 3)).reshape(12, 12, 12)
    mean = np.einsum("ijk,i,j,k", values, *[weights / 2] * 3)
    variance = np.einsum("ijk,i,j,k", values**2, *[weights / 2] * 3) - mean**2
    first, total = [], []
    for axis in range(3):
        along = np.moveaxis(values, axis, 0)
        given = np.einsum("ijk,j,k", along, weights / 2, weights / 2)
        first.append((given**2 @ weights / 2 - mean**2) / variance)
        others = np.einsum("ijk,i", along, weights / 2)
        total.append(1 - (np.einsum("jk,j,k", others**2, weights / 2, weights / 2) - mean**2) / variance)
    return np.array(first), np.array(total)


FIRST, TOTAL = brute_force()


def like(at):
    return 40.0 * model(at) + 3.0 * at[:, 1] * np.exp(at[:, 2])


def unlike(at):
    return np.cos(40 * at.sum(axis=1))


def opposite(at):
    return -model(at) * (1 + 0.5 * np.sin(6 * at[:, 0]))


def version(count, seed, number):
    share = shares(3, count, seed, TURN, number)
    return Design(("a", "b", "c"), count, False, share, scrambles=TURN, members=((0,), (1,), (2,)), plain=True), share


def estimate(*cheaper, seed=0, runs=RUNS):
    """The estimator, and the outcomes of the model and of cheaper versions of it."""
    design, share = version(runs, seed, 0)
    versions = [version(OF_CHEAPER, seed, number + 1) for number in range(len(cheaper))]
    outcomes = np.concatenate([model(share), *(f(at) for f, (_, at) in zip(cheaper, versions, strict=True))])
    ok = np.ones(runs, dtype=bool)
    beside = tuple(Version(*one) for one in versions)
    return ByChaos(design, share, ok, Intervals(10, 0.95, seed), sizes=(runs,), cheaper=beside), outcomes


def widest(found):
    return max(found.S1_conf.max(), found.ST_conf.max())


@pytest.mark.parametrize("cheaper", [(like,), (opposite, like), (unlike, like)])
def test_a_version_that_is_like_the_model_saves_runs(cheaper):
    one, outcomes = estimate(*cheaper)
    alone, by_itself = estimate()
    found, without = one.analysis(outcomes), alone.analysis(by_itself)
    assert one.fitted(outcomes).used
    assert one.fitted(outcomes).alone == alone.fitted(by_itself).alone
    assert widest(found) < 0.5 * widest(without)
    np.testing.assert_allclose(found.S1, FIRST, atol=widest(found))
    np.testing.assert_allclose(found.ST, TOTAL, atol=widest(found))


@pytest.mark.parametrize("cheaper", [(like,), (unlike,), (opposite,), (like, unlike)])
def test_intervals_hold_the_truth_whatever_the_cheaper_version_is(cheaper):
    held = []
    for seed in range(12):
        one, outcomes = estimate(*cheaper, seed=seed, runs=48)
        found = one.analysis(outcomes)
        held += [np.abs(found.S1 - FIRST) <= found.S1_conf, np.abs(found.ST - TOTAL) <= found.ST_conf]
    assert np.mean(held) > 0.93


def test_a_version_that_tells_nothing_is_not_used():
    one, outcomes = estimate(unlike)
    alone, by_itself = estimate()
    assert not one.fitted(outcomes).used
    np.testing.assert_array_equal(one.analysis(outcomes).ST, alone.analysis(by_itself).ST)
    np.testing.assert_array_equal(one.analysis(outcomes).ST_conf, alone.analysis(by_itself).ST_conf)


@pytest.mark.parametrize("wrong", [np.nan, 7.0], ids=["failed", "constant"])
def test_a_version_without_enough_runs_is_left_out(wrong):
    one, outcomes = estimate(like)
    outcomes[RUNS:] = wrong
    alone, by_itself = estimate()
    np.testing.assert_array_equal(one.analysis(outcomes).S1, alone.analysis(by_itself).S1)


def test_failed_runs_of_a_version_are_left_out():
    one, outcomes = estimate(like)
    whole = one.analysis(outcomes)
    outcomes[RUNS + 5 :: 7] = np.nan
    some = one.analysis(outcomes)
    np.testing.assert_allclose(some.ST, whole.ST, atol=0.01)
    assert not np.array_equal(some.ST, whole.ST)


def test_points_of_curves_have_the_indices_that_each_has_alone():
    one, _ = estimate(like)
    share = np.concatenate([one.share, one.cheaper[0].share])
    of_model = np.arange(len(share)) < RUNS
    time = np.linspace(0.2, 1.0, 6)
    curves = np.where(of_model, model(share), like(share))[:, np.newaxis] * time + share[:, :1] * time**2
    found = one.of(curves)
    alone = one.analysis(curves[:, 3])
    np.testing.assert_allclose(found["ST"][:, 3], alone.ST, atol=0.01)
    without = replace(one, cheaper=()).of(curves[:RUNS])
    assert found["ST_conf"].max() < 0.5 * without["ST_conf"].max()


def test_the_convergence_uses_all_runs_of_cheaper_versions():
    one, outcomes = estimate(like, runs=64)
    found = replace(one, sizes=(32, 64)).convergence(outcomes)
    small, of_small = estimate(like, runs=32)
    np.testing.assert_array_equal(found.ST[0], small.analysis(of_small).ST)
    np.testing.assert_array_equal(found.ST[1], one.analysis(outcomes).ST)


def test_a_fit_is_not_repeated():
    one, outcomes = estimate(like)
    assert one.fitted(outcomes) is one.fitted(outcomes.copy())


def test_sums_of_polynomials():
    a = Sum(np.array([[0, 0], [1, 0]]), np.array([1.0, 2.0]))
    b = Sum(np.array([[0, 2], [1, 0]]), np.array([3.0, 5.0]))
    at = np.random.default_rng(0).random((9, 2))
    np.testing.assert_allclose(a.plus(-2.0, b).at(at), a.at(at) - 2.0 * b.at(at))


def test_the_same_function_at_another_scale_leaves_nothing():
    cheap, share = version(OF_CHEAPER, 1, 1)
    fine, at = version(RUNS, 1, 0)
    polynomial = Sum(np.array([[0, 0, 0], [1, 0, 0], [0, 3, 1]]), np.array([1.0, 2.0, 0.5]))
    below = fitted(Runs(share, cheap.scramble, polynomial.at(share)), stands_in=True)
    found = fitted(Runs(at, fine.scramble, 5.0 - 3.0 * polynomial.at(at)), below)
    assert found.used and found.unexplained < 1e-12
    assert set(found.without) == set(range(TURN))
