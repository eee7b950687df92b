"""Variance-based sensitivity: Sobol indices from the outcomes of a Saltelli design.

A Saltelli design comes in blocks of one base sample each. What is done about failed rows is decided in
:mod:`sinew.tasks.sobol.estimate`; :func:`indices_if_failed_had` shows how far the indices move when failed rows are
given the smallest, the mean and the largest outcome.
"""

import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import ndtri, stdtrit

from sinew.tasks.simulate.saltelli import Design
from sinew.tasks.sobol.result import KEYS, Analysis, Indices
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
    n, width, m = blocks.shape
    blocks = moderate(blocks, axis=(0, 1))
    mean = blocks.mean(axis=(0, 1))
    spread = blocks.std(axis=(0, 1))
    varies = spread > 1e-12 * np.maximum(np.abs(mean), np.finfo(float).tiny)
    scaled = (blocks - mean) / np.where(varies, spread, 1.0)
    a, b = scaled[:, 0], scaled[:, -1]
    weights, factor = intervals.resampled(scramble)
    draws = np.concatenate([np.ones((1, n)), weights]) / n  # the first "resample" is the sample itself
    mean_ab = draws @ (a + b) / 2
    variance = draws @ (a**2 + b**2) / 2 - mean_ab**2
    varies &= variance[0] > ALONE
    found = {key: np.full((width - 2, m), np.nan) for key in KEYS}
    with np.errstate(divide="ignore", invalid="ignore"):
        for j in range(width - 2):
            ab = scaled[:, 1 + j]
            first = (draws @ (b * (ab - a))) / variance
            total = 0.5 * (draws @ ((a - ab) ** 2)) / variance
            for key, value in (("S1", first), ("ST", total)):
                found[key][j] = np.where(varies, value[0], np.nan)
                found[f"{key}_conf"][j] = np.where(varies, factor * value[1:].std(axis=0, ddof=1), np.nan)
    return found


def moderate(outcomes: Array, axis: int | tuple[int, ...] = 0) -> Array:
    """Outcomes in other units, powers of two, in which squares neither overflow nor vanish. NaN stays what it is."""
    if not outcomes.size:
        return outcomes
    _, exponent = np.frexp(np.fmax.reduce(np.abs(outcomes), axis=axis))
    return np.ldexp(outcomes, -exponent)


def column(found: dict[str, Array], j: int) -> Indices:
    """The indices of output ``j`` of those of :func:`indices`."""
    return Indices(*(found[key][:, j] for key in KEYS))


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
        candidate = indices(design.blocks(filled, every), design.scramble, intervals)
        found |= {f"{key}_if_{name}": candidate[key][:, 0] for key in ("S1", "ST")}
    return found
