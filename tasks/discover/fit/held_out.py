"""Predictions of held-out data: by the bare model, and by the candidates that the verdict may be about."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from sinew.runner.evaluation.adaptive import Session
from sinew.tasks.discover.fit.fit import Fitted
from sinew.tasks.discover.fit.search import Candidates
from sinew.tasks.discover.fit.specimen_fits import Effects, SpecimenFits, each_for_all
from sinew.tasks.discover.judge.rules import MIN_CRITERION_GAIN, leading, rivals
from sinew.tasks.discover.measure.splits import gain
from sinew.tasks.discover.result import Gain
from sinew.tasks.simulate import Array
from sinew.tasks.study.workspace import Workspace

BLOCK = 50  # points: errors that are farther apart count as independent

Kinds = Mapping[str, Mapping[str, Array]]
"""Whitened squared errors by kind of split and by curve of a specimen: ``[quantities, t]``, NaN where unmeasured."""

SquaredErrors = Mapping[Effects, Kinds]
"""The same by candidate; ``()`` is the bare model."""


def hold_out(workspace: Workspace, cohort: Sequence[SpecimenFits], candidates: Candidates) -> SquaredErrors:
    """Predict held-out data with each candidate that the verdict may be about, and add the gains to the scores.

    Empty where no effect improves the fit clearly.
    """
    judged = _to_judge(candidates)
    if not judged:
        return {}
    pair = judged[0] if len(judged[0]) == 2 else None
    alone = _better_of(candidates, pair) if pair else judged[0]
    rival = rivals(candidates.scores, candidates.scored[judged[0]])[:1]
    wanted = list(dict.fromkeys([(), *judged, *map(candidates.effects_of, rival), alone]))
    errors = squared_errors(workspace, cohort, candidates.with_bare, wanted)
    for effects in wanted:
        if effects in candidates.scored:
            candidates.scored[effects] = replace(candidates.scored[effects], held=gains(errors[()], errors[effects]))
    if pair:
        candidates.scored[pair] = replace(candidates.scored[pair], beyond=gains(errors[alone], errors[pair]))
    return errors


def hold_out_of(
    workspace: Workspace, cohort: Sequence[SpecimenFits], candidates: Candidates, effects: Effects
) -> SquaredErrors:
    """Predict held-out data with one candidate, and add the gains to its score."""
    errors = squared_errors(workspace, cohort, candidates.with_bare, [(), effects])
    candidates.scored[effects] = replace(candidates.scored[effects], held=gains(errors[()], errors[effects]))
    return errors


def _to_judge(candidates: Candidates) -> list[Effects]:
    """Candidates that the verdict may be about: a pair and the best single effect, or this alone, or none."""
    scores = candidates.scores
    best = leading(scores)
    if scores.gain(best) < MIN_CRITERION_GAIN:
        return []
    return list(dict.fromkeys(map(candidates.effects_of, (best, scores.best_single))))


def _better_of(candidates: Candidates, pair: Effects) -> Effects:
    """The better of a pair's effects alone, in whichever form it fits best."""
    slugs = {effect.slug for effect in pair}
    singles = [effects for effects in candidates.fits if len(effects) == 1 and effects[0].slug in slugs]
    return min(singles, key=lambda effects: sum(one.loss for one in candidates.fits[effects]))


def squared_errors(
    workspace: Workspace,
    cohort: Sequence[SpecimenFits],
    known: Mapping[Effects, Sequence[Fitted]],
    wanted: Sequence[Effects],
) -> SquaredErrors:
    """Errors on held-out data of the ``wanted`` candidates, of which fits to all data are ``known``."""

    def work(i: int, effects: Effects, session: Session) -> dict[str, dict[str, Array]]:
        fits = known[effects]
        errors = cohort[i].held_out(session, effects, fits[i].at)
        count = sum(len(effect.parameters) for effect in effects)
        if len(cohort) > 1:
            values = np.mean([fit.at[fit.at.size - count :] for k, fit in enumerate(fits) if k != i], axis=0)
            errors |= cohort[i].of_others(session, effects, fits[i].at, values)
        return errors

    columns = each_for_all(workspace, cohort, "predicting what was left out", wanted, work)
    all_errors: dict[Effects, dict[str, dict[str, Array]]] = {}
    for effects, column in zip(wanted, columns, strict=True):
        kinds = all_errors.setdefault(effects, {})
        for one, by_kind in zip(cohort, column, strict=True):
            for kind, curves in by_kind.items():
                kinds.setdefault(kind, {}).update({f"{one.name} {name}": each for name, each in curves.items()})
    return all_errors


def gains(without: Kinds, extended: Kinds) -> dict[str, Gain]:
    """By kind of split: how much better held-out data are predicted by one candidate than by another."""
    return {
        kind: gain({name: (without[kind][name], errors) for name, errors in curves.items()}, BLOCK)
        for kind, curves in extended.items()
    }
