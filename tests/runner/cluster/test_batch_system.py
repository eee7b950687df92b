"""The contract of a batch system: the same tests with the real daemons of each.

| promise | test |
|---|---|
| a job is submitted, waits, runs and ends; its node is known | ``test_a_job_is_seen_from_submission_to_end`` |
| a cancelled job ends | ``test_a_cancelled_job_ends`` |
| a job puts itself back into the queue | ``test_a_job_puts_itself_back_into_the_queue`` |
| a refusal is one line that names the field | ``test_a_refused_request_names_the_field`` |
| workers join; a lost job is replaced | ``test_worker_jobs_join_and_a_lost_one_is_replaced`` |
| workers leave before their walltime | ``test_workers_leave_before_their_walltime`` |
"""

import json
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from sinew.runner.cluster import drain
from sinew.runner.cluster.batch_system import BatchSystem, JobRequest, QueuedJob, Refused
from sinew.runner.cluster.batch_systems import BATCH_SYSTEMS
from sinew.runner.cluster.client import open_client
from sinew.runner.cluster.job_table import JobTable
from sinew.runner.cluster.jobs import Jobs
from sinew.runner.cluster.network import Network
from sinew.runner.evaluation.ensemble import evaluate
from sinew.runner.store.store import Store
from tests.runner.evaluations import Quick, must_end_in, table_spec
from tests.runner.stores import some

WAIT_S = 90.0
FACTS = """\
import json, sys
from sinew.runner.cluster.batch_systems import current, current_job, this_node
print(json.dumps({"title": current().title, "job": current_job(), "node": this_node(), "cpus": current().cpus()}))
"""


@dataclass(frozen=True)
class Site:
    """A batch system that runs, and what its testbed has."""

    key: str
    nodes: set[str]

    @property
    def system(self) -> BatchSystem:
        return BATCH_SYSTEMS[self.key]

    def request(self, folder: Path, **changes: Any) -> JobRequest:
        facts = {"name": "sinew-contract", "output": str(folder / "output"), "cores": 1}
        return JobRequest(**(facts | {"memory_mb": 500, "walltime_s": 600.0} | changes))

    def script(self, folder: Path, *lines: str, **changes: Any) -> Path:
        """A job script with these lines."""
        asked = self.system.leader_directives(self.request(folder, **changes))
        path = folder / "job.sh"
        path.write_text("\n".join(["#!/usr/bin/env bash", *asked, *lines]) + "\n")
        return path


@pytest.fixture(params=[pytest.param(name, marks=pytest.mark.slurm) for name in ("slurm", "grid_engine")])
def site(request) -> Site:
    nodes = {"slurm": {"n1", "n2", "n3", "n4"}, "grid_engine": {"localhost"}}[request.param]
    request.getfixturevalue(f"{request.param}_cluster")
    return Site(request.param, nodes)


def until(ready: Callable[[], Any], what: str) -> Any:
    end = time.monotonic() + WAIT_S
    while not (found := ready()):
        assert time.monotonic() < end, f"waited in vain for {what}"
        time.sleep(0.1)
    return found


def seen(site: Site, job: str) -> QueuedJob | None:
    return site.system.queue([job]).get(job)


def ended(site: Site, job: str) -> bool:
    found = seen(site, job)
    return found is None or not found.live


def test_a_job_is_seen_from_submission_to_end(site, tmp_path):
    gate, facts = tmp_path / "gate", tmp_path / "facts.py"
    facts.write_text(FACTS)
    script = site.script(
        tmp_path, f"{sys.executable} {facts} > {tmp_path}/facts.json", f"until [ -e {gate} ]; do sleep 0.1; done"
    )
    site.system.check_script(script)
    job = site.system.submit(script)
    assert job.isdigit()
    running = until(lambda: (found := seen(site, job)) and found.running and found, "the job to run")
    assert (running.job, running.name, running.live) == (job, "sinew-contract", True)
    assert running.nodes in site.nodes
    assert job in site.system.queue()
    told = json.loads(until(lambda: (tmp_path / "facts.json").exists() and (tmp_path / "facts.json").read_text(), ""))
    assert told == {"title": site.system.title, "job": job, "node": running.nodes, "cpus": 1}
    gate.touch()
    until(lambda: ended(site, job), "the job to end")


