"""Studies on a real SLURM: write, submit and follow them, and read what happened from their result folders."""

import contextlib
import io
import json
import os
import re
import shlex
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar
from unittest import mock

import numpy as np
import psutil

from sinew.runner.cluster import slurm
from sinew.runner.cluster.batch_system import QueuedJob
from sinew.runner.cluster.job_table import COORDINATOR, WORKER, JobRecord, JobTable
from sinew.runner.store.store import open_store
from sinew.tasks.cli.main import main
from sinew.tasks.model import Protocol, Specimen
from sinew.tasks.simulate.febio.simulator import FEBio
from sinew.tasks.simulate.febio.tendon import read_template
from sinew.tasks.study.model import model_of
from sinew.tasks.study.resources import resource
from sinew.tasks.study.study import read_study
from tests.batch import places
from tests.tasks import stand_in
from tests.tasks.stand_in import WITHOUT_FIGURES, committed
from tests.trusting import trusted

T = TypeVar("T")
JOB_SCRIPT = "job_script: job.sh.j2\n"  # in a profile: the leading job draws no figures
PROFILE = """
name: testbed
interface: lo
coordinator: {memory: 500M, walltime: "10:00"}
workers: {jobs: 2, cores: 2, memory: 1000M, walltime: "10:00", poll_s: 1}
"""
ALLOCATION = """
name: testbed
mode: allocation
interface: lo
allocation: {tasks: 4, memory: 500M, walltime: "10:00"}
"""


# ---- write and submit a study


def profile_with(leader: str = "10:00", worker: str = "10:00", jobs: int = 2, cores: int = 1, **fields: object) -> str:
    """A profile without figures: walltimes, the size of worker jobs, and further fields of the profile."""
    text = PROFILE.replace('500M, walltime: "10:00"', f'500M, walltime: "{leader}"')
    text = text.replace('1000M, walltime: "10:00"', f'1000M, walltime: "{worker}"')
    text = text.replace("jobs: 2, cores: 2", f"jobs: {jobs}, cores: {cores}")
    return text + JOB_SCRIPT + "".join(f"{name}: {json.dumps(value)}\n" for name, value in fields.items())


def prepare(folder: Path, profile: str = PROFILE, seconds: float = 0.02, base_samples: int = 8) -> Path:
    """A study on SLURM with the stand-in solver, and its profile; 16 rows for each base sample. Returns its path.

    ``seconds``: what each row takes.
    """
    folder.mkdir(exist_ok=True)
    study, _, _ = stand_in.prepare(folder, seconds, base_samples)
    text = study.read_text().replace(f"base_samples: {base_samples}", f"base_samples: {base_samples}, resamples: 20")
    study.write_text(text + "\ncluster: slurm\ncohort: cohort\ntasks: [sobol]\n")
    write_profile(folder, profile)
    return trusted(study)


def write_profile(folder: Path, profile: str) -> None:
    """A profile, and the script that leads without figures, for a profile that names it."""
    (folder / "profile.yaml").write_text(profile)
    command = f'{{{{ command | replace("-P -m sinew", "{shlex.quote(str(WITHOUT_FIGURES))}") }}}}'
    script = resource("templates/job.sh.j2").read_text()
    assert script.count("{{ command }}") == 1
    (folder / "job.sh.j2").write_text(script.replace("{{ command }}", command))


def sinew(*words: object, expect: int = 0) -> str:
    """Run the command in this process; what it prints, or its errors when it is expected to fail."""
    out, err, code = io.StringIO(), io.StringIO(), 0
    arguments = mock.patch.object(sys, "argv", ["sinew", *map(str, words)])
    with arguments, contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            main()
        except SystemExit as stopped:
            code = int(stopped.code or 0)
    assert code == expect, out.getvalue() + err.getvalue()
    return (err if expect else out).getvalue()


def sinew_process(*words: object, expect: int = 0) -> str:
    """The same with a process of its own, as users run it."""
    command = [sys.executable, "-m", "sinew", *map(str, words)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=400)
    assert done.returncode == expect, done.stdout + done.stderr
    return done.stderr if expect else done.stdout


