"""Variance-based sensitivity: Sobol indices from the outcomes of a Saltelli design.

A Saltelli design comes in blocks of one base sample each. What is done about failed rows is decided in
:mod:`sinew.tasks.sobol.estimate`; :func:`indices_if_failed_had` shows how far the indices move when failed rows are
given the smallest, the mean and the largest outcome.
"""

import warnings
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.special import ndtri, stdtrit

from sinew.tasks.simulate.saltelli import Design
from sinew.tasks.sobol.result import KEYS, Analysis, Indices
from sinew.tasks.sobol.shapley import terms
from sinew.tasks.study.streams import Stream, state

Array = np.ndarray[Any, Any]
#: Part of the variance of all outcomes that A and B have at least; with less, a few other outcomes are all that varies,
#: and no index can be told.
ALONE = 1e-12


@dataclass(frozen=True)
class Intervals:
    """How intervals are found, at a ``confidence``, from the study's ``seed``.

    With several scrambles of the sequence: Student's t interval from their jackknife (each is left out in turn), which
    knows how much less than a random design the sequence errs (L'Ecuyer and Lemieux 2002, in: Modeling Uncertainty,
    419). With one: SALib's normal interval from ``resamples`` of a bootstrap of base samples, which does not.
    """

    resamples: int
    confidence: float
    seed: int

    @property
    def salib_seed(self) -> int:
        return state(self.seed, Stream.SOBOL_BOOTSTRAP) | 1  # SALib takes 0 for no seed at all

    def resampled(self, scramble: Array) -> tuple[Array, float]:
        """How often each base sample counts in each of ``r`` resamples, ``[r, n]``, and a factor.

        ``scramble`` ``[n]``: which sequence each is from. The factor makes the half-width of an interval of the
        standard deviation over resamples.
        """
        n, tail = scramble.size, 0.5 + self.confidence / 2
        there = np.unique(scramble)
        count = there.size
        if count > 1:
            kept = scramble != there[:, np.newaxis]
            factor = float(stdtrit(count - 1, tail)) * (count - 1) / np.sqrt(count)
            return kept * (n / kept.sum(axis=1, keepdims=True)), factor
        drawn = np.random.default_rng(self.salib_seed).integers(n, size=(n, self.resamples))
        return np.stack([np.bincount(column, minlength=n) for column in drawn.T]).astype(float), float(ndtri(tail))


def indices(blocks: Array, scramble: Array, intervals: Intervals) -> dict[str, Array]:
    """First and total order indices of many outputs at once, with intervals.

    ``blocks`` ``[n, d + 2, m]``: outcomes A, AB_1 ... AB_d, B of n base samples for m outputs; ``scramble`` ``[n]``:
    which sequence each base sample comes from. Returns S1, S1_conf, ST, ST_conf ``[d, m]``, NaN for outputs that do not
    vary, or of which a few outcomes are all that varies. The estimators are those of :mod:`SALib.analyze.sobol`
    (Saltelli et al. 2010), which takes one output at a time; with the same resamples the numbers are equal.
    """
    given = _resampled(blocks, scramble, intervals)
    a, b = given.scaled[:, 0], given.scaled[:, -1]
    every = (given.scaled[:, 1 + j] for j in range(blocks.shape[1] - 2))
    return given.shares((("S1", b * (ab - a)), ("ST", 0.5 * (a - ab) ** 2)) for ab in every)


def dependent_indices(blocks: Array, orders: Array, scramble: Array, intervals: Intervals) -> dict[str, Array]:
    """The same of parameters that depend on each other, with Shapley effects.

    ``blocks`` ``[n, block, m]``: all rows of :mod:`sinew.tasks.simulate.dependent`, whose ``orders`` are ``[n, d]``.
    """
    given = _resampled(blocks, scramble, intervals)
    every = terms(given.scaled, orders)
    return given.shares((("S1", first), ("ST", total), ("Sh", added)) for first, total, added in every)


def of_design(design: Design, outcomes: Array, whole: Array, intervals: Intervals) -> dict[str, Array]:
    """Indices of outcomes ``[n, m]`` of a design's ``whole`` ``[base samples]``, by what it is for."""
    blocks, scramble = design.blocks(outcomes, whole), design.scramble[whole]
    if design.orders is None:
        return indices(blocks, scramble, intervals)
    return dependent_indices(blocks, design.orders[whole], scramble, intervals)


