"""Noise of simulated measurements: relative errors are those of simulations to which noise was really added."""

import numpy as np
import pytest

from sinew.tasks.data.noise import Noise
from sinew.tasks.data.virtual import autoregressive
from sinew.tasks.infer.abc.noise import noise_of_curves
from sinew.tasks.infer.abc.observations import root_mean_square
from sinew.tasks.model import Curve
from sinew.tasks.model.protocols import one_step

SD = 0.05


def test_where_the_noise_is_unknown_or_nothing_none_is_simulated():
    protocol = one_step(10.0, 5.0)
    curve = Curve(protocol, np.ones(protocol.time_s.size))
    noise = noise_of_curves([(curve, Noise(np.nan, np.nan, np.nan)), (curve, Noise(0.0, 0.0))])
    np.testing.assert_array_equal(noise.relative_errors(np.array([0.3, 0.1])), [0.3, 0.1])


@pytest.mark.parametrize("ar1", [0.0, 0.4, 0.9])
@pytest.mark.parametrize("part", [0.0, 0.02, 0.5])
def test_errors_are_distributed_as_those_of_noisy_simulations(part, ar1):
    """The measured curve has noise of its own, and differs from the simulated one by a smooth part of the force."""
    protocol = one_step(10.0, 5.0)
    force = 1.0 + np.sin(np.linspace(0, 3, protocol.time_s.size))
    rng = np.random.default_rng(3)
    exact, drawn = [], []
    noise = noise_of_curves([(Curve(protocol, force), Noise(SD, ar1))])
    np.random.seed(4)
    for _ in range(3000):
        measured, simulated = (SD * autoregressive(rng, force.size, ar1) for _ in range(2))
        apart = part * force + measured
        exact.append(np.sqrt(np.mean((apart + simulated) ** 2)) / root_mean_square(force))
        error = np.sqrt(np.mean(apart**2)) / root_mean_square(force)
        drawn.append(noise.relative_errors(np.array([error]))[0])
    assert np.mean(drawn) == pytest.approx(np.mean(exact), rel=0.01)
    assert np.std(drawn) == pytest.approx(np.std(exact), rel=0.12)
