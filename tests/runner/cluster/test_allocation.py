"""What an allocation leaves when all of its tasks are killed at once."""

from sinew.runner.cluster.allocation import remove_abandoned
from sinew.runner.cluster.network import shared_certificate


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
