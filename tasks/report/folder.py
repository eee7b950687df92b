"""What a result folder holds, in whatever state it is: results, log, evaluations, measured curves."""

import json
import shlex
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import islice
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import xarray as xr

from sinew.runner.errors import BadInput, SinewError, StoreError, one_line
from sinew.runner.files import MAX_CONTAINERS, NotReadable, containers, read_regular
from sinew.runner.store.store import Store, open_store, refuse_strange_entries
from sinew.runner.store.table import Table
from sinew.tasks.discover.result import DiscoverResult
from sinew.tasks.model import FORCE, file_name
from sinew.tasks.registry import TASKS
from sinew.tasks.report.status import read_status
from sinew.tasks.simulate import Array
from sinew.tasks.simulate.registry import of_own_models
from sinew.tasks.study.curves import POINTS, MeasuredCurve, MeasuredQuantity, kept_curves, represented
from sinew.tasks.study.result import Result

R = TypeVar("R", bound=Result)

MOST = 1e15  # of a number in a log
MAX_LOG_BYTES = 2**25  # the last of them are read,
MAX_LINE_BYTES = 2**20  # of one event
MAX_EVENTS = 50_000  # and of these the last lines
MAX_RESULT_BYTES = 2**28  # of arrays that a section shows together
MAX_CURVES = 5_000  # that a page shows
MAX_PROTOCOLS = 2_000  # of a specimen: each is looked for in the store, more than once


@dataclass(frozen=True)
class State:
    """What became of a task: ``word`` is done, damaged, failed, running, stopped or "not run"; ``why``, where known."""

    word: str
    why: str = ""
    seconds: float | None = None
    evaluations: int | None = None


@dataclass(frozen=True)
class ResultFolder:
    """A result folder as it is. ``trouble`` holds a line for each thing in it that cannot be read."""

    folder: Path
    results: dict[str, Any]
    states: dict[str, State]
    events: list[dict[str, Any]]
    store: Store | None
    status: dict[str, Any] | None
    trouble: list[str] = field(default_factory=list)

    def result(self, kind: type[R]) -> R | None:
        """The result of a task, if there is one."""
        return self.results.get(kind.TASK)

    @property
    def name(self) -> str:
        """The study's name, else the folder's."""
        return self.store.study if self.store is not None else self.folder.resolve().name

    @property
    def runs(self) -> list[dict[str, Any]]:
        """What the log says of each run: versions, machine, seed, data."""
        return [event for event in self.events if event["message"] == "run started"]

    @cached_property
    def tables(self) -> dict[str, list[Table]]:
        """Tables of evaluations of one specimen, by its name; the one with the most points of its curves first."""
        found: dict[str, list[Table]] = {}
        for table in self.store.tables() if self.store is not None else []:
            if protocols_of(table):
                found.setdefault(table.title.rpartition(" ")[0], []).append(table)
        for tables in found.values():
            tables.sort(key=_points, reverse=True)
        return dict(sorted(found.items()))

    @cached_property
    def measured(self) -> dict[str, dict[str, MeasuredCurve]]:
        """Measured curves by specimen and protocol.

        They are those of the cohort; in folders of older versions, those at the points of the evaluations, or what a
        discovery looked at. What is compared beside the force is that at the points of the evaluations.
        """
        found = kept_curves(self.store) if self.store is not None else {}
        found |= {name: dict(_curves(tables[0])) for name, tables in self.tables.items() if name not in found}
        discovery = self.result(DiscoverResult)
        for name in discovery.cells if discovery is not None else ():
            if name not in found and self.store is not None:
                kept = self.store.read_result(f"discover/{file_name(name)}")
                protocols = sorted(str(key).removeprefix("time_") for key in kept.dims)
                found[name] = {protocol: _discovered(kept, protocol) for protocol in protocols}
        if sum(map(len, found.values())) > MAX_CURVES:
            self.trouble.append(f"{self.folder}: holds more than {MAX_CURVES:,} curves; the first of them are shown")
        return {
            name: {
                protocol: replace(curve, others=_others(self.tables.get(name, ()), protocol))
                for protocol, curve in every.items()
            }
            for name, every in _first(found, MAX_CURVES).items()
        }

    @property
    def forces(self) -> bool:
        """Whether any force was measured."""
        return any(np.isfinite(curve.force_N).any() for every in self.measured.values() for curve in every.values())

    @property
    def study(self) -> str:
        """The study file, as a person would name it in a command."""
        return str(self.runs[-1].get("study_file", "STUDY")) if self.runs else "STUDY"

    def command(self, task: str) -> str:
        """What a person types to run a task into this folder."""
        last = self.runs[-1] if self.runs else {}
        out = str(last.get("out", ""))
        words = ["sinew", task, shlex.quote(one_line(self.study))]
        if out and Path(out) != Path("results") / self.name:
            words += ["--out", shlex.quote(one_line(out))]
        return f"`{' '.join(words)}`"

    def missing(self, task: str) -> str:
        """Why a task has no result, and what to run."""
        state, command = self.states[task], self.command(task)
        sentences = {
            "not run": self._not_run(task, command),
            "running": "Running now: its section fills when it ends.",
            "stopped": f"Stopped before its end; {command} goes on, finished rows are kept.",
            "failed": f"Failed: {state.why}. Then {command} goes on, finished rows are kept.",
        }
        return sentences.get(state.word, f"{state.why[:1].upper()}{state.why[1:]}.")

    def _not_run(self, task: str, command: str) -> str:
        own = self.runs and self.runs[-1].get("simulator") in of_own_models()
        if own and TASKS[task].measured and not self.forces:
            return f"Not run: it needs measured curves ({command[:-1]} --data COHORT`)."
        if task == "compare" and len({name.rpartition("/")[0] for name in self.measured}) == 1:
            return "Not run: it needs two sites, that is specimens in folders COHORT/SITE/SPECIMEN of two sites."
        if why := self.states[task].why:
            return f"Not run: {why}. Then {command}."
        return f"Not run yet: {command}."


