"""What the commands over a study do, as one function: for notebooks and scripts."""

from pathlib import Path

from tasks import pipeline
from tasks.opened import Results
from tasks.problems import BadInput, shown
from tasks.study import Study
from tasks.task import TASKS
from tasks.workspace import open_workspace


def run(
    study: Study,
    *names: str,
    out: str | Path | None = None,
    data: str | Path | None = None,
    workers: int | None = None,
    simulator: str | None = None,
    retry_failed: bool = False,
    extend: bool = False,
    figures: bool = False,
    quiet: bool = True,
) -> Results:
    """Run tasks of a study, all that it names unless you name some; what is done already is not done again.

    ``out`` is the result folder (``results/NAME`` if you say nothing), ``data`` a cohort in place of the study's;
    ``extend`` doubles the base samples of the last Sobol study; ``figures`` draws all figures into the folder, as the
    command does (each result's ``plot`` draws one at a time). Says nothing unless ``quiet`` is False: look at the
    results that it returns. A script that is not a notebook calls it under ``if __name__ == "__main__":``, because
    worker processes import the script.

    Raises :class:`tasks.BadInput` and other :class:`runner.errors.SinewError`, one line each, as the command prints.
    """
    unknown = [name for name in names if name not in TASKS]
    if unknown:
        raise BadInput("task", shown(unknown[0]), f"some of {', '.join(TASKS)}")
    folder = Path("results") / study.name if out is None else Path(out)
    chosen = list(names) or list(study.tasks)
    options = {"extend": True} if extend else {}
    cohort = None if data is None else Path(data)
    pipeline.check(study, folder, chosen, data=cohort, extend=extend)
    with open_workspace(
        study,
        data=cohort,
        out=folder,
        cluster=study.cluster_spec(workers),
        simulator=simulator,
        quiet=quiet,
        retry_failed=retry_failed,
    ) as workspace:
        pipeline.run(workspace, chosen, figures=figures, **options)
    return Results(folder)
