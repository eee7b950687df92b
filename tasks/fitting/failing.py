"""Where a model fails: a region of its parameters, learned from the runs that failed and those that did not."""

import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np

from sinew.tasks.fitting.folds import folds_of, some_of
from sinew.tasks.simulate import Array

FEWEST = 5  # failed runs from which a region is learned
SCALES = (0.05, 30.0)


@dataclass(frozen=True, eq=False)
class Failing:
    """How probable it is that a run fails: by a Gaussian process classifier, or the same everywhere.

    ``caught``: part of left-out runs that failed and were expected to; ``mistaken``: part of those that did not fail
    and were expected to. Both are NaN where nothing was learned.
    """

    share: float
    caught: float = np.nan
    mistaken: float = np.nan
    classifier: Any = None

    def probability(self, at: Array) -> Array:
        """``[m]`` at points ``[m, d]``, parts of the parameters' ranges."""
        if self.classifier is None:
            return np.full(len(at), self.share)
        return np.asarray(self.classifier.predict_proba(at)[:, 1])


def failing(share: Array, failed: Array) -> Failing:
    """The region in which runs at ``share`` ``[n, d]`` ``failed`` ``[n]``."""
    part = float(failed.mean())
    if not FEWEST <= failed.sum() <= failed.size - FEWEST:
        return Failing(part)
    from sklearn.exceptions import ConvergenceWarning
    from sklearn.gaussian_process import GaussianProcessClassifier
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel

    size = share.shape[1]
    kernel = ConstantKernel(10.0, (1e-1, 1e4)) * RBF(np.full(size, 1.0), [SCALES] * size)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)  # a scale at its bound: the region does not depend on it
        some = np.union1d(some_of(len(share)), np.flatnonzero(failed)[:FEWEST])  # both kinds are among them
        kernel = GaussianProcessClassifier(kernel, random_state=0).fit(share[some], failed[some]).kernel_
    whole = GaussianProcessClassifier(kernel, optimizer=None).fit(share, failed)
    expected = np.zeros(len(share), dtype=bool)
    for out in folds_of(len(share)):
        if 0 < failed[~out].sum() < (~out).sum():
            again = GaussianProcessClassifier(kernel, optimizer=None).fit(share[~out], failed[~out])
            expected[out] = again.predict(share[out])
    return Failing(part, float(expected[failed].mean()), float(expected[~failed].mean()), whole)
