"""The proposal density of ABC-SMC: a normal distribution fitted to the last generation, mixed with the prior.

pyABC's own kernels place a normal density on every particle. With 40 particles in 16 dimensions the sum is far too low
between them: a few particles that happen to lie there get nearly all of the weight, and decide the posterior. The
mixture here is defensive (Hesterberg 1995, Technometrics 37; Owen and Zhou 2000, JASA 95): because ``PRIOR_SHARE`` of
the proposals come from the prior, no weight exceeds ``1 / PRIOR_SHARE`` times that of a draw from the prior.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
from pyabc.parameters import Parameter as Parameters
from pyabc.transition import Transition
from scipy.linalg import solve_triangular

from sinew.tasks.infer.abc.pyabc_priors import Normals
from sinew.tasks.simulate import Array

PRIOR_SHARE = 0.2
WIDER = 1.3  # factor of the variance: proposals must reach beyond the particles


class DefensiveNormal(Transition):  # type: ignore[misc]
    """Proposes from ``prior`` with the probability ``PRIOR_SHARE``, else from a normal distribution."""

    def __init__(self, prior: Normals) -> None:
        self.prior = prior

    def fit(self, X: pd.DataFrame, w: Array) -> None:
        """Mean and covariance of particles with weights ``w`` ``[n]``; correlations are shrunk, as n is small."""
        values = X[list(self.prior.names)].to_numpy()
        self.mean_ = w @ values
        effective = 1.0 / np.sum(w**2)
        self.worth_ = effective / len(w)  # share of particles of equal weight
        apart = values - self.mean_
        covariance = (apart * w[:, np.newaxis]).T @ apart * (effective / max(effective - 1.0, 1.0))
        sd = np.sqrt(np.diag(covariance))
        least = 1e-3 * self.prior.spread  # all particles alike: still move
        sd = np.maximum(sd, least)
        trust = effective / (effective + len(sd))
        correlation = trust * covariance / np.outer(sd, sd)
        np.fill_diagonal(correlation, 1.0)
        self.lower_ = np.linalg.cholesky(WIDER * correlation * np.outer(sd, sd))
        self.log_area_ = float(np.log(np.diag(self.lower_)).sum() + 0.5 * len(sd) * np.log(2 * np.pi))

    def rvs_single(self) -> Parameters:
        """One proposal, from numpy's global generator as pyABC draws."""
        if np.random.random() < PRIOR_SHARE:
            return self.prior.rvs()
        drawn = self.mean_ + self.lower_ @ np.random.standard_normal(self.mean_.size)
        return Parameters(dict(zip(self.prior.names, drawn.tolist(), strict=True)))

    def pdf(self, x: Mapping[Any, Any] | pd.DataFrame) -> Any:
        """Density of a parameter set, or of each row of a frame."""
        if isinstance(x, pd.DataFrame):
            return np.array([self.pdf(row) for row in x.to_dict("records")])
        values = np.array([x[name] for name in self.prior.names], dtype=float)
        scaled = solve_triangular(self.lower_, values - self.mean_, lower=True, check_finite=False)
        inside = float(np.exp(-0.5 * (scaled @ scaled) - self.log_area_))
        return PRIOR_SHARE * self.prior.pdf(x) + (1.0 - PRIOR_SHARE) * inside
