"""Beyond this machine: the real scheduler and runner, with workers whose evaluations only sleep.

Scheduler and client share one process, as in the job that leads a study on a cluster, under TLS. The workers are real
ones of one thread each, hundreds of them in a process, and they write real segments; on a cluster they would not share
their cores with the scheduler. Each number of rows
has a process and a cluster of its own.
"""

import asyncio
import logging
import math
import multiprocessing
import os
import resource
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import dask
import numpy as np
import psutil
from distributed import Client, LocalCluster, Worker

from sinew.runner.cluster.dask_settings import DASHBOARD, SETTINGS
from sinew.runner.cluster.network import shared_certificate
from sinew.runner.evaluation.batch import Outcome
from sinew.runner.evaluation.ensemble import evaluate
from sinew.runner.periodic import every
from sinew.runner.store.schema import Field, TableSpec
from sinew.runner.store.store import Store
from tests.benchmarks.common import median_line

WORKERS, HELPERS = 1000, 2
SIZES = ((10**3, 20.0), (10**4, 3.0), (10**5, 0.3), (10**6, 0.04))  # rows, seconds of an evaluation
FEWER = (10**4, 10**5)  # rows of the shortest evaluations, after the most of them
SLOTS, ROUNDS = 64, 3
FIXED = ((3200, 1.0, 95), (32_000, 0.1, 90))  # rows, seconds of an evaluation, aim (% utilisation)
AIM_MS = 0.2  # client and scheduler, for an evaluation in a batch of many
DIMENSIONS = 16
IDLE_S = 15.0
# what hundreds of workers in one process need not do each; their heartbeats stay as they are
TOGETHER = {
    "distributed.admin.tick.interval": "10 s",
    "distributed.admin.system-monitor.interval": "60 s",
    "distributed.worker.use-file-locking": False,
}
LEGEND = """  used: share of the workers' time in evaluations; +start: with the start of the workers; steady: between
  the first and the last tenth of the rows. MB, CPU: of the process of scheduler and client; idle: CPU time of the
  same cluster over the same time without work; ms: CPU time beyond that; late: MB from 20 to 80 % of the rows;
  late/early: CPU time of a row from 50 to 80 % over that from 20 to 50 %; helpers: CPU time of the workers"""


@dataclass(frozen=True)
class Sleep:
    """An evaluation that takes ``seconds`` and says when it began."""

    seconds: float
    title: str

    def __call__(self, parameters: np.ndarray) -> Outcome:
        count = len(parameters)
        began = time.time() + self.seconds * np.arange(count)
        time.sleep(self.seconds * count)
        return Outcome({"began": began}, np.zeros(count, dtype=np.int8))

    def table(self) -> TableSpec:
        names = tuple(f"p{i}" for i in range(DIMENSIONS))
        fields = (Field("began", (), "s", "when the evaluation began, since 1970"),)
        return TableSpec(self.title, {"title": self.title}, names, ("1",) * DIMENSIONS, fields, ())


# ---- simulated workers


def serve(address: str, folder: Path, count: int) -> None:
    """In a helper process: ``count`` workers, until the process is stopped or the scheduler is gone."""
    allow_files()
    logging.getLogger("distributed").setLevel(logging.CRITICAL)

    async def work() -> None:
        security = shared_certificate(folder / "certificate", create=False)

        def worker() -> Worker:
            place = {"host": "127.0.0.1", "local_directory": str(folder)}
            return Worker(address, nthreads=1, memory_limit=0, dashboard=False, security=security, **place)

        workers: list[Worker] = []
        while len(workers) < count:
            workers += await asyncio.gather(*(worker() for _ in range(min(16, count - len(workers)))))
        await asyncio.gather(*(worker.finished() for worker in workers))

    with dask.config.set(SETTINGS | TOGETHER):
        asyncio.run(work())


def allow_files() -> None:
    """A thousand workers have some thousand connections."""
    most = resource.getrlimit(resource.RLIMIT_NOFILE)[1]
    resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))


@dataclass(frozen=True)
class Cluster:
    """A client, the processes of its workers, and how long it took until all of them were there."""

    client: Client
    helpers: list[psutil.Process]
    arrival_s: float

    def helpers_s(self) -> float:
        """Their CPU time."""
        return sum(times.user + times.system for times in (helper.cpu_times() for helper in self.helpers))


