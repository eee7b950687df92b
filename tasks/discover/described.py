"""What the library leaves, described by laws of the grammar, where some of them predict what was not fitted."""

from collections.abc import Sequence

from sinew.tasks.discover.after.added import study_with
from sinew.tasks.discover.after.estimates import estimates
from sinew.tasks.discover.after.telling import telling_experiment
from sinew.tasks.discover.compound import taken_away
from sinew.tasks.discover.fit.laws import FoundLaw, find_law
from sinew.tasks.discover.fit.search import Candidates
from sinew.tasks.discover.fit.specimen_fits import Effects, SpecimenFits, profiled_each
from sinew.tasks.discover.follow_up import NextExperiment
from sinew.tasks.discover.on_workers import gap_of
from sinew.tasks.discover.result import WITH_LAWS, Law
from sinew.tasks.study.workspace import Workspace


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
        gap=gap_of(workspace, cohort, found.errors, effects, found.fits, beside),
        path=path,
        difference=difference,
        other=tuple(law.name for law in found.second[0] if law not in beside) if found.second else (),
        refuted_by=_refuted_by(workspace, cohort, found),
    )


def _refuted_by(workspace: Workspace, cohort: Sequence[SpecimenFits], found: FoundLaw) -> NextExperiment | None:
    """The test that tells the laws from the best others, or from none where no others predict anything."""
    models = [(found.effects, found.fits), found.second or (found.base, found.base_fits)]
    return telling_experiment(workspace, cohort, models, "the test that would refute the law")
