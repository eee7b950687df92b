"""Workers that leave before their walltime: every row is evaluated exactly once, and no worker is killed."""

import time
from contextlib import contextmanager

import numpy as np
import pytest
from distributed import Client, Nanny, Scheduler
from distributed.deploy.spec import SpecCluster

from runner import drain, ensemble
from runner.ensemble import Policy, evaluate
from runner.errors import ClusterError, WalltimeReached
from runner.store import PENDING, Store
from tests.runner.evaluations import Quick, table_spec
from tests.runner.test_store import some


@contextmanager
def workers_with(*seconds: float | None):
    """A client of a cluster whose workers must be gone so many seconds from now (None: may stay)."""
    specs = {}
    for number, left in enumerate(seconds):
        deadline = {drain.DEADLINE: str(time.time() + left), drain.WALLTIME: str(left)} if left else {}
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
    parameters = some(160)
    with workers_with(20.0, 26.0, None) as client, Store.writing(tmp_path, "study") as store:
        table = store.table(table_spec())
        rows = table.plan(parameters)
        seen = []

        def report(done: int, failed: int, running: int) -> None:
            seen.append(len(client.scheduler_info()["workers"]))

        evaluate(lambda: client, table, Quick(notes, seconds_per_row=0.4), rows, report, Policy())
        assert not table.status.any()
    assert max(seen) == 3
    assert seen[-1] == 1, "two workers had to leave"
    assert sorted(evaluated(notes)) == sorted(f"{a!r},{b!r}" for a, b in parameters.tolist())


def test_a_row_that_fits_into_no_walltime_is_one_clear_line(tmp_path):
    with workers_with(9.0) as client, Store.writing(tmp_path, "study") as store:
        table = store.table(table_spec())
        rows = table.plan(some(3))
        expected = "the workers' walltime of 9 s is too short: one evaluation takes at least"
        with pytest.raises(ClusterError, match=expected):
            evaluate(lambda: client, table, Quick(seconds_per_row=30.0), rows)
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
    monkeypatch.setattr(ensemble, "_register", interrupted)
    with workers_with(None) as client, Store.writing(tmp_path, "study") as store:
        table = store.table(table_spec())
        rows = table.plan(some(3))
        with pytest.raises(WalltimeReached, match="0 of 3 rows are finished and kept") as reached:
            evaluate(lambda: client, table, Quick(), rows, None, Policy())
    assert not reached.value.worked


def test_without_a_walltime_nothing_ends():
    assert np.isinf(drain.seconds_left())


def test_a_job_script_says_when_it_ends():
    _, walltime, deadline = drain.job_script_lines(90.0)
    assert walltime == "export SINEW_WALLTIME=90"
    assert deadline == "export SINEW_DEADLINE=$(( $(date +%s) + 90 ))"
