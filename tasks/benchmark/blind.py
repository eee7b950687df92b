"""A study run as a user would run it, for a benchmark: nothing but its cohort's folder is known to it."""

from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from typing import Any, TypeVar

from sinew.runner.errors import BadInput, one_line, shown
from sinew.runner.files import strange_entry
from sinew.tasks.cluster.spec import cluster_of
from sinew.tasks.study import pipeline
from sinew.tasks.study.study import Study
from sinew.tasks.study.workspace import Workspace, open_workspace

T = TypeVar("T")


def run_blind(
    study: Study,
    tasks: Sequence[str],
    out: Path,
    workers: int | None,
    read: Callable[[Workspace, dict[str, Any]], T],
    *,
    figures: bool = True,
) -> T | str:
    """What ``read`` makes of the open workspace and the results by task; or why the study failed, in one line."""
    try:
        pipeline.check(study, out, tasks)
        with open_workspace(study, out=out, cluster=cluster_of(study, workers), quiet=True) as workspace:
            return read(workspace, pipeline.run(workspace, tasks, figures=figures))
    except Exception as error:  # noqa: BLE001 - whatever it is, the other cases can still be run
        return one_line(f"{type(error).__name__}: {error}")


def refuse_others(folder: Path, made: Collection[str], command: str) -> None:
    """Raise :class:`BadInput` for anything in a folder that ``command`` does not make: it would be removed."""
    others = sorted({entry.name for entry in folder.iterdir()} - set(made)) if folder.is_dir() else []
    if others:
        raise BadInput(folder, f"holds {shown(others[0])}", f"an empty folder, or one of `sinew {command}`")


def refuse_strange(folder: Path) -> None:
    """Raise :class:`BadInput` for links, pipes and devices in a folder."""
    if (found := strange_entry(folder)) is not None:
        raise BadInput(found[0], f"is {found[1]}", "files and folders only")
