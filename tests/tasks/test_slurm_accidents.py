"""Studies on a real SLURM that meet accidents: they go on and finish, or say in one line why they cannot."""

import contextlib
import hashlib
import json
import os
import re
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import numpy as np
import psutil
import pytest

from runner import slurm
from runner.store import open_store
from tasks.model import Specimen
from tasks.simulate.febio import read_template, render
from tasks.study import read_study
from tests.tasks import test_submission as submission
from tests.tasks import test_survival as survival
from tests.tasks.test_submission import ALLOCATION, PROFILE, finish, live, sinew, submit, until

LEADS, WORKS = '10:00"}\nworkers', 'walltime: "10:00", poll_s'
ONLY_LEADER = 'case "$SLURM_JOB_NAME" in *-worker) ;; *) {} ;; esac'
ONLY_WORKERS = 'case "$SLURM_JOB_NAME" in *-worker) {} ;; esac'


@pytest.fixture
def bed(slurm_cluster):
    """The functions of the testbed; it is as before when a test ends, whatever that did."""
    module = sys.modules[type(slurm_cluster).__module__]
    yield module
    if not daemon_lives(slurm_cluster, "slurmctld"):
        module.start_controller(slurm_cluster)
    for node in slurm_cluster.names:
        if not daemon_lives(slurm_cluster, f"slurmd.{node}"):
            module.restore_node(slurm_cluster, node)
    slurm.cancel([job.job for job in live()])
    until(lambda: not live() and not processes_of_jobs(), "the end of all jobs")
    for node in slurm_cluster.run("sinfo", "-hN", "-t", "drain", "-p", "work", "-o", "%N").split():
        slurm_cluster.run("scontrol", "update", f"NodeName={node}", "State=RESUME")


def daemon_lives(testbed, name: str) -> bool:
    path = testbed.root / f"{name}.pid"
    return path.exists() and psutil.pid_exists(int(path.read_text()))


def profile_with(leads: str = "10:00", works: str = "10:00", jobs: int = 2, cores: int = 2, prologue: str = "") -> str:
    text = PROFILE.replace(LEADS, f'{leads}"}}\nworkers').replace(WORKS, f'walltime: "{works}", poll_s')
    text = text.replace("jobs: 2, cores: 2", f"jobs: {jobs}, cores: {cores}")
    return text + (f"prologue: [{json.dumps(prologue)}]\n" if prologue else "")


def prepare(folder: Path, profile: str = PROFILE, seconds: float = 0.3, base_samples: int = 8) -> Path:
    """A study whose solver also writes down each row when it begins; returns the study's path."""
    study = submission.prepare(folder, profile, seconds, base_samples)
    solver = folder / "solver"
    note = (
        'name = hashlib.md5(text.split("<Material>")[1].split("</Material>")[0].encode()).hexdigest()\n'
        f"os.write(os.open({str(folder / 'begun')!r}, os.O_WRONLY | os.O_APPEND | os.O_CREAT), (name + '\\n').encode())"
    )
    solver.write_text(solver.read_text().replace("time.sleep(", f"{note}\ntime.sleep("))
    return study


def begun(out: Path) -> list[int]:
    """Rows in the order in which solvers began with them."""
    study = next(path for path in (out.parent, out.parent.parent) if (path / "begun").exists()) / "study.yaml"
    model, template = read_study(study).tendon(), read_template(study.parent, None)
    table = open_store(out).tables()[0]
    specimen, times = Specimen("any", 10.0, 8.0, 4.0), np.array([0.0, 1.0, 2.0])
    rows = {}
    for row, values in enumerate(table.parameters(np.arange(len(table)))):
        text = render(template, model, specimen, times, 0.1 * times, values)
        material = text.split("<Material>")[1].split("</Material>")[0]
        rows[hashlib.md5(material.encode()).hexdigest()] = row
    return [rows[name] for name in study.with_name("begun").read_text().split()]


def moment(out: Path) -> tuple[set[int], int]:
    """Which rows are committed now, and how many solvers had begun."""
    rows = survival.committed(out)
    return rows, len(begun(out))


def progress(out: Path, rows: int = 8) -> tuple[set[int], int]:
    until(lambda: len(survival.committed(out)) >= rows, f"{rows} rows")
    return moment(out)


