"""What every task works with: the study, its cohort, a simulator, a result folder's store, a cluster on demand."""

import json
import logging
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar
from typing import Protocol as Interface

import numpy as np
from distributed import Client

from sinew.runner.cluster.client import ClusterSpec, open_client
from sinew.runner.cluster.dashboard import dashboard, way_to
from sinew.runner.cluster.local import Local
from sinew.runner.console import Console
from sinew.runner.errors import BadInput
from sinew.runner.evaluation import external
from sinew.runner.evaluation.adaptive import AdaptiveRun
from sinew.runner.evaluation.batch import Evaluation
from sinew.runner.evaluation.ensemble import evaluate, run_adaptive
from sinew.runner.evaluation.policy import Policy
from sinew.runner.files import remove_folder
from sinew.runner.library_logs import libraries_log_to
from sinew.runner.printing import put
from sinew.runner.progress import Board, Report, Show, open_board, progress
from sinew.runner.store.schema import TableSpec
from sinew.runner.store.store import Store, refuse_strange_entries
from sinew.runner.store.table import Table
from sinew.tasks.data.cohort import Cohort
from sinew.tasks.model import Model, Specimen
from sinew.tasks.registry import TASKS
from sinew.tasks.simulate import Array, Simulator
from sinew.tasks.simulate.build import simulator_of
from sinew.tasks.simulate.evaluation import SpecimenEvaluation
from sinew.tasks.study.cohort import cohort_of
from sinew.tasks.study.curves import keep_curves
from sinew.tasks.study.files import refuse_other_names
from sinew.tasks.study.json_lines import LogFile
from sinew.tasks.study.model import model_of
from sinew.tasks.study.range_check import Ranges, keep, look
from sinew.tasks.study.study import Study

T = TypeVar("T")
U = TypeVar("U")

log = logging.getLogger("sinew")


class Stored(Evaluation, Interface):
    """An evaluation that says how its outcomes are stored."""

    def table(self) -> TableSpec: ...


