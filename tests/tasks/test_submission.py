"""Studies on a real SLURM: submitted, followed, refused, cancelled; the same bytes as on a laptop."""

import csv
import json
import re
import stat
import subprocess
import sys
import time
from pathlib import Path

import pytest
from distributed import Client

from runner import slurm
from runner.store import open_store
from tasks.cohort import virtual_cohort, write_cohort
from tests.runner.test_store import contents
from tests.tasks import test_survival as survival

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
allocation: {tasks: 5, memory: 500M, walltime: "10:00"}
"""


def prepare(folder: Path, profile: str = PROFILE, seconds: float = 0.02, base_samples: int = 8) -> Path:
    """A study on SLURM with a stand-in solver, and its profile; returns the study's path."""
    folder.mkdir(exist_ok=True)
    study, _, _ = survival.prepare(folder)
    text = study.read_text().replace("base_samples: 32", f"base_samples: {base_samples}, resamples: 20")
    study.write_text(text + "\ncluster: slurm\ncohort: cohort\ntasks: [sobol]\n")
    solver = folder / "solver"
    solver.write_text(solver.read_text().replace("time.sleep(0.02)", f"time.sleep({seconds})"))
    (folder / "profile.yaml").write_text(profile)
    return study


def sinew(*words: str | Path, expect: int = 0) -> str:
    """What the command prints; its errors when it is expected to fail."""
    command = [sys.executable, "-m", "tasks.cli", *map(str, words)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=400)
    assert done.returncode == expect, done.stdout + done.stderr
    return done.stdout if expect == 0 else done.stderr


def submit(study: Path, *words: str | Path) -> Path:
    """Submit a study; returns its result folder."""
    out = study.parent / "out"
    sinew("submit", study, "--profile", study.parent / "profile.yaml", "--out", out, *words)
    return out


def until(condition, what: str, seconds: float = 300.0):
    """Wait until a condition holds; returns what it gave. The limit is for what hangs, not for what is slow."""
    end = time.monotonic() + seconds
    while not (found := condition()):
        assert time.monotonic() < end, f"{what} did not happen within {seconds} s"
        time.sleep(0.2)
    return found


def live() -> list[slurm.QueuedJob]:
    return [job for job in slurm.queue().values() if job.live]


def log_of(out: Path) -> str:
    return "\n".join(path.read_text(errors="replace") for path in sorted((out / "jobs").glob("*.log")))


def finish(out: Path) -> None:
    until(lambda: not live(), "the end of all jobs", 600)
    assert (out / "sobol.json").exists(), log_of(out)


@pytest.mark.parametrize("profile", [PROFILE, ALLOCATION], ids=["jobs", "allocation"])
def test_a_study_through_slurm(tmp_path, slurm_cluster, profile):
    study = prepare(tmp_path / "slurm", profile)
    out = submit(study)
    finish(out)
    calm = prepare(tmp_path / "here")
    calm.write_text(calm.read_text().replace("cluster: slurm", "cluster: {name: local, workers: 1}"))
    sinew("run", calm, "--out", tmp_path / "here" / "out", "--quiet")
    assert contents(out / "store.zarr") == contents(tmp_path / "here" / "out" / "store.zarr")

    status = json.loads(sinew("status", out, "--json"))
    rows = len(open_store(out).tables()[0])
    assert status["tables"][0]["done"] == rows
    assert {job["role"] for job in status["jobs"]} <= {"coordinator", "worker"}
    assert sum(job["rows"] for job in status["jobs"]) == rows, "each row belongs to a job"
    assert {job["state"] for job in status["jobs"]} == {"done"}
    assert status["core_hours"]["jobs"] > status["core_hours"]["evaluations"] > 0
    told = list(csv.DictReader(sinew("status", out, "--rows").splitlines()))
    assert [int(line["row"]) for line in told] == list(range(rows))
    assert {line["node"] for line in told} <= {"n1", "n2", "n3", "n4"}
    assert {line["job"] for line in told} <= {job["job"] for job in status["jobs"]}
    assert not list((out / "jobs").glob("certificate*")), "the keys of a run end with it"
    assert not survival.leftovers(tmp_path / "slurm" / "solver")


