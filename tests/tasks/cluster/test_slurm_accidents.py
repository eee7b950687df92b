"""Studies on a real SLURM that meet accidents: they go on and finish, or say in one line why they cannot."""

import contextlib
import json
import subprocess
import time
from pathlib import Path

import pytest

from sinew.runner.cluster import slurm
from tests.small_disk import may_mount, small_disk
from tests.tasks.cluster.slurm_studies import (
    ALLOCATION,
    JOB_SCRIPT,
    finished_well,
    gave_up,
    leader,
    leading_processes,
    live,
    lives_of,
    moment,
    nothing_is_left,
    once,
    prepare,
    processes_of_jobs,
    profile_with,
    progress,
    said_by_leader,
    sinew,
    submit,
    until,
    worker_jobs,
    working,
)
from tests.tasks.simulate.febio.restarting import with_long_runs
from tests.tasks.stand_in import committed
from tests.trusting import trusted

ONLY_LEADER = 'case "$SLURM_JOB_NAME" in *-worker) ;; *) {} ;; esac'
ONLY_WORKERS = 'case "$SLURM_JOB_NAME" in *-worker) {} ;; esac'


def remembers(slurm_cluster, job):
    """Wait until a controller that is killed would know of all that happened: else it starts running jobs again."""
    saved, now = slurm_cluster.root / "state" / "job_state", time.time()
    slurm_cluster.run("scontrol", "update", f"JobId={job}", "Comment=runs")  # what changed is saved within seconds
    until(lambda: saved.is_file() and saved.stat().st_mtime > now, "the state that the controller saves")


@pytest.mark.takes(40)
def test_a_preempted_worker_job_is_replaced(tmp_path, slurm_cluster, bed):
    profile = profile_with(cores=2).replace("workers: {", "workers: {partition: scavenge, ")
    (tmp_path / "held").write_text("24")  # or the study may be finished before a busy machine gets to it
    out = submit(prepare(tmp_path, profile, seconds=0.5, base_samples=4))
    before = progress(out)
    victim = working(out)[0]
    urgent = ("-p", "urgent", "-w", victim.nodes, "-c", "2", "--mem=100", "--output=/dev/null", "--wrap", "sleep 5")
    slurm_cluster.run("sbatch", *urgent)
    is_replaced(out, victim.job, "PREEMPTED")
    (tmp_path / "held").unlink()
    finished_well(out, before)


@pytest.mark.takes(40)
@pytest.mark.thorough
def test_a_node_fails(tmp_path, slurm_cluster, bed):
    (tmp_path / "held").write_text("24")
    out = submit(prepare(tmp_path, profile_with(cores=2), seconds=0.5, base_samples=4))
    before = progress(out)
    victim = working(out)[0]
    bed.fail_node(slurm_cluster, victim.nodes)
    is_replaced(out, victim.job, "NODE_FAIL")
    (tmp_path / "held").unlink()
    finished_well(out, before)
    bed.restore_node(slurm_cluster, victim.nodes)


def is_replaced(out: Path, job: str, end: str) -> None:
    """Wait until a worker job has ended in this state, and another was submitted after that."""

    def replaced() -> bool:
        jobs = {record.job: record for record in worker_jobs(out)}
        ended = jobs[job].ended
        return ended is not None and any(record.submitted > ended for record in jobs.values())

    until(replaced, "the job in place of the one that ended")
    assert next(record.end for record in worker_jobs(out) if record.job == job) == end


@pytest.mark.takes(45)
@pytest.mark.thorough
def test_the_controller_is_away_for_a_while(tmp_path, slurm_cluster, bed):
    study = prepare(tmp_path, profile_with(), seconds=1.0, base_samples=4)
    out = submit(study)
    before = progress(out)
    remembers(slurm_cluster, leader(out))
    bed.kill_controller(slurm_cluster)
    assert json.loads(sinew("status", out, "--json"))["now"]["alive"]
    for command in (("cancel", out), ("submit", study, "--profile", tmp_path / "profile.yaml", "--out", out)):
        said = sinew(*command, expect=2)
        assert said.count("\n") == 1
        assert "SLURM's controller does not answer" in said
    during = moment(out)
    assert during[0] > before[0], "what runs, runs on"
    bed.start_controller(slurm_cluster)
    finished_well(out, before, during)
    once(out)


