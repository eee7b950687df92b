"""Studies on a real Grid Engine, and profiles that ask it for what it does not have."""

import json
from pathlib import Path

import pytest

from sinew.runner.cluster.batch_systems import BATCH_SYSTEMS
from sinew.runner.errors import BadInput
from sinew.runner.store.store import open_store
from sinew.tasks.cluster.profile import read_profile
from tests.runner.stores import contents
from tests.tasks.cluster.slurm_studies import JOB_SCRIPT, RunHere, prepare, sinew, until, worker_jobs

PROFILE = """
name: testbed
batch_system: grid_engine
interface: lo
coordinator: {memory: 4G, walltime: "10:00"}
workers: {jobs: 2, cores: 2, memory: 6G, walltime: "10:00", poll_s: 1}
"""


def submit(study: Path) -> Path:
    """Submit a study; returns its result folder."""
    sinew("submit", study, "--profile", study.parent / "profile.yaml", "--out", study.parent / "out")
    return study.parent / "out"


def live() -> list[str]:
    return [job.job for job in BATCH_SYSTEMS["grid_engine"].queue().values() if job.live]


@pytest.mark.takes(35)
def test_a_study_through_grid_engine(tmp_path, grid_engine_cluster):
    out = submit(prepare(tmp_path / "cluster", PROFILE + JOB_SCRIPT))
    here = RunHere(prepare(tmp_path / "here")).finished()
    until(lambda: not live(), "the end of all jobs", 200)
    assert (out / "sobol.json").exists()
    assert contents(out / "store.zarr") == contents(here / "store.zarr")
    status = json.loads(sinew("status", out, "--json"))
    assert {job["role"] for job in status["jobs"]} == {"coordinator", "worker"}
    assert {job["state"] for job in status["jobs"]} == {"done"}
    assert sum(job["rows"] for job in status["jobs"]) == len(open_store(out).tables()[0])


@pytest.mark.takes(20)
def test_a_second_submission_is_refused_and_cancel_ends_all_jobs(tmp_path, grid_engine_cluster):
    study = prepare(tmp_path, PROFILE, seconds=0.5)
    out = submit(study)
    until(lambda: len(worker_jobs(out)) == 2, "the worker jobs in the table of jobs", 120)
    said = sinew("submit", study, "--profile", tmp_path / "profile.yaml", "--out", out, expect=2)
    assert "Grid Engine job" in said
    assert "works on it already" in said
    sinew("cancel", out)
    until(lambda: not live(), "the end of all jobs", 60)


def test_a_refused_job_is_one_line_that_names_the_field(tmp_path, grid_engine_cluster):
    study = prepare(tmp_path, f"{PROFILE}partition: nowhere.q\n")
    said = sinew("submit", study, "--profile", tmp_path / "profile.yaml", "--out", tmp_path / "out", expect=2)
    assert "profile.yaml: partition: Grid Engine refuses the job (Job was rejected because job requests unknown" in said
    assert len(said.strip().splitlines()) == 1
    assert live() == []


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("mode: allocation", "mode: 'allocation' is not offered with Grid Engine; expected 'jobs'"),
        ("qos: high", "qos: 'high', but Grid Engine has no qos; expected"),
        ("directives: [--exclusive]", "directives.0: '--exclusive'; expected one option of qsub"),
        ("directives: ['-l a=1; id']", "directives.0: .*; expected one option of qsub"),
        ("directives: ['-N mine']", "directives.0: '-N mine' is for sinew to say; expected an option besides"),
    ],
)
def test_what_grid_engine_does_not_have_is_refused(tmp_path, line, words):
    path = tmp_path / "profile.yaml"
    path.write_text(f"{PROFILE}{line}\n")
    with pytest.raises(BadInput, match=words):
        read_profile(path)


def test_options_of_a_profile_become_options_of_qsub(tmp_path):
    path = tmp_path / "profile.yaml"
    path.write_text(f"{PROFILE}account: lab\npartition: long.q\ndirectives: ['-pe openmp 4', '-l mem_free=2G']\n")
    profile = read_profile(path)
    assert profile.options(profile.workers) == ("-P lab", "-q long.q", "-pe openmp 4", "-l mem_free=2G")