def read_folder(folder: Path) -> ResultFolder:
    """Read a result folder, finished or not. Raises :class:`BadInput` when it is none at all."""
    if not folder.is_dir():
        problem = "is a file" if folder.exists() else "is not there"
        raise BadInput(folder, problem, "a result folder, as given to --out")
    refuse_strange_entries(folder)
    trouble: list[str] = []
    events = _read_log(folder / "log.jsonl", trouble)
    results = {}
    for task in TASKS:
        try:
            found = TASKS[task].read(folder)
        except BadInput as error:
            trouble.append(str(error))
        else:
            if found is not None:
                results[task] = found
    store, status, unreadable = None, None, list(trouble)
    try:
        store = open_store(folder)
        status = read_status(folder)
    except StoreError as error:
        trouble.append(str(error))
    if not results and not events and store is None:
        if unreadable:
            raise SinewError(unreadable[0])
        raise BadInput(folder, "holds no store.zarr, log.jsonl or result", "a result folder, as given to --out")
    alive = bool(status and status["now"] and status["now"]["alive"])
    states = {name: _state(name, folder, results, events, alive=alive) for name in TASKS}
    states = {name: state for name, state in states.items() if not TASKS[name].optional or state.word != "not run"}
    return ResultFolder(folder, results, states, events, store, status, trouble)


def _first(found: dict[str, dict[str, MeasuredCurve]], most: int) -> dict[str, dict[str, MeasuredCurve]]:
    """The first ``most`` curves by specimen and protocol, specimens sorted by name."""
    pairs = ((name, protocol) for name, every in sorted(found.items()) for protocol in every)
    kept: dict[str, dict[str, MeasuredCurve]] = {}
    for name, protocol in islice(pairs, most):
        kept.setdefault(name, {})[protocol] = found[name][protocol]
    return kept


def _points(table: Table) -> int:
    return sum(
        column.size for name in protocols_of(table) if (column := table.coordinate(f"displacement_{name}")) is not None
    )


def _curves(table: Table) -> Iterator[tuple[str, MeasuredCurve]]:
    for name in protocols_of(table):
        yield name, represented(name, *columns_of(table, name))


def _others(tables: Sequence[Table], protocol: str) -> dict[str, MeasuredQuantity]:
    """What any of the tables of a specimen holds of a protocol beside the force; the first one counts."""
    found = {quantity: one for table in reversed(tables) for quantity, one in _compared(table, protocol)}
    return dict(sorted(found.items()))


