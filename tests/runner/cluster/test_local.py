"""Local workers that are killed while they start: they are started anew, and the terminal shows nothing of it."""

import os
import signal
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path
from typing import Any

import dask
import psutil
import pytest

from sinew.runner.cluster import local
from sinew.runner.cluster.client import Address, ask_for, open_client
from sinew.runner.cluster.dask_settings import ENVIRONMENT
from sinew.runner.cluster.local import Local
from sinew.runner.errors import ClusterError
from sinew.runner.temporary import PREFIX

OTHERS: set[int] = set()


@pytest.fixture(autouse=True)
def _others(monkeypatch):
    """Workers that are there before a test are those that tests of other files share."""
    monkeypatch.setattr(f"{__name__}.OTHERS", {process.pid for process in psutil.Process().children()})


def worker_processes() -> list[psutil.Process]:
    """Workers that a test has in this process: that start, or that run and have given themselves a title."""
    found = []
    for process in psutil.Process().children():
        if process.pid in OTHERS:
            continue
        with suppress(psutil.Error):
            if any(words in " ".join(process.cmdline()) for words in ("spawn_main", "dask worker")):
                found.append(process)
    return found


@contextmanager
def sends(number: int, count: int) -> Iterator[list[int]]:
    """Send a signal to each of the next ``count`` worker processes as soon as it is there; yields whom it hit."""
    hit: list[int] = []
    end = threading.Event()

    def watch() -> None:
        while not end.is_set() and len(hit) < count:
            for process in worker_processes():
                if process.pid not in hit and len(hit) < count:
                    os.kill(process.pid, number)
                    hit.append(process.pid)
            time.sleep(0.005)

    thread = threading.Thread(target=watch)
    thread.start()
    try:
        yield hit
    finally:
        end.set()
        thread.join()


def test_workers_use_one_thread_and_keep_their_memory(monkeypatch):
    for name in ENVIRONMENT:  # what the user sets, or what Dask sets for clusters that other tests start, comes first
        monkeypatch.delenv(name, raising=False)
    with open_client(Local(1)) as client:
        (found,) = client.run(lambda: dict(os.environ)).values()
    assert found["OMP_NUM_THREADS"] == found["OPENBLAS_NUM_THREADS"] == "1"
    assert int(found["MALLOC_MMAP_THRESHOLD_"]) == 32 * 2**20  # glibc takes no more
    assert int(found["MALLOC_TRIM_THRESHOLD_"]) == 256 * 2**20


def becomes_two(client) -> bool:
    until = time.monotonic() + 120
    while len(client.scheduler_info()["workers"]) < 2 and time.monotonic() < until:
        time.sleep(0.1)
    return len(client.scheduler_info()["workers"]) == 2


@pytest.mark.parametrize(("number", "count"), [(signal.SIGKILL, 1), (signal.SIGTERM, 2), (signal.SIGKILL, 5)])
def test_workers_killed_while_they_start_are_started_again(capfd, number, count):
    """The first, both, and both twice and one of them once more."""
    with sends(number, count) as hit, open_client(Local(2)) as client:
        assert client.submit(sum, (1, 2)).result(60) == 3
        assert becomes_two(client)
    assert len(hit) == count
    assert capfd.readouterr().err == ""


def test_an_interrupt_does_not_reach_workers_that_start(capfd):
    """Ctrl-C is for the main process alone: these workers come up, the very processes that got the signal."""
    with sends(signal.SIGINT, 2) as hit, open_client(Local(2)) as client:
        assert becomes_two(client)
        assert {info["pid"] for info in client.run(lambda: {"pid": os.getpid()}).values()} == set(hit)
    assert capfd.readouterr().err == ""


def test_workers_that_never_start_end_the_run_with_one_line(monkeypatch, capfd):
    monkeypatch.setattr(local, "TRIES", 2)
    with (
        sends(signal.SIGKILL, 1000),
        pytest.raises(ClusterError, match=r"cluster: 2 local workers could not be started \(.+\)"),
        open_client(Local(2)),
    ):
        pytest.fail("no worker is there")
    assert not worker_processes()
    assert capfd.readouterr().err == ""


