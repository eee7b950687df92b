"""Studies on a real SLURM: submitted, followed, refused, cancelled; the same bytes as on a laptop."""

import csv
import json
import re
import stat
from pathlib import Path

import pytest
from distributed import Client

from sinew.runner.errors import ClusterError
from sinew.runner.store.store import open_store
from sinew.tasks.cluster import submission
from sinew.tasks.cluster.profile import read_profile
from sinew.tasks.cluster.submission import check_scripts, job_scripts
from sinew.tasks.data.cohort import write_cohort
from sinew.tasks.data.virtual import virtual_cohort
from sinew.tasks.study.study import read_study
from tests.runner.stores import contents
from tests.tasks.cluster.slurm_studies import (
    ALLOCATION,
    JOB_SCRIPT,
    PROFILE,
    RunHere,
    finish,
    live,
    log_of,
    nothing_is_left,
    prepare,
    profile_with,
    sinew,
    sinew_process,
    submit,
    until,
    write_profile,
)
from tests.tasks.stand_in import leftovers
from tests.trusting import trusted


@pytest.mark.takes(45)
def test_a_study_through_slurm(tmp_path, slurm_cluster):
    """As worker jobs, submitted by the command that users type, and in one allocation: the same bytes as here."""
    studies = {"jobs": prepare(tmp_path / "jobs"), "allocation": prepare(tmp_path / "allocation", ALLOCATION)}
    jobs, allocation = (study.parent / "out" for study in studies.values())
    profile = tmp_path / "jobs" / "profile.yaml"
    sinew_process("submit", studies["jobs"], "--profile", profile, "--out", jobs)
    submit(studies["allocation"], at_once=True)
    here = RunHere(prepare(tmp_path / "calm"))
    for out in (jobs, allocation):
        finish(out)
        assert (out / "figures" / "sobol.pdf").exists()
        assert (out / "report.html").exists()
        assert not list((out / "jobs").glob("certificate*")), "the keys of a run end with it"
        assert not leftovers(out.with_name("solver"))
        the_status_says_who_did_what(out)
    expected = contents(here.finished() / "store.zarr")
    assert contents(jobs / "store.zarr") == expected
    assert contents(allocation / "store.zarr") == expected


def the_status_says_who_did_what(out: Path) -> None:
    """Each row belongs to a job of the study."""
    status = json.loads(sinew("status", out, "--json"))
    rows = len(open_store(out).tables()[0])
    assert status["tables"][0]["done"] == rows
    assert {job["role"] for job in status["jobs"]} <= {"coordinator", "worker"}
    assert sum(job["rows"] for job in status["jobs"]) == rows
    assert {job["state"] for job in status["jobs"]} == {"done"}
    assert status["core_hours"]["jobs"] > status["core_hours"]["evaluations"] > 0
    lines = list(csv.DictReader(sinew("status", out, "--rows").splitlines()))
    assert [int(line["row"]) for line in lines] == list(range(rows))
    assert {line["node"] for line in lines} <= {"n1", "n2", "n3", "n4"}
    assert {line["job"] for line in lines} <= {job["job"] for job in status["jobs"]}