@pytest.mark.takes(45)
def test_the_controller_is_away_when_the_study_starts(tmp_path, slurm_cluster, bed):
    go = tmp_path / "go"
    wait = ONLY_LEADER.format(f"while [ ! -e {go} ]; do sleep 0.2; done")
    study = prepare(tmp_path, profile_with(prologue=[wait]), seconds=0.1, base_samples=4)
    out = submit(study, at_once=True)
    leads = leader(out)
    until(lambda: live()[0].state == "RUNNING", "the start of the leading job")
    time.sleep(1.5)  # slurmctld saves what changed, but not twice within a second, and then after 5 s at most
    slurm_cluster.run("scontrol", "update", f"JobId={leads}", "Comment=runs")
    time.sleep(7)
    bed.kill_controller(slurm_cluster)
    go.touch()
    until(lambda: leading_processes(study), "the start of the leading process")
    with contextlib.suppress(AssertionError):  # it may end, or try for a while
        until(lambda: not processes_of_jobs(leads), "the end of the leading job", 12)
    bed.start_controller(slurm_cluster)
    finished_well(out)


@pytest.mark.takes(55)
@pytest.mark.parametrize(
    "how",
    [
        "killed",
        pytest.param("requeued", marks=pytest.mark.thorough),
        pytest.param("killed while the controller is away", marks=pytest.mark.thorough),
    ],
)
def test_the_leading_job_is(tmp_path, slurm_cluster, bed, how):
    study = prepare(tmp_path, profile_with(), seconds=0.5, base_samples=4)
    out = submit(study)
    before = progress(out)
    first, leads = [job.job for job in working(out)], leader(out)
    if how == "requeued":
        slurm_cluster.run("scontrol", "requeue", leads)
    else:
        (leading,) = leading_processes(study)
        away = how != "killed"
        if away:
            bed.kill_controller(slurm_cluster)
        leading.kill()
        if away:
            time.sleep(8)
            bed.start_controller(slurm_cluster)
    until(lambda: lives_of(out, leads).count("started") == 2, "the second life")
    again = moment(out)
    until(lambda: any(job.job not in first for job in working(out)), "the start of new worker jobs")
    until(lambda: not any(processes_of_jobs(job) for job in first), "the end of the first life's processes", 30)
    finished_well(out, before, again)
    assert all(record.ended for record in worker_jobs(out))
    assert lives_of(out, leads)[-1] == "done"


@pytest.mark.takes(200)
def test_the_leading_job_stops_before_its_walltime_and_goes_on(tmp_path, slurm_cluster, bed):
    """One worker needs 128 s for all rows; the leading job has 120 s, of which a busy machine takes half to start."""
    study = prepare(tmp_path, profile_with(leader="2:00", jobs=1), seconds=4.0, base_samples=2)
    out = submit(study)
    until(lambda: "its walltime was near" in lives_of(out, leader(out)), "the end of the first life")
    until(lambda: slurm.queue()[leader(out)].state == "PENDING", "the leading job's place in the queue")
    said = sinew("submit", study, "--profile", tmp_path / "profile.yaml", "--out", out, expect=2)
    assert f"SLURM job {leader(out)} (" in said, "what waits to go on leads already"
    finished_well(out)
    once(out)
    _lives_of_two_walltimes(out)


@pytest.mark.takes(200)
@pytest.mark.thorough
def test_an_allocation_that_is_too_short_for_everything(tmp_path, slurm_cluster, bed):
    """One worker needs 128 s for all rows; the allocation has 120 s, of which a busy machine takes half to start."""
    profile = ALLOCATION.replace("10:00", "2:00").replace("tasks: 4", "tasks: 3") + JOB_SCRIPT
    out = submit(prepare(tmp_path, profile, seconds=4.0, base_samples=2))
    finished_well(out)
    once(out)
    _lives_of_two_walltimes(out)


def _lives_of_two_walltimes(out: Path) -> None:
    lives = lives_of(out, leader(out))
    assert lives[:4] == ["submitted", "started", "its walltime was near", "started"]
    assert lives[-1] == "done"


@pytest.mark.takes(75)
@pytest.mark.thorough
def test_worker_jobs_whose_walltime_is_too_short(tmp_path, slurm_cluster, bed):
    """However long they take to start."""
    profile = profile_with(worker="1:00", jobs=1, prologue=[ONLY_WORKERS.format("sleep 12")])
    out = submit(prepare(tmp_path, profile, seconds=100, base_samples=2))
    gave_up(out, "the workers' walltime of 60 s is too short: one evaluation takes at least")


@pytest.mark.takes(170)
@pytest.mark.thorough
def test_a_run_that_is_longer_than_a_walltime_goes_on_in_the_next_job(tmp_path, slurm_cluster, bed):
    study = prepare(tmp_path, profile_with(worker="1:00", jobs=1), base_samples=2)
    notes = with_long_runs(study, seconds=130.0)
    out = submit(trusted(study))
    finished_well(out)
    said = notes.read_text().splitlines()
    begins = [int(line.removeprefix("from ")) for line in said if line.startswith("from ")]
    assert len(begins) > 1, "it needs two jobs"
    assert begins == sorted(set(begins)), "each run is farther than the one before"
    steps = [line for line in said if line.startswith("step ")]
    assert len(steps) - len(set(steps)) < 0.3 * len(set(steps)) * (len(begins) - 1), "little is computed again"
    assert not list((out / "attempts").rglob("*.state"))


