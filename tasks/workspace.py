"""What every task works with: the study, its cohort, a simulator, a result folder's store, a cluster on demand."""

import hashlib
import json
import logging
import os
import shutil
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from typing import Protocol as Interface

import numpy as np
from distributed import Client
from pythonjsonlogger.json import JsonFormatter

from runner.batch import Evaluation
from runner.cluster import ClusterSpec, Local, open_client
from runner.dashboard import dashboard, way_to
from runner.ensemble import Policy, Talk, converse, evaluate
from runner.progress import Board, Report, Show, open_board, progress
from runner.store import Store, Table, TableSpec
from tasks.evaluate import SpecimenEvaluation
from tasks.measurements import Cohort
from tasks.model import Model, Specimen
from tasks.problems import BadInput
from tasks.simulate import Array, Simulator
from tasks.study import Study

log = logging.getLogger("sinew")


class Stored(Evaluation, Interface):
    """An evaluation that says how its outcomes are stored."""

    def table(self) -> TableSpec: ...


@dataclass
class Workspace:
    """An open result folder. Use :func:`open_workspace`."""

    study: Study
    cohort: Cohort
    model: Model
    simulator: Simulator
    store: Store
    out: Path
    cluster: ClusterSpec
    board: Board
    show: Show = "words"
    retry_failed: bool = False
    simulations: int = 0
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
            self._client = self._stack.enter_context(open_client(self.cluster))
            at = dashboard(self._client)
            how = way_to(at)
            log.info("cluster", extra={"scheduler": self._client.scheduler_info()["address"], "dashboard": how})
            self.board.put(dashboard=at)
            if not self.quiet and not isinstance(self.cluster, Local):
                print(f"dashboard: {how}", flush=True)
        return self._client

    def progress(
        self, title: str, total: int, *, of: str = "rows", done: int = 0, brief: bool = False
    ) -> AbstractContextManager[Report]:
        """Show how something that is counted comes along, see :func:`runner.progress.progress`."""
        return progress(title, total, self.board, of=of, done=done, show="nothing" if brief else self.show)

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
        """See to it that planned rows have outcomes.

        ``here`` evaluates in this process: for few rows, that is faster than starting a cluster. ``brief``: one of many
        calls, of which none needs to be told about.
        """
        asked = np.unique(rows).size
        pending = table.pending(rows).size
        if not pending:
            return
        self.simulations += pending
        policy = Policy(multiple=self.simulator.batch_multiple, retries=self.study.retries)
        client = (lambda: None) if here else self.client
        with self.progress(title, asked, done=asked - pending, brief=brief) as report:
            evaluate(client, table, evaluation, rows, report, policy)

    def converse(self, talks: Sequence[Talk], title: str) -> list[Any]:
        """Let several talks ask for evaluations on the study's cluster; returns what each of them returned."""
        tables = [table for talk in talks for table, _ in talk.tables]
        before = sum(table.finished() for table in tables)
        policy = Policy(multiple=self.simulator.batch_multiple, retries=self.study.retries)
        rows = sum(talk.rows for talk in talks)
        with self.progress(title, rows) if rows else nullcontext() as report:
            try:
                return converse(self.client, talks, report, policy)
            finally:
                self.simulations += sum(table.finished() for table in tables) - before

    def event(self, event: str, **facts: Any) -> None:
        """A JSON line for a program that looks on."""
        if self.show == "json":
            print(json.dumps({"event": event, **facts}), flush=True)


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
) -> Iterator[Workspace]:
    """Read what a study needs, check all of it, and only then open (or create) its result folder.

    ``data`` replaces the study's cohort. ``quiet``: nothing is shown; ``as_json``: JSON lines are. Raises
    :class:`BadInput` and :class:`runner.errors.StoreError`.
    """
    cohort = check_cohort(study, data, out)
    chosen = study.simulator_object(simulator, attempts_folder(out))
    with ExitStack() as stack:
        store = stack.enter_context(Store.writing(out, study.name))
        stack.enter_context(_log_to(out / "log.jsonl"))
        for abandoned in (out / "attempts").glob("attempt-*"):  # their workers were killed
            shutil.rmtree(abandoned, ignore_errors=True)
        model = study.tendon()
        board = stack.enter_context(open_board(out))
        if isinstance(cluster, Local):
            board.put(workers=cluster.workers)
        show: Show = "json" if as_json else "nothing" if quiet else "words"
        yield Workspace(study, cohort, model, chosen, store, out, cluster, board, show, retry_failed, _stack=stack)


def check_cohort(study: Study, data: Path | None, out: Path) -> Cohort:
    """The study's cohort, or the one in ``data``, if it and the result folder can be used for the study.

    Raises :class:`BadInput`.
    """
    cohort = study.cohort_of(data)
    for task in ("sobol", "calibrate", "infer", "discover"):
        names = getattr(study, task).specimens
        if names != "all":
            cohort.choose(names, f"{study.path}: {task}.specimens")
    check_folder(out)
    if out.resolve().is_relative_to(cohort.folder.resolve()):
        raise BadInput(f"--out {out}", f"lies inside the cohort {cohort.folder}", "a folder beside it")
    return cohort


def attempts_folder(out: Path) -> Path:
    """Where a result folder keeps what solvers read and wrote."""
    return out.resolve() / "attempts"


def check_folder(out: Path) -> None:
    """Refuse a result folder that cannot be one, before anything is written."""
    existing = next(parent for parent in (out, *out.absolute().parents) if os.path.lexists(parent))
    if not existing.is_dir():
        raise BadInput(f"--out {out}", f"{existing} is a file", "a folder")
    if not os.access(existing, os.W_OK):
        raise BadInput(f"--out {out}", f"{existing} cannot be written to", "a folder of yours")


@contextmanager
def _log_to(path: Path) -> Iterator[None]:
    handler = logging.FileHandler(path, encoding="utf-8")
    handler.setFormatter(JsonFormatter("%(asctime)s %(levelname)s %(name)s %(message)s"))
    logger = logging.getLogger("sinew")
    logger.addHandler(handler)
    logger.setLevel(logging.INFO)
    logger.propagate = False
    try:
        yield
    finally:
        logger.removeHandler(handler)
        handler.close()


def digest(*parts: Any) -> str:
    """Names inputs of an analysis, so that an unchanged one is not done again."""
    hashed = hashlib.blake2b(digest_size=16)
    for part in parts:
        if isinstance(part, np.ndarray):
            hashed.update(np.ascontiguousarray(part).tobytes())
        else:
            hashed.update(json.dumps(part, sort_keys=True, default=str).encode())
    return hashed.hexdigest()


def write_json(path: Path, content: dict[str, Any]) -> None:
    """Write a result as JSON, whole or not at all; numbers that are not finite become null."""
    write_text(path, json.dumps(_plain(content), indent=1, allow_nan=False) + "\n")


def write_text(path: Path, text: str) -> None:
    """Write a file, whole or not at all."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    temporary.write_text(text, "utf-8")
    os.replace(temporary, path)


def read_result(path: Path) -> dict[str, Any] | None:
    """A result that was written before, or None."""
    try:
        content = json.loads(path.read_text("utf-8"))
    except (OSError, json.JSONDecodeError, UnicodeDecodeError):
        return None
    return content if isinstance(content, dict) else None


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, np.generic):
        return _plain(value.item())
    if isinstance(value, float):
        return value if np.isfinite(value) else None
    return value
