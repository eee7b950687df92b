"""Gaussian processes of several values with one kernel: Matern 5/2 with a length scale for each parameter, and noise.

They are those of scikit-optimize. Searches (:mod:`.bayesian`) and emulators (:mod:`.emulator`) use them. Parameters are
on the unit cube.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import solve_triangular
from scipy.optimize import minimize

from sinew.tasks.simulate import Array

FIT_STEPS = 40
SCALE_BOUNDS = (0.05, 30.0)
NOISE, NOISE_BOUNDS = 1e-4, (1e-8, 1e-1)


@dataclass(frozen=True)
class Process:
    """A Gaussian process of ``m`` values with one kernel: ``scale`` times the regressor's, about ``centre`` ``[m]``."""

    regressor: Any  # skopt.learning.GaussianProcessRegressor
    centre: Array
    scale: float

    def mean(self, at: Array) -> Array:
        """``[g, m]`` at points ``[g, d]``."""
        return np.asarray(self.centre + self.scale * self.regressor.predict(at))

    def mean_and_sd(self, at: Array) -> tuple[Array, Array]:
        """``[g, m]``, and ``[g]``, which is the same for all values, at points ``[g, d]``."""
        regressor = self.regressor
        across = regressor.kernel_(at, regressor.X_train_)
        known = solve_triangular(regressor.L_, across.T, lower=True, check_finite=False)
        variance = np.maximum(regressor.kernel_.diag(at) - np.sum(known**2, axis=0), 0.0)
        return self.centre + self.scale * (across @ regressor.alpha_), self.scale * np.sqrt(variance)


def fitted(points: Array, values: Array, theta: Array | None, *, refit: bool = True) -> tuple[Process, Array]:
    """The process for ``values`` ``[n, m]`` at ``points`` ``[n, d]``, and its ``theta`` ``[d + 2]``.

    ``theta`` holds logarithms: of the variance, of the length scales, and of the noise's variance, in units of the
    largest variance of a column of ``values``. It is fitted with ``refit``, from where it was before.
    """
    from skopt.learning import GaussianProcessRegressor
    from skopt.learning.gaussian_process.kernels import ConstantKernel, Matern, WhiteKernel

    size = points.shape[1]
    centre = values.mean(axis=0)
    scale = float(values.std(axis=0).max()) or 1.0
    scaled = (values - centre) / scale
    kernel = ConstantKernel(1.0, (1e-2, 1e3)) * Matern(np.full(size, 1.0), [SCALE_BOUNDS] * size, nu=2.5)
    if refit or theta is None:
        noisy = kernel + WhiteKernel(NOISE, NOISE_BOUNDS)
        noisy = noisy if theta is None else noisy.clone_with_theta(theta)
        theta = _likeliest(noisy, points, scaled)
    kernel, noise = kernel.clone_with_theta(theta[:-1]), float(np.exp(theta[-1]))
    regressor = GaussianProcessRegressor(kernel, alpha=noise, optimizer=None)
    return Process(regressor.fit(points, scaled), centre, scale), theta


def _likeliest(kernel: Any, points: Array, values: Array) -> Array:
    """The ``theta`` with the largest marginal likelihood, searched from the kernel's present one."""
    from skopt.learning import GaussianProcessRegressor

    regressor = GaussianProcessRegressor(kernel, alpha=0.0, optimizer=None).fit(points, values)

    def loss(theta: Array) -> tuple[float, Array]:
        value, slope = regressor.log_marginal_likelihood(theta, eval_gradient=True, clone_kernel=False)
        return -float(value), -slope

    options = {"maxiter": FIT_STEPS}
    found = minimize(loss, kernel.theta, jac=True, method="L-BFGS-B", bounds=kernel.bounds, options=options)
    return np.asarray(found.x)