def test_a_cancelled_job_ends(site, tmp_path):
    # exec: a shell that is killed while it starts a program could leave that program behind
    job = site.system.submit(site.script(tmp_path, "exec sleep 600"))
    until(lambda: (found := seen(site, job)) and found.running, "the job to run")
    site.system.cancel([job])
    until(lambda: ended(site, job), "the job to end")
    site.system.cancel([job])  # once more does no harm
    site.system.cancel([])


def test_a_job_puts_itself_back_into_the_queue(site, tmp_path):
    runs = tmp_path / "runs"
    again = [f"if [ $(wc -l < {runs}) -lt 2 ]; then", *site.system.requeue_lines(), "fi"]
    job = site.system.submit(site.script(tmp_path, f"echo ${site.system.job_variable} >> {runs}", *again))
    until(lambda: runs.exists() and len(runs.read_text().split()) == 2 and ended(site, job), "its second run")
    assert runs.read_text().split() == [job, job]


@pytest.mark.parametrize(
    ("field", "changes"),
    [
        ("partition", {}),
        ("memory", {"memory_mb": 900_000}),
        ("cores", {"cores": 64, "memory_mb": 64 * 300}),
    ],
)
def test_a_refused_request_names_the_field(site, tmp_path, field, changes):
    if field == "partition":
        changes = {"options": site.system.options({"partition": "nowhere"})}
    script = site.script(tmp_path, "true", **changes)
    with pytest.raises(Refused) as raised:
        site.system.check_script(script)
    assert raised.value.field == field, raised.value.words
    assert str(raised.value).startswith(f"{site.system.title} refuses the job: ")
    assert "\n" not in str(raised.value)
    assert "sinew-contract" not in {job.name for job in site.system.queue().values() if job.live}


def jobs(site: Site, folder: Path, **changes: Any) -> Jobs:
    facts = {"name": "contract", "folder": folder, "maximum": 2, "minimum": 0, "cores": 1, "memory_mb": 3000}
    facts |= {"walltime_s": 600.0, "network": Network("lo"), "poll_s": 0.5, "batch_system": site.key}
    return Jobs(**(facts | changes))


@pytest.mark.takes(30)
def test_worker_jobs_join_and_a_lost_one_is_replaced(site, tmp_path):
    notes, lost = tmp_path / "notes", []
    with Store.writing(tmp_path / "out", "study") as store, open_client(jobs(site, tmp_path / "jobs")) as client:
        table = store.table(table_spec())
        rows = table.plan(some(60))

        def report(done: int, failed: int, running: int) -> None:
            live = [job for job in site.system.queue().values() if job.running] if done and not lost else []
            if len(live) == 2:
                lost.append(live[0].job)
                site.system.cancel(lost)

        evaluate(lambda: client, table, Quick(notes, seconds_per_row=0.4), rows, report)
        assert not table.status.any()
        workers = set(map(str, table.read("worker", rows)))
    assert len(lost) == 1
    assert {worker.partition(":")[0] for worker in workers} <= site.nodes
    records = JobTable(tmp_path / "jobs").read()
    assert len(records) == 3, "two at first, and one in place of that which was lost"
    assert {worker.rpartition(" job ")[2] for worker in workers} <= set(records)
    assert all(record.batch_system == site.key and record.ended is not None for record in records.values())
    until(lambda: not any(job.live for job in site.system.queue(records).values()), "the jobs to end")


@pytest.mark.takes(25)
def test_workers_leave_before_their_walltime(site, tmp_path):
    """The walltime of a job reaches its worker. When the end is near, it leaves, and another job goes on."""
    notes, parameters, left = tmp_path / "notes", some(20), []
    spec = jobs(site, tmp_path / "jobs", maximum=1, walltime_s=600.0)
    with Store.writing(tmp_path / "out", "study") as store, open_client(spec) as client:
        table = store.table(table_spec())
        rows = table.plan(parameters)

        def report(done: int, failed: int, running: int) -> None:
            if done and not left:
                left.extend(client.run(drain.seconds_left).values())
                client.run(must_end_in, 6.0)

        evaluate(lambda: client, table, Quick(notes, seconds_per_row=0.4), rows, report)
        assert not table.status.any()
    assert len(left) == 1
    assert 300.0 < left[0] < 600.0
    assert len(JobTable(tmp_path / "jobs").read()) == 2
    assert sorted(notes.read_text().splitlines()) == sorted(f"{a!r},{b!r}" for a, b in parameters.tolist())
