"""Variance-based sensitivity: Sobol indices from the outcomes of a Saltelli design.

Failed rows. A Saltelli design comes in blocks of one base sample each. A block with a failed row is left out of every
estimate, and :func:`indices_if_failed_had` shows how far the indices move when the failed rows are given the smallest,
the mean and the largest outcome instead.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import ndtri

from sinew.tasks.simulate.saltelli import Design
from sinew.tasks.sobol.result import KEYS, Analysis, Convergence, Indices
from sinew.tasks.study.streams import Stream, state

Array = np.ndarray[Any, Any]
RULE = "base samples with a failed row are left out"
FIRST_SIZE = 5  # the convergence begins with 2**5 base samples


@dataclass(frozen=True)
class Bootstrap:
    """How intervals are found: how many ``resamples``, their ``confidence``, and the study's ``seed``."""

    resamples: int
    confidence: float
    seed: int

    @property
    def z(self) -> float:
        """Half-width of an interval in standard deviations."""
        return float(ndtri(0.5 + self.confidence / 2))

    @property
    def salib_seed(self) -> int:
        return state(self.seed, Stream.SOBOL_BOOTSTRAP) | 1  # SALib takes 0 for no seed at all

    def weights(self, n: int) -> Array:
        """SALib's bootstrap of ``n`` base samples as weights ``[resamples, n]``."""
        drawn = np.random.default_rng(self.salib_seed).integers(n, size=(n, self.resamples))
        return np.stack([np.bincount(column, minlength=n) for column in drawn.T]).astype(float)


def indices(blocks: Array, weights: Array, z: float) -> dict[str, Array]:
    """First and total order indices of many outputs at once, with bootstrap intervals.

    ``blocks`` ``[n, d + 2, m]``: outcomes A, AB_1 ... AB_d, B of n base samples for m outputs; ``weights`` ``[r, n]``:
    how often each base sample is drawn in each resample. Returns S1, S1_conf, ST, ST_conf ``[d, m]``, NaN for outputs
    that do not vary. The estimators are those of :mod:`SALib.analyze.sobol` (Saltelli et al. 2010), which takes one
    output at a time; with the same resamples the numbers are equal.
    """
    n, width, m = blocks.shape
    mean = blocks.mean(axis=(0, 1))
    spread = blocks.std(axis=(0, 1))
    varies = spread > 1e-12 * np.maximum(np.abs(mean), np.finfo(float).tiny)
    scaled = (blocks - mean) / np.where(varies, spread, 1.0)
    a, b = scaled[:, 0], scaled[:, -1]
    draws = np.concatenate([np.ones((1, n)), weights]) / n  # the first "resample" is the sample itself
    mean_ab = draws @ (a + b) / 2
    variance = draws @ (a**2 + b**2) / 2 - mean_ab**2
    found = {key: np.full((width - 2, m), np.nan) for key in KEYS}
    with np.errstate(divide="ignore", invalid="ignore"):
        for j in range(width - 2):
            ab = scaled[:, 1 + j]
            first = (draws @ (b * (ab - a))) / variance
            total = 0.5 * (draws @ ((a - ab) ** 2)) / variance
            for key, value in (("S1", first), ("ST", total)):
                found[key][j] = np.where(varies, value[0], np.nan)
                found[f"{key}_conf"][j] = np.where(varies, z * value[1:].std(axis=0, ddof=1), np.nan)
    return found


def column(found: dict[str, Array], j: int) -> Indices:
    """The indices of output ``j`` of those of :func:`indices`."""
    return Indices(*(found[key][:, j] for key in KEYS))


def analyse(design: Design, outcomes: Array, whole: Array, bootstrap: Bootstrap) -> Analysis:
    """SALib's own analysis of one output ``[n]``; ``whole`` ``[base samples]``: those without a failed row."""
    import SALib.analyze.sobol as salib_analyze

    used = outcomes.reshape(design.base_samples, design.block)[whole].ravel()
    if not np.isfinite(used).all():  # SALib would turn one of them into zeros everywhere
        raise ValueError("outcomes of whole base samples must be numbers")
    if np.ptp(used) <= 1e-12 * np.abs(used).max():
        return Analysis(*(np.full(len(design.names), np.nan) for _ in KEYS))
    found = salib_analyze.analyze(
        design.problem,
        used,
        design.second_order,
        num_resamples=bootstrap.resamples,
        conf_level=bootstrap.confidence,
        seed=bootstrap.salib_seed,
    )
    second = {key: np.asarray(found[key]) for key in ("S2", "S2_conf")} if design.second_order else {}
    return Analysis(*(np.asarray(found[key]) for key in KEYS), **second)


def indices_if_failed_had(design: Design, total: Array, ok: Array) -> dict[str, Array]:
    """Indices of the total objective if all failed rows had the smallest, mean or largest outcome: not a bound."""
    if ok.all():
        return {}
    every: Array = np.ones(design.base_samples, dtype=bool)
    found: dict[str, Array] = {}
    for name, value in (("smallest", total[ok].min()), ("mean", total[ok].mean()), ("largest", total[ok].max())):
        filled = np.where(ok, total, value)[:, np.newaxis]
        candidate = indices(design.blocks(filled, every), np.ones((2, design.base_samples)), 1.0)
        found |= {f"{key}_if_{name}": candidate[key][:, 0] for key in ("S1", "ST")}
    return found


def convergence(design: Design, total: Array, whole: Array, bootstrap: Bootstrap) -> Convergence:
    """Indices of the total objective from the first 32, 64, ... base samples."""
    sizes = [2**k for k in range(FIRST_SIZE, 31) if 2**k <= design.base_samples] or [design.base_samples]
    curve: dict[str, list[Array]] = {key: [] for key in KEYS}
    used = []
    for size in sizes:
        among = whole.copy()
        among[size:] = False
        if among.sum() < 2:
            continue
        blocks = design.blocks(total[:, np.newaxis], among)
        found = indices(blocks, bootstrap.weights(len(blocks)), bootstrap.z)
        used.append(size)
        for key in KEYS:
            curve[key].append(found[key][:, 0])
    return Convergence(used, *(np.array(curve[key]) for key in KEYS))
