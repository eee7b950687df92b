"""The discrepancy: its evidence is that of the normal distribution it stands for, and its sizes are found again."""

import numpy as np
import pytest

from sinew.tasks.fitting.discrepancy import WIDTH, discrepancy_of
from sinew.tasks.model.protocols import cyclic, one_step
from tests.tasks.discover.measure.test_shape import measured_with

NOTHING = np.log(0.01)  # about the smallest size


@pytest.fixture(scope="module")
def several():
    return discrepancy_of(measured_with(lambda protocol: np.zeros(protocol.time_s.size)))


def covariance(discrepancy, sizes):
    parts = (np.exp(2 * size) * block @ block.T for size, block in zip(sizes, discrepancy.blocks, strict=True))
    return np.eye(len(discrepancy.blocks[0])) + sum(parts)


def drawn(discrepancy, sizes, rng):
    """Residuals of noise and a discrepancy of these sizes."""
    errors = [np.exp(size) * block @ rng.standard_normal(block.shape[1])
              for size, block in zip(sizes, discrepancy.blocks, strict=True)]  # fmt: skip
    return sum(errors) + rng.standard_normal(len(discrepancy.blocks[0]))


def test_the_evidence_is_that_of_a_normal_distribution(several):
    rng, sizes = np.random.default_rng(1), np.array([0.5, -1.0, 1.0])
    error, slopes = drawn(several, sizes, rng), rng.standard_normal((len(several.blocks[0]), 3))
    spread = covariance(several, sizes)
    solved = np.linalg.solve(spread, np.column_stack([error, slopes]))
    known = np.linalg.slogdet(slopes.T @ solved[:, 1:] / WIDTH + np.eye(3))[1]
    expected = error @ solved[:, 0] + np.linalg.slogdet(spread)[1] + known
    assert several.evidence(sizes, error, slopes) == pytest.approx(expected, rel=1e-9)


def test_whitening_leaves_what_is_white(several):
    sizes = np.array([0.5, -1.0, 1.0])
    white = several.whitening(sizes)
    whole = white(white(covariance(several, sizes)).T)
    np.testing.assert_allclose(whole, np.eye(len(whole)), atol=1e-8)
    np.testing.assert_allclose(white(whole[:, 0]), white(whole)[:, 0], atol=1e-12)


@pytest.mark.parametrize("sizes", [(1.5, NOTHING, NOTHING), (NOTHING, 1.5, NOTHING), (NOTHING, NOTHING, 1.5)])
def test_sizes_are_found_again(several, sizes):
    rng = np.random.default_rng(2)
    slopes = np.zeros((len(several.blocks[0]), 1))
    found = np.array([several.sized(drawn(several, sizes, rng), slopes, np.zeros(3))[0] for _ in range(8)])
    large = np.array(sizes) > 0
    assert np.mean(found[:, large]) == pytest.approx(1.5, abs=0.2)
    assert np.median(found[:, ~large]) < -1.0


def test_noise_alone_leaves_no_discrepancy(several):
    rng = np.random.default_rng(3)
    error, slopes = rng.standard_normal(len(several.blocks[0])), np.zeros((len(several.blocks[0]), 1))
    sizes, evidence = several.sized(error, slopes, np.zeros(3))
    assert sizes.max() < -1.0
    assert evidence == pytest.approx(several.evidence(sizes, error, slopes))
    assert evidence < several.evidence(np.zeros(3), error, slopes) - 10.0


@pytest.mark.parametrize(("makes", "blocks"), [((one_step,), 1), ((cyclic,), 2), ((one_step, cyclic), 3)])
def test_what_never_changes_from_phase_to_phase_or_curve_to_curve_has_no_size(makes, blocks):
    found = discrepancy_of(measured_with(lambda protocol: np.zeros(protocol.time_s.size), makes))
    assert len(found.blocks) == blocks
    for block in found.blocks:
        assert np.square(block).sum() / len(block) == pytest.approx(1.0)