def _compared(table: Table, protocol: str) -> Iterator[tuple[str, MeasuredQuantity]]:
    specimen = table.identity.get("specimen")
    compared = specimen.get("compared") if isinstance(specimen, dict) else None
    for quantity in compared if isinstance(compared, dict) else ():
        values = table.coordinate(f"measured_{quantity}_{protocol}")
        time_s = table.coordinate(f"time_{protocol}")
        if quantity != FORCE and values is not None and time_s is not None and values.size == time_s.size:
            there = np.flatnonzero(np.isfinite(values))
            there = there[:: max(1, -(-there.size // POINTS))]
            unit = str(table.group[f"measured_{quantity}_{protocol}"].attrs.get("units", "1"))
            yield quantity, MeasuredQuantity(unit, time_s[there], values[there])


def _discovered(kept: xr.Dataset, protocol: str) -> MeasuredCurve:
    columns = (kept[f"{kind}_{protocol}"].to_numpy() for kind in ("time", "displacement", "measured"))
    return represented(protocol, *columns)


def read_results(store: Store, names: Sequence[str], start: str = "", **expected: Sequence[str]) -> list[xr.Dataset]:
    """Several results of a store, which a section needs together: arrays whose names begin with ``start``.

    ``expected``: as for ``Store.read_result``. Raises ``StoreError`` for too much of them.
    """
    found, size = [], 0
    for name in names:
        whole = store.read_result(name, **expected)
        found.append(whole[[str(each) for each in whole.data_vars if str(each).startswith(start)]])
        size += found[-1].nbytes
        if size > MAX_RESULT_BYTES:
            raise StoreError(f"{store.path}: {name} and those before it take more than {MAX_RESULT_BYTES:,} bytes")
    return found


def protocols_of(table: Table) -> list[str]:
    """The protocols that a table of a specimen holds; none for the table of a site."""
    names = table.coordinate("protocol")
    if names is not None and names.size > MAX_PROTOCOLS:
        raise StoreError(f"{table.folder / 'store.zarr'}: {table.title} holds {names.size:,} protocols")
    return [] if names is None else [str(name) for name in names]


def columns_of(table: Table, protocol: str) -> tuple[Array, Array, Array]:
    """Times (s), displacements (mm) and measured forces (N, NaN: none) ``[t]`` that a table holds of a protocol."""
    time, moved, force = (table.coordinate(f"{kind}_{protocol}") for kind in ("time", "displacement", "measured"))
    if time is None or moved is None:
        raise StoreError(f"{table.folder / 'store.zarr'}: {table.title} holds no times of the protocol {protocol}")
    return time, moved, np.full(time.size, np.nan) if force is None else force


def _read_log(path: Path, trouble: list[str]) -> list[dict[str, Any]]:
    """Events of ``log.jsonl``; the last line may be cut short, where a run was killed."""
    try:
        content = read_regular(path, 0, last=MAX_LOG_BYTES)
    except FileNotFoundError:
        return []
    except NotReadable as problem:
        trouble.append(f"{path}: {problem}")
        return []
    except OSError as error:
        trouble.append(f"{path}: {error.strerror or 'cannot be read'}")
        return []
    if len(content) == MAX_LOG_BYTES or containers(content) > MAX_CONTAINERS:
        content = _shortened(content)
        trouble.append(f"{path}: is too long; only its end is read, what was earlier is missing here")
    lines = content.split(b"\n")
    if len(lines) - 1 > MAX_EVENTS:
        lines = lines[-MAX_EVENTS - 1 :]
        trouble.append(
            f"{path}: has more than {MAX_EVENTS:,} lines; the last are read, what was earlier is missing here"
        )
    events, bad = [], 0
    for line in lines[:-1]:
        try:
            event = json.loads(line) if len(line) <= MAX_LINE_BYTES else None
        except (ValueError, RecursionError):
            event = None
        if isinstance(event, dict) and isinstance(event.get("message"), str):
            events.append(event)
        else:
            bad += 1
    if bad:
        trouble.append(f"{path}: {bad} of {len(lines) - 1} lines cannot be read; their content is missing here")
    return events


def _shortened(content: bytes) -> bytes:
    """The last lines of a log that fit into the memory."""
    while containers(content) > MAX_CONTAINERS:
        content = content[len(content) // 2 :]
    return content.partition(b"\n")[2]


def _state(task: str, folder: Path, results: dict[str, Any], events: list[dict[str, Any]], *, alive: bool) -> State:
    last, done = None, None
    for event in events:
        if event.get("task") == task:
            last = event
            done = event if event["message"] == "task finished" else done
    new = _number(done, "new_simulations")
    how = (_number(done, "seconds"), None if new is None else int(new))
    if task in results:
        again = last is not None and last["message"] == "task failed"
        return State("done", f"a later run failed: {_why(last)}" if again else "", *how)
    if (folder / f"{task}.json").exists():
        return State("damaged", f"{task}.json cannot be read; run `sinew {task}` again", *how)
    if last is None or last["message"] == "task finished":
        return State("not run")
    if last["message"] == "task not run" and str(last.get("needs")) in results:
        return State("not run")
    if last["message"] == "task not run":
        return State("not run", f"it needs {one_line(str(last.get('needs')))}, which failed")
    if last["message"] == "task failed":
        return State("failed", _why(last))
    return State("running", "its rows are being evaluated") if alive else State("stopped", "ended before its result")


def _number(event: dict[str, Any] | None, name: str) -> float | None:
    """A number of an event, which may come from anywhere."""
    value = (event or {}).get(name)
    return float(value) if isinstance(value, int | float) and 0 <= value < MOST else None


def _why(event: dict[str, Any] | None) -> str:
    return one_line(str((event or {}).get("reason", "no reason is known")))