def test_the_whole_pipeline_through_slurm(tmp_path, slurm_cluster):
    """Tasks that ask step by step, from Sobol to the comparison of sites: the same bytes as on this machine."""
    tasks = "[sobol, importance, calibrate, infer, predict, compare]"
    text = f"""
name: pipeline
seed: 5
cohort: cohort
tasks: {tasks}
sobol: {{base_samples: 16, resamples: 20, specimens: [distal/1]}}
importance: {{trees: 10, repeats: 2}}
calibrate: {{evaluations: 60, starts: 1, bayesian: {{evaluations: 14, initial: 10}}}}
infer: {{population: 8, generations: 2, epsilon: 0.6, pending: 8}}
compare: {{permutations: 20}}
cluster: slurm
"""
    specimens, truth = virtual_cohort(seed=1, per_site=2, rate_hz=1.0)
    write_cohort(tmp_path / "cohort", [one for one in specimens if one.site != "middle"], truth)
    study = tmp_path / "study.yaml"
    study.write_text(text)
    (tmp_path / "profile.yaml").write_text(PROFILE.replace("memory: 500M", "memory: 1500M"))
    out = submit(study)
    local = tmp_path / "local.yaml"
    local.write_text(text.replace("cluster: slurm", "cluster: {name: local, workers: 1}"))
    here = tmp_path / "here"
    sinew("run", local, "--out", here, "--quiet")
    until(lambda: not live(), "the end of all jobs", 600)
    assert (out / "compare.json").exists(), log_of(out)
    for name in ("sobol", "importance", "calibrate", "infer", "predict", "compare"):
        assert (out / f"{name}.json").read_bytes() == (here / f"{name}.json").read_bytes(), name
    assert contents(out / "store.zarr") == contents(here / "store.zarr")


def scheduler_of(out: Path) -> str | None:
    path = out / "log.jsonl"
    for line in path.read_text().splitlines() if path.exists() else ():
        if "scheduler" in (said := json.loads(line)):
            return said["scheduler"]
    return None


def test_one_study_while_it_runs(tmp_path, slurm_cluster):
    """Strangers are refused, keys are private, a second coordinator is refused, status tells, cancel ends all."""
    study = prepare(tmp_path, seconds=2.0)
    out = submit(study)
    address = until(lambda: scheduler_of(out), "the start of the scheduler")
    assert address.startswith("tls://127.0.0.1:")
    with pytest.raises((OSError, TypeError, ValueError, RuntimeError)):
        Client(address, timeout="3 s", set_as_default=False)
    folder = out / "jobs" / "certificate"
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    assert {stat.S_IMODE(path.stat().st_mode) for path in folder.iterdir()} == {0o600}

    leader = next(job for job in live() if not job.name.endswith("worker"))
    said = sinew("submit", study, "--profile", tmp_path / "profile.yaml", "--out", out, expect=2)
    assert re.fullmatch(rf"sinew: \S+out: SLURM job {leader.job} \(RUNNING on n\d\) works on it already; .*\n", said)
    said = sinew("run", study, "--profile", tmp_path / "profile.yaml", "--out", out, expect=2)
    assert f"SLURM job {leader.job}" in said
    local = tmp_path / "local.yaml"
    local.write_text(study.read_text().replace("cluster: slurm", "cluster: local"))
    said = sinew("run", local, "--out", out, expect=2)
    assert "in use by process" in said
    assert f"SLURM job {leader.job}" in said

    until(lambda: json.loads(sinew("status", out, "--json"))["tables"][0]["done"] > 4, "progress")
    status = json.loads(sinew("status", out, "--json"))
    assert status["now"]["alive"]
    assert status["now"]["running"] > 0
    assert status["now"]["rows_per_s"] > 0
    assert "running" in sinew("status", out)
    seen = json.loads(sinew("watch", out, "--once", "--json"))
    assert seen["state"] == "running"
    assert seen["rows"][0]["done"] >= status["tables"][0]["done"]
    assert seen["jobs"]["running"] > 1
    assert seen["dashboard"].startswith("http://127.0.0.1:"), "the scheduler is on this machine"
    assert "sobol" in sinew("watch", out, "--once")
    assert "127.0.0.1" in log_of(out), "how to reach the dashboard"
    assert "ssh -N -L" in log_of(out)

    assert f"job {leader.job}" in sinew("cancel", out)
    until(lambda: not live(), "the end of all jobs", 120)
    done = json.loads(sinew("status", out, "--json"))["tables"][0]["done"]
    assert done >= status["tables"][0]["done"]
    until(lambda: not survival.leftovers(tmp_path / "solver"), "the end of all solvers", 10)
    assert not folder.exists()
    assert json.loads(sinew("watch", out, "--once", "--json"))["state"] == "interrupted"
    before = len((tmp_path / "notes").read_text().splitlines())
    solver = tmp_path / "solver"
    solver.write_text(solver.read_text().replace("time.sleep(2.0)", "time.sleep(0.05)"))
    finish(submit(study))
    again = len((tmp_path / "notes").read_text().splitlines()) - before
    assert again <= len(open_store(out).tables()[0]) - done, "what was finished is not computed again"
    assert "0 jobs cancelled" in sinew("cancel", out)