def processes_of_jobs(job: str | None = None) -> list[psutil.Process]:
    """What runs in the jobs of this testbed."""
    found = []
    for process in psutil.process_iter():
        with contextlib.suppress(psutil.Error):
            variables = process.environ()
            ours = variables.get("SLURM_CONF") == os.environ["SLURM_CONF"] and "SLURM_JOB_ID" in variables
            if ours and job in (None, variables["SLURM_JOB_ID"]):
                found.append(process)
    return found


def nothing_is_left(folder: Path) -> None:
    until(lambda: not live() and not processes_of_jobs(), "the end of all processes", 20)
    assert not survival.leftovers(folder / "solver")


def finished_well(out: Path, *moments: tuple[set[int], int]) -> None:
    """The study ends with every row ok, nothing committed computed again, and nothing left behind."""
    finish(out)
    nothing_is_left(next(path for path in (out.parent, out.parent.parent) if (path / "solver").exists()))
    assert not open_store(out).tables()[0].status.any()
    runs = begun(out)
    assert set(runs) == set(range(len(open_store(out).tables()[0])))
    for rows, count in moments:
        assert rows
        assert not [row for row in runs[count:] if row in rows], "committed rows were computed again"


def once(out: Path) -> None:
    again = {row: count for row, count in Counter(begun(out)).items() if count > 1}
    assert not again, "rows were begun more than once"


def events(out: Path) -> list[dict]:
    return [json.loads(line) for line in (out / "jobs" / "jobs.jsonl").read_text().splitlines()]


def leader(out: Path) -> str:
    return next(event["job"] for event in events(out) if event.get("role") == slurm.COORDINATOR)


def lives_of(out: Path, job: str) -> list[str]:
    return [event.get("end", event["event"]) for event in events(out) if event["job"] == job]


def worker_jobs(out: Path) -> list[slurm.JobRecord]:
    return [r for r in slurm.JobTable(out / "jobs").read().values() if r.role == slurm.WORKER]


def working(out: Path) -> list[slurm.QueuedJob]:
    """Worker jobs that run."""
    ours = {record.job for record in worker_jobs(out)}
    return [job for job in live() if job.job in ours and job.state == "RUNNING"]


def said_by_leader(out: Path) -> str:
    return "".join(path.read_text() for path in (out / "jobs").glob(f"*-{leader(out)}.log"))


def gave_up(testbed, out: Path, pattern: str) -> None:
    """The leading job ends with one clear line and exit code 2, and is not requeued; nothing is left behind."""
    until(lambda: not live(), "the end of all jobs", 600)
    said = said_by_leader(out)
    errors = [line for line in said.splitlines() if line.startswith("sinew: ")]
    assert len(errors) == 1, said
    assert re.search(pattern, errors[0]), said
    assert "Traceback" not in said
    shown = testbed.run("scontrol", "show", "job", leader(out))
    assert "JobState=FAILED" in shown
    assert "ExitCode=2:0" in shown
    assert "Restarts=0" in shown


def test_a_preempted_worker_job_is_replaced(tmp_path, slurm_cluster, bed):
    study = prepare(tmp_path, PROFILE.replace("workers: {", "workers: {partition: scavenge, "), seconds=0.5)
    out = submit(study)
    before = progress(out)
    victim = working(out)[0]
    urgent = ("-p", "urgent", "-w", victim.nodes, "-c", "2", "--mem=100", "--output=/dev/null", "--wrap", "sleep 5")
    slurm_cluster.run("sbatch", *urgent)
    finished_well(out, before)
    jobs = {record.job: record for record in worker_jobs(out)}
    assert jobs[victim.job].end == "PREEMPTED"
    assert any(record.submitted > jobs[victim.job].ended for record in jobs.values()), "it was not replaced"


def test_a_node_fails(tmp_path, slurm_cluster, bed):
    out = submit(prepare(tmp_path, seconds=0.5))
    before = progress(out)
    victim = working(out)[0]
    bed.fail_node(slurm_cluster, victim.nodes)
    finished_well(out, before)
    jobs = {record.job: record for record in worker_jobs(out)}
    assert jobs[victim.job].end == "NODE_FAIL"
    assert any(record.submitted > jobs[victim.job].ended for record in jobs.values()), "it was not replaced"
    bed.restore_node(slurm_cluster, victim.nodes)


def test_the_controller_is_away_for_a_while(tmp_path, slurm_cluster, bed):
    study = prepare(tmp_path, seconds=0.4, base_samples=16)
    out = submit(study)
    before = progress(out)
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


