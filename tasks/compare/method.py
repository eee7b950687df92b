"""How far posteriors overlap: one principal component, ROC curves by pairs (Pekedis 2025), a linear classifier.

The paper reduces the standardised parameters to one component. A difference across that direction would be missed, so
a linear classifier of all parameters, judged on particles that it was not fitted to, stands beside it. Particles keep
their weights throughout: equal draws from them would add noise, and would put copies of one particle on both sides of a
cross-validation.

Every interval here comes from the finite number of particles. More particles make it shorter, more specimens do not: it
says how far two posteriors overlap, and does not test whether two sites of all tendons differ.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
from scipy.optimize import brentq
from scipy.special import expit, logit, ndtri

from sinew.tasks.compare.result import Densities, Pair, Roc, Separability
from sinew.tasks.compare.settings import Settings
from sinew.tasks.infer.result import FEW
from sinew.tasks.study import streams
from sinew.tasks.study.streams import Stream

Array = np.ndarray[Any, Any]
FEWEST = 4  # particles of a site
GRID = 201  # values of the component at which densities are computed


@dataclass(frozen=True, eq=False)
class Particles:
    """``values`` ``[n, d]`` with ``weights`` ``[n]`` whose sum is 1."""

    values: Array
    weights: Array

    @property
    def effective(self) -> float:
        """How many particles of equal weight are worth as much (Kish 1965)."""
        return float(1.0 / np.sum(self.weights**2))


@dataclass(frozen=True, eq=False)
class Component:
    """First principal component of standardised parameters: ``loadings`` ``[d]`` of unit length.

    ``mean`` and ``sd`` ``[d]`` standardise; ``explained`` is its part of the variance. A parameter that is the same in
    every particle has no part in it.
    """

    mean: Array
    sd: Array
    loadings: Array
    explained: float

    def standardised(self, values: Array) -> Array:
        """``[n, d]`` without units."""
        return (values - self.mean) / np.where(self.sd > 0, self.sd, 1.0)

    def of(self, values: Array) -> Array:
        """The component ``[n]`` of ``values`` ``[n, d]``."""
        return self.standardised(values) @ self.loadings


@dataclass(frozen=True)
class Area:
    """Area under an ROC curve, and the ``interval`` in which it is known."""

    auc: float
    interval: tuple[float, float]


def pairs_of(
    component: Component, along: Mapping[str, Array], sites: Mapping[str, Particles], seed: int, settings: Settings
) -> list[Pair]:
    """The comparison of each pair of ``sites``; ``along`` holds the component ``[n]`` of each one's particles."""
    pairs = combinations(sites, 2)
    return [
        _pair(component, along, sites, pair, streams.key(seed, Stream.COMPARISON, number), settings)
        for number, pair in enumerate(pairs)
    ]


def _pair(
    component: Component,
    along: Mapping[str, Array],
    sites: Mapping[str, Particles],
    pair: tuple[str, str],
    seed: tuple[int, ...],
    settings: Settings,
) -> Pair:
    from sklearn.metrics import roc_curve

    first, second = pair
    found = area(along[first], along[second], sites[first].weights, sites[second].weights, settings.confidence)
    values = np.concatenate([along[first], along[second]])
    weights = np.concatenate([sites[first].weights, sites[second].weights])
    labels = np.repeat([0, 1], [along[first].size, along[second].size])
    false_positive, true_positive, _ = roc_curve(labels, values, sample_weight=weights)
    scaled = {site: Particles(component.standardised(sites[site].values), sites[site].weights) for site in pair}
    return Pair(
        sites=[first, second],
        auc=found.auc,
        interval=np.array(found.interval),
        roc=Roc(false_positive, true_positive),
        all_parameters=separability(scaled[first], scaled[second], seed, settings),
    )


def first_component(groups: list[Particles]) -> Component:
    """The first principal component of all groups together, each of the same weight in all.

    Parameters are standardised by mean and standard deviation over all of them. The largest loading is positive.
    """
    values = np.concatenate([group.values for group in groups])
    weights = np.concatenate([group.weights for group in groups]) / len(groups)
    mean = weights @ values
    sd = np.sqrt(weights @ (values - mean) ** 2)
    sd = np.where(sd > 1e-12 * np.maximum(np.abs(mean), np.finfo(float).tiny), sd, 0.0)
    standardised = (values - mean) / np.where(sd > 0, sd, 1.0)
    correlation = (standardised * weights[:, np.newaxis]).T @ standardised
    variances, directions = np.linalg.eigh(correlation)
    loadings = np.where(sd > 0, directions[:, -1], 0.0)
    loadings = loadings * np.sign(loadings[np.argmax(np.abs(loadings))])
    total = float(variances.sum())
    return Component(mean, sd, loadings, float(variances[-1]) / total if total > 0 else 0.0)