@pytest.mark.parametrize(
    ("change", "field", "words"),
    [
        ("partition: nowhere", "partition", "partition"),
        ("partition: lab\naccount: nobody", "account", "account"),
        ("qos: golden", "qos", "qos"),
        ("constraint: quantum", "constraint", "feature"),
        ("directives: [--reservation=mine]", "directives", "reservation"),
        ("workers: {cores: 1, memory: 900G}", "workers.memory", ""),
        ("workers: {cores: 64}", "workers.cores", ""),
        ('partition: short\nworkers: {cores: 1, walltime: "10:00"}', "workers.walltime", "time limit"),
        ("workers: {cores: 1, memory: 500M, partition: nowhere}", "workers.partition", "partition"),
        ("coordinator: {partition: nowhere}\nworkers: {cores: 1, memory: 500M}", "coordinator.partition", "partition"),
    ],
)
def test_what_slurm_refuses_is_one_line_that_names_the_field(tmp_path, slurm_cluster, change, field, words):
    keys = [line.partition(":")[0] for line in change.splitlines()]
    kept = [line for line in PROFILE.splitlines() if line.partition(":")[0] not in keys]
    study = prepare(tmp_path, "\n".join([*kept, change, ""]))
    arguments = ("submit", study, "--profile", tmp_path / "profile.yaml", "--out", tmp_path / "out")
    said = sinew(*arguments, expect=2)
    assert said.count("\n") == 1
    assert f"profile.yaml: {field}: SLURM refuses the job (" in said
    assert words in said.lower()
    assert "nothing was submitted" in said
    assert not live()


def test_a_dry_run_prints_both_scripts_and_submits_nothing(tmp_path, slurm_cluster):
    study = prepare(tmp_path, PROFILE + "modules: [febio/4]\nprologue: ['export A=1']\nscratch: $TMPDIR\n")
    arguments = ("submit", study, "--profile", tmp_path / "profile.yaml", "--out", tmp_path / "out", "--dry-run")
    said = sinew(*arguments)
    for line in ("#SBATCH --time=0:10:00", "module load febio/4", "export A=1", "export SINEW_WALLTIME=600"):
        assert said.count(f"{line}\n") == (1 if line.startswith("#") else 2)
    assert "#SBATCH --requeue" in said
    assert "#SBATCH --no-requeue" in said
    assert 'SINEW_SCRATCH="$TMPDIR/sinew-$SLURM_JOB_ID"' in said
    assert not live()
    assert not (tmp_path / "out").exists()


def test_the_job_script_can_be_edited(tmp_path, slurm_cluster):
    study = prepare(tmp_path, PROFILE + "job_script: mine.sh.j2\n")
    (tmp_path / "mine.sh.j2").write_text("#!/bin/sh\n# hello {{ name }}\n{{ command }}\n")
    arguments = ("submit", study, "--profile", tmp_path / "profile.yaml", "--out", tmp_path / "out", "--dry-run")
    assert sinew(*arguments).startswith("#!/bin/sh\n# hello sinew-survival\n/")
    (tmp_path / "mine.sh.j2").write_text("#!/bin/sh\n{{ nothing }}\n")
    assert "mine.sh.j2: 'nothing' is undefined; expected a Jinja2 template" in sinew(*arguments, expect=2)