def test_the_controller_is_away_when_the_study_starts(tmp_path, slurm_cluster, bed):
    go = tmp_path / "go"
    wait = ONLY_LEADER.format(f"while [ ! -e {go} ]; do sleep 0.2; done")
    out = submit(prepare(tmp_path, profile_with(prologue=wait), seconds=0.1))
    leads = leader(out)
    until(lambda: live()[0].state == "RUNNING", "the start of the leading job")
    time.sleep(1.5)  # slurmctld saves what changed, but not twice within a second, and then after 5 s at most
    slurm_cluster.run("scontrol", "update", f"JobId={leads}", "Comment=runs")
    time.sleep(7)
    bed.kill_controller(slurm_cluster)
    go.touch()
    until(lambda: any("tasks.cli" in process.cmdline() for process in processes_of_jobs(leads)), "the leader's start")
    with contextlib.suppress(AssertionError):  # it may end, or try for a while
        until(lambda: not processes_of_jobs(leads), "the leader's end", 12)
    bed.start_controller(slurm_cluster)
    finished_well(out)


@pytest.mark.parametrize("how", ["requeued", "killed", "killed while the controller is away"])
def test_the_leading_job_is(tmp_path, slurm_cluster, bed, how):
    out = submit(prepare(tmp_path, seconds=0.5))
    before = progress(out)
    first, leads = [job.job for job in working(out)], leader(out)
    if how == "requeued":
        slurm_cluster.run("scontrol", "requeue", leads)
    else:
        python = [p for p in processes_of_jobs(leads) if "tasks.cli" in p.cmdline()]
        assert len(python) == 1
        away = how != "killed"
        if away:
            bed.kill_controller(slurm_cluster)
        python[0].kill()
        if away:
            time.sleep(8)
            bed.start_controller(slurm_cluster)
    until(lambda: lives_of(out, leads).count("started") == 2, "the second life")
    again = moment(out)
    until(lambda: any(job.job not in first for job in working(out)), "new worker jobs")
    until(lambda: not any(processes_of_jobs(job) for job in first), "the end of the first life's processes", 5)
    finished_well(out, before, again)
    assert all(record.ended for record in worker_jobs(out))
    assert lives_of(out, leads)[-1] == "done"


def test_the_leading_job_stops_before_its_walltime_and_goes_on(tmp_path, slurm_cluster, bed):
    study = prepare(tmp_path, profile_with(leads="1:00", jobs=1, cores=1), seconds=1.3, base_samples=2)
    out = submit(study)
    until(lambda: "its walltime was near" in lives_of(out, leader(out)), "the end of the first life")
    until(lambda: slurm.queue()[leader(out)].state == "PENDING", "its place in the queue")
    said = sinew("submit", study, "--profile", tmp_path / "profile.yaml", "--out", out, expect=2)
    assert f"SLURM job {leader(out)} (" in said, "what waits to go on leads already"
    finished_well(out)
    once(out)
    lives = lives_of(out, leader(out))
    assert lives[:4] == ["submitted", "started", "its walltime was near", "started"]
    assert lives[-1] == "done"


def test_worker_jobs_whose_walltime_is_too_short(tmp_path, slurm_cluster, bed):
    """However long they take to start."""
    profile = profile_with(works="1:00", jobs=1, cores=1, prologue=ONLY_WORKERS.format("sleep 12"))
    out = submit(prepare(tmp_path, profile, seconds=100, base_samples=2))
    gave_up(slurm_cluster, out, "the workers' walltime of 60 s is too short: one evaluation takes at least")
    nothing_is_left(tmp_path)


def test_a_leading_job_whose_walltime_is_too_short(tmp_path, slurm_cluster, bed):
    out = submit(prepare(tmp_path, profile_with(leads="1:00", jobs=1, cores=1), seconds=100, base_samples=2))
    gave_up(slurm_cluster, out, r"coordinator\.walltime: nothing finished within its walltime \(1:00\)")
    nothing_is_left(tmp_path)


