"""SLURM's commands and answers, without a SLURM."""

import pytest

from sinew.runner.cluster import batch_system, slurm
from sinew.runner.cluster.batch_system import QueuedJob, Refused
from sinew.runner.errors import ClusterError


@pytest.mark.parametrize(
    ("words", "field"),
    [
        ("Batch job submission failed: Invalid partition name specified", "partition"),
        ("allocation failure: Invalid account or account/partition combination specified", "account"),
        ("allocation failure: Memory specification can not be satisfied", "memory"),
        ("allocation failure: Requested time limit is invalid (missing or exceeds some limit)", "walltime"),
        ("allocation failure: Requested node configuration is not available", "cores"),
        ("Invalid qos specification", "qos"),
        ("Invalid feature specification", "constraint"),
        ("Requested reservation is invalid", "directives"),
        ("something nobody thought of", None),
    ],
)
def test_a_refusal_names_what_is_refused(words, field):
    assert slurm.commands.refused(words).field == field


def test_without_slurm_there_is_one_clear_line(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(ClusterError, match="sbatch was not found; run this on a login node"):
        slurm.submit(tmp_path / "job.sh")


def fake(folder, name: str, script: str) -> None:
    path = folder / name
    path.write_text(f"#!/bin/sh\n{script}\n")
    path.chmod(0o755)


def test_a_controller_that_is_away_is_no_refusal(tmp_path, monkeypatch):
    fake(tmp_path, "sbatch", "echo 'sbatch: error: Unable to contact slurm controller (connect failure)' >&2; exit 1")
    monkeypatch.setenv("PATH", f"{tmp_path}:/bin:/usr/bin")
    with pytest.raises(ClusterError, match="controller does not answer") as raised:
        slurm.submit(tmp_path / "job.sh")
    assert not isinstance(raised.value, Refused)


def test_what_a_site_prints_before_the_number_of_a_job_does_no_harm(tmp_path, monkeypatch):
    fake(tmp_path, "sbatch", "echo 'Welcome to the cluster'; echo '4711;cluster'")
    monkeypatch.setenv("PATH", f"{tmp_path}:/bin:/usr/bin")
    assert slurm.submit(tmp_path / "job.sh") == "4711"


def test_a_command_that_hangs_is_given_up(tmp_path, monkeypatch):
    fake(tmp_path, "squeue", "exec sleep 60")
    monkeypatch.setenv("PATH", f"{tmp_path}:/bin:/usr/bin")
    monkeypatch.setattr(batch_system, "COMMAND_TIMEOUT_S", 0.3)
    with pytest.raises(ClusterError, match=r"squeue gave no answer within 0\.3 s"):
        slurm.queue()


def test_the_numbers_of_the_own_job_do_not_reach_the_next(tmp_path, monkeypatch):
    fake(tmp_path, "sbatch", "env | grep -c -E '^(SLURM_|SLURMD_|SINEW_)' >&2; exit 1")
    monkeypatch.setenv("PATH", f"{tmp_path}:/bin:/usr/bin")
    monkeypatch.setenv("SLURM_CONF", "/etc/slurm.conf")
    for name in ("SLURM_JOB_ID", "SLURM_MEM_PER_NODE", "SLURMD_NODENAME", "SINEW_DEADLINE"):
        monkeypatch.setenv(name, "1")
    with pytest.raises(Refused, match=r"SLURM refuses the job: 1$"):
        slurm.submit(tmp_path / "job.sh")


def test_queue_reads_what_squeue_prints(tmp_path, monkeypatch):
    fake(tmp_path, "squeue", "printf '12|RUNNING|None|n[1-2]|sinew-a|b\\n13|COMPLETED|None|n1|sinew-a\\nnoise\\n'")
    monkeypatch.setenv("PATH", f"{tmp_path}:/bin:/usr/bin")
    assert slurm.queue(["12"]) == {
        "12": QueuedJob("12", "RUNNING", "None", "n[1-2]", "sinew-a|b", live=True, running=True)
    }
    assert [job.live for job in slurm.queue().values()] == [True, False]
    assert slurm.queue([]) == {}
