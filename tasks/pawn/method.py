"""PAWN (Pianosi and Wagener 2018): how far the whole distribution of an outcome moves when a parameter is known.

The indices are SALib's. Bootstrap intervals and the level of no influence, which SALib does not give, come from
:func:`median_distances`, the same statistic computed for all parameters at once.
"""

from typing import Any

import numpy as np

from sinew.tasks.pawn.result import Pawn
from sinew.tasks.study.streams import generator

Array = np.ndarray[Any, Any]
FEWEST_ROWS_OF_A_SLIDE = 5  # a distribution of fewer outcomes says nothing


def pawn_indices(
    features: Array, outcomes: Array, *, slides: int, resamples: int, confidence: float, seed: int
) -> Pawn:
    """Indices of each of ``features`` ``[n, d]`` for ``outcomes`` ``[n]``, from a generic sample.

    The interval of the median is the bootstrap's, moved by the bias that resampling has: it holds the scatter of the
    estimate. A small sample makes all distances larger, which no interval tells but ``no_influence`` does: it is the
    ``confidence`` quantile of the median when the outcomes are shuffled.
    """
    import SALib.analyze.pawn as salib_analyze

    if not np.isfinite(outcomes).all():  # SALib would leave them out without a word
        raise ValueError("outcomes must be numbers")
    problem = {"num_vars": features.shape[1], "names": [str(j) for j in range(features.shape[1])]}
    problem["bounds"] = [[0.0, 1.0]] * features.shape[1]
    found = salib_analyze.analyze(problem, features, outcomes, S=slides)
    rng = generator(seed, "pawn bootstrap")
    boot = np.empty((resamples, features.shape[1]))
    for k in range(resamples):
        drawn = rng.integers(len(outcomes), size=len(outcomes))
        boot[k] = median_distances(features[drawn], outcomes[drawn], slides)
    shuffled = generator(seed, "pawn shuffle")
    null = np.stack([median_distances(features, shuffled.permutation(outcomes), slides) for _ in range(resamples)])
    tail = (1 - confidence) / 2
    low, high = np.quantile(boot, [tail, 1 - tail], axis=0)
    bias = boot.mean(axis=0) - found["median"]  # resampled distances are larger: ties take the place of neighbours
    return Pawn(
        median=np.asarray(found["median"]),
        median_low=np.clip(low - bias, 0.0, found["median"]),
        median_high=np.clip(high - bias, found["median"], 1.0),
        maximum=np.asarray(found["maximum"]),
        mean=np.asarray(found["mean"]),
        CV=np.asarray(found["CV"]),
        no_influence=float(np.quantile(null, confidence)),
    )


def median_distances(features: Array, outcomes: Array, slides: int) -> Array:
    """Median over ``slides`` of the Kolmogorov-Smirnov distance ``[d]`` of the outcomes in a slide from all of them."""
    order = np.argsort(outcomes, kind="stable")
    ordered, values = features[order], outcomes[order]
    last = np.append(values[1:] != values[:-1], True)  # of equal outcomes, where the step of a distribution ends
    everywhere = np.arange(1, values.size + 1)[last] / values.size
    edges = np.quantile(features, np.arange(0, 1 + 1 / slides, 1 / slides), axis=0)
    distances = np.full((slides, features.shape[1]), np.nan)
    for s in range(slides):
        inside = (ordered >= edges[s]) & (ordered < edges[s + 1])
        counts = inside.sum(axis=0)
        within = np.cumsum(inside, axis=0)[last] / np.where(counts > 0, counts, 1)
        distances[s] = np.where(counts > 0, np.abs(within - everywhere[:, np.newaxis]).max(axis=0), np.nan)
    return np.asarray(np.nanmedian(distances, axis=0))