def test_workers_that_come_just_before_the_leading_job_must_stop(tmp_path, slurm_cluster, bed):
    """They are not to blame for a walltime in which nothing finished: it waits in the queue again."""
    occupy = ["-p", "urgent", "-N", "3", "--exclusive", "--output=/dev/null", "--parsable", "--wrap", "sleep 600"]
    occupied = slurm_cluster.run("sbatch", *occupy).strip()
    out = submit(prepare(tmp_path, profile_with(leads="1:00", jobs=2), seconds=25, base_samples=2))
    until(lambda: lives_of(out, leader(out))[1:] == ["started"], "the start of the first life")
    time.sleep(41)  # of the 50 seconds before it must stop; with a quarter of 60 it would be to blame
    slurm_cluster.run("scancel", occupied)
    until(lambda: len(lives_of(out, leader(out))) > 2, "the end of the first life")
    assert lives_of(out, leader(out))[:3] == ["submitted", "started", "its walltime was near"], said_by_leader(out)
    until(lambda: slurm.queue()[leader(out)].state == "PENDING", "its place in the queue")
    assert f"job {leader(out)} " in sinew("cancel", out), "what waits to go on can be cancelled"
    nothing_is_left(tmp_path)


def test_worker_jobs_that_cannot_start(tmp_path, slurm_cluster, bed):
    out = submit(prepare(tmp_path, profile_with(prologue=ONLY_WORKERS.format("echo no solver here; exit 3"))))
    gave_up(slurm_cluster, out, r"worker job \d+ ended before it came to work: no solver here \(/.*-worker-\d+\.log\)")
    assert len(worker_jobs(out)) <= 8
    assert all(record.ended for record in worker_jobs(out))
    nothing_is_left(tmp_path)


@pytest.fixture
def disk(tmp_path):
    """A small file system of its own."""
    folder = tmp_path / "disk"
    folder.mkdir()
    if os.geteuid() or subprocess.run(["mount", "-t", "tmpfs", "-o", "size=16m", "tmpfs", folder]).returncode:
        pytest.skip("only root can mount a file system")
    yield folder
    for path in (folder / "out" / "journal", folder):
        subprocess.run(["umount", "--lazy", path], capture_output=True)


def fill(folder: Path) -> Path:
    path = folder / "filler"
    with contextlib.suppress(OSError), open(path, "wb", buffering=0) as file:
        while True:
            file.write(bytes(4096))
    return path


def test_a_full_disk(tmp_path, slurm_cluster, disk, bed):
    study = prepare(tmp_path, seconds=0.3)
    command = ("submit", study, "--profile", tmp_path / "profile.yaml", "--out", disk / "out")
    sinew(*command)
    out = disk / "out"
    before = progress(out)
    filler = fill(disk)
    gave_up(slurm_cluster, out, "no space left on the disk; free some and run the same command again")
    nothing_is_left(tmp_path)
    assert survival.committed(out) >= before[0]
    filler.unlink()
    sinew(*command)
    finished_well(out, before)


def test_a_disk_that_becomes_read_only(tmp_path, slurm_cluster, disk, bed):
    study = prepare(tmp_path, seconds=0.3)
    command = ("submit", study, "--profile", tmp_path / "profile.yaml", "--out", disk / "out")
    sinew(*command)
    out = disk / "out"
    before = progress(out)
    journal = out / "journal"
    subprocess.run(["mount", "--bind", journal, journal], check=True)
    mount = ["mount", "-o", "remount,bind,ro", journal]
    until(lambda: subprocess.run(mount, capture_output=True).returncode == 0, "a read-only journal", 60)
    gave_up(slurm_cluster, out, "Read-only file system")
    nothing_is_left(tmp_path)
    subprocess.run(["umount", journal], check=True)
    assert survival.committed(out) >= before[0]
    sinew(*command)
    finished_well(out, before)


def test_the_client_of_an_allocation_is_killed(tmp_path, slurm_cluster, bed):
    out = submit(prepare(tmp_path, ALLOCATION))
    before = progress(out)
    client = next(p for p in processes_of_jobs(leader(out)) if p.environ().get("SLURM_PROCID") == "1")
    client.kill()
    finished_well(out, before)
    assert lives_of(out, leader(out)) == ["submitted", "started", "started", "done"]


def test_an_allocation_that_is_too_short_for_everything(tmp_path, slurm_cluster, bed):
    profile = ALLOCATION.replace("10:00", "1:00").replace("tasks: 5", "tasks: 3")
    out = submit(prepare(tmp_path, profile, seconds=1.3, base_samples=2))
    finished_well(out)
    once(out)
    lives = lives_of(out, leader(out))
    assert lives[:4] == ["submitted", "started", "its walltime was near", "started"]
    assert lives[-1] == "done"