def area(x: Array, y: Array, x_weights: Array, y_weights: Array, confidence: float = 0.95) -> Area:
    """How often a draw from ``y`` is above one from ``x``; below 0.5, ``y`` is the lower one.

    ``x`` ``[n]`` and ``y`` ``[m]`` have weights whose sums are 1. The interval is that of :func:`interval`.
    """
    above_x, below_y = placements(x, y, x_weights, y_weights)
    return _area(above_x, below_y, x_weights, y_weights, confidence)


def _area(above_x: Array, below_y: Array, x_weights: Array, y_weights: Array, confidence: float) -> Area:
    auc = min(max(float(x_weights @ above_x + y_weights @ below_y) / 2, 0.0), 1.0)  # rounding
    variance = _variance(above_x, x_weights) + _variance(below_y, y_weights)
    effective = (1.0 / np.sum(x_weights**2), 1.0 / np.sum(y_weights**2))
    return Area(auc, interval(auc, variance, effective, confidence))


def placements(x: Array, y: Array, x_weights: Array, y_weights: Array) -> tuple[Array, Array]:
    """For each of ``x`` ``[n]`` the weight of the ``y`` above it, for each of ``y`` ``[m]`` that of the ``x`` below it.

    Ties count half. Their weighted means are the area under the ROC curve.
    """
    return 1.0 - _weight_below(x, y, y_weights), _weight_below(y, x, x_weights)


def _weight_below(points: Array, others: Array, weights: Array) -> Array:
    order = np.argsort(others, kind="stable")
    passed = np.concatenate([[0.0], np.cumsum(weights[order])]) / weights.sum()
    places = (np.searchsorted(others[order], points, side=side) for side in ("left", "right"))
    below: Array = sum(passed[place] for place in places) / 2
    return below


def _variance(placed: Array, weights: Array) -> float:
    """Of the weighted mean of ``placed`` ``[n]``: particles were drawn together with their weights."""
    n = weights.size
    return float(n / (n - 1) * np.sum((weights * (placed - weights @ placed)) ** 2))


def interval(auc: float, variance: float, effective: tuple[float, float], confidence: float) -> tuple[float, float]:
    """Where the area under an ROC curve may be.

    ``variance`` is that of DeLong et al. (1988), with weights; the interval is symmetric on the logistic scale, which
    keeps it between 0 and 1 and true for large areas. Where the groups do not overlap, ``variance`` is zero and says
    nothing: the interval is then that of Newcombe (2006, method 5) for ``effective`` particles of either group. With
    fewer than ``FEW`` of these in a group, it is the hull of both intervals.
    """
    z = float(ndtri(0.5 + confidence / 2))
    if variance < 1e-12 or not 0.0 < auc < 1.0:
        return _newcombe(auc, effective, z)
    spread = z * np.sqrt(variance) / (auc * (1.0 - auc))
    low, high = (float(bound) for bound in expit(logit(auc) + np.array([-spread, spread])))
    if min(effective) < FEW:
        others = _newcombe(auc, effective, z)
        return min(low, others[0]), max(high, others[1])
    return low, high


def _newcombe(auc: float, effective: tuple[float, float], z: float) -> tuple[float, float]:
    m, n = effective
    more = (m + n) / 2 - 1.0

    def beyond(theta: float) -> float:
        variance = theta * (1 - theta) * (1 + more * ((1 - theta) / (2 - theta) + theta / (1 + theta))) / (m * n)
        return abs(theta - auc) - z * float(np.sqrt(variance))

    low = brentq(beyond, 0.0, auc - 1e-9) if auc > 1e-6 else 0.0
    high = brentq(beyond, auc + 1e-9, 1.0) if auc < 1.0 - 1e-6 else 1.0
    return low, high


