"""What a discovery asks of fitted models besides fits, on the study's cluster: a solver may have to run for it."""

from collections.abc import Callable, Sequence
from typing import TypeVar

from sinew.runner.evaluation.adaptive import Session
from sinew.tasks.discover.after.gap import Expected, expected_errors, gap
from sinew.tasks.discover.fit.fit import Fitted
from sinew.tasks.discover.fit.held_out import SquaredErrors
from sinew.tasks.discover.fit.specimen_fits import Effects, SpecimenFits, each_for_all
from sinew.tasks.discover.measure.cells import misfit_map
from sinew.tasks.discover.measure.conflict import conflict, together
from sinew.tasks.discover.misfit_map import CellMisfit
from sinew.tasks.discover.result import Conflict, Gap
from sinew.tasks.study import streams
from sinew.tasks.study.streams import Stream
from sinew.tasks.study.workspace import Workspace

FAR_BEYOND = 0.02  # of the probability of chance: that of the second, farther limit of a cell

T = TypeVar("T")


def on_a_worker(workspace: Workspace, cohort: Sequence[SpecimenFits], title: str, ask: Callable[[], T]) -> T:
    """What ``ask`` returns, which can be pickled."""
    return each_for_all(workspace, cohort[:1], title, [None], lambda _, __, session: session.compute(ask))[0][0]


def misfits(
    workspace: Workspace, chance: float, cohort: Sequence[SpecimenFits], effects: Effects, fits: Sequence[Fitted]
) -> list[tuple[CellMisfit, ...]]:
    """The misfit maps of fits with ``effects``, by specimen; ``chance`` is that of the whole cohort."""
    stream = Stream.MISFIT_AFTER if effects else Stream.MISFIT_BEFORE

    def work(i: int, _: None, session: Session) -> tuple[CellMisfit, ...]:
        one, seed = cohort[i], streams.key(workspace.seed, stream, i)
        how = (chance / len(cohort), FAR_BEYOND, seed)
        found: tuple[CellMisfit, ...] = session.compute(misfit_map, one.measured, one.candidate(effects), fits[i], *how)
        return found

    having = " + ".join(effect.name for effect in effects) or "the model as it is"
    return each_for_all(workspace, cohort, f"where it is wrong: {having}", [None], work)[0]


def gap_of(
    workspace: Workspace,
    cohort: Sequence[SpecimenFits],
    found: SquaredErrors,
    effects: Effects,
    fits: Sequence[Fitted],
    before: Effects = (),
) -> Gap:
    """The gap on held-out data between the model ``before`` and that with ``effects``, which has these ``fits``."""

    def work(i: int, _: None, session: Session) -> Expected:
        one = cohort[i]
        expected: Expected = session.compute(expected_errors, one.candidate(effects), one.measured, fits[i])
        return expected

    (expected,) = each_for_all(workspace, cohort, "the gap", [None], work)
    return gap(found, effects, expected, before)


def conflicts(workspace: Workspace, cohort: Sequence[SpecimenFits], bare_fits: Sequence[Fitted]) -> Conflict:
    """Whether one set of parameters can be right for all protocols, by specimen and for all of them."""

    def work(i: int, _: None, session: Session) -> object:
        one, fitted = cohort[i], bare_fits[i]
        return session.compute(conflict, one.candidate(), one.measured, fitted, one.alone(session, fitted))

    title = "the model as it is, for each curve alone"
    (found,) = each_for_all(workspace, cohort, title, [None], work)
    return together({one.name: each for one, each in zip(cohort, found, strict=True)})
