"""The finer emulator of a likelihood, against functions that polynomials of second order do not reach."""

import numpy as np

from sinew.tasks.infer.likelihood.emulator import emulator
from sinew.tasks.infer.likelihood.fine import fine_emulator
from tests.tasks.infer.likelihood.problem import SIZE, errors


def bent(at):
    """Whitened errors ``[n, 20]`` that are far from polynomials of second order."""
    time = np.linspace(0.0, 3.0, 20)
    return 200.0 * at[:, :1] * np.exp(-time / (0.5 + 2.0 * at[:, 1:2])) + 30.0 * at[:, 2:] ** 3 - 60.0


def test_polynomials_of_second_order_are_emulated_exactly():
    rng = np.random.default_rng(4)
    known = rng.uniform(size=(60, SIZE))
    at = rng.uniform(known.min(axis=0), known.max(axis=0), size=(9, SIZE))
    found = fine_emulator(known, errors(known)).squares(at)
    np.testing.assert_allclose(found, np.square(errors(at)).sum(axis=1), rtol=1e-6)


def test_it_comes_nearer_than_the_emulator_of_walks():
    rng = np.random.default_rng(5)
    known = rng.uniform(0.3, 0.7, size=(120, 3))
    at = rng.uniform(0.35, 0.65, size=(200, 3))
    exact = np.square(bent(at)).sum(axis=1)
    fine = fine_emulator(known, bent(known)).squares(at)
    rough = emulator(known, bent(known), np.ones(len(known))).squares(at)
    assert np.std(fine - exact) < 0.05 * np.std(rough - exact)
