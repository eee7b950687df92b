"""The table of jobs: incomplete lines, requeued jobs, and what a job has cost."""

import json

import pytest

from sinew.runner.cluster.job_table import COORDINATOR, WORKER, JobRecord, JobTable, noted


def test_the_table_of_jobs_survives_lines_that_are_cut_short(tmp_path):
    table = JobTable(tmp_path / "jobs")
    assert table.read() == {}
    table.note("7", "submitted", role=WORKER, name="sinew-a-worker", cores=4)
    table.note("7", "started", nodes="n3")
    table.note("7", "ended", end="PREEMPTED", unknown=1)
    with open(table.path, "a") as file:
        file.write('{"time": 1, "job": "8", "ev')
    record = table.read()["7"]
    assert (record.role, record.cores, record.nodes, record.end) == (WORKER, 4, "n3", "PREEMPTED")
    assert record.core_hours(0.0) == pytest.approx(4 * (record.ended - record.started) / 3600)
    assert list(table.read()) == ["7"]


def test_a_requeued_job_runs_again_and_counts_from_its_first_start(tmp_path):
    table = JobTable(tmp_path)
    facts = {"role": COORDINATOR, "name": "sinew-a", "cores": 1}
    lines = [(0, "submitted"), (10, "started"), (70, "ended"), (200, "started")]
    table.path.write_text("".join(json.dumps({"time": t, "job": "5", "event": e, **facts}) + "\n" for t, e in lines))
    record = table.read()["5"]
    assert record.ended is None
    assert record.core_hours(270.0) == pytest.approx((60 + 70) / 3600)


def test_a_job_that_ended_before_it_began_has_cost_nothing(tmp_path):
    table = JobTable(tmp_path)
    facts = {"role": COORDINATOR, "name": "sinew-a", "cores": 1}
    lines = [(9e10, "started"), (0, "ended")]
    table.path.write_text("".join(json.dumps({"time": t, "job": "5", "event": e, **facts}) + "\n" for t, e in lines))
    assert table.read()["5"].core_hours(10.0) == 0.0


def test_the_table_names_the_batch_system_unless_it_is_slurm(tmp_path):
    table = JobTable(tmp_path)
    table.note("1", "submitted", **noted("slurm"))
    table.note("2", "submitted", **noted("grid_engine"))
    assert "batch_system" not in table.path.read_text().splitlines()[0]
    assert [record.batch_system for record in table.read().values()] == ["slurm", "grid_engine"]


def test_only_a_job_for_this_folder_is_one_of_a_table(tmp_path):
    """A table that came with somebody's result folder, or in a copy of a folder, may name any of the user's jobs."""
    table, other = JobTable(tmp_path / "here"), JobTable(tmp_path / "there")
    ours = table.job_name("study", WORKER)
    for noted_name, in_queue, same in (
        (ours, ours, True),
        (ours, table.job_name("other", WORKER), False),
        (other.job_name("study", WORKER), other.job_name("study", WORKER), False),
        ("sinew-study-worker", "sinew-study-worker", False),
        ("training", "training", False),
        ("", "", False),
    ):
        assert table.is_job(JobRecord("7", name=noted_name), in_queue) == same


def test_a_folder_has_one_name_through_whatever_link_it_is_reached(tmp_path):
    (tmp_path / "there").mkdir()
    (tmp_path / "link").symlink_to("there")
    names = {JobTable(tmp_path / name).job_name("study", COORDINATOR) for name in ("there", "link", "there/../there")}
    assert len(names) == 1


def test_a_link_that_appears_is_not_followed(tmp_path):
    table = JobTable(tmp_path)
    (tmp_path / "victim").write_text("precious")
    table.path.symlink_to(tmp_path / "victim")
    with pytest.raises(OSError, match="is a link; remove it"):
        table.note("7", "started")
    assert (tmp_path / "victim").read_text() == "precious"