def test_a_run_whose_workers_all_die_and_never_start_again_ends(monkeypatch, capfd):
    monkeypatch.setattr(local, "TRIES", 2)
    monkeypatch.setattr(local, "LOOK_S", 0.1)
    with open_client(Local(2)) as client:
        ask_for(client, 2)  # all is well
        with sends(signal.SIGKILL, 1000), pytest.raises(ClusterError, match="2 local workers could not be started"):
            for nanny in list(client.cluster.workers.values()):  # otherwise it starts them again itself
                client.sync(nanny.close)
            until = time.monotonic() + 120
            while time.monotonic() < until:
                ask_for(client, 2)
                time.sleep(0.05)
    assert capfd.readouterr().err == ""


def test_workers_killed_later_are_replaced(capfd):
    """Two that work, and their first successors while these start."""
    with open_client(Local(2)) as client:
        with sends(signal.SIGKILL, 6) as hit:
            until = time.monotonic() + 120
            while len(hit) < 6 and time.monotonic() < until:
                time.sleep(0.05)
        assert client.submit(sum, (1, 2)).result(60) == 3
        assert becomes_two(client)
        assert not set(client.run(os.getpid).values()) & set(hit)
    assert len(hit) == 6
    assert capfd.readouterr().err == ""


def test_what_workers_write_stays_in_the_folder_and_goes_with_it(tmp_path):
    """Otherwise it would stay among the system's temporary files."""
    place = tmp_path / "workers"
    with open_client(Local(2), place) as client:
        folders = client.run(lambda dask_worker: dask_worker.local_directory).values()
        assert all(Path(folder).is_relative_to(place) for folder in folders)
    assert not place.exists()


@pytest.mark.parametrize("named", [False, True])
def test_the_key_of_a_run_lies_in_its_own_folder_alone(tmp_path, monkeypatch, named):
    """Dask writes a key that it is given as text to a temporary folder, and a process killed then would leave it."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "tmp"))
    monkeypatch.setenv("TMPDIR", str(tmp_path / "tmp"))
    (tmp_path / "tmp").mkdir()
    place = tmp_path / "out" / ".workers" if named else tmp_path / "tmp"
    with open_client(Local(1), place if named else None) as client:
        (keys,) = client.run(_keys).values()
        assert _keys(client.cluster.scheduler) == keys
        for key in map(Path, keys):
            assert (key.name, key.stat().st_mode & 0o777, key.parent.stat().st_mode & 0o777) == (
                "key.pem",
                0o600,
                0o700,
            )
            assert key.is_relative_to(place)
            assert named or key.relative_to(place).parts[0].startswith(PREFIX), "the next process removes no other one"
    assert not list(tmp_path.rglob("*.pem"))
    assert not list((tmp_path / "tmp").iterdir())


def _keys(dask_worker: Any) -> list[str]:
    """What a process of Dask knows of the keys: texts, or paths of files."""
    roles = ("client", "scheduler", "worker")
    return sorted({dask_worker.security.get_tls_config_for_role(role)["key"] for role in roles})


def test_an_encrypted_scheduler_without_a_certificate_is_one_line():
    words = r"cluster.address: tls://127.0.0.1:1 is encrypted, but Dask's configuration names no certificate"
    with pytest.raises(ClusterError, match=words), open_client(Address("tls://127.0.0.1:1")):
        pytest.fail("there is no scheduler")


def test_nobody_else_writes_into_the_folder_of_local_workers(tmp_path):
    """Dask puts it on the path from which modules are imported."""
    (tmp_path / "theirs").mkdir()
    (tmp_path / "theirs").chmod(0o777)
    with pytest.raises(PermissionError), open_client(Local(1), tmp_path / "theirs"):
        pass
    before = os.umask(0)
    try:
        with open_client(Local(1), tmp_path / "out" / "mine"):
            assert (tmp_path / "out" / "mine").stat().st_mode & 0o777 == 0o700
    finally:
        os.umask(before)


def test_nothing_of_dask_lies_elsewhere_when_an_interrupt_has_taken_the_settings_back(tmp_path, monkeypatch):
    """The thread that starts the cluster goes on for a moment."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setattr(dask.config, "set", lambda *_, **__: nullcontext())
    with open_client(Local(1), tmp_path / "out") as client:
        assert client.submit(sum, (1, 2)).result(60) == 3
    assert not (tmp_path / "dask-scratch-space").exists()
