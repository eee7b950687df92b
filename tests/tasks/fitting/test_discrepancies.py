"""Discrepancies of several quantities: their evidence is that of one normal distribution, and one is as it was."""

import numpy as np
import pytest

from sinew.tasks.data.noise import Noise
from sinew.tasks.fitting.discrepancies import discrepancies_of
from sinew.tasks.fitting.discrepancy import WIDTH, discrepancy_of
from sinew.tasks.fitting.measured import Measured
from sinew.tasks.model import Curve, Specimen
from sinew.tasks.model.protocols import cyclic, one_step

SMALL = np.log(0.02)


@pytest.fixture(scope="module")
def measured():
    """Force and lateral strain, both 0, the latter at every second point."""
    curves = []
    for make in (one_step, cyclic):
        protocol = make(10.0, 4.0)
        seen = np.where(np.arange(protocol.time_s.size) % 2, np.nan, 0.0)
        curves.append(Curve(protocol, np.zeros(protocol.time_s.size), {"lateral_strain": seen}))
    noise = {"lateral_strain": Noise(1e-3, 0.2)}
    return Measured(Specimen("one", 10.0, 8.0, 4.0, tuple(curves)), Noise(1.0, 0.3), noise)


def drawn(several, sizes, rng):
    """Residuals of noise and discrepancies of these sizes, by quantity."""
    error = np.empty(sum(place.size for place in several.places))
    for place, one, own in zip(several.places, several.each, sizes, strict=True):
        parts = [np.exp(size) * block @ rng.standard_normal(block.shape[1])
                 for size, block in zip(own, one.blocks, strict=True)]  # fmt: skip
        error[place] = np.sum(parts, axis=0) + rng.standard_normal(place.size)
    return error


def covariance(several, sizes):
    """Of residuals with discrepancies of log ``sizes``, block by block of the quantities."""
    whole = np.eye(sum(place.size for place in several.places))
    begin = 0
    for place, one in zip(several.places, several.each, strict=True):
        for size, block in zip(sizes[begin:], one.blocks, strict=False):
            whole[np.ix_(place, place)] += np.exp(2 * size) * block @ block.T
        begin += len(one.blocks)
    return whole


def evidence(several, sizes, error, slopes):
    """Minus twice its logarithm, from the whole covariance."""
    spread = covariance(several, sizes)
    solved = np.linalg.solve(spread, np.column_stack([error, slopes]))
    known = np.linalg.slogdet(slopes.T @ solved[:, 1:] / WIDTH + np.eye(slopes.shape[1]))[1]
    return error @ solved[:, 0] + np.linalg.slogdet(spread)[1] + known


def test_each_quantity_has_its_own_sizes_and_all_share_the_parameters(measured):
    several, rng = discrepancies_of(measured), np.random.default_rng(1)
    assert several.count == 6
    error = drawn(several, [(1.5, SMALL, SMALL), (SMALL, SMALL, 2.5)], rng)
    slopes = 5.0 * rng.standard_normal((error.size, 2))
    sizes, found = several.sized(error, slopes, np.zeros(6))
    assert found == pytest.approx(evidence(several, sizes, error, slopes), rel=1e-9)
    assert sizes[[0, 5]] == pytest.approx([1.5, 2.5], abs=0.5)
    assert max(sizes[[1, 2, 3]]) < 0.5
    for number in range(6):  # none is larger nearby
        for step in (-0.2, 0.2):
            near = sizes + step * (np.arange(6) == number)
            assert evidence(several, near, error, slopes) > found - 0.05


def test_whitening_leaves_what_is_white(measured):
    several = discrepancies_of(measured)
    sizes = np.array([0.5, -1.0, 1.0, 2.0, 0.0, -0.5])
    white = several.whitening(sizes)
    whole = white(white(covariance(several, sizes)).T)
    np.testing.assert_allclose(whole, np.eye(len(whole)), atol=1e-7)
    np.testing.assert_allclose(white(whole[:, 0]), white(whole)[:, 0], atol=1e-12)


def test_where_the_force_is_all_it_is_the_discrepancy_of_the_force(measured):
    alone = Measured(measured.specimen, measured.noise)
    one, single = discrepancies_of(alone), discrepancy_of(alone)
    error, slopes = np.sin(np.arange(one.places[0].size)), np.cos(np.arange(2.0 * one.places[0].size)).reshape(-1, 2)
    (sizes, found), (expected, known) = (each.sized(error, slopes, np.zeros(3)) for each in (one, single))
    np.testing.assert_array_equal(sizes, expected)
    assert found == known
    np.testing.assert_array_equal(one.whitening(sizes)(error), single.whitening(sizes)(error))


def test_a_size_is_judged_with_what_the_other_quantity_says_of_the_parameters(measured):
    """Of a parameter that the width determines, the force's discrepancy cannot be an error."""
    several, rng = discrepancies_of(measured), np.random.default_rng(2)
    slopes = np.zeros((sum(place.size for place in several.places), 6))
    slopes[several.places[0]] = 2.0 * several.each[0].blocks[0][:, :6]
    slopes[several.places[1], :6] = 40.0 * rng.standard_normal((several.places[1].size, 6))
    error = drawn(several, [(0.3, SMALL, SMALL), (SMALL, SMALL, SMALL)], rng)
    sizes, found = several.sized(error, slopes, np.zeros(6))
    for step in (-0.1, 0.1):
        assert evidence(several, sizes + step * (np.arange(6) == 0), error, slopes) > found
    alone, _ = several.each[0].sized(error[several.places[0]], slopes[several.places[0]], np.zeros(3))
    assert abs(alone[0] - sizes[0]) > 0.02, "without the width it would be another"
