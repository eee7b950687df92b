"""The next experiment for a cohort: which test would tell candidates with their fits apart."""

from collections.abc import Sequence
from functools import partial

from sinew.tasks.discover.after.experiment import Rival, next_experiment
from sinew.tasks.discover.fit.fit import Fitted
from sinew.tasks.discover.fit.specimen_fits import Effects, SpecimenFits
from sinew.tasks.discover.follow_up import NextExperiment
from sinew.tasks.discover.on_workers import on_a_worker
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

    ask = partial(next_experiment, some[0].candidate().stand_in, rivals, measured)
    experiment = on_a_worker(workspace, some, title, ask)
    return experiment.result() if experiment else None
