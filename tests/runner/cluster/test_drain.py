"""Workers that leave before their walltime: every row is evaluated exactly once, and no worker is killed."""

import asyncio
import time
from contextlib import contextmanager, nullcontext
from types import SimpleNamespace

import numpy as np
import pytest
from distributed import Client, Nanny, Reschedule, Scheduler
from distributed.core import Status
from distributed.deploy.spec import SpecCluster

from sinew.runner.cluster import drain
from sinew.runner.errors import ClusterError, WalltimeReached
from sinew.runner.evaluation import on_cluster
from sinew.runner.evaluation.ensemble import evaluate
from sinew.runner.evaluation.policy import Policy
from sinew.runner.store.schema import PENDING
from sinew.runner.store.store import Store
from tests.runner.evaluations import Quick, must_end_in, table_spec
from tests.runner.stores import some


@contextmanager
def workers_with(*walltimes: float | None):
    """A client of a cluster whose workers have these walltimes (s; None: no walltime).

    Their deadlines are far away: starting takes an unknown time. Tests move them when the workers work.
    """
    specs = {}
    for number, walltime in enumerate(walltimes):
        deadline = {drain.DEADLINE: str(time.time() + 600.0), drain.WALLTIME: str(walltime)} if walltime else {}
        options = {"nthreads": 1, "env": deadline, "config": {"distributed.worker.memory.pause": False}}
        specs[number] = {"cls": Nanny, "options": options}
    scheduler = {"cls": Scheduler, "options": {"dashboard_address": "127.0.0.1:0", "host": "127.0.0.1"}}
    with (
        SpecCluster(specs, scheduler, silence_logs="error") as cluster,
        Client(cluster, set_as_default=False) as client,
    ):
        yield client


def evaluated(notes) -> list[str]:
    return notes.read_text().splitlines() if notes.exists() else []


def test_planned_ends_cost_no_row_and_repeat_none(tmp_path):
    notes = tmp_path / "notes"
    parameters = some(40)
    with workers_with(600.0, 600.0, None) as client, Store.writing(tmp_path, "study") as store:
        address = {worker["name"]: address for address, worker in client.scheduler_info()["workers"].items()}
        table = store.table(table_spec())
        rows = table.plan(parameters)
        seen = []

        def report(done: int, failed: int, running: int) -> None:
            if done and not seen:
                for number, seconds in ((0, 5.0), (1, 7.0)):
                    client.run(must_end_in, seconds, workers=[address[number]])
            if done:
                seen.append(len(client.scheduler_info()["workers"]))

        evaluate(lambda: client, table, Quick(notes, seconds_per_row=0.4), rows, report, Policy())
        assert not table.status.any()
    assert seen[0] == 3
    assert seen[-1] == 1, "two workers had to leave"
    assert sorted(evaluated(notes)) == sorted(f"{a!r},{b!r}" for a, b in parameters.tolist())


def test_a_row_that_fits_into_no_walltime_is_one_clear_line(tmp_path):
    with workers_with(9.0) as client, Store.writing(tmp_path, "study") as store:
        table = store.table(table_spec())
        rows = table.plan(some(3))
        moved = []

        def report(done: int, failed: int, running: int) -> None:
            if running and not moved:
                moved.append(client.run(must_end_in, 5.0))

        expected = "the workers' walltime of 9 s is too short: one evaluation takes at least"
        with pytest.raises(ClusterError, match=expected):
            evaluate(lambda: client, table, Quick(seconds_per_row=30.0), rows, report)
        assert (table.status == PENDING).all()


@pytest.mark.parametrize("here", [True, False])
def test_the_process_that_leads_stops_in_time_and_goes_on_later(tmp_path, monkeypatch, here):
    notes = tmp_path / "notes"
    parameters = some(40)
    with workers_with(None) as client, Store.writing(tmp_path, "study") as store:
        table = store.table(table_spec())
        rows = table.plan(parameters)
        monkeypatch.setenv(drain.DEADLINE, str(time.time() + 15.0))
        monkeypatch.setenv(drain.WALLTIME, "15")
        with pytest.raises(WalltimeReached, match=r"\d+ of 40 rows are finished and kept") as reached:
            evaluate(lambda: None if here else client, table, Quick(notes, seconds_per_row=0.5), rows)
        assert drain.seconds_left() > 7.0
        assert reached.value.worked
        first = len(evaluated(notes))
        assert 0 < first < 40
        monkeypatch.delenv(drain.DEADLINE)
        evaluate(lambda: client, table, Quick(notes, seconds_per_row=0.01), rows)
        assert not table.status.any()
    assert len(evaluated(notes)) == len(set(evaluated(notes))) == 40


