"""Temporary folders, those of killed processes among them."""

import os
import signal
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import pytest

from sinew.runner import temporary
from sinew.runner.temporary import PREFIX, temporary_folder


@pytest.fixture(autouse=True)
def place(tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    return tmp_path


def test_a_folder_is_this_users_alone_and_goes_at_the_end(place):
    with temporary_folder() as folder:
        assert folder.parent == place
        assert folder.stat().st_mode & 0o777 == 0o700
        (folder / "sub").mkdir()
        (folder / "sub" / "file").write_text("x")
        with temporary_folder() as other:
            assert folder.exists()
            assert other != folder
    assert list(place.iterdir()) == []


def test_a_folder_goes_when_an_error_ends_the_work(place):
    with pytest.raises(ZeroDivisionError), temporary_folder():
        raise ZeroDivisionError
    assert list(place.iterdir()) == []


def test_what_a_killed_process_left_is_removed_by_the_next_and_what_a_living_one_uses_stays(place):
    script = (
        "import sys, time\nfrom sinew.runner.temporary import temporary_folder\n"
        "with temporary_folder() as folder:\n"
        "    (folder / 'file').write_text('x'); print(folder, flush=True); time.sleep(600)\n"
    )
    processes = [subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True) for _ in range(2)]
    try:
        folders = [process.stdout.readline().strip() for process in processes]
        processes[0].send_signal(signal.SIGKILL)
        processes[0].wait()
        assert os.path.exists(folders[0])
        with temporary_folder():
            assert [os.path.exists(folder) for folder in folders] == [False, True]
    finally:
        for process in processes:
            process.kill()
            process.wait()
            process.stdout.close()


def test_links_and_files_of_that_name_are_left_alone(place):
    (place / "precious").mkdir()
    (place / "precious" / "file").write_text("x")
    (place / f"{PREFIX}link").symlink_to(place / "precious")
    (place / f"{PREFIX}file").write_text("x")
    with temporary_folder():
        pass
    assert sorted(path.name for path in place.iterdir()) == ["precious", f"{PREFIX}file", f"{PREFIX}link"]
    assert (place / "precious" / "file").exists()


def test_folders_of_others_are_left_alone(place, monkeypatch):
    (place / f"{PREFIX}theirs").mkdir()
    monkeypatch.setattr(os, "geteuid", lambda: os.getuid() + 1)
    with temporary_folder():
        pass
    assert (place / f"{PREFIX}theirs").exists()


def test_a_folder_that_is_removed_before_it_is_locked_is_made_again(place, monkeypatch):
    made = []
    original = temporary._lock

    def lock(folder):
        made.append(folder)
        if len(made) == 1:
            folder.rmdir()
        return original(folder)

    monkeypatch.setattr(temporary, "_lock", lock)
    with temporary_folder() as folder:
        assert made[0] != folder == made[1]


def test_many_at_once_do_not_remove_each_other(place):
    def work(number):
        with temporary_folder() as folder:
            (folder / "file").write_text(str(number))
            return (folder / "file").read_text() == str(number)

    with ThreadPoolExecutor(8) as pool:
        assert all(pool.map(work, range(200)))
    assert list(place.iterdir()) == []
