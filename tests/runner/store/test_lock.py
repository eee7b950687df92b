"""One process at a time writes a store."""

import multiprocessing
from pathlib import Path

import pytest

from sinew.runner.cluster.batch_systems import this_process
from sinew.runner.errors import StoreError
from sinew.runner.store.lock import lock
from sinew.runner.store.store import Store


def _hold(folder: Path, opened: "multiprocessing.synchronize.Event", end: "multiprocessing.synchronize.Event") -> None:
    with Store.writing(folder, "study"):
        opened.set()
        end.wait(30)


def test_a_second_writer_is_refused_and_told_who_is_first(tmp_path):
    context = multiprocessing.get_context("spawn")
    opened, end = context.Event(), context.Event()
    process = context.Process(target=_hold, args=(tmp_path, opened, end))
    process.start()
    assert opened.wait(30)
    try:
        with pytest.raises(StoreError, match=f"in use by process {process.pid} on "), Store.writing(tmp_path, "study"):
            pass
    finally:
        process.kill()
        process.join(10)
    with Store.writing(tmp_path, "study"):  # the lock died with its holder
        pass


def test_a_lock_that_is_a_link_is_not_followed(tmp_path):
    (tmp_path / "victim").write_text("precious")
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "lock").symlink_to(tmp_path / "victim")
    with pytest.raises(StoreError, match="lock"), Store.writing(tmp_path / "out", "study"):
        pass
    assert (tmp_path / "victim").read_text() == "precious"


def test_the_lock_names_its_holder(tmp_path):
    with lock(tmp_path):
        assert (tmp_path / "lock").read_text() == f"{this_process()}\n"
        with pytest.raises(StoreError) as error, lock(tmp_path):
            pass
        assert str(error.value) == f"{tmp_path}: in use by {this_process()}; wait or stop it"
    (tmp_path / "lock").write_text("a longer text of somebody who was here before, and left it\n" * 3)
    with lock(tmp_path):
        assert (tmp_path / "lock").read_text() == f"{this_process()}\n"
        (tmp_path / "lock").write_text("")
        with pytest.raises(StoreError, match=r"in use by another process; wait or stop it$"), lock(tmp_path):
            pass


def test_a_folder_that_cannot_hold_a_lock_is_named(tmp_path):
    (tmp_path / "lock").mkdir()
    with (
        pytest.raises(StoreError, match=f"^{tmp_path / 'lock'}: Is a directory; it must be a regular file$"),
        lock(tmp_path),
    ):
        pass


def test_everybody_may_read_a_lock_and_only_its_owner_write(tmp_path):
    with lock(tmp_path):
        assert (tmp_path / "lock").stat().st_mode & 0o777 == 0o644


def test_a_folder_that_cannot_be_written_to_is_named(tmp_path, monkeypatch):
    def refused(*_: object) -> int:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("os.open", refused)
    with (
        pytest.raises(StoreError, match=f"{tmp_path}: cannot be written to; expected a folder of yours"),
        lock(tmp_path),
    ):
        pass
