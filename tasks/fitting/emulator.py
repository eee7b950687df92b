"""Emulators of courses: what a model gives along time, as a function of its parameters, learned from few runs.

Courses are taken apart into principal components. Each component gets the better of two emulators, by what each says of
runs that it was not trained with (eight folds):

================  ====================================================================================================
kind              what it is
================  ====================================================================================================
``chaos``         few orthonormal polynomials (:mod:`sinew.tasks.fitting.chaos`)
``process``       a Gaussian process, Matern 5/2 with a length scale for each parameter
                  (:mod:`sinew.tasks.fitting.gaussian_process`)
================  ====================================================================================================

What is left out of a process follows from its covariance without a new fit (Dubrule 1983, Math. Geol. 15, 687).
Polynomials are chosen anew without each fold.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sinew.tasks.fitting.chaos import basis, polynomials
from sinew.tasks.fitting.folds import folds_of, some_of
from sinew.tasks.fitting.gaussian_process import Process, fitted
from sinew.tasks.fitting.limits import COMPONENTS, KINDS, Kind
from sinew.tasks.simulate import Array

EXPLAINED = 1e-6  # part of the variance that principal components leave out
ROUNDING = 1e-12  # of a course that does not vary
INSIDE, SDS = 0.95, 1.959964  # an interval, and its half-width in standard deviations of a normal distribution


@dataclass(frozen=True)
class Fit:
    """How a principal component is emulated: the better ``kind``, and what each kind needs to be made again.

    ``degree``: of polynomials, the highest that was tried. ``theta``: of the process, see
    :func:`.gaussian_process.fitted`. ``error``: root mean square of left-out errors, in standard deviations of the
    component.
    """

    kind: Kind
    degree: int
    theta: tuple[float, ...]
    error: float


@dataclass(frozen=True, eq=False)
class Courses:
    """Courses ``[n, t]`` as ``centre + scale * (scores @ directions)``, and a ``rest`` ``[t]`` (rms) that is left out.

    ``scale`` ``[t]`` is that of the course to which a point belongs. ``scores`` ``[n, q]``, ``directions`` ``[q, t]``.
    """

    centre: Array
    scale: Array
    scores: Array
    directions: Array
    rest: Array


@dataclass(frozen=True, eq=False)
class LeftOut:
    """What emulators say of runs that they were not trained with: ``mean`` and ``sd`` ``[n, t]``."""

    mean: Array
    sd: Array


class Emulator:
    """An emulator of courses, trained with runs at ``share`` ``[n, d]`` (parts of the parameters' ranges)."""

    def __init__(self, share: Array, courses: Courses, fits: Sequence[Fit]) -> None:
        self.share, self.courses, self.fits = share, courses, tuple(fits)
        self.processes = [
            fitted(share, scores[:, np.newaxis], np.array(fit.theta), refit=False)[0]
            for scores, fit in zip(courses.scores.T, fits, strict=True)
        ]
        self._polynomials = {
            number: basis(share, courses.scores[:, number], fit.degree)
            for number, fit in enumerate(fits)
            if fit.kind == "chaos"
        }

    def predict(self, at: Array) -> tuple[Array, Array]:
        """Means and standard deviations ``[m, t]`` of the courses at ``at`` ``[m, d]``."""
        means, sds = [], []
        for number, (fit, process) in enumerate(zip(self.fits, self.processes, strict=True)):
            scores = self.courses.scores[:, number]
            if (known := self._polynomials.get(number)) is not None:
                means.append(polynomials(at, known.exponents) @ known.coefficients(self.share, scores))
                sds.append(np.full(len(at), fit.error * scores.std()))
            else:
                mean, sd = process.mean_and_sd(at)
                means.append(mean[:, 0])
                sds.append(np.hypot(sd, np.sqrt(process.regressor.alpha) * process.scale))  # of a run, with its noise
        shape = (len(self.fits), len(at))
        return combined(self.courses, np.reshape(means, shape).T, np.reshape(sds, shape).T)


def combined(courses: Courses, mean: Array, sd: Array) -> tuple[Array, Array]:
    """Means and standard deviations ``[m, t]`` of courses from those of their components ``[m, q]``."""
    variance = sd**2 @ courses.directions**2 + courses.rest**2
    return courses.centre + courses.scale * (mean @ courses.directions), courses.scale * np.sqrt(variance)


def taken_apart(values: Array, scale: Array) -> Courses:
    """Principal components of courses ``[n, t]``; ``scale`` ``[t]`` above 0."""
    centre = values.mean(axis=0)
    scaled = (values - centre) / scale
    left, sizes, directions = np.linalg.svd(scaled, full_matrices=False)
    whole = np.sum(sizes**2)
    varies = whole > ROUNDING**2 * scaled.size
    lost = 1.0 - np.cumsum(sizes**2) / (whole if varies else 1.0)
    count = min(int(np.argmax(lost <= EXPLAINED)) + 1, COMPONENTS, len(sizes)) if varies else 0
    scores, directions = left[:, :count] * sizes[:count], directions[:count]
    rest = np.sqrt(np.mean((scaled - scores @ directions) ** 2, axis=0))
    return Courses(centre, scale, scores, directions, rest)


def trained(share: Array, courses: Courses, before: Sequence[Fit] = ()) -> tuple[list[Fit], LeftOut]:
    """The better emulator of each component, and what these say of left-out runs.

    ``before``: fits of fewer runs, from whose length scales the search begins.
    """
    folds = folds_of(len(share))
    fits, means, sds = [], [], []
    for number, scores in enumerate(courses.scores.T):
        theta = np.array(before[number].theta) if number < len(before) else None
        polynomial, degree = _chaos_without(share, scores, folds)
        mean, sd, length_scales = _process_without(share, scores, folds, theta)
        errors: dict[Kind, float] = {"chaos": rms(polynomial - scores), "process": rms(mean - scores)}
        kind = min(KINDS, key=errors.__getitem__)
        if kind == "chaos":
            mean, sd = polynomial, np.full(len(scores), errors[kind])
        fits.append(Fit(kind, degree, length_scales, errors[kind] / float(scores.std())))
        means.append(mean)
        sds.append(sd)
    shape = (len(courses.directions), len(share))
    mean, sd = combined(courses, np.reshape(means, shape).T, np.reshape(sds, shape).T)
    return fits, LeftOut(mean, sd)


def widening(values: Array, found: LeftOut, parameters: int) -> float:
    """The factor of standard deviations with which 95 % of left-out values ``[n, t]`` lie within their intervals.

    The quantile is that of split conformal prediction (Lei et al. 2018, J. Am. Stat. Assoc. 113, 1094) over all points;
    points of one run are not independent of each other, so it is no guarantee. Left-out runs helped to find
    ``parameters`` and 2 numbers of each process: as in linear regression, that is what they are too good by.
    """
    known = found.sd > 0.0
    ratios = np.sort(np.abs(values - found.mean)[known] / found.sd[known])
    if not ratios.size:
        return 1.0
    quantile = float(ratios[min(int(np.ceil(INSIDE * (ratios.size + 1))), ratios.size) - 1])
    return quantile / SDS * float(np.sqrt(len(values) / (len(values) - parameters - 2)))


def rms(errors: Array) -> float:
    """The root mean square of numbers."""
    return float(np.sqrt(np.mean(errors**2)))


def _chaos_without(share: Array, scores: Array, folds: Sequence[Array]) -> tuple[Array, int]:
    """Left-out values ``[n]`` of polynomials, and the degree of all runs."""
    whole = basis(share, scores)
    mean = np.empty(len(scores))
    for out in folds:
        again = basis(share[~out], scores[~out], whole.degree)
        mean[out] = polynomials(share[out], again.exponents) @ again.coefficients(share[~out], scores[~out])
    return mean, whole.degree


def _process_without(
    share: Array, scores: Array, folds: Sequence[Array], theta: Array | None
) -> tuple[Array, Array, tuple[float, ...]]:
    """Left-out values and standard deviations ``[n]`` of a process, and its ``theta``."""
    some = some_of(len(share))
    _, theta = fitted(share[some], scores[some, np.newaxis], theta)
    process, _ = fitted(share, scores[:, np.newaxis], theta, refit=False)
    inverse = np.linalg.inv(covariance(process, share))
    pull = inverse @ (scores - process.centre[0]) / process.scale
    mean, sd = np.empty(len(scores)), np.empty(len(scores))
    for out in map(np.flatnonzero, folds):
        spread = np.linalg.inv(inverse[np.ix_(out, out)])
        mean[out] = scores[out] - process.scale * (spread @ pull[out])
        sd[out] = process.scale * np.sqrt(np.maximum(np.diag(spread), 0.0))
    return mean, sd, tuple(map(float, theta))


def covariance(process: Process, at: Array) -> Array:
    """The covariance ``[n, n]`` of what was observed at ``at``, in units of the process."""
    regressor = process.regressor
    return np.asarray(regressor.kernel_(at) + regressor.alpha * np.eye(len(at)))
