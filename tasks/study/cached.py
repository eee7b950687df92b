"""Results that are made once: an analysis of unchanged inputs is read back, everything else is made anew.

A result's key covers what it means, not how the code is written: study and data, the simulator, the versions of the
libraries, and the declared version of the method (:class:`sinew.tasks.study.result.Result`).
"""

import io
import logging
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, TypeVar

import xarray as xr

from sinew.runner.console import Console
from sinew.runner.errors import BadInput, StoreError, one_line
from sinew.runner.store.store import Store
from sinew.tasks.registry import TASKS
from sinew.tasks.study.files import digest
from sinew.tasks.study.result import Result
from sinew.tasks.study.workspace import Workspace

R = TypeVar("R", bound=Result)

log = logging.getLogger("sinew")


def key(kind: type[Result], *parts: Any) -> str:
    """The key of a result: its method with all libraries, and ``parts``, the inputs (arrays or plain values)."""
    return digest(kind.versions(), *parts)


def cached(
    workspace: Workspace, kind: type[R], inputs: str, arrays: Iterable[str], files: Iterable[str] = ()
) -> R | None:
    """The result of an earlier run with the same ``inputs``, if all that it left is still there.

    ``arrays`` are groups of the store, marked with the same inputs by :func:`commit` or whoever wrote them before it;
    ``files`` are relative to the folder.
    """
    try:
        found = kind.read(workspace.out)
    except BadInput:  # damaged, or of another version: it is made again
        return None
    if found is None or found.inputs != inputs:
        return None
    there = all(_is_whole(workspace.store, name, inputs) for name in arrays)
    there = there and all((workspace.out / name).is_file() for name in files)
    return found if there and _can_be_shown(found, workspace.out) else None


def _can_be_shown(found: Result, out: Path) -> bool:
    """Whether a result is one that this program wrote: fields that are right one by one may contradict each other."""
    nowhere = Console(file=io.StringIO())
    try:
        show = TASKS[found.TASK].module("show")
        show.summary(found, out, nowhere)
        show.table(found)
    except Exception as error:  # noqa: BLE001 - whatever it is, the result is made again
        why = f"{type(error).__name__}: {error}"
        log.warning("a result that cannot be shown is made anew", extra={"task": found.TASK, "reason": one_line(why)})
        return False
    return True


def _is_whole(store: Store, name: str, inputs: str) -> bool:
    """Whether arrays of these ``inputs`` are there and can be read."""
    try:
        return bool(store.read_result(name).attrs.get("inputs") == inputs)
    except StoreError:
        return False


def commit(workspace: Workspace, result: Result, arrays: Mapping[str, xr.Dataset]) -> None:
    """Write a result's ``arrays`` to the store, marked with its key, and then the result itself."""
    for name, dataset in arrays.items():
        workspace.store.write_result(name, dataset.assign_attrs(inputs=result.inputs))
    result.write(workspace.out)