def submit(study: Path, out: Path | None = None, *, at_once: bool = False) -> Path:
    """Submit a study and wait until its solver runs; returns its result folder, which is beside it unless given.

    ``at_once``: do not wait.
    """
    out = out or study.parent / "out"
    command = ("submit", study, "--profile", study.parent / "profile.yaml", "--out", out)
    if at_once:
        sinew(*command)
        return out
    runs = study.with_name("begun")
    with places.a_place():
        before = runs.stat().st_size if runs.exists() else 0
        sinew(*command)
        until(lambda: (runs.exists() and runs.stat().st_size > before) or not live(), "the first run of the solver")
    return out


class RunHere:
    """The same study in one process of this machine, in the background and without accidents."""

    def __init__(self, study: Path) -> None:
        """``study``: a study for SLURM."""
        self.out = study.parent / "here" / "out"
        self.out.parent.mkdir()
        self.errors = self.out.with_name("errors")
        local = study.with_name("local.yaml")
        local.write_text(study.read_text().replace("cluster: slurm", "cluster: {name: local, workers: 1}"))
        command = [sys.executable, WITHOUT_FIGURES, "run", trusted(local), "--out", self.out, "--quiet"]
        with open(self.errors, "wb") as errors:
            here = os.environ | {"SINEW_TESTS_ONE_PROCESS": "1"}
            self.process = subprocess.Popen(command, stdout=errors, stderr=errors, env=here)

    def finished(self) -> Path:
        """Wait for its end; returns its result folder."""
        assert self.process.wait(600) == 0, self.errors.read_text()
        return self.out


# ---- follow a study


def until(condition: Callable[[], T], what: str, seconds: float = 600.0) -> T:
    """Wait until a condition holds; returns what it gave. The limit is for what hangs, not for what is slow.

    What comes soon is seen soon. Whoever waits for long asks less often: asking costs more than a study's solvers.
    """
    began = time.monotonic()
    while not (found := condition()):
        waited = time.monotonic() - began
        assert waited < seconds, f"{what} did not happen within {seconds} s"
        time.sleep(min(0.2 + 0.05 * waited, 1.0))
    return found


def live() -> list[QueuedJob]:
    """All jobs that wait or run."""
    return [job for job in slurm.queue().values() if job.live]


def processes_of_jobs(job: str | None = None) -> list[psutil.Process]:
    """What runs in the jobs of this SLURM, or in one of them."""
    found = []
    for process in psutil.process_iter():
        with contextlib.suppress(psutil.Error):
            variables = process.environ()
            ours = variables.get("SLURM_CONF") == os.environ["SLURM_CONF"] and "SLURM_JOB_ID" in variables
            if ours and job in (None, variables["SLURM_JOB_ID"]):
                found.append(process)
    return found


def leading_processes(study: Path) -> list[psutil.Process]:
    """The Python processes of the job that leads a study; an allocation has one for each of its tasks."""
    found = []
    for process in processes_of_jobs():
        with contextlib.suppress(psutil.Error):
            words = process.cmdline()
            if words[:1] == [sys.executable] and "run" in words and str(study) in words:
                found.append(process)
    return found


Moment = tuple[set[int], int]


def moment(out: Path) -> Moment:
    """Which rows are committed now, and how many runs of the solver had begun."""
    rows = committed(out)
    return rows, len(begun(out))


def progress(out: Path, rows: int = 8) -> Moment:
    """Wait until so many rows are committed."""
    until(lambda: len(committed(out)) >= rows, f"the commit of {rows} rows")
    return moment(out)


# ---- what happened


def study_of(out: Path) -> Path:
    """The study of a result folder, which is one or two folders above it."""
    return next(path for path in (out.parent, out.parent.parent) if (path / "solver").exists()) / "study.yaml"