@contextmanager
def simulated(workers: int, folder: Path) -> Iterator[Cluster]:
    """Scheduler and client in this process, ``workers`` workers in others."""
    allow_files()
    context = multiprocessing.get_context("spawn")
    shares = [len(share) for share in np.array_split(np.arange(workers), HELPERS)]
    with dask.config.set(SETTINGS):
        cluster = LocalCluster(
            n_workers=0,
            threads_per_worker=1,
            host="127.0.0.1",
            protocol="tls://",
            security=shared_certificate(folder / "certificate", create=True),
            dashboard_address=DASHBOARD,
            silence_logs=logging.ERROR,
        )
        helpers = [context.Process(target=serve, args=(cluster.scheduler_address, folder, n)) for n in shares]
        with cluster, Client(cluster, set_as_default=False) as client:
            started = time.monotonic()
            try:
                for helper in helpers:
                    helper.start()
                while len(cluster.scheduler.workers) < workers:
                    assert all(helper.is_alive() for helper in helpers)
                    time.sleep(0.1)
                arrival_s = time.monotonic() - started
                yield Cluster(client, [psutil.Process(helper.pid) for helper in helpers], arrival_s)
            finally:
                for helper in helpers:
                    helper.kill()
                    helper.join()


# ---- measuring


@dataclass
class Watch:
    """Notes now and then how many rows are finished, and this process's CPU time and memory."""

    finished: int = 0
    notes: list[tuple[int, float, float, float]] = field(default_factory=list)  # rows, moment, CPU s, MB

    def report(self, finished: int, failed: int, running: int) -> None:
        self.finished = finished

    def look(self) -> None:
        self.notes.append((self.finished, time.monotonic(), time.process_time(), memory_MB()))

    def at(self, finished: float) -> np.ndarray:
        """The first note with so many rows finished."""
        notes = np.array(self.notes)
        return notes[np.searchsorted(notes[:, 0], finished)]


def memory_MB() -> float:
    return psutil.Process().memory_info().rss / 1e6


@dataclass(frozen=True)
class Measured:
    """What one call of the runner took, in the process that holds scheduler and client."""

    rows: int
    seconds: float
    workers: int
    batches: int
    arrival_s: float
    wall_s: float
    steady: float  # utilisation between the first and the last tenth of the rows
    cpu_s: float
    idle_s: float  # CPU time of the same cluster over the same time when it has nothing to do
    helpers_s: float
    before_MB: float
    growth_MB: float
    late_MB: float  # growth between one fifth and four fifths of the rows
    late_cpu: float  # CPU time of a row between half and four fifths, over that between one fifth and half
    load: float

    @property
    def used(self) -> float:
        """Share of the workers' time that evaluations had."""
        return self.rows * self.seconds / (self.workers * self.wall_s)

    @property
    def used_with_arrival(self) -> float:
        return self.used * self.wall_s / (self.wall_s + self.arrival_s)

    @property
    def overhead_s(self) -> float:
        return self.cpu_s - self.idle_s

    @property
    def overhead_ms(self) -> float:
        """Of an evaluation."""
        return 1e3 * self.overhead_s / self.rows


def call(cluster: Cluster, store: Store, title: str, rows: int, seconds: float, idle: float = 0.0) -> Measured:
    """Evaluate ``rows`` rows through the runner; planning them is not counted. ``idle``: CPU seconds per second."""
    work = Sleep(seconds, title)
    workers = sum(cluster.client.nthreads().values())
    table = store.table(work.table())
    planned = table.plan(np.random.default_rng(0).random((rows, DIMENSIONS)))
    watch = Watch()
    watch.look()
    helpers_s = cluster.helpers_s()
    with every(0.2, watch.look, "watch"):
        evaluate(lambda: cluster.client, table, work, planned, watch.report)
    watch.look()
    assert not table.status[planned].any()
    _, moments, cpu, memory = np.array(watch.notes).T
    wall_s = moments[-1] - moments[0]
    early, half, late = (watch.at(share * rows) for share in (0.2, 0.5, 0.8))
    distinct = early[0] < half[0] < late[0]
    per_row = [
        (b[2] - a[2] - idle * (b[1] - a[1])) / (b[0] - a[0]) for a, b in ((early, half), (half, late)) if distinct
    ]
    return Measured(
        rows=rows,
        seconds=seconds,
        workers=workers,
        batches=1 + np.count_nonzero(np.diff(table.read("wall_seconds", planned))),  # one number for all of a batch
        arrival_s=cluster.arrival_s,
        wall_s=wall_s,
        steady=steady(table.read("began", planned), seconds, workers),
        cpu_s=cpu[-1] - cpu[0],
        idle_s=idle * wall_s,
        helpers_s=cluster.helpers_s() - helpers_s,
        before_MB=memory[0],
        growth_MB=memory.max() - memory[0],
        late_MB=late[3] - early[3] if distinct else math.nan,
        late_cpu=per_row[1] / per_row[0] if distinct else math.nan,
        load=os.getloadavg()[0],
    )