@dataclass
class Workspace:
    """An open result folder. Use :func:`open_workspace`.

    ``simulations`` counts the rows that were evaluated, ``counted`` other work by its name, such as fits.
    """

    study: Study
    cohort: Cohort
    model: Model
    simulator: Simulator
    store: Store
    out: Path
    cluster: ClusterSpec
    board: Board
    ranges: Ranges | None = None
    show: Show = "words"
    retry_failed: bool = False
    simulations: int = 0
    counted: dict[str, int] = field(default_factory=dict)
    _stack: ExitStack = field(default_factory=ExitStack, repr=False)
    _client: Client | None = field(default=None, repr=False)

    @property
    def seed(self) -> int:
        return self.study.seed

    @property
    def quiet(self) -> bool:
        """Whether tables and other words for a person are left out."""
        return self.show != "words"

    def client(self) -> Client:
        """A client of the study's cluster, started when it is first needed."""
        if self._client is None:
            self._client = self._stack.enter_context(open_client(self.cluster, workers_folder(self.out)))
            at = dashboard(self._client)
            how = way_to(at)
            log.info("cluster", extra={"scheduler": self._client.scheduler_info()["address"], "dashboard": how})
            self.board.put(dashboard=at)
            if not self.quiet and not isinstance(self.cluster, Local):
                put(f"dashboard: {how}")
        return self._client

    def progress(
        self, title: str, total: int, *, of: str = "rows", done: int = 0, brief: bool = False
    ) -> AbstractContextManager[Report]:
        """Show how something that is counted comes along, see :func:`sinew.runner.progress.progress`."""
        if of != "rows":
            self.counted[of] = self.counted.get(of, 0) + total - done
        return progress(title, total, self.board, of=of, done=done, show="nothing" if brief else self.show)

    def each(self, title: str, of: str, work: Callable[[T], U], items: Mapping[str, T]) -> dict[str, U]:
        """``work`` of every item by name, in this process and one after the other; shows the progress."""
        done: dict[str, U] = {}
        if items:
            with progress(title, len(items), self.board, of=of, show=self.show) as report:
                for name, item in items.items():
                    done[name] = work(item)
                    report(len(done), 0, 0)
        return done

    def note(self, part: str, name: str, words: str, **numbers: float | int | str | None) -> None:
        """Tell those who look on how far a part of the work has come; it costs next to nothing."""
        self.board.note(part, name, words, **numbers)

    def specimens(self, names: Sequence[str] | str, where: str) -> tuple[Specimen, ...]:
        """The specimens that a task's settings name."""
        if isinstance(names, str):
            return self.cohort.specimens
        return self.cohort.choose(names, f"{self.study.path}: {where}")

    def evaluation(self, specimen: Specimen) -> SpecimenEvaluation:
        """What the study asks of a specimen."""
        return SpecimenEvaluation(self.model, specimen, self.simulator, self.study.store.points_per_curve)

    def plan(self, evaluation: Stored, parameters: Array) -> tuple[Table, Array]:
        """The table of an evaluation and the row in it of each of ``parameters`` ``[n, d]``, known or new."""
        table = self.store.table(evaluation.table())
        table.fold(table.segments())
        rows = table.plan(parameters)
        if self.retry_failed:
            table.reopen(np.unique(rows))
        return table, rows

    def evaluate(
        self,
        evaluation: Evaluation,
        table: Table,
        rows: Array,
        title: str,
        *,
        here: bool = False,
        brief: bool = False,
    ) -> None:
        """Evaluate those of the planned rows that have no outcome yet.

        ``here`` evaluates in this process: for few rows, that is faster than starting a cluster. ``brief``: one of many
        calls, none of which is worth a line of its own.
        """
        asked = np.unique(rows).size
        pending = table.pending(rows).size
        if not pending:
            return
        self.simulations += pending
        policy = Policy(multiple=self.simulator.capabilities.batch_multiple, retries=self.study.retries)
        client = (lambda: None) if here else self.client
        with self.progress(title, asked, done=asked - pending, brief=brief) as report:
            evaluate(client, table, evaluation, rows, report, policy)

    def run_adaptive(self, runs: Sequence[AdaptiveRun], title: str) -> list[Any]:
        """Run several adaptive runs on the study's cluster; returns what each of them returned."""
        tables = [table for adaptive in runs for table, _ in adaptive.tables]
        before = sum(table.finished() for table in tables)
        policy = Policy(multiple=self.simulator.capabilities.batch_multiple, retries=self.study.retries)
        rows = sum(adaptive.rows for adaptive in runs)
        with self.progress(title, rows) if rows else nullcontext() as report:
            try:
                return run_adaptive(self.client, runs, report, policy)
            finally:
                self.simulations += sum(table.finished() for table in tables) - before

    @property
    def console(self) -> Console:
        """Where words for a person go; silent where none are wanted."""
        return Console(quiet=self.quiet, highlight=False)

    def say(self, words: str) -> None:
        """A line for a person."""
        self.console.print(words)

    def event(self, event: str, **facts: Any) -> None:
        """A JSON line for a program that looks on."""
        if self.show == "json":
            put(json.dumps({"event": event, **facts}))


