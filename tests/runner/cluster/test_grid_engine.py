"""Grid Engine's commands and answers, without a Grid Engine."""

from pathlib import Path

import pytest

from sinew.runner.cluster import grid_engine
from sinew.runner.cluster.batch_system import Away, JobRequest, QueuedJob, Refused
from sinew.runner.errors import ClusterError

LISTED = """<?xml version='1.0'?>
<job_info><queue_info><job_list state="running"><JB_job_number>7</JB_job_number><JB_name>sinew-a</JB_name>
<state>r</state><queue_name>work.q@n3</queue_name></job_list></queue_info>
<job_info><job_list state="pending"><JB_job_number>8</JB_job_number><JB_name>b</JB_name><state>qw</state>
<queue_name></queue_name></job_list><job_list><JB_job_number>9</JB_job_number><JB_name>c</JB_name>
<state>Eqw</state></job_list><job_list><JB_job_number>10</JB_job_number><JB_name>d</JB_name>
<state>dr</state><queue_name>work.q@n1</queue_name></job_list></job_info></job_info>"""


@pytest.fixture
def fake(tmp_path, monkeypatch):
    """Puts a script in place of a command."""
    monkeypatch.setenv("PATH", f"{tmp_path}:/bin:/usr/bin")

    def put(name: str, script: str) -> None:
        (tmp_path / name).write_text(f"#!/bin/sh\n{script}\n")
        (tmp_path / name).chmod(0o755)

    return put


@pytest.mark.parametrize(
    ("words", "field"),
    [
        ('Job was rejected because job requests unknown queue "nope.q"', "partition"),
        ('job rejected: the requested project "nope" does not exist', "account"),
        ('job rejected: the requested parallel environment "nope" does not exist', "cores"),
        ('Job 12 cannot run in PE "smp" because it only offers 0 slots', "cores"),
        ("Job 14 (-l h_vmem=900G) cannot run because it offers only qf:h_vmem=16G", "memory"),
        ("Job 15 (-l h_rt=99) cannot run because it offers only qf:h_rt=10", "walltime"),
        ('unknown resource "nosuch"', "directives"),
        ("something nobody thought of", None),
    ],
)
def test_a_refusal_names_what_is_refused(words, field):
    assert grid_engine.commands.refused(words).field == field


def test_queue_reads_what_qstat_prints(fake, tmp_path):
    (tmp_path / "answer").write_text(LISTED)
    fake("qstat", f"cat {tmp_path}/answer")
    jobs = grid_engine.queue()
    assert jobs["7"] == QueuedJob("7", "r", "", "n3", "sinew-a", live=True, running=True)
    assert {job: (one.live, one.running) for job, one in jobs.items()} == {
        "7": (True, True),
        "8": (True, False),
        "9": (False, False),
        "10": (False, False),
    }
    assert list(grid_engine.queue(["8", "99"])) == ["8"]
    assert grid_engine.queue([]) == {}


@pytest.mark.parametrize("said", ["nonsense", '<!DOCTYPE a [<!ENTITY e "x">]><a>&e;</a>'])
def test_an_answer_that_is_no_xml_may_be_better_later(fake, tmp_path, said):
    (tmp_path / "answer").write_text(said)
    fake("qstat", f"cat {tmp_path}/answer")
    with pytest.raises(Away, match="not XML"):
        grid_engine.queue()


def test_a_job_has_a_number(fake, tmp_path):
    (tmp_path / "answer").write_text(LISTED.replace(">7<", ">-u *<"))
    fake("qstat", f"cat {tmp_path}/answer")
    assert list(grid_engine.queue()) == ["8", "9", "10"]


def test_a_master_that_is_away_is_no_refusal(fake, tmp_path):
    fake("qsub", "echo 'error: commlib error: got select error (Connection refused)' >&2; exit 1")
    with pytest.raises(Away, match="master does not answer"):
        grid_engine.submit(tmp_path / "job.sh")


def test_a_number_is_expected_of_a_submitted_job(fake, tmp_path):
    fake("qsub", "echo 17")
    assert grid_engine.submit(tmp_path / "job.sh") == "17"
    fake("qsub", "echo 'Your job 17 has been submitted'")
    with pytest.raises(ClusterError, match="took the job but printed no job number"):
        grid_engine.submit(tmp_path / "job.sh")


def test_the_variables_of_the_own_job_do_not_reach_the_next(fake, tmp_path, monkeypatch):
    fake("qsub", "env | grep -c -E '^(JOB_|SGE_JOB|SINEW_|NSLOTS)' >&2; exit 1")
    for name in ("JOB_ID", "SGE_JOB_SPOOL_DIR", "SINEW_DEADLINE", "NSLOTS"):
        monkeypatch.setenv(name, "1")
    with pytest.raises(Refused, match=r"Grid Engine refuses the job: 0$"):
        grid_engine.submit(tmp_path / "job.sh")


def test_ended_jobs_are_cancelled_without_complaint(fake):
    fake("qdel", "echo 'denied: job \"999\" does not exist'; exit 1")
    grid_engine.cancel(["999"])
    fake("qdel", "echo 'denied: \"me\" is not an operator'; exit 1")
    with pytest.raises(ClusterError, match="not an operator"):
        grid_engine.cancel(["999"])


@pytest.mark.parametrize(
    ("cores", "options", "expected"),
    [
        (1, (), ["-l h_vmem=4000M"]),
        (4, (), ["-l h_vmem=1000M", "-pe smp 4"]),
        (4, ("-pe openmp 4",), ["-l h_vmem=1000M", "-pe openmp 4"]),
        (4, ("-l mem_free=1G",), ["-pe smp 4", "-l mem_free=1G"]),
    ],
)
def test_cores_and_memory_unless_a_directive_asks_for_them(cores, options, expected):
    request = JobRequest("a", "log", cores, 4000, 90_061.0, options)
    asked = grid_engine.worker_options(request)["job_extra_directives"]
    assert asked == ["-r n", "-o log", "-S /bin/bash", "-l h_rt=25:01:01", *expected]
    assert grid_engine.leader_directives(request)[:2] == ["#$ -N a", "#$ -cwd"]


def test_only_a_process_in_a_job_belongs_to_one(monkeypatch):
    monkeypatch.delenv("SGE_JOB_SPOOL_DIR", raising=False)
    monkeypatch.setenv("JOB_ID", "5")  # of something else
    assert (grid_engine.job(), grid_engine.node(), grid_engine.cpus()) == (None, "", None)
    monkeypatch.setenv("SGE_JOB_SPOOL_DIR", str(Path("spool")))
    monkeypatch.setenv("HOSTNAME", "n7")
    monkeypatch.setenv("NSLOTS", "3")
    assert (grid_engine.job(), grid_engine.node(), grid_engine.cpus()) == ("5", "n7", 3)
