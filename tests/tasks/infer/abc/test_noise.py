"""Noise of simulated measurements: relative errors are those of simulations to which noise was really added."""

import numpy as np
import pytest

from sinew.tasks.data.noise import Noise
from sinew.tasks.data.virtual import autoregressive
from sinew.tasks.infer.abc.noise import noise_of_curves
from sinew.tasks.infer.abc.observations import root_mean_square
from sinew.tasks.model import Curve
from sinew.tasks.model.protocols import one_step

SD, AR1 = 0.05, 0.4


@pytest.mark.parametrize("part", [0.0, 0.02, 0.5])
def test_errors_are_distributed_as_those_of_noisy_simulations(part):
    protocol = one_step(10.0, 5.0)
    force = 1.0 + np.sin(np.linspace(0, 3, protocol.time_s.size))
    curve = Curve(protocol, force)
    apart = part * force  # a smooth difference of simulated and measured force
    rng = np.random.default_rng(1)
    noisy = np.array([apart + SD * autoregressive(rng, force.size, AR1) for _ in range(2000)])
    exact = np.sqrt(np.mean(noisy**2, axis=1)) / root_mean_square(force)
    noise = noise_of_curves([(curve, Noise(SD, AR1))])
    np.random.seed(2)
    drawn = np.array([noise.relative_errors(np.array([part]))[0] for _ in range(2000)])
    assert drawn.mean() == pytest.approx(exact.mean(), rel=0.005)
    assert drawn.std() == pytest.approx(exact.std(), rel=0.1)
