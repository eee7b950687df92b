"""Noise of known level and correlation is found again, on top of signals that move, hold and cycle."""

import numpy as np
import pytest

from tasks.cohort import virtual_cohort
from tasks.model import Curve, Protocol
from tasks.noise import noise_of


def noisy(signal: np.ndarray, sd: float, ar1: float, seed: int) -> Curve:
    rng = np.random.default_rng(seed)
    noise = np.empty(signal.size)
    noise[0] = rng.normal(0, sd)
    for i in range(1, signal.size):
        noise[i] = ar1 * noise[i - 1] + rng.normal(0, sd * np.sqrt(1 - ar1**2))
    time_s = np.arange(signal.size) / 100
    return Curve(Protocol("pull", time_s, time_s), signal + noise)


@pytest.mark.parametrize("ar1", [0.0, 0.3, 0.7])
@pytest.mark.parametrize("shape", ["ramp and hold", "cycles"])
def test_known_noise_is_found_again(shape, ar1):
    t = np.arange(20_000) / 100
    held = 300 * np.minimum(t / 7, 1) * np.exp(-np.maximum(t - 7, 0) / 80)
    signal = held if shape == "ramp and hold" else 150 * (1 - np.cos(t / 3))
    found = [noise_of(noisy(signal, 1.5, ar1, seed)) for seed in range(8)]
    assert np.mean([noise.sd_N for noise in found]) == pytest.approx(1.5, rel=0.05)
    assert np.mean([noise.ar1 for noise in found]) == pytest.approx(ar1, abs=0.06)


def test_a_virtual_specimen_has_the_noise_that_was_put_on():
    specimens, truth = virtual_cohort(seed=5, per_site=1, rate_hz=100.0)
    for specimen in specimens:
        made = truth["specimens"][specimen.name]
        for curve in specimen.curves:
            noise = noise_of(curve)
            assert noise.sd_N == pytest.approx(made["noise_sd_N"], rel=0.1)
            assert noise.ar1 == pytest.approx(made["noise_ar1"], abs=0.08)


def test_a_curve_without_noise_and_one_that_is_too_short():
    t = np.arange(500) / 100
    assert noise_of(Curve(Protocol("pull", t, t), 3 * t)).sd_N == pytest.approx(0, abs=1e-9)
    assert np.isnan(noise_of(Curve(Protocol("pull", t[:50], t[:50]), t[:50])).sd_N)