@pytest.mark.takes(65)
@pytest.mark.thorough
def test_a_leading_job_whose_walltime_is_too_short(tmp_path, slurm_cluster, bed):
    out = submit(prepare(tmp_path, profile_with(leader="1:00", jobs=1), seconds=100, base_samples=2))
    gave_up(out, r"coordinator\.walltime: nothing finished within its walltime \(1:00\)", late_workers=True)


@pytest.mark.takes(65)
@pytest.mark.thorough
def test_workers_that_come_just_before_the_leading_job_must_stop(tmp_path, slurm_cluster, bed):
    """They are not to blame for a walltime in which nothing finished: it waits in the queue again."""
    occupy = ["-p", "urgent", "-N", "3", "--exclusive", "--output=/dev/null", "--parsable", "--wrap", "exec sleep 600"]
    occupied = slurm_cluster.run("sbatch", *occupy).strip()
    out = submit(prepare(tmp_path, profile_with(leader="1:00", cores=2), seconds=25, base_samples=2), at_once=True)
    leads = leader(out)
    until(lambda: slurm.queue()[leads].state == "RUNNING", "the start of the leading job")
    time.sleep(43)  # of the 52 s before it stops; with workers for a quarter of the 60 s, it would be to blame
    slurm_cluster.run("scancel", occupied)
    until(lambda: len(lives_of(out, leads)) > 2, "the end of the first life")
    assert lives_of(out, leads)[:3] == ["submitted", "started", "its walltime was near"], said_by_leader(out)
    until(lambda: slurm.queue()[leads].state == "PENDING", "the leading job's place in the queue")
    assert f"job {leads} " in sinew("cancel", out), "what waits to go on can be cancelled"
    nothing_is_left(out)


@pytest.mark.takes(20)
def test_worker_jobs_that_cannot_start(tmp_path, slurm_cluster, bed):
    prologue = ONLY_WORKERS.format("echo no solver here; exit 3")
    out = submit(prepare(tmp_path, profile_with(prologue=[prologue])), at_once=True)
    gave_up(out, r"worker job \d+ ended before it came to work: no solver here \(/.*-worker-\d+\.log\)")
    assert len(worker_jobs(out)) <= 8
    assert all(record.ended for record in worker_jobs(out))


@pytest.mark.takes(55)
@pytest.mark.thorough
def test_the_client_of_an_allocation_is_killed(tmp_path, slurm_cluster, bed):
    study = prepare(tmp_path, ALLOCATION + JOB_SCRIPT, seconds=0.3, base_samples=4)
    out = submit(study)
    before = progress(out)
    (client,) = (p for p in leading_processes(study) if p.environ()["SLURM_PROCID"] == "1")
    client.kill()
    finished_well(out, before)
    assert lives_of(out, leader(out)) == ["submitted", "started", "started", "done"]


@pytest.fixture
def disk():
    """A small file system of its own."""
    with small_disk(megabytes=16) as folder:
        yield folder


def fill(folder: Path) -> Path:
    path = folder / "filler"
    with contextlib.suppress(OSError), open(path, "wb", buffering=0) as file:
        while True:
            file.write(bytes(4096))
    return path


@may_mount
@pytest.mark.takes(45)
def test_a_full_disk(slurm_cluster, disk, bed):
    study = prepare(disk.parent, profile_with(), seconds=0.5, base_samples=4)
    out = submit(study, disk / "out")
    before = progress(out)
    filler = fill(disk)
    gave_up(out, "no space left on the disk; free some and run the same command again")
    assert committed(out) >= before[0]
    filler.unlink()
    finished_well(submit(study, out), before)


@may_mount
@pytest.mark.takes(50)
@pytest.mark.thorough
def test_a_disk_that_becomes_read_only(slurm_cluster, disk, bed):
    study = prepare(disk.parent, profile_with(), seconds=0.5, base_samples=4)
    out = submit(study, disk / "out")
    before = progress(out)
    journal = out / "journal"
    subprocess.run(["mount", "--bind", journal, journal], check=True)
    mount = ["mount", "-o", "remount,bind,ro", journal]
    until(lambda: subprocess.run(mount, capture_output=True).returncode == 0, "a read-only journal", 60)
    gave_up(out, "Read-only file system")
    subprocess.run(["umount", journal], check=True)
    assert committed(out) >= before[0]
    finished_well(submit(study, out), before)
