"""A candidate in the result: its gains, its predictions, and its parameters with their intervals."""

from collections.abc import Mapping, Sequence
from itertools import repeat

import numpy as np
from scipy.stats import chi2

from sinew.tasks.discover.fit.candidate import Candidate
from sinew.tasks.discover.fit.fit import Fitted
from sinew.tasks.discover.fit.intervals import Profiled
from sinew.tasks.discover.fit.specimen_fits import Effects, SpecimenFits
from sinew.tasks.discover.judge.scores import Score, Scores, explained
from sinew.tasks.discover.measure.splits import LATER, PROTOCOL
from sinew.tasks.discover.result import CandidateResult, Estimate, SharedEstimate

NORMAL_90 = 1.645  # standard deviations to either side of a 90 % interval


def candidate_result(
    score: Score,
    scores: Scores,
    effects: Effects,
    cohort: Sequence[SpecimenFits],
    fits: Sequence[Fitted],
    profiled: Sequence[Profiled] | None = None,
) -> CandidateResult:
    """One of the candidates, with its fits in the order of the specimens.

    ``profiled`` holds the intervals by profile likelihood of each specimen, where they are known.
    """
    candidates = [one.candidate(effects) for one in cohort]
    held_out = score.held.get(PROTOCOL, score.held.get(LATER))
    names = [one.name for one in cohort]
    each = zip(names, candidates, fits, profiled or repeat(None, len(fits)), strict=True)
    parameters = {name: estimates(effects, candidate, fit, known) for name, candidate, fit, known in each}
    return CandidateResult(
        effects=score.effects,
        forms=tuple(effect.name for effect in effects),
        loss=score.loss,
        free=len(cohort) * sum(len(effect.parameters) for effect in effects),
        gain=scores.gain(score),
        gains=dict(zip(names, score.gains, strict=True)),
        explained=explained(scores.bare, score, scores.noise),
        held_out=held_out.gain if held_out else None,
        held_out_error=held_out.error if held_out else None,
        splits=score.held,
        beyond_one=score.beyond,
        in_place=score.in_place,
        on_bound=score.on_bound,
        parameters=parameters,
        shared=shared_estimates(effects, candidates[0], fits),
    )


def shared_estimates(effects: Effects, candidate: Candidate, fits: Sequence[Fitted]) -> dict[str, SharedEstimate]:
    """Parameters of the machine as one value for all specimens, and how likely it is that there is one (chi-square).

    They are reported and decide nothing: where nature's form of an effect is not the library's, values differ by more
    than noise.
    """
    if len(fits) < 2:
        return {}
    low, high = candidate.bounds()
    parameters = [(effect, parameter) for effect in effects for parameter in effect.parameters]
    first = candidate.size - len(parameters)
    estimates = {}
    for k, (effect, parameter) in enumerate(parameters, first):
        if parameter.name in effect.shared:
            values = np.array([low[k] + (high[k] - low[k]) * fitted.at[k] for fitted in fits])
            weights = np.array([((high[k] - low[k]) * fitted.uncertainty[k]) ** -2.0 for fitted in fits])
            mean = float(weights @ values / weights.sum())
            p = float(chi2.sf(float(weights @ (values - mean) ** 2), len(fits) - 1))
            half = NORMAL_90 / float(np.sqrt(weights.sum()))
            ends = (max(mean - half, float(low[k])), min(mean + half, float(high[k])))
            estimates[parameter.name] = SharedEstimate(mean, parameter.unit, ends, p)
    return estimates


def estimates(
    effects: Effects, candidate: Candidate, fitted: Fitted, profiled: Profiled | None
) -> Mapping[str, Estimate]:
    """Values and 90 % intervals of the effects' parameters: by profile, or else from the curvature at the fit."""
    low, high = candidate.bounds()
    parameters = [parameter for effect in effects for parameter in effect.parameters]
    own = slice(candidate.size - len(parameters), None)
    if profiled is not None:
        fitted, ends = profiled.fitted, profiled.ends
    else:
        ends = fitted.at[own, np.newaxis] + NORMAL_90 * fitted.uncertainty[own, np.newaxis] * np.array([-1.0, 1.0])
        ends = np.clip(ends, 0.0, 1.0)  # as a profile ends there: values beyond are not possible
    values = low[own] + (high - low)[own] * fitted.at[own]
    intervals = low[own, np.newaxis] + (high - low)[own, np.newaxis] * ends
    return {
        parameter.name: Estimate(value, parameter.unit, (interval[0], interval[1]))
        for parameter, value, interval in zip(parameters, values.tolist(), intervals.tolist(), strict=True)
    }
