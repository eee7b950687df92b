"""What the commands over a study do, as one function: for notebooks and scripts."""

from pathlib import Path

from sinew.result_folder import Results
from sinew.runner.errors import BadInput, shown
from sinew.tasks.cluster.spec import cluster_of
from sinew.tasks.registry import TASKS
from sinew.tasks.study import pipeline
from sinew.tasks.study.study import Study, read_study
from sinew.tasks.study.workspace import open_workspace


def run(
    study: Study | str | Path,
    *names: str,
    out: str | Path | None = None,
    data: str | Path | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    simulator: str | None = None,
    retry_failed: bool = False,
    extend: bool = False,
    figures: bool = False,
    quiet: bool = True,
) -> Results:
    """Run tasks of a study, all that it names unless you name some; what is done already is not done again.

    ``study`` is what :func:`sinew.read_study` reads, or the path of its file;
    ``out`` is the result folder (``results/NAME`` if you say nothing), ``data`` a cohort in place of the study's,
    ``scheduler`` the address of a Dask scheduler in place of the study's cluster;
    ``extend`` doubles the base samples of the last Sobol study; ``figures`` draws all figures into the folder, as the
    command does (each result's ``plot`` draws one at a time). Says nothing unless ``quiet`` is False: look at the
    results that it returns. A script that is not a notebook calls it under ``if __name__ == "__main__":``, because
    worker processes import the script.

    Raises :class:`sinew.BadInput` and other :class:`sinew.runner.errors.SinewError`, one line each, as the command
    prints.
    """
    study = study if isinstance(study, Study) else read_study(study)
    unknown = [name for name in names if name not in TASKS]
    if unknown:
        raise BadInput("task", shown(unknown[0]), f"some of {', '.join(TASKS)}")
    folder = Path("results") / study.name if out is None else Path(out)
    chosen = list(names) or list(study.tasks)
    cohort = None if data is None else Path(data)
    pipeline.check(study, folder, chosen, data=cohort, extend=extend)
    with open_workspace(
        study,
        data=cohort,
        out=folder,
        cluster=cluster_of(study, workers, scheduler),
        simulator=simulator,
        quiet=quiet,
        retry_failed=retry_failed,
    ) as workspace:
        pipeline.run(workspace, chosen, figures=figures, extend=extend)
    return Results(folder)
