"""Bands around measured force curves, at the kept points, and the share of the points that they cover.

=========  ============================================================================================================
``hdi``    from the lowest to the highest of three simulations: at the posterior mean, and at the low and at the high
           bounds of the highest density intervals of all parameters (Pekedis 2025, first case); none if one fails
``draws``  the pointwise middle 95 % of 40 simulations with draws from the posterior (second case; both numbers are
           settings)
``new``    the pointwise band of a specimen that was not measured yet
``whole``  the band that holds 95 % of such specimens' curves from their beginning to their end
=========  ============================================================================================================

The first two are the paper's, and neither is about a single tendon. One parameter set for all specimens of a site
describes their mean, and the more specimens there are, the narrower its posterior: see ``coverage``. The third takes
its spread from the specimens themselves: those of the site *but this one*, each with its calibrated parameters, are
simulated with this one's geometry and displacements. With n - 1 such curves, the next one lies within mean ± t sd
sqrt(1 + 1 / (n - 1)), t with n - 2 degrees of freedom: the prediction interval of a normal sample (Geisser 1993,
Predictive Inference). Stiffnesses scatter by factors rather than by newtons, and the force of an unloaded tendon
changes sign, hence asinh: a logarithm for large forces, linear near zero. The noise of the others' curves is added in
squares. Of the specimen itself, only geometry and displacements enter.

After an inference by likelihood, ``new`` and ``whole`` are made of draws of a new specimen from the population's
posterior, with noise. ``new`` lies between two of them by rank, so that one more lies inside with 95 % at each point
(Wilks 1941, doi:10.1214/aoms/1177731788). ``whole`` reaches as far from the median, in
standard deviations of each point (of asinh of the forces), as it takes to hold 95 % of the draws entirely. The
population's posterior knows the specimen's own curves, one of several, so ``coverage`` is a little too good.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr
from scipy.special import ndtri, stdtrit

from sinew.tasks.data.noise import noise_of
from sinew.tasks.model import FORCE, Specimen
from sinew.tasks.predict.result import BANDS, SIMULATED, Coverage
from sinew.tasks.predict.settings import HDI, fewest_of_new

FEWEST = 4  # specimens of a site for the band of a new one: two others would say nothing of the spread
FEWEST_DRAWS = 100  # of a new specimen, from which on there is a band of whole curves
BENDS = 0.2  # share of the largest force at which asinh turns from a line to a logarithm
Array = np.ndarray[Any, Any]
Band = tuple[Array, Array]


def bands_of(
    simulated: dict[str, Array], noise: float, probability: float, *, from_population: bool
) -> dict[str, Band | None]:
    """Each band from its simulations ``[n, t]``; None where too few of them are left.

    ``from_population``: those of a new specimen are draws from a population, not the other specimens.
    """
    three, drawn, others = (simulated[name] for name in SIMULATED)
    new: Band | None = None
    whole: Band | None = None
    if from_population and len(others) >= fewest_of_new(probability):
        noisy = others + noise * np.random.default_rng(0).standard_normal(others.shape)
        new = one_more(noisy, probability)
        whole = simultaneous(noisy, probability) if len(others) >= FEWEST_DRAWS else None
    elif not from_population and len(others) >= FEWEST - 1:
        new = next_curve(others, noise, probability)
    return {
        "hdi": (three.min(axis=0), three.max(axis=0)) if len(three) == HDI else None,
        "draws": pointwise(drawn, probability) if len(drawn) > 1 else None,
        "new": new,
        "whole": whole,
    }


def pointwise(curves: Array, probability: float) -> Band:
    """Bounds ``[t]`` that hold the middle ``probability`` of ``curves`` ``[n, t]`` at each point."""
    low, high = np.quantile(curves, [(1 - probability) / 2, (1 + probability) / 2], axis=0)
    return low, high


def one_more(curves: Array, probability: float) -> Band:
    """Bounds ``[t]`` between which one more of ``curves`` ``[n, t]`` lies with ``probability`` at each point."""
    low, high = np.quantile(curves, [(1 - probability) / 2, (1 + probability) / 2], axis=0, method="weibull")
    return low, high


def simultaneous(curves: Array, probability: float) -> Band:
    """Bounds ``[t]`` between which ``probability`` of ``curves`` ``[n, t]`` lie entirely.

    As far from the median as it takes, in standard deviations of each point, of asinh of the curves.
    """
    bend = _bend(curves)
    bent = np.arcsinh(curves / bend)
    middle, spread = np.median(bent, axis=0), np.maximum(bent.std(axis=0), np.finfo(float).tiny)
    farthest = np.sort((np.abs(bent - middle) / spread).max(axis=1))
    reach = farthest[min(int(np.ceil((len(curves) + 1) * probability)), len(curves)) - 1] * spread
    return bend * np.sinh(middle - reach), bend * np.sinh(middle + reach)


def _bend(curves: Array) -> float:
    """The force at which asinh turns from a line to a logarithm."""
    return 2.0 * BENDS * float(np.abs(curves).max(axis=1).mean()) or 1.0


def next_curve(curves: Array, noise: float, probability: float) -> Band:
    """Bounds ``[t]`` for one more of ``curves`` ``[n, t]`` that is measured with ``noise`` (standard deviation).

    The prediction interval of a normal sample, of asinh of the curves; the bend is at ``BENDS`` of their largest
    values' mean.
    """
    n = len(curves)
    bend = _bend(curves)
    bent = np.arcsinh(curves / bend)
    mean = bent.mean(axis=0)
    reach = float(stdtrit(n - 1, 0.5 + probability / 2)) * np.sqrt(1.0 + 1.0 / n) * bent.std(axis=0, ddof=1)
    middle, low, high = (bend * np.sinh(each) for each in (mean, mean - reach, mean + reach))
    measured = float(ndtri(0.5 + probability / 2)) * noise
    return middle - np.hypot(middle - low, measured), middle + np.hypot(high - middle, measured)


def noise_level(specimens: Sequence[Specimen], protocol: str, quantity: str = FORCE) -> float:
    """Standard deviation of the noise of specimens' curves of a protocol; 0 where it is unknown.

    In newton, or in the unit of another ``quantity`` that is compared.
    """
    if quantity != FORCE:
        levels = [one.noise[quantity] for one in specimens]
        return float(np.sqrt(np.mean(np.square(levels)))) if levels else 0.0
    sd = [noise_of(curve, one.curves).sd_N for one in specimens for curve in one.curves if curve.name == protocol]
    known = np.array([value for value in sd if np.isfinite(value)])
    return float(np.sqrt(np.mean(known**2))) if known.size else 0.0


def typical(specimens: Sequence[Specimen]) -> Specimen:
    """The specimen of most protocols and, of these, median cross-section: stresses depend on strains only."""
    most = max(len(one.curves) for one in specimens)
    ordered = sorted((one for one in specimens if len(one.curves) == most), key=lambda one: one.area_mm2)
    return ordered[(len(ordered) - 1) // 2]


def coverage(dataset: xr.Dataset) -> dict[str, Coverage]:
    """The share of the measured points inside each band, each point once; points that are NaN were not measured.

    ``dataset`` holds ``measured``, ``BAND_low`` and ``BAND_high`` ``[point]`` with the coordinates ``protocol`` and
    ``specimen``. Points where a band is NaN do not count for it.
    """
    measured = dataset["measured"].to_numpy()
    protocols, specimens = dataset["protocol"].to_numpy(), dataset["specimen"].to_numpy()
    found = {}
    for name in BANDS:
        low, high = dataset[f"{name}_low"].to_numpy(), dataset[f"{name}_high"].to_numpy()
        given = np.isfinite(low) & np.isfinite(measured)
        inside = given & (measured >= low) & (measured <= high)
        found[name] = Coverage(
            all=_share(inside[given]),
            points=int(given.sum()),
            protocols={str(each): _share(inside[given & (protocols == each)]) for each in dict.fromkeys(protocols)},
            specimens={str(each): _share(inside[given & (specimens == each)]) for each in dict.fromkeys(specimens)},
            curves=_share(_whole(inside, given, specimens, protocols)),
        )
    return found


def _whole(inside: Array, given: Array, specimens: Array, protocols: Array) -> Array:
    """For each curve whether all of its points that are ``given`` are ``inside``."""
    curves = dict.fromkeys(zip(specimens[given], protocols[given], strict=True))
    return np.array(
        [inside[given & (specimens == one) & (protocols == test)].all() for one, test in curves], dtype=bool
    )


def _share(inside: Array) -> float | None:
    return float(inside.sum() / inside.size) if inside.size else None