@pytest.mark.takes(70)
@pytest.mark.thorough
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
infer: {{paper: true, population: 8, generations: 2, epsilon: 0.6, pending: 8}}
compare: {{permutations: 20}}
cluster: slurm
"""
    specimens, truth = virtual_cohort(seed=1, per_site=2, rate_hz=1.0)
    write_cohort(tmp_path / "cohort", [one for one in specimens if one.site != "middle"], truth)
    write_profile(tmp_path, PROFILE.replace("memory: 500M", "memory: 1500M") + JOB_SCRIPT)
    study = tmp_path / "study.yaml"
    study.write_text(text)
    out = submit(study, at_once=True)
    here = RunHere(study).finished()
    until(lambda: not live(), "the end of all jobs")
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


@pytest.mark.takes(55)
def test_one_study_while_it_runs(tmp_path, slurm_cluster):
    """Strangers are refused, keys are private, a second coordinator is refused, status tells, cancel ends all."""
    study = prepare(tmp_path, profile_with(), seconds=2.0)
    out = submit(study)
    address = until(lambda: scheduler_of(out), "the start of the scheduler")
    assert address.startswith("tls://127.0.0.1:")
    with pytest.raises((OSError, TypeError, ValueError, RuntimeError)):
        Client(address, timeout="3 s", set_as_default=False)
    keys = out / "jobs" / "certificate"
    assert stat.S_IMODE(keys.stat().st_mode) == 0o700
    assert {stat.S_IMODE(path.stat().st_mode) for path in keys.iterdir()} == {0o600}

    leader = next(job.job for job in live() if not job.name.endswith("worker"))
    a_second_coordinator_is_refused(study, out, leader)
    until(lambda: json.loads(sinew("status", out, "--json"))["tables"][0]["done"] > 4, "the commit of 5 rows")
    status_and_watch_show_it(out)
    assert "127.0.0.1" in log_of(out), "how to reach the dashboard"
    assert "ssh -N -L" in log_of(out)

    assert f"job {leader}" in sinew("cancel", out)
    nothing_is_left(out)  # a job is no longer live once it is signalled, while its processes still clean up
    assert not keys.exists()
    assert json.loads(sinew("watch", out, "--once", "--json"))["state"] == "interrupted"
    done = json.loads(sinew("status", out, "--json"))["tables"][0]["done"]
    it_goes_on(study, out, done)
    assert "0 jobs cancelled" in sinew("cancel", out)


def a_second_coordinator_is_refused(study: Path, out: Path, leader: str) -> None:
    profile = study.with_name("profile.yaml")
    said = sinew("submit", study, "--profile", profile, "--out", out, expect=2)
    assert re.fullmatch(rf"sinew: \S+out: SLURM job {leader} \(RUNNING on n\d\) works on it already; .*\n", said)
    said = sinew("run", study, "--profile", profile, "--out", out, expect=2)
    assert f"SLURM job {leader}" in said
    local = study.with_name("local.yaml")
    local.write_text(study.read_text().replace("cluster: slurm", "cluster: local"))
    said = sinew("run", trusted(local), "--out", out, expect=2)
    assert "in use by process" in said
    assert f"SLURM job {leader}" in said


def status_and_watch_show_it(out: Path) -> None:
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


def it_goes_on(study: Path, out: Path, done: int) -> None:
    """Submitted again, it ends, and computes nothing again of the rows that were ``done``."""
    notes, solver = study.with_name("notes"), study.with_name("solver")
    before = len(notes.read_text().splitlines())
    solver.write_text(solver.read_text().replace("time.sleep(2.0)", "time.sleep(0.05)"))
    finish(submit(trusted(study)))
    again = len(notes.read_text().splitlines()) - before
    assert again <= len(open_store(out).tables()[0]) - done, "what was finished is not computed again"


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
    study = read_study(prepare(tmp_path, "\n".join([*kept, change, ""])))
    profile = read_profile(tmp_path / "profile.yaml")
    with pytest.raises(ClusterError) as refused:
        check_scripts(profile, job_scripts(study, profile, tmp_path / "out", ()))
    said = str(refused.value)
    assert said.startswith(f"{profile.path}: {field}: SLURM refuses the job (")
    assert words in said.lower()
    assert said.endswith("nothing was submitted")


@pytest.mark.takes(3)
def test_a_refused_study_is_one_line_and_nothing_is_submitted(tmp_path, slurm_cluster):
    study = prepare(tmp_path, PROFILE + "partition: nowhere\n")
    arguments = ("submit", study, "--profile", tmp_path / "profile.yaml", "--out", tmp_path / "out")
    said = sinew_process(*arguments, expect=2)
    assert said.startswith(f"sinew: {tmp_path / 'profile.yaml'}: partition: SLURM refuses the job (")
    assert said.count("\n") == 1
    assert not live()
    assert not (tmp_path / "out").exists()


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


def test_the_job_script_can_be_edited(tmp_path):
    study = prepare(tmp_path, PROFILE + "job_script: mine.sh.j2\n")
    (tmp_path / "mine.sh.j2").write_text("#!/bin/sh\n# hello {{ name }}\n{{ command }}\n")
    arguments = ("submit", study, "--profile", tmp_path / "profile.yaml", "--out", tmp_path / "out", "--dry-run")
    assert re.match(r"#!/bin/sh\n# hello sinew-survival-[0-9a-f]{10}\n/", sinew(*arguments))
    (tmp_path / "mine.sh.j2").write_text("#!/bin/sh\n{{ nothing }}\n")
    assert "mine.sh.j2: 'nothing' is undefined; expected a Jinja2 template" in sinew(*arguments, expect=2)


def test_only_results_count_as_finished_work(tmp_path):
    before = submission._finished(tmp_path)
    for name in ("progress.json", "ranges.json", "simulate.json"):
        (tmp_path / name).write_text("{}")
    assert submission._finished(tmp_path) == before
    (tmp_path / "sobol.json").write_text("{}")
    assert submission._finished(tmp_path) != before


def test_what_a_task_keeps_counts_as_finished_work(tmp_path):
    kept = tmp_path / "discover" / "distal-1.fits.jsonl"
    kept.parent.mkdir()
    kept.write_text("{}\n")
    before = submission._finished(tmp_path)
    kept.write_text("{}\n[1.0]\n")
    assert submission._finished(tmp_path) != before


def test_a_state_of_a_run_that_goes_on_later_counts_as_finished_work(tmp_path):
    before = submission._finished(tmp_path)
    state = tmp_path / "attempts" / "states" / "0a.state"
    state.parent.mkdir(parents=True)
    state.write_text("x")
    assert submission._finished(tmp_path) != before
