"""The next experiment for a cohort: which test would tell candidates with their fits apart."""

from collections.abc import Sequence

from sinew.runner.evaluation.adaptive import Session
from sinew.tasks.discover.after.experiment import Experiment, Rival, next_experiment
from sinew.tasks.discover.fit.fit import Fitted
from sinew.tasks.discover.fit.specimen_fits import Effects, SpecimenFits, each_for_all
from sinew.tasks.discover.follow_up import NextExperiment
from sinew.tasks.study.workspace import Workspace

MAX_SPECIMENS = 4  # for which it is computed


def telling_experiment(
    workspace: Workspace,
    cohort: Sequence[SpecimenFits],
    models: Sequence[tuple[Effects, Sequence[Fitted]]],
    title: str,
) -> NextExperiment | None:
    """The test that tells ``models``, effects with their fits by specimen, apart best; None where none does."""
    some = cohort[:MAX_SPECIMENS]
    rivals = [Rival(effects, tuple(one.at for one in fits[:MAX_SPECIMENS])) for effects, fits in models]
    measured = [one.measured for one in some]

    def work(_: int, __: None, session: Session) -> Experiment | None:
        bare = some[0].candidate().stand_in
        answer: Experiment | None = session.compute(next_experiment, bare, rivals, measured)
        return answer

    ((experiment,),) = each_for_all(workspace, some[:1], title, [None], work)
    return experiment.result() if experiment else None