def begun(out: Path) -> list[int]:
    """The rows in the order in which runs of the solver began."""
    study = study_of(out)
    model = model_of(read_study(study).model, "tendon")
    solver = FEBio("none", "none", read_template(study.parent, None), out)
    table = open_store(out).tables()[0]
    specimen, times = Specimen("any", 10.0, 8.0, 4.0), np.array([0.0, 1.0, 2.0])
    protocol = Protocol("any", times, 0.1 * times)
    rows = {}
    for row, values in enumerate(table.parameters(np.arange(len(table)))):
        text = solver.rendered(model, specimen, protocol, values)
        material = text.split("<Material>")[1].split("</Material>")[0]
        rows[stand_in.named(material)] = row
    return [rows[name] for name in study.with_name("begun").read_text().split()]


def log_of(out: Path) -> str:
    """What all jobs of a study printed."""
    return "\n".join(path.read_text(errors="replace") for path in sorted((out / "jobs").glob("*.log")))


def events(out: Path) -> list[dict[str, object]]:
    """What the table of jobs says, line by line."""
    return [json.loads(line) for line in (out / "jobs" / "jobs.jsonl").read_text().splitlines()]


def leader(out: Path) -> str:
    """The number of the job that leads."""
    return next(str(event["job"]) for event in events(out) if event.get("role") == COORDINATOR)


def lives_of(out: Path, job: str) -> list[object]:
    """What happened to a job: each event, or how it ended."""
    return [event.get("end", event["event"]) for event in events(out) if event["job"] == job]


def worker_jobs(out: Path) -> list[JobRecord]:
    """All worker jobs that the table of jobs knows."""
    return [r for r in JobTable(out / "jobs").read().values() if r.role == WORKER]


def working(out: Path) -> list[QueuedJob]:
    """Worker jobs that run."""
    ours = {record.job for record in worker_jobs(out)}
    return [job for job in live() if job.job in ours and job.state == "RUNNING"]


def said_by_leader(out: Path) -> str:
    """What the leading job printed, in all of its lives."""
    return "".join(path.read_text() for path in (out / "jobs").glob(f"*-{leader(out)}.log"))


# ---- how it must end


def finish(out: Path) -> None:
    """Wait for the end of all jobs; the study has its result."""
    until(lambda: not live(), "the end of all jobs")
    assert (out / "sobol.json").exists(), log_of(out)


def nothing_is_left(out: Path) -> None:
    """No job and no process of a job is left."""
    until(lambda: not live() and not processes_of_jobs(), "the end of all processes", 120)
    assert not stand_in.leftovers(study_of(out).with_name("solver"))


def finished_well(out: Path, *moments: Moment) -> None:
    """The study ends with every row ok, no committed row computed again, and nothing left behind."""
    finish(out)
    nothing_is_left(out)
    table = open_store(out).tables()[0]
    assert not table.status.any()
    runs = begun(out)
    assert set(runs) == set(range(len(table)))
    for rows, count in moments:
        assert rows
        assert not [row for row in runs[count:] if row in rows], "committed rows were computed again"


def once(out: Path) -> None:
    """No row was begun twice."""
    again = {row: count for row, count in Counter(begun(out)).items() if count > 1}
    assert not again, "rows were begun more than once"


def gave_up(out: Path, pattern: str, *, late_workers: bool = False) -> None:
    """The leading job ends with one clear line and exit code 2, and is not requeued; nothing is left behind.

    With ``late_workers``, it may have been requeued before, where workers of a slow machine came too late to be judged.
    """
    until(lambda: not live(), "the end of all jobs")
    said = said_by_leader(out)
    lines = [line for line in said.splitlines() if line.startswith("sinew: ")]
    late = [line for line in lines if late_workers and line.startswith("sinew: the walltime is near: 0 of ")]
    errors = [line for line in lines if line not in late]
    assert len(errors) == 1, said
    assert re.search(pattern, errors[0]), said
    assert "Traceback" not in said
    command = ["scontrol", "show", "job", leader(out)]
    shown = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert "JobState=FAILED" in shown
    assert "ExitCode=2:0" in shown
    assert f"Restarts={len(late)}" in shown
    nothing_is_left(out)