@dataclass(frozen=True, eq=False)
class _Resampled:
    """Outcomes ``scaled`` ``[n, block, m]`` to a mean of 0 and a spread of 1, and what is resampled of them.

    ``draws`` ``[1 + r, n]``: of the sample itself, and of its resamples; ``variance`` ``[1 + r, m]``: of A and B.
    Terms of Shapley effects are parts of ``of_pairs``, (A - B)^2 / 2, so that the effects sum to 1.
    """

    scaled: Array
    varies: Array
    draws: Array
    factor: float
    variance: Array

    def shares(self, parameters: Iterable[Iterable[tuple[str, Array]]]) -> dict[str, Array]:
        """Indices ``[d, m]`` and half their intervals, from the terms ``[n, m]`` of each index of each parameter."""
        found: dict[str, list[Array]] = {}
        for terms_of in parameters:
            for key, each in terms_of:
                with np.errstate(divide="ignore", invalid="ignore"):
                    value = (self.draws @ each) / (self.of_pairs if key == "Sh" else self.variance)
                    half = self.factor * value[1:].std(axis=0, ddof=1)
                found.setdefault(key, []).append(np.where(self.varies, value[0], np.nan))
                found.setdefault(f"{key}_conf", []).append(np.where(self.varies, half, np.nan))
        return {key: np.array(values) for key, values in found.items()}

    @cached_property
    def of_pairs(self) -> Array:
        """What Shapley effects are parts of, ``[1 + r, m]``."""
        return np.asarray(self.draws @ (0.5 * (self.scaled[:, 0] - self.scaled[:, -1]) ** 2))


def _resampled(blocks: Array, scramble: Array, intervals: Intervals) -> _Resampled:
    blocks = moderate(blocks, axis=(0, 1))
    mean = blocks.mean(axis=(0, 1))
    spread = blocks.std(axis=(0, 1))
    varies = spread > 1e-12 * np.maximum(np.abs(mean), np.finfo(float).tiny)
    scaled = (blocks - mean) / np.where(varies, spread, 1.0)
    a, b = scaled[:, 0], scaled[:, -1]
    weights, factor = intervals.resampled(scramble)
    draws = np.concatenate([np.ones((1, len(blocks))), weights]) / len(blocks)  # the first is the sample itself
    variance = draws @ (a**2 + b**2) / 2 - (draws @ (a + b) / 2) ** 2
    return _Resampled(scaled, varies & (variance[0] > ALONE), draws, factor, variance)


def moderate(outcomes: Array, axis: int | tuple[int, ...] = 0) -> Array:
    """Outcomes in other units, powers of two, in which squares neither overflow nor vanish. NaN stays what it is."""
    if not outcomes.size:
        return outcomes
    _, exponent = np.frexp(np.fmax.reduce(np.abs(outcomes), axis=axis))
    return np.ldexp(outcomes, -exponent)


def column(found: dict[str, Array], j: int) -> Indices:
    """The indices of output ``j`` of those of :func:`indices`."""
    return Indices(**{key: values[:, j] for key, values in found.items()})


def analyse(design: Design, outcomes: Array, whole: Array, intervals: Intervals) -> Analysis:
    """SALib's own analysis of one output ``[n]``; ``whole`` ``[base samples]``: those without a failed row."""
    outcomes = moderate(np.where(np.repeat(whole, design.block), outcomes, np.nan))
    used = outcomes.reshape(design.base_samples, design.block)[whole]
    if not np.isfinite(used).all():  # SALib would turn one of them into zeros everywhere
        raise ValueError("outcomes of whole base samples must be numbers")
    if np.ptp(used) <= 1e-12 * np.abs(used).max() or used[:, [0, -1]].var() <= ALONE * used.var():
        return Analysis(*(np.full(len(design.names), np.nan) for _ in KEYS))
    keys = [*KEYS, *(("S2", "S2_conf") if design.second_order else ())]
    found = _by_salib(design, outcomes, whole, intervals)
    there = np.unique(design.scramble[whole])
    if there.size > 1:
        _, factor = intervals.resampled(design.scramble[whole])
        without = [_by_salib(design, outcomes, whole & (design.scramble != each), intervals) for each in there]
        for key in keys[::2]:
            found[f"{key}_conf"] = factor * np.std([each[key] for each in without], axis=0, ddof=1)
    return Analysis(**{key: np.asarray(found[key]) for key in keys})


def _by_salib(design: Design, outcomes: Array, whole: Array, intervals: Intervals) -> dict[str, Any]:
    """What SALib says of the base samples that are ``whole``."""
    import SALib.analyze.sobol as salib_analyze

    with warnings.catch_warnings():  # of a resample in which nothing varies
        warnings.filterwarnings("ignore", "Constant values encountered", UserWarning)
        return dict(
            salib_analyze.analyze(
                design.problem,
                outcomes.reshape(design.base_samples, design.block)[whole].ravel(),
                design.second_order,
                num_resamples=intervals.resamples if design.scrambles == 1 else 2,
                conf_level=intervals.confidence,
                seed=intervals.salib_seed,
            )
        )


def indices_if_failed_had(design: Design, total: Array, ok: Array, intervals: Intervals) -> dict[str, Array]:
    """Indices of the total objective if all failed rows had the smallest, mean or largest outcome: not a bound."""
    if ok.all():
        return {}
    every: Array = np.ones(design.base_samples, dtype=bool)
    found: dict[str, Array] = {}
    for name, value in (("smallest", total[ok].min()), ("mean", total[ok].mean()), ("largest", total[ok].max())):
        filled = np.where(ok, total, value)[:, np.newaxis]
        candidate = of_design(design, filled, every, intervals)
        found |= {f"{key}_if_{name}": candidate[key][:, 0] for key in ("S1", "ST")}
    return found
