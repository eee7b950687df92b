"""The user's secret: one for all processes, and nobody else's."""

import os
from concurrent.futures import ThreadPoolExecutor

import pytest

from sinew.runner.secret import BYTES, secret, state_folder


@pytest.fixture(autouse=True)
def _home(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))


def test_all_processes_have_the_same_and_nobody_else_can_read_it():
    with ThreadPoolExecutor(8) as pool:
        for _ in range(50):
            (state_folder() / "secret").unlink(missing_ok=True)
            (only,) = set(pool.map(lambda _: secret(), range(16)))
            assert len(only) == BYTES
    assert os.stat(state_folder() / "secret").st_mode & 0o077 == 0
    assert [path.name for path in state_folder().iterdir()] == ["secret"], "no temporary file is left"


@pytest.mark.parametrize(
    ("kind", "words"), [("empty", "has 0 bytes, not 32"), ("link", "is a link"), ("folder", "is a folder")]
)
def test_what_is_no_secret_is_refused(tmp_path, kind, words):
    secret()
    path = state_folder() / "secret"
    path.rename(tmp_path / "elsewhere")
    if kind == "empty":
        path.touch()
    elif kind == "link":
        path.symlink_to(tmp_path / "elsewhere")
    else:
        path.mkdir()
    with pytest.raises(OSError, match=f"{words}.*remove it"):
        secret()


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o620, 0o666])
def test_a_secret_that_others_may_know_is_refused(mode):
    secret()
    (state_folder() / "secret").chmod(mode)
    with pytest.raises(PermissionError, match=r"may be known to others.*remove it"):
        secret()


def test_a_secret_of_somebody_else_is_refused(monkeypatch):
    """Who could once write into the folder may have left one."""
    secret()
    monkeypatch.setattr("sinew.runner.secret.own_folder", lambda folder: folder)
    monkeypatch.setattr(os, "geteuid", lambda: os.getuid() + 1)
    with pytest.raises(PermissionError, match=r"may be known to others.*remove it"):
        secret()


def test_another_home_has_another(tmp_path, monkeypatch):
    first = secret()
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "other"))
    assert secret() != first


def test_a_folder_that_others_can_write_to_is_refused():
    state_folder().mkdir(parents=True)
    state_folder().chmod(0o777)
    with pytest.raises(PermissionError, match="is no folder that only you can write to"):
        secret()


def test_a_relative_place_is_none(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_STATE_HOME", "state")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert state_folder() == tmp_path / ".local" / "state" / "sinew"
