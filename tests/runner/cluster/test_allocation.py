"""What an allocation leaves when all of its tasks are killed at once, and what one of its tasks leaves to others."""

from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace

import pytest

from sinew.runner.cluster import allocation
from sinew.runner.cluster.allocation import remove_abandoned
from sinew.runner.cluster.network import shared_certificate
from sinew.runner.evaluation import external


def test_keys_of_allocations_that_were_killed_are_removed_by_the_next(tmp_path):
    for job in ("7-0", "7-1", "8-0"):
        shared_certificate(tmp_path / f"certificate-{job}", create=True)
        (tmp_path / f"scheduler-{job}.json").write_text("{}")
    (tmp_path / ".certificate-7-2.partial").mkdir()  # killed while it wrote its key
    (tmp_path / ".certificate-7-2.partial" / "key.pem").touch()
    (tmp_path / "scheduler-x.json").mkdir()
    (tmp_path / "jobs.jsonl").touch()
    remove_abandoned(tmp_path, "8-0")
    left = sorted(path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*") if path.is_file())
    assert left == ["certificate-8-0/certificate.pem", "certificate-8-0/key.pem", "jobs.jsonl", "scheduler-8-0.json"]


def test_a_task_that_ends_leaves_the_scratch_of_the_others_on_its_node(tmp_path, monkeypatch):
    """All tasks on a node have one folder of the job; each works in a part of it."""
    scratch = tmp_path / "scratch"
    monkeypatch.setenv(external.SCRATCH, str(scratch))
    other = scratch / "task-3" / "attempt-1"
    other.mkdir(parents=True, mode=0o700)
    scratch.chmod(0o700)
    worked: list[Path] = []

    @contextmanager
    def serving(spec):
        worked.append(external.scratch(spec.folder))
        (worked[0] / "attempt-2").mkdir()
        raise KeyboardInterrupt
        yield

    monkeypatch.setattr(allocation, "open_allocation", serving)
    spec = SimpleNamespace(system=SimpleNamespace(task=lambda: 2), folder=tmp_path)
    with pytest.raises(SystemExit):
        allocation.join_allocation(spec)
    assert worked == [scratch / "task-2"]
    assert not worked[0].exists()
    assert other.is_dir()
