"""What the library leaves, described by laws of the grammar, where some of them predict what was not fitted."""

from collections.abc import Sequence

from sinew.runner.evaluation.adaptive import Session
from sinew.tasks.discover.after.added import study_with
from sinew.tasks.discover.after.estimates import estimates
from sinew.tasks.discover.after.experiment import Experiment, Rival, next_experiment
from sinew.tasks.discover.after.gap import gap
from sinew.tasks.discover.compound import taken_away
from sinew.tasks.discover.fit.laws import FoundLaw, find_law
from sinew.tasks.discover.fit.search import Candidates
from sinew.tasks.discover.fit.specimen_fits import Effects, SpecimenFits, each_for_all, profiled_each
from sinew.tasks.discover.follow_up import NextExperiment
from sinew.tasks.discover.result import WITH_LAWS, Law
from sinew.tasks.study.workspace import Workspace

MAX_SPECIMENS = 4  # for which the test that would refute a law is computed


def described(
    workspace: Workspace, cohort: Sequence[SpecimenFits], candidates: Candidates, beside: Effects
) -> Law | None:
    """The laws that describe what the effects ``beside`` them leave; None where none predicts what was not fitted."""
    base_fits = candidates.with_bare[beside]
    found = find_law(workspace, cohort, beside, base_fits)
    if not found.laws:
        return None
    effects, floor = found.effects, candidates.floor
    share, interval = taken_away(cohort, candidates.bare, (beside, base_fits), (effects, found.fits), floor)
    ends = profiled_each(workspace, cohort, "intervals of the law", effects, found.fits)
    parameters = {
        one.name: estimates(effects, one.candidate(effects), fitted, known)
        for one, fitted, known in zip(cohort, found.fits, ends, strict=True)
    }
    path, difference = study_with(workspace, effects, WITH_LAWS)
    return Law(
        names=tuple(law.name for law in found.laws),
        equations=tuple(law.equation for law in found.laws),
        beside=tuple(effect.name for effect in beside),
        share=share,
        interval=interval,
        parameters=parameters,
        gap=gap(found.errors, effects, cohort, found.fits, beside),
        path=path,
        difference=difference,
        other=tuple(law.name for law in found.second[0] if law not in beside) if found.second else (),
        refuted_by=_refuted_by(workspace, cohort, found),
    )


def _refuted_by(workspace: Workspace, cohort: Sequence[SpecimenFits], found: FoundLaw) -> NextExperiment | None:
    """The test that tells the laws from the best others, or from none where no others predict anything."""
    models = [Rival(found.effects, tuple(one.at for one in found.fits[:MAX_SPECIMENS]))]
    other, fits = found.second or (found.base, found.base_fits)
    models.append(Rival(other, tuple(one.at for one in fits[:MAX_SPECIMENS])))
    measured = [one.measured for one in cohort[:MAX_SPECIMENS]]

    def work(_: int, __: None, session: Session) -> Experiment | None:
        answer: Experiment | None = session.compute(next_experiment, workspace.model, models, measured)
        return answer

    ((experiment,),) = each_for_all(workspace, cohort[:1], "the test that would refute the law", [None], work)
    return experiment.result() if experiment else None
