"""Results that are made once: an analysis of unchanged inputs is read back, everything else is made anew.

A result's key covers what it means, not how the code is written: study and data, the simulator, the versions of the
libraries, and the declared version of the method (:class:`sinew.tasks.study.result.Result`).
"""

from collections.abc import Iterable, Mapping
from typing import Any, TypeVar

import xarray as xr

from sinew.runner.errors import BadInput
from sinew.tasks.study.files import digest
from sinew.tasks.study.result import Result
from sinew.tasks.study.workspace import Workspace

R = TypeVar("R", bound=Result)


def key(kind: type[Result], *parts: Any) -> str:
    """The key of a result: its method with all libraries, and ``parts``, the inputs (arrays or plain values)."""
    return digest(kind.method(), *parts)


def cached(
    workspace: Workspace, kind: type[R], inputs: str, arrays: Iterable[str], files: Iterable[str] = ()
) -> R | None:
    """The result of an earlier run with the same ``inputs``, if all that it left is still there.

    ``arrays`` are groups of the store, written by :func:`commit` or before it; ``files`` are relative to the folder.
    """
    try:
        found = kind.read(workspace.out)
    except BadInput:  # damaged, or of another version: it is made again
        return None
    if found is None or found.inputs != inputs:
        return None
    root = workspace.store.root
    there = all(name in root and root[name].attrs.get("inputs", inputs) == inputs for name in arrays)
    return found if there and all((workspace.out / name).is_file() for name in files) else None


def commit(workspace: Workspace, result: Result, arrays: Mapping[str, xr.Dataset]) -> None:
    """Write a result's ``arrays`` to the store, marked with its key, and then the result itself."""
    for name, dataset in arrays.items():
        workspace.store.write_result(name, dataset.assign_attrs(inputs=result.inputs))
    result.write(workspace.out)
