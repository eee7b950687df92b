"""How many worker jobs a keeper keeps in the queue, and which it replaces."""

import asyncio
import math
import time
from dataclasses import dataclass, field

import pytest

from sinew.runner.cluster.batch_system import Away, QueuedJob
from sinew.runner.cluster.job_table import JobTable
from sinew.runner.cluster.keeper import Growing, Keeper
from sinew.runner.errors import ClusterError


@dataclass
class Job:
    """A worker job that was submitted long ago."""

    job_id: str
    job_name: str = "sinew-study-worker"
    refusal: ClusterError | None = None
    submitted_at: float = -math.inf


@dataclass
class Cluster(Growing):
    """A cluster of jobs that notes what is asked of it."""

    wanted_slots: int
    workers: dict[str, Job] = field(default_factory=dict)
    failure: None = None
    scheduler_info: dict[str, dict] = field(default_factory=lambda: {"workers": {}})
    ended: list[str] = field(default_factory=list)
    scaled: list[int] = field(default_factory=list)

    def sync(self, function):
        return asyncio.run(function())

    async def scale_down(self, names):
        self.ended += names

    def scale(self, jobs):
        self.scaled.append(jobs)


@dataclass
class System:
    """A batch system with these jobs in its queue."""

    live: set[str]
    title: str = "SLURM"
    queue_command: str = "squeue"

    def queue(self, jobs):
        return {
            job: QueuedJob(job, "RUNNING" if job in self.live else "CANCELLED", "", "n1", "", job in self.live, True)
            for job in jobs
        }


def looked(tmp_path, wanted_slots: int, live: set[str], **bounds: int) -> Cluster:
    """A cluster of jobs 1 and 2 with two cores each, after its keeper has looked at the queue once."""
    cluster = Cluster(wanted_slots, {"one": Job("1"), "two": Job("2")})
    bounds = {"minimum": 0, "maximum": 4, **bounds}
    keeper = Keeper(cluster, System(live), JobTable(tmp_path), tmp_path.joinpath, cores=2, facts={}, **bounds)
    keeper.look()
    assert cluster.failure is None
    return cluster


@pytest.mark.parametrize(("slots", "jobs"), [(5, 3), (6, 3), (7, 4), (100, 4)])
def test_there_are_as_many_jobs_as_have_work_up_to_the_maximum(tmp_path, slots, jobs):
    assert looked(tmp_path, slots, {"1", "2"}).scaled == [jobs]


@pytest.mark.parametrize("slots", [0, 1, 3, 4])
def test_jobs_with_less_to_do_stay(tmp_path, slots):
    cluster = looked(tmp_path, slots, {"1", "2"})
    assert cluster.scaled == []
    assert cluster.ended == []


def test_a_job_that_ended_is_replaced_while_there_is_work(tmp_path):
    cluster = looked(tmp_path, 4, {"1"})
    assert cluster.ended == ["two"]
    assert cluster.scaled == [2]


def test_a_job_that_was_taken_without_a_number_is_not_submitted_without_end(tmp_path):
    """Nobody would ever end such jobs. A batch system that is away is asked again instead."""
    for refusal, lost in ((ClusterError("printed no job number"), True), (Away("no answer"), False)):
        cluster = Cluster(4, {"one": Job("", refusal=refusal)})
        bounds = {"minimum": 0, "maximum": 4}
        keeper = Keeper(cluster, System(set()), JobTable(tmp_path), tmp_path.joinpath, cores=2, facts={}, **bounds)
        for _ in range(Keeper.GIVE_UP_AFTER * 4):
            keeper.look()
        assert (cluster.failure is not None) == lost


def test_jobs_that_ended_are_not_replaced_when_nobody_is_wanted(tmp_path):
    """Of a cancelled study all jobs end at once: the one that leads must not submit new ones while it stops."""
    cluster = looked(tmp_path, 0, set())
    assert cluster.ended == ["one", "two"]
    assert cluster.scaled == [0]


def test_the_minimum_is_kept(tmp_path):
    assert looked(tmp_path, 0, set(), minimum=1).scaled == [1]


def ends(tmp_path, system: System) -> dict[str, str]:
    """How the jobs 1 and 2 ended by the table of jobs, when the queue is as given while their cluster closes."""
    cluster = Cluster(0, {"one": Job("1"), "two": Job("2", submitted_at=time.monotonic())})
    bounds = {"minimum": 0, "maximum": 4}
    Keeper(cluster, system, JobTable(tmp_path), tmp_path.joinpath, cores=2, facts={}, **bounds).ended_now()
    return {number: job.end for number, job in JobTable(tmp_path).read().items()}


def test_a_job_that_ended_since_the_last_look_is_told_as_the_queue_shows_it(tmp_path):
    assert ends(tmp_path, System({"1"})) == {"1": "done", "2": "CANCELLED"}


def test_a_job_that_the_queue_has_forgotten_did_not_end_with_the_cluster(tmp_path):
    """One that was submitted just now may not be in the queue yet."""

    class Forgetful(System):
        def queue(self, jobs):
            return {}

    assert ends(tmp_path, Forgetful(set())) == {"1": "unknown to squeue", "2": "done"}


def test_a_queue_that_is_away_does_not_keep_a_cluster_from_closing(tmp_path, caplog):
    class Away(System):
        def queue(self, jobs):
            raise ClusterError("squeue: no answer")

    assert ends(tmp_path, Away(set())) == {"1": "done", "2": "done"}
    assert [record.error for record in caplog.records] == ["squeue: no answer"]
