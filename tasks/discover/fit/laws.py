"""The law that describes what the library leaves: a search in the grammar of :mod:`sinew.tasks.model.law`.

Each step looks ahead to all admissible laws, fits the most promising ones, and predicts held-out data with those that
fit best. A law is taken when it predicts them better than the model without it, by more than two standard errors on two
kinds of splits (on one where there is one). Then a second law is looked for in the same way. Fit alone decides nothing:
among so many laws there is always one that fits.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sinew.runner.evaluation.adaptive import Session
from sinew.tasks.discover.fit.fit import Fitted
from sinew.tasks.discover.fit.held_out import SquaredErrors, gains, squared_errors
from sinew.tasks.discover.fit.sizes import size_of, sized
from sinew.tasks.discover.fit.specimen_fits import Effects, SpecimenFits, each_for_all
from sinew.tasks.discover.judge.rules import MIN_HELD_OUT_ERRORS, MIN_SPLIT_KINDS
from sinew.tasks.discover.judge.scores import criterion
from sinew.tasks.discover.measure.splits import SPECIMEN
from sinew.tasks.discover.result import Gain
from sinew.tasks.model import Specimen
from sinew.tasks.model.law import MAX_LAWS, compiled, terms
from sinew.tasks.study.workspace import Workspace

FITTED = 8  # laws that are fitted in each step,
EACH_SLUG = 2  # of which so many have the same part and driver
PREDICTING = 3  # that predict held-out data


@dataclass(frozen=True, eq=False)
class FoundLaw:
    """The ``laws`` that predict what the model without them, ``base``, does not; none where there are no such laws.

    ``base_fits``: of the model without them. ``fits``: of base and laws together, by specimen. ``errors``: on held-out
    data, of both. ``second``: the best model with another part or driver in the place of the last law's, and its fits;
    None where no other was good enough.
    """

    base: Effects
    base_fits: tuple[Fitted, ...]
    laws: Effects
    fits: tuple[Fitted, ...]
    errors: SquaredErrors
    second: tuple[Effects, tuple[Fitted, ...]] | None

    @property
    def effects(self) -> Effects:
        return (*self.base, *self.laws)


def find_law(
    workspace: Workspace, cohort: Sequence[SpecimenFits], base: Effects, base_fits: Sequence[Fitted]
) -> FoundLaw:
    """Look for laws beside the effects of ``base``, which has these fits."""
    measured = [one.measured.specimen for one in cohort]
    size = size_of(measured)
    possible = [sized(compiled(term), size) for term in terms(units_of(measured))]
    known: dict[Effects, Sequence[Fitted]] = {base: base_fits}
    errors: dict[Effects, Mapping[str, Mapping[str, np.ndarray]]] = {}
    chosen, second = base, None
    while len(chosen) - len(base) < MAX_LAWS:
        there = {effect.slug for effect in chosen}
        several: list[Effects] = [(*chosen, one) for one in possible if one.slug not in there]
        tried = _fitted(workspace, cohort, known, several)
        wanted = [each for each in dict.fromkeys([base, chosen, *tried[:PREDICTING]]) if each not in errors]
        errors |= squared_errors(workspace, cohort, known, wanted)
        worthy = [one for one in tried[:PREDICTING] if predicts(gains(errors[chosen], errors[one]))]
        if not worthy:
            break
        worthy.sort(key=lambda one: -_own_gain(gains(errors[chosen], errors[one])))
        chosen, *others = worthy
        other = next((one for one in others if one[-1].slug != chosen[-1].slug), None)
        second = None if other is None else (other, tuple(known[other]))
    return FoundLaw(base, tuple(base_fits), chosen[len(base) :], tuple(known[chosen]), errors, second)


def units_of(specimens: Sequence[Specimen]) -> dict[str, float]:
    """The unit of each driver: the power of ten that is nearest to its largest value in the tests."""
    largest: dict[str, list[float]] = {}
    for one in specimens:
        for curve in one.curves:
            strain, time = 0.5 * (one.stretch(curve.protocol) ** 2 - 1.0), curve.protocol.time_s
            reached = {
                "strain": np.abs(strain).max(),
                "rate": np.abs(np.diff(strain) / np.diff(time)).max(),
                "path": np.abs(np.diff(strain)).sum(),
                "time": time[-1] - time[0],
                "force": np.abs(curve.force_N).max(),
            }
            for name, value in reached.items():
                largest.setdefault(name, []).append(float(value))
    return {name: 10.0 ** round(float(np.log10(max(max(values), 1e-6)))) for name, values in largest.items()}


def predicts(held: Mapping[str, Gain]) -> bool:
    """Whether held-out data are predicted better on enough kinds of splits."""
    better = sum(one.gain > MIN_HELD_OUT_ERRORS * one.error for one in held.values())
    return better >= max(1, min(MIN_SPLIT_KINDS, len(held)))


def _own_gain(held: Mapping[str, Gain]) -> float:
    """The gain on data of a specimen that was fitted: other specimens may have other sizes of the same law."""
    own = [one.gain for kind, one in held.items() if kind != SPECIMEN]
    return sum(own) if own else sum(one.gain for one in held.values())


def _fitted(
    workspace: Workspace,
    cohort: Sequence[SpecimenFits],
    known: dict[Effects, Sequence[Fitted]],
    several: Sequence[Effects],
) -> list[Effects]:
    """The most promising of several models, each with a last law more than one that is known, the best first."""
    before = known[several[0][:-1]]
    promises = each_for_all(
        workspace, cohort, "searching for laws", several,
        lambda i, effects, session: cohort[i].promise(session, effects, before[i]),
    )  # fmt: skip
    points = [one.points for one in before]

    def score(effects: Effects, loss: float) -> float:
        return criterion(loss, len(effects[-1].parameters), points)

    order = sorted(range(len(several)), key=lambda k: score(several[k], sum(promises[k])))
    chosen: list[Effects] = []
    for k in order:
        same = [one for one in chosen if one[-1].slug == several[k][-1].slug]
        if len(chosen) < FITTED and len(same) < EACH_SLUG:
            chosen.append(several[k])

    def work(i: int, effects: Effects, session: Session) -> Fitted:
        return cohort[i].extended(session, effects, before[i])

    columns = each_for_all(workspace, cohort, "laws", chosen, work)
    known |= dict(zip(chosen, columns, strict=True))
    return sorted(chosen, key=lambda effects: score(effects, sum(one.loss for one in known[effects])))