def separability(first: Particles, second: Particles, seed: tuple[int, ...], settings: Settings) -> Separability:
    """How well a linear classifier of all parameters tells particles that it has not seen.

    Linear discriminant analysis, ``folds``, ``repeats`` times over. DeLong's variance leaves out that another
    sample would have trained another classifier: without a difference, its intervals miss 0.5 in 15 of 100 cases.
    What is left out is seen when the sites' names are shuffled: ``p_value`` and ``without_difference`` (the range
    that holds ``confidence`` of the areas then) come from there, and the interval is never shorter than their scatter.
    With fewer than ``FEW`` effective particles both are None: that clouds of particles differ is no news, they were
    proposed in different places; it is their weights that make posteriors of them.
    """
    values = np.concatenate([first.values, second.values])
    weights = np.concatenate([first.weights, second.weights])
    weights = np.maximum(weights, 1e-9 * weights.max())  # one particle may have it all, and be in one fold only
    is_second = np.repeat([False, True], [first.weights.size, second.weights.size])
    folds = min(settings.folds, first.weights.size, second.weights.size)
    rng = np.random.default_rng(seed)
    placed = np.zeros(weights.size)
    for _ in range(settings.repeats):
        placed += _placed_unseen(values, weights, is_second, folds, rng) / settings.repeats
    parts = [weights[~is_second] / weights[~is_second].sum(), weights[is_second] / weights[is_second].sum()]
    auc = min(max(float(parts[0] @ placed[~is_second] + parts[1] @ placed[is_second]) / 2, 0.0), 1.0)
    shuffled = np.empty(settings.permutations)
    for k in range(settings.permutations):
        names = rng.permutation(is_second)
        each = _placed_unseen(values, weights, names, folds, rng)
        halves = (each[side] @ weights[side] / weights[side].sum() for side in (~names, names))
        shuffled[k] = sum(halves) / 2
    scatter = float(np.mean((shuffled - 0.5) ** 2)) * 4 * auc * (1 - auc)  # it narrows where areas are near 0 or 1
    variance = max(_variance(placed[~is_second], parts[0]) + _variance(placed[is_second], parts[1]), scatter)
    tail = (1 - settings.confidence) / 2
    few = min(first.effective, second.effective) < FEW
    return Separability(
        auc=auc,
        interval=np.array(interval(auc, variance, (first.effective, second.effective), settings.confidence)),
        without_difference=None if few else np.quantile(shuffled, [tail, 1 - tail]),
        p_value=None if few else float((1 + np.sum(shuffled >= auc)) / (1 + settings.permutations)),
        folds=folds,
        repeats=settings.repeats,
        permutations=settings.permutations,
    )


def _placed_unseen(values: Array, weights: Array, is_second: Array, folds: int, rng: np.random.Generator) -> Array:
    """Placements ``[n]`` of all particles by classifiers fitted without them, among those of their fold."""
    from sklearn.model_selection import StratifiedKFold

    placed = np.empty(weights.size)
    splits = StratifiedKFold(folds, shuffle=True, random_state=int(rng.integers(2**31)))
    for train, test in splits.split(values, is_second):
        direction = discriminant(values[train], weights[train], is_second[train])
        score = values[test] @ direction
        a, b = test[~is_second[test]], test[is_second[test]]
        sides = score[~is_second[test]], score[is_second[test]]
        placed[a], placed[b] = placements(*sides, weights[a], weights[b])
    return placed


def discriminant(values: Array, weights: Array, is_second: Array) -> Array:
    """Fisher's linear discriminant ``[d]`` of weighted particles (scikit-learn's takes no weights).

    The covariance is drawn towards a multiple of the identity, the more so the fewer particles there are.
    """
    size = values.shape[1]
    means, covariance, effective = [], np.zeros((size, size)), 0.0
    for side in (~is_second, is_second):
        weight = weights[side] / weights[side].sum()
        mean = weight @ values[side]
        apart = values[side] - mean
        covariance += (apart * weight[:, np.newaxis]).T @ apart / 2
        effective += 1.0 / np.sum(weight**2)
        means.append(mean)
    shrinkage = size / (size + effective)
    level = float(np.trace(covariance)) / size or 1.0
    shrunk = (1 - shrinkage) * covariance + shrinkage * level * np.eye(size)
    direction: Array = np.linalg.solve(shrunk, means[1] - means[0])
    return direction


def densities(along: Mapping[str, Array], sites: Mapping[str, Particles]) -> Densities:
    """Kernel density of the component of each site on a common grid; None for a site without any spread."""
    from scipy.stats import gaussian_kde

    every = np.concatenate(list(along.values()))
    margin = 0.35 * float(np.ptp(every)) or 1.0
    grid = np.linspace(every.min() - margin, every.max() + margin, GRID)
    found: dict[str, Array | None] = {}
    for site, values in along.items():
        varies = np.ptp(values) > 1e-9 * max(1.0, float(np.abs(values).max())) and sites[site].effective > 1 + 1e-6
        found[site] = gaussian_kde(values, weights=sites[site].weights)(grid) if varies else None
    return Densities(grid, found)
