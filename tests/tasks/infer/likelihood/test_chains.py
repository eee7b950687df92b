"""Chains of specimens and their population: calibrated where everything is drawn from the prior."""

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import chi2, chisquare, kstest

from sinew.runner.errors import BadInput
from sinew.tasks.infer.likelihood import explore
from sinew.tasks.infer.likelihood.chains import CHAINS, begun, swept
from sinew.tasks.infer.likelihood.compiled import FARTHEST
from sinew.tasks.infer.likelihood.effort import FULL
from sinew.tasks.infer.likelihood.explore import explored
from sinew.tasks.infer.likelihood.population import SPREAD_DF, _scatter, from_prior
from sinew.tasks.infer.likelihood.scores import places
from sinew.tasks.model.parameters import own_parameter

SIZE, SPECIMENS = 2, 3
ROUGH = replace(FULL, candidates=2, starts=2, again=2, rounds=2)
VARIED = tuple(own_parameter(f"p{j}", "1", 0.0, 1.0) for j in range(SIZE))


@dataclass(frozen=True, eq=False)
class Line:
    """A specimen whose whitened errors are not quite linear; the first parameter is better determined."""

    measured: np.ndarray
    varied: tuple = VARIED
    size: int = SIZE
    points: int = 6
    near: None = None
    parts: tuple = (np.arange(6),)

    def errors(self, at):
        return course(at) - self.measured

    def squares(self, at):
        return np.square(self.errors(at)).sum(axis=1)

    def slopes(self, at):
        steps = 1e-6 * np.eye(SIZE)
        return self.errors(at[np.newaxis])[0], ((self.errors(at + steps) - self.errors(at - steps)) / 2e-6).T


def course(at):
    x = np.arange(6) / 5
    return 20.0 * at[:, :1] * (1 + 0.3 * at[:, 1:] * x) + 1.5 * at[:, 1:] * x**2


def ranks(seed, heavy):
    """Where the truth is among draws of its posterior: of the population's mean and spread and of one specimen."""
    rng = np.random.default_rng(seed)
    scores = np.full((SPECIMENS, SIZE), np.inf)
    while np.abs(scores).max() > FARTHEST:  # a specimen is within the ranges
        truth = from_prior(rng, 1, SIZE, SPECIMENS, heavy=heavy)
        root = np.linalg.cholesky(truth.covariance()[0])
        weights = truth.weights[:, 0] if heavy else np.ones(SPECIMENS)
        scores = truth.mean + (rng.standard_normal((SPECIMENS, SIZE)) @ root.T) / np.sqrt(weights)[:, np.newaxis]
    targets = [Line(course(places(one)[np.newaxis])[0] + rng.standard_normal(6)) for one in scores]
    known = [explored(target, (seed, i), ROUGH) for i, target in enumerate(targets)]
    state = begun(targets, known, (seed, 100), heavy=heavy)
    block = swept(targets, known, state, 25, (seed, 200), heavy=heavy)
    spread = np.sqrt(np.diagonal(truth.covariance()[0]))
    every = ((block.mean, truth.mean[0]), (block.spread, spread), (block.scores[:, :, 0], scores[0]))
    return np.array([(draws[8:] < one).mean(axis=(0, 1)) for draws, one in every])


COHORTS = 24


@pytest.mark.parametrize("heavy", [False, pytest.param(True, marks=pytest.mark.thorough)])
def test_truth_is_anywhere_among_the_draws(heavy, monkeypatch):
    """Simulation-based calibration (Talts et al. 2018): ranks are uniform. A rough emulator will do here."""
    for name, value in (("PATHS", 4), ("WALKERS", 64)):
        monkeypatch.setattr(explore, name, value)
    found = np.array([ranks(seed, heavy) for seed in range(COHORTS)])
    for name, each in zip(("mean", "spread", "specimen"), found.swapaxes(0, 1), strict=True):
        for j in range(SIZE):
            counts = np.histogram(each[:, j], bins=5, range=(0, 1))[0]
            assert chisquare(counts).pvalue > 5e-4, (name, j, counts)


class Fragile(Line):
    """A specimen that only fits can compute."""

    def errors(self, at):
        return course(at) - 1.0 if len(at) <= SIZE + 1 else np.full((len(at), 6), np.nan)


def test_a_specimen_that_cannot_be_computed_around_its_fit_is_refused():
    fragile = Fragile(SimpleNamespace(specimen=SimpleNamespace(name="distal/1")))
    with pytest.raises(BadInput, match=r"infer: distal/1: nearly all runs of the model around its best fit fail"):
        explored(fragile, (1, 0))


def test_blocks_follow_from_their_seed_and_the_state_before():
    targets = [Line(course(np.array([[0.4, 0.5]]))[0] + shift) for shift in (0.0, 0.3)]
    known = [explored(target, (1, i)) for i, target in enumerate(targets)]
    state = begun(targets, known, (2,), heavy=False)
    first = swept(targets, known, state, 3, (3,), heavy=False)
    again = swept(targets, known, state, 3, (3,), heavy=False)
    np.testing.assert_array_equal(first.scores, again.scores)
    second = swept(targets, known, first.state, 3, (3,), heavy=False)
    assert second.state.sweep == 6
    assert not np.array_equal(first.mean, second.mean)


def test_the_covariance_of_a_draw_is_that_of_its_specimens():
    """Given specimens, mean and scales, the trace of precision times scatter is chi-squared distributed (Wishart)."""
    targets = [Line(course(np.array([[0.5, 0.5]]))[0]) for _ in range(SPECIMENS)]
    known = [explored(target, (3, i), ROUGH) for i, target in enumerate(targets)]
    state, found = begun(targets, known, (4,), heavy=False), []
    for _ in range(40):
        state = swept(targets, known, state, 4, (5,), heavy=False).state
        scatter = _scatter(state.population.apart_from_mean(state.scores), state.population.scales)
        df = SPREAD_DF + SIZE - 1.0 + SPECIMENS
        traces = np.einsum("cjk,ckj->c", state.population.precision, scatter)
        found += list(chi2.cdf(traces, df * SIZE))
    assert kstest(found, "uniform").pvalue > 1e-3


def test_few_draws_of_a_specimen_begin_all_chains():
    target = Line(course(np.array([[0.4, 0.5]]))[0])
    known = explored(target, (1, 0))
    state = begun([target], [replace(known, begin=known.begin[:3])], (2,), heavy=False)
    assert state.scores.shape == (1, CHAINS, SIZE)
