"""Areas, intervals, components and classifiers, against values that are known beforehand."""

import numpy as np
import pytest
from scipy.stats import norm
from sklearn.decomposition import PCA
from sklearn.metrics import roc_auc_score

from sinew.tasks.compare.method import Particles, area, discriminant, first_component, interval, separability
from sinew.tasks.compare.settings import Settings


def equal(n):
    return np.full(n, 1.0 / n)


def test_the_area_is_that_of_scikit_learn_with_ties_and_weights():
    rng = np.random.default_rng(1)
    x, y = rng.integers(0, 9, 50).astype(float), rng.integers(2, 11, 70).astype(float)
    a, b = rng.dirichlet(np.ones(50)), rng.dirichlet(np.ones(70))
    labels = np.repeat([0, 1], [50, 70])
    known = roc_auc_score(labels, np.concatenate([x, y]), sample_weight=np.concatenate([a, b]))
    assert area(x, y, a, b).auc == pytest.approx(known, abs=1e-12)
    assert area(y, x, b, a).auc == pytest.approx(1 - known, abs=1e-12), "it keeps its direction"


def test_the_variance_is_the_one_that_delong_published():
    """The formula written out over pairs, with equal weights."""
    rng = np.random.default_rng(2)
    x, y = rng.normal(size=15), rng.normal(0.7, size=20)
    above = (y[np.newaxis] > x[:, np.newaxis]).astype(float)
    known = above.mean(axis=1).var(ddof=1) / 15 + above.mean(axis=0).var(ddof=1) / 20
    auc = above.mean()
    half = 1.959964 * np.sqrt(known) / (auc * (1 - auc))
    low, high = 1 / (1 + np.exp(-(np.log(auc / (1 - auc)) + np.array([-half, half]))))
    assert area(x, y, equal(15), equal(20)).interval == pytest.approx((low, high), abs=1e-6)


@pytest.mark.parametrize("weighted", [False, True])
@pytest.mark.parametrize("distance", [0.0, 1.0, 2.5])
def test_the_interval_holds_the_known_area_as_often_as_it_says(distance, weighted):
    """Two normal distributions: the area is Phi(distance / sqrt 2). Weighted ones are drawn from wider ones."""
    rng = np.random.default_rng(3)
    wide = 1.5 if weighted else 1.0
    known = norm.cdf(distance / np.sqrt(2))
    held = 0
    for _ in range(600):
        x, y = rng.normal(0, wide, 40), rng.normal(distance, wide, 40)
        a, b = norm.pdf(x) / norm.pdf(x, 0, wide), norm.pdf(y, distance) / norm.pdf(y, distance, wide)
        low, high = area(x, y, a / a.sum(), b / b.sum()).interval
        held += low <= known <= high
    assert 0.92 <= held / 600 <= 0.985


def test_few_effective_particles_make_a_wide_interval():
    rng = np.random.default_rng(4)
    x, y = rng.normal(size=40), rng.normal(size=40)
    uneven = np.array([0.2] * 4 + [0.2 / 36] * 36)
    even_low, even_high = area(x, y, equal(40), equal(40)).interval
    low, high = area(x, y, uneven, uneven).interval
    assert high - low > 1.8 * (even_high - even_low)


def test_groups_that_do_not_overlap_do_not_have_an_interval_of_nothing():
    apart = area(np.arange(40.0), 100 + np.arange(40.0), equal(40), equal(40))
    assert apart.auc == 1.0
    assert apart.interval[1] == 1.0
    assert 0.9 < apart.interval[0] < 0.99
    reverse = area(100 + np.arange(40.0), np.arange(40.0), equal(40), equal(40))
    assert reverse.auc == 0.0
    assert reverse.interval == pytest.approx((0.0, 1 - apart.interval[0]), abs=1e-6)
    low, high = area(np.zeros(9), np.zeros(9), equal(9), equal(9)).interval
    assert low < 0.5 < high, "nothing but ties"
    assert interval(1.0, 0.0, (4.0, 4.0), 0.95)[0] < apart.interval[0], "four of each know less"


def test_the_component_is_that_of_scikit_learn():
    rng = np.random.default_rng(5)
    mixed = rng.normal(size=(60, 4)) @ rng.normal(size=(4, 4)) * [1.0, 100.0, 0.01, 5.0]
    component = first_component([Particles(mixed[:30], equal(30)), Particles(mixed[30:], equal(30))])
    standardised = (mixed - mixed.mean(axis=0)) / mixed.std(axis=0)
    known = PCA(1).fit(standardised)
    assert component.explained == pytest.approx(known.explained_variance_ratio_[0])
    assert np.abs(component.loadings) == pytest.approx(np.abs(known.components_[0]))
    assert np.abs(component.of(mixed)) == pytest.approx(np.abs(known.transform(standardised)[:, 0]))


def test_a_weight_counts_as_copies_do_and_a_constant_parameter_not_at_all():
    rng = np.random.default_rng(6)
    values = np.column_stack([rng.normal(size=(10, 3)), np.full(10, 0.2)])
    copies = np.repeat(np.arange(10), [4, 1, 1, 1, 3, 1, 1, 1, 1, 2])
    weighted = Particles(values, np.bincount(copies) / copies.size)
    other = Particles(rng.normal(1, size=(8, 4)) * [1, 1, 1, 0] + [0, 0, 0, 0.2], equal(8))
    found = first_component([weighted, other])
    known = first_component([Particles(values[copies], equal(copies.size)), other])
    assert found.loadings == pytest.approx(known.loadings)
    assert found.loadings[3] == 0.0
    assert np.isfinite(found.of(values)).all()


def test_the_discriminant_finds_a_difference_across_the_largest_spread():
    """One component misses it: the first direction has all the spread, the second all the difference."""
    rng = np.random.default_rng(7)
    groups = []
    for shift in (0.0, 1.5):
        along, across = rng.normal(0, 1, 60), rng.normal(0, 0.4, 60) + shift * 0.4
        values = np.column_stack([along + across, along - across, along + 0.3 * rng.normal(size=60)])
        groups.append(Particles(values, equal(60)))
    component = first_component(groups)
    by_component = area(*(component.of(group.values) for group in groups), equal(60), equal(60))
    assert by_component.interval[0] < 0.5 < by_component.interval[1]
    found = separability(*groups, (0,), Settings(permutations=60))
    assert found.auc > 0.8
    assert found.interval[0] > 0.65
    assert found.p_value == pytest.approx(1 / 61)
    values, weights = (np.concatenate([getattr(g, part) for g in groups]) for part in ("values", "weights"))
    direction = discriminant(values, weights, np.repeat([False, True], 60))
    assert direction[0] * direction[1] < 0


def test_without_a_difference_the_classifier_of_all_parameters_claims_none():
    """16 parameters and 40 particles: fitted and judged on the same ones, it would say 0.85."""
    rng = np.random.default_rng(8)
    held, claimed, areas = 0, 0, []
    for number in range(40):
        groups = [Particles(rng.normal(size=(40, 16)), rng.dirichlet(np.full(40, 3.0))) for _ in range(2)]
        found = separability(*groups, (number,), Settings(permutations=20))
        held += found.interval[0] <= 0.5 <= found.interval[1]
        claimed += found.p_value < 0.05
        areas.append(found.auc)
    assert held >= 34
    assert claimed <= 6
    assert abs(np.mean(areas) - 0.5) < 0.05