def steady(begun: np.ndarray, seconds: float, workers: int) -> float:
    ended = np.sort(begun + seconds)
    begin, end = ended[ended.size // 10], ended[-ended.size // 10]
    inside = np.minimum(begun + seconds, end) - np.maximum(begun, begin)
    return float(inside.clip(0.0).sum() / (workers * (end - begin)))


def measure(workers: int, sizes: list[tuple[int, float]]) -> list[Measured]:
    """One size after the other on one cluster; first a call of one short row for each worker, which warms up."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        with simulated(workers, folder) as cluster, Store.writing(folder / "out", "benchmark") as store:
            warm = call(cluster, store, "warm", workers, 0.01)
            started = time.process_time()
            time.sleep(IDLE_S)
            idle = (time.process_time() - started) / IDLE_S
            return [warm, *(call(cluster, store, f"call {i}", *size, idle) for i, size in enumerate(sizes))]


def apart(workers: int, sizes: list[tuple[int, float]]) -> list[Measured]:
    """The same in a process of its own."""
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        return pool.submit(measure, workers, sizes).result()


# ---- telling


COLUMNS: dict[str, tuple[int, str, Callable[[Measured], float]]] = {  # width, format, number
    "rows": (11, ",", lambda f: f.rows),
    "s/row": (6, "g", lambda f: f.seconds),
    "workers": (8, "", lambda f: f.workers),
    "batches": (8, ",", lambda f: f.batches),
    "start s": (8, ".1f", lambda f: f.arrival_s),
    "wall s": (7, ".1f", lambda f: f.wall_s),
    "used%": (6, ".1f", lambda f: 100 * f.used),
    "+start": (7, ".1f", lambda f: 100 * f.used_with_arrival),
    "steady": (7, ".1f", lambda f: 100 * f.steady),
    "RSS MB": (7, ".0f", lambda f: f.before_MB),
    "+MB": (5, ".0f", lambda f: f.growth_MB),
    "late": (6, "+.1f", lambda f: f.late_MB),
    "CPU s": (7, ".1f", lambda f: f.cpu_s),
    "idle s": (7, ".1f", lambda f: f.idle_s),
    "ms/row": (8, ".3f", lambda f: f.overhead_ms),
    "ms/batch": (9, ".2f", lambda f: 1e3 * f.overhead_s / f.batches),
    "late/early": (11, ".2f", lambda f: f.late_cpu),
    "helpers s": (10, ".1f", lambda f: f.helpers_s),
    "load": (6, ".1f", lambda f: f.load),
}


def head(title: str) -> None:
    print(f"\n  {title}")
    print("".join(name.rjust(width) for name, (width, _, _) in COLUMNS.items()), flush=True)


def tell(found: list[Measured]) -> None:
    for one in found:
        print("".join(f"{number(one):{form}}".rjust(w) for w, form, number in COLUMNS.values()), flush=True)


def exponent(name: str, found: list[Measured], number: Callable[[Measured], float]) -> None:
    """``b`` of numbers ~ rows^b: least squares of the logarithms, with its standard error."""
    values = [max(0.1, number(f)) for f in found]  # memory may also shrink
    (b, _), covariance = np.polyfit(np.log([f.rows for f in found]), np.log(values), 1, cov=True)
    print(f"  {name} ~ rows^b: b = {b:+.2f} +- {math.sqrt(covariance[0, 0]):.2f}")


def main() -> None:
    print(f"  TLS, {HELPERS} processes of workers; load average at the start {os.getloadavg()[0]:.1f}")
    print(LEGEND)
    head(f"{WORKERS} workers")
    found = []
    for size in SIZES:
        found.append(apart(WORKERS, [size, *((rows, size[1]) for rows in FEWER if size == SIZES[-1])]))
        tell([found[-1][1]])
    sizes = [one[1] for one in found]
    exponent("CPU time of scheduler and client over idle (us of an evaluation)", sizes, lambda f: 1e3 * f.overhead_ms)
    exponent("the same of the whole run (ms)", sizes, lambda f: 1e3 * f.overhead_s)
    exponent("growth of memory (MB)", sizes, lambda f: f.growth_MB)
    print(f"  an evaluation in a batch of many: {sizes[-1].overhead_ms:.3f} ms (aim {AIM_MS})")
    head(f"evaluations of {SIZES[-1][1]:g} s on one cluster, first those that warm up")
    equal = [*found[-1][2:], found[-1][1]]
    tell([found[-1][0], *equal])
    exponent("CPU time of scheduler and client over idle of the whole run (ms)", equal, lambda f: 1e3 * f.overhead_s)
    head(f"{SLOTS} workers on one cluster")
    rounds = apart(SLOTS, [(rows, seconds) for _ in range(ROUNDS) for rows, seconds, _ in FIXED])[1:]
    tell(rounds)
    for _, seconds, aim in FIXED:
        these = [f for f in rounds if f.seconds == seconds]
        name = f"{SLOTS} workers, evaluations of {seconds:g} s"
        median_line(f"{name}, utilisation (aim {aim})", [f.used for f in these], "%", 100)
        median_line(f"{name}, in the steady part", [f.steady for f in these], "%", 100)
        median_line(f"{name}, scheduler and client, an evaluation", [f.overhead_ms for f in these], "ms")
