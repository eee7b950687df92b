"""A likelihood of products of up to two parameters, which polynomials of second order emulate exactly."""

import numpy as np

from sinew.tasks.infer.likelihood.emulator import emulator

SIZE = 3
MATRIX = np.random.default_rng(1).normal(size=(12, SIZE)) * [8.0, 4.0, 0.5]
CENTRE = np.array([0.4, 0.6, 0.5])


def errors(at, centre=CENTRE):
    return (at - centre) @ MATRIX.T + 3.0 * (at[:, :1] - 0.4) * (at[:, 1:2] - 0.6) + np.arange(12) / 6


def known(centre=CENTRE):
    at = np.random.default_rng(2).uniform(size=(60, SIZE))
    return emulator(at, errors(at, centre), np.ones(len(at)))
