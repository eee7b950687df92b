"""Differences between the populations of two sites, parameter by parameter.

========================  =============================================================================================
difference of means       of each draw of two posteriors; where the specimens of both sites come from the same donors,
                          Student's posterior of the mean of their differences, given each draw of the specimens, so
                          what donors have in common does not widen it
ratio of spreads          of each draw of two posteriors; 1 if populations scatter alike
direction                 probability that the difference, or the logarithm of the ratio, has the sign of its median
needed, detectable        by Student's t test: how many specimens of each site find a difference as large as the
                          posterior mean, and which difference this many specimens find, with probability ``POWER``
========================  =============================================================================================
"""

from bisect import bisect_left
from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Any

import numpy as np
import xarray as xr
from scipy.optimize import brentq
from scipy.stats import nct
from scipy.stats import t as student_t

from sinew.tasks.compare.result import Contrast, Interval

Array = np.ndarray[Any, Any]
Donors = Sequence[str | None]
POWER = 0.8
MOST_NEEDED = 1000  # specimens of each site
FEWEST_PAIRS = 3
SURE = 5.0  # standard errors


def contrasts_of(
    draws: Mapping[str, xr.Dataset],
    donors: Mapping[str, Donors],
    names: Sequence[str],
    confidence: float,
    rng: np.random.Generator,
) -> list[Contrast]:
    """The contrasts of each pair of sites by parameter, second less first.

    ``draws`` by site as an inference by likelihood stores them, and the ``donors`` of its specimens in their order
    there.
    """
    return [
        contrast
        for pair in combinations(draws, 2)
        for contrast in _of_pair(pair, draws, _partners(*(donors[site] for site in pair)), names, confidence, rng)
    ]


def _partners(first: Donors, second: Donors) -> tuple[list[int], list[int]] | None:
    """The places of specimens of the same donors in both sites.

    None unless every specimen of the smaller site has a partner of its own.
    """
    if any(None in each or len(set(each)) < len(each) for each in (first, second)):
        return None
    both = [donor for donor in first if donor in second]
    if len(both) < max(FEWEST_PAIRS, min(len(first), len(second))):
        return None
    return [first.index(one) for one in both], [second.index(one) for one in both]


def _of_pair(
    pair: tuple[str, str],
    draws: Mapping[str, xr.Dataset],
    partners: tuple[list[int], list[int]] | None,
    names: Sequence[str],
    confidence: float,
    rng: np.random.Generator,
) -> list[Contrast]:
    every = [draws[site].sel(parameter=list(names)) for site in pair]
    count = min(one.sizes["chain"] * one.sizes["draw"] for one in every)
    order = [rng.permutation(one.sizes["chain"] * one.sizes["draw"])[:count] for one in every]

    def drawn(name: str) -> list[Array]:
        """``[m, ...]`` of both sites, in an order of their own, as their posteriors are independent."""
        flat = (one[name].to_numpy() for one in every)
        return [one.reshape(-1, *one.shape[2:])[chosen] for one, chosen in zip(flat, order, strict=True)]

    means, spreads, values = drawn("mean"), drawn("spread"), drawn("specimens")
    if partners is None:
        differences = means[1] - means[0]
        sizes = [one.shape[1] for one in values]
        scatter = np.sqrt(np.mean([np.square(one).mean(axis=0) for one in spreads], axis=0))
    else:
        apart = values[1][:, partners[1]] - values[0][:, partners[0]]
        sizes = [apart.shape[1]] * 2
        differences = means_given(rng, apart)
        scatter = np.sqrt(np.square(apart.std(axis=1, ddof=1)).mean(axis=0) / 2)  # of each of both sites
    ratios = np.log(spreads[1] / spreads[0])
    found = []
    for j, name in enumerate(names):
        difference = float(differences[:, j].mean())
        found.append(
            Contrast(
                sites=list(pair),
                parameter=name,
                paired=partners is not None,
                difference=interval(differences[:, j], confidence),
                spread_ratio=interval(ratios[:, j], confidence).exponential(),
                needed=needed(difference, float(scatter[j]), 1 - confidence, paired=partners is not None),
                detectable=detectable(float(scatter[j]), sizes, 1 - confidence, paired=partners is not None),
            )
        )
    return found


def means_given(rng: np.random.Generator, values: Array) -> Array:
    """Draws ``[m, k]`` of the mean of a normal distribution, given ``values`` ``[m, n, k]`` of it.

    Student's distribution around their mean: the posterior with the prior 1/spread.
    """
    count = values.shape[1]
    scatter = values.std(axis=1, ddof=1) / np.sqrt(count)
    return np.asarray(values.mean(axis=1) + scatter * rng.standard_t(count - 1, size=scatter.shape))


def interval(draws: Array, confidence: float) -> Interval:
    """Mean, equal-tailed interval and probability of direction of draws ``[m]``."""
    tail = 50.0 * (1.0 - confidence)
    low, high = np.percentile(draws, [tail, 100.0 - tail])
    above = float(np.mean(draws > 0.0) + 0.5 * np.mean(draws == 0.0))
    return Interval(float(draws.mean()), float(low), float(high), max(above, 1.0 - above))


def power(difference: float, scatter: float, sizes: Sequence[int], level: float, *, paired: bool) -> float:
    """The probability that a t test at ``level`` finds a difference between two sites.

    ``scatter``: standard deviation of the specimens of each site; of pairs, that of their differences over sqrt(2).
    """
    df = sizes[0] - 1 if paired else sum(sizes) - 2
    shift = abs(difference) / (scatter * np.sqrt(1.0 / sizes[0] + 1.0 / sizes[1]))
    edge = float(student_t.ppf(1.0 - level / 2, df))
    if shift > SURE * (1.0 + edge):  # where SciPy's distribution is NaN
        return 1.0
    return float(nct.sf(edge, df, shift) + (nct.cdf(-edge, df, shift) if shift < SURE else 0.0))


def needed(difference: float, scatter: float, level: float, *, paired: bool) -> int | None:
    """The fewest specimens of each site that find a difference with probability ``POWER``.

    None if it takes more than ``MOST_NEEDED``.
    """

    def enough(count: int) -> bool:
        return power(difference, scatter, [count, count], level, paired=paired) >= POWER

    counts = range(2, MOST_NEEDED + 1)  # one of each site finds nothing
    found = bisect_left(counts, True, key=enough)
    return counts[found] if found < len(counts) else None


def detectable(scatter: float, sizes: Sequence[int], level: float, *, paired: bool) -> float | None:
    """The smallest difference that specimens of these ``sizes`` find with probability ``POWER``.

    None for a single specimen of each site, which can find none.
    """
    if sum(sizes) < 3 or (paired and sizes[0] < 2):
        return None
    surely = 2.0 * SURE * (1.0 + float(student_t.ppf(1.0 - level / 2, 1)))  # found by any sizes
    return scatter * float(brentq(lambda one: power(one, 1.0, sizes, level, paired=paired) - POWER, 0.0, surely))
