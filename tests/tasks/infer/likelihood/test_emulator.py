"""The emulator of a likelihood, against one that it can emulate exactly."""

import numpy as np

from tests.tasks.infer.likelihood.problem import SIZE, errors, known


def test_polynomials_of_second_order_are_emulated_exactly():
    at = np.random.default_rng(4).uniform(size=(9, SIZE))
    np.testing.assert_allclose(known().squares(at), np.square(errors(at)).sum(axis=1), rtol=1e-6)


def test_slopes_of_components_are_those_of_the_errors():
    at = np.array([0.3, 0.5, 0.6])
    steps = 1e-5 * np.eye(SIZE)
    exact = (errors(at + steps) - errors(at - steps)) / 2e-5
    found = known().slopes(at)
    np.testing.assert_allclose(found @ found.T, exact @ exact.T, rtol=1e-4)