@contextmanager
def open_workspace(
    study: Study,
    *,
    data: Path | None = None,
    out: Path,
    cluster: ClusterSpec,
    simulator: str | None = None,
    quiet: bool = False,
    as_json: bool = False,
    retry_failed: bool = False,
    judge_ranges: bool = True,
) -> Iterator[Workspace]:
    """Read what a study needs, check all of it, and only then open (or create) its result folder.

    ``data`` replaces the study's cohort. ``quiet``: nothing is shown; ``as_json``: JSON lines are. ``judge_ranges``:
    refuse ranges that cannot reach the measured forces. Raises :class:`BadInput` and
    :class:`sinew.runner.errors.StoreError`.
    """
    cohort = check_cohort(study, data, out)
    chosen = simulator_of(study, simulator, attempts_folder(out), fields_folder(out))
    model = model_of(study.model, study.simulator.law)
    ranges = check_ranges(study, cohort, out) if judge_ranges else None
    with ExitStack() as stack:
        store = stack.enter_context(Store.writing(out, study.name))
        stack.enter_context(_log_to(out / "log.jsonl"))
        stack.enter_context(_no_abandoned_folders(out))
        if ranges is not None:
            keep(ranges, out)
        keep_curves(store, cohort)
        board = stack.enter_context(open_board(out))
        if isinstance(cluster, Local):
            board.put(workers=cluster.workers)
        show: Show = "json" if as_json else "nothing" if quiet else "words"
        yield Workspace(
            study, cohort, model, chosen, store, out, cluster, board, ranges, show, retry_failed, _stack=stack
        )


def check_cohort(study: Study, data: Path | None, out: Path) -> Cohort:
    """The study's cohort, or the one in ``data``, if it and the result folder can be used for the study.

    Raises :class:`BadInput`, and ``StoreError`` for a result folder with links, pipes or devices.
    """
    cohort = cohort_of(study, data)
    for task in TASKS:
        names = getattr(getattr(study, task), "specimens", "all")
        if names != "all":
            cohort.choose(names, f"{study.path}: {task}.specimens")
    check_folder(out)
    if out.is_dir():
        refuse_strange_entries(out)
    if out.resolve().is_relative_to(cohort.folder.resolve()):
        raise BadInput(f"--out {out}", f"lies inside the cohort {cohort.folder}", "a folder beside it")
    return cohort


def check_ranges(study: Study, cohort: Cohort, out: Path) -> Ranges | None:
    """The look at the study's ranges, None where there is nothing to look at.

    Raises :class:`BadInput` for ranges that cannot reach the measured forces.
    """
    ranges = look(study, cohort, out)
    if ranges is not None:
        ranges.refuse(study.path)
    return ranges


def attempts_folder(out: Path) -> Path:
    """Where a result folder keeps what solvers read and wrote."""
    return out.resolve() / "attempts"


def fields_folder(out: Path) -> Path:
    """Where a result folder keeps the fields of runs, if the study asks for it."""
    return out.resolve() / "fields"


def workers_folder(out: Path) -> Path:
    """Where local workers keep their own files while they run."""
    return external.scratch(out.resolve()) / ".workers"


@contextmanager
def _no_abandoned_folders(out: Path) -> Iterator[None]:
    """Remove folders of workers that were killed, those of former runs before, and those of this one at its end."""
    try:
        _remove_abandoned(out)
        yield
    finally:
        _remove_abandoned(out)


def _remove_abandoned(out: Path) -> None:
    for abandoned in (workers_folder(out), *(out / "attempts").glob("attempt-*")):
        remove_folder(abandoned)
    for partial in fields_folder(out).glob(".*.partial"):
        partial.unlink(missing_ok=True)


def check_folder(out: Path) -> None:
    """Refuse a result folder that cannot be one, before anything is written."""
    refuse_other_names(out, "--out ")
    existing = next(parent for parent in (out, *out.absolute().parents) if os.path.lexists(parent))
    if not existing.is_dir():
        raise BadInput(f"--out {out}", f"{existing} is a file", "a folder")
    if not os.access(existing, os.W_OK):
        raise BadInput(f"--out {out}", f"{existing} cannot be written to", "a folder of yours")


@contextmanager
def _log_to(path: Path) -> Iterator[None]:
    handler = LogFile(path)
    logger = logging.getLogger("sinew")
    level, propagate = logger.level, logger.propagate
    logger.addHandler(handler)
    logger.setLevel(logging.INFO)
    logger.propagate = False
    try:
        with libraries_log_to(handler):
            yield
    finally:
        logger.removeHandler(handler)
        logger.setLevel(level)
        logger.propagate = propagate
        handler.close()