def test_a_deadline_whose_alarm_comes_while_workers_are_still_met_blames_nobody(tmp_path, monkeypatch):
    """As on a busy machine, where the first messages to workers take longer than the loop would."""

    def interrupted(client, plugin):
        raise WalltimeReached("the alarm")

    monkeypatch.setenv(drain.WALLTIME, "60")
    monkeypatch.setattr(on_cluster, "register", interrupted)
    with workers_with(None) as client, Store.writing(tmp_path, "study") as store:
        table = store.table(table_spec())
        rows = table.plan(some(3))
        with pytest.raises(WalltimeReached, match="0 of 3 rows are finished and kept") as reached:
            evaluate(lambda: client, table, Quick(), rows, None, Policy())
    assert not reached.value.worked


class StandInWorker:
    """What the plugin needs of a worker: ``executing`` gives how many tasks run, each time that it asks."""

    def __init__(self, executing: list[int]) -> None:
        self.executing, self.calls = executing, []
        self.status = Status.running
        self.state = self
        self.loop = SimpleNamespace(asyncio_loop=None)
        self.plugins = {drain.Leave.name: drain.Leave()}
        self.plugins[drain.Leave.name].worker = self

    @property
    def executing_count(self) -> int:
        self.calls.append("asked")
        return self.executing.pop(0)

    def log_event(self, topic: str, message: dict) -> None:
        self.calls.append(topic)

    async def close_gracefully(self, reason: str) -> None:
        self.calls.append("closed")


def leave(worker: StandInWorker) -> None:
    async def until_closed() -> None:
        plugin = worker.plugins[drain.Leave.name]
        await plugin.leave()
        assert worker.status == Status.paused, "it must take no more batches"
        await plugin.closing

    asyncio.run(until_closed())


@pytest.mark.parametrize(("left_s", "expected_s", "goes_back"), [(60.0, 30.0, False), (60.0, 60.0, True)])
def test_a_batch_that_cannot_end_in_time_goes_back_to_the_scheduler(monkeypatch, left_s, expected_s, goes_back):
    worker = StandInWorker([0, 0])
    monkeypatch.setattr(drain, "get_worker", lambda: worker)

    def at_once(work, loop):
        return SimpleNamespace(result=lambda timeout: asyncio.run(work))

    monkeypatch.setattr(asyncio, "run_coroutine_threadsafe", at_once)
    monkeypatch.setenv(drain.DEADLINE, str(time.time() + left_s))
    with pytest.raises(Reschedule) if goes_back else nullcontext():
        drain.enter(expected_s)


@pytest.mark.parametrize("kept", [None, 0, 1])
def test_a_batch_that_goes_on_later_is_not_too_long_for_a_walltime(monkeypatch, kept):
    """If it has kept a state in this job."""
    worker = StandInWorker([1, 1])
    monkeypatch.setattr(drain, "get_worker", lambda: worker)
    monkeypatch.setenv(drain.WALLTIME, "60")
    monkeypatch.setenv(drain.DEADLINE, str(time.time() + 20.0))
    counts = [3]
    drain.enter(0.0, kept=None if kept is None else lambda: counts[0])
    counts[0] += kept or 0
    worker.plugins[drain.Leave.name].first -= 40.0
    worker.plugins[drain.Leave.name].began -= 40.0
    monkeypatch.setenv(drain.DEADLINE, str(time.time() + 1.0))
    leave(worker)
    assert (drain.TOO_SHORT in worker.calls) == (not kept)
    assert worker.calls[-1] == "closed"


def test_a_worker_that_leaves_waits_for_what_runs(monkeypatch):
    worker = StandInWorker([2, 1, 1, 0, 0])
    monkeypatch.setenv(drain.DEADLINE, str(time.time() + 600.0))
    leave(worker)
    assert worker.calls == ["asked"] * 5 + ["closed"]


def test_a_worker_whose_batch_takes_too_long_closes_all_the_same(monkeypatch):
    worker = StandInWorker([1, 1])
    monkeypatch.setenv(drain.DEADLINE, str(time.time() + 1.0))
    leave(worker)
    assert worker.calls == ["asked", "asked", "closed"]


def test_without_a_walltime_nothing_ends():
    assert np.isinf(drain.seconds_left())


def test_a_job_script_says_when_it_ends():
    _, walltime, deadline = drain.job_script_lines(90.0)
    assert walltime == "export SINEW_WALLTIME=90"
    assert deadline == "export SINEW_DEADLINE=$(( $(date +%s) + 90 ))"
