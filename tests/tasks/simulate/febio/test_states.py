"""States of interrupted runs: read as they were written, and only if this user wrote them."""

import os

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sinew.tasks.simulate.febio.states import State, read_state, write_state

SECRET, MOST = b"s" * 32, 2**20
STATE = State(12.5, {"a.txt": b"*Step  = 1\n\xff\x00", "b.txt": b""}, ended=False)


@pytest.fixture
def kept(tmp_path):
    """A state with a dump."""
    dump = tmp_path / "dump"
    dump.write_bytes(bytes(range(256)) * 40)
    write_state(tmp_path / "run.state", SECRET, STATE, dump)
    return tmp_path / "run.state"


def test_a_state_is_read_as_it_was_written(kept, tmp_path):
    assert read_state(kept, SECRET, tmp_path / "copy", MOST) == STATE
    assert (tmp_path / "copy").read_bytes() == (tmp_path / "dump").read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["copy", "dump", "run.state"]


def test_a_run_that_has_ended_has_no_dump(tmp_path):
    ended = State(3.0, {"a.txt": b"x"}, ended=True)
    write_state(tmp_path / "run.state", SECRET, ended, None)
    assert read_state(tmp_path / "run.state", SECRET, tmp_path / "copy", MOST) == ended
    assert not (tmp_path / "copy").exists()


@pytest.mark.parametrize("at", [0, 31, 32, 39, 40, 60, -1])
def test_a_changed_byte_makes_it_none(kept, tmp_path, at):
    content = bytearray(kept.read_bytes())
    content[at] ^= 1
    kept.write_bytes(content)
    assert read_state(kept, SECRET, tmp_path / "copy", MOST) is None
    assert not (tmp_path / "copy").exists(), "no solver finds it there"


@given(content=st.binary(max_size=200))
def test_any_bytes_are_no_state(tmp_path_factory, content):
    folder = tmp_path_factory.mktemp("any")
    (folder / "run.state").write_bytes(content)
    assert read_state(folder / "run.state", SECRET, folder / "copy", MOST) is None


@pytest.mark.parametrize("size", [0, 20, 36, 100, 5000])
def test_a_state_that_is_cut_short_is_none(kept, tmp_path, size):
    kept.write_bytes(kept.read_bytes()[:size])
    assert read_state(kept, SECRET, tmp_path / "copy", MOST) is None


def test_a_state_of_another_user_or_another_run_is_none(kept, tmp_path):
    assert read_state(kept, b"t" * 32, tmp_path / "copy", MOST) is None
    kept.rename(tmp_path / "other.state")
    assert read_state(tmp_path / "other.state", SECRET, tmp_path / "copy", MOST) is None


@pytest.mark.parametrize("kind", ["missing", "link", "pipe", "folder"])
def test_what_is_no_file_is_none(kept, tmp_path, kind):
    place = tmp_path / "here" / "run.state"
    place.parent.mkdir()
    if kind == "link":
        place.symlink_to(kept)
    elif kind == "pipe":
        os.mkfifo(place)
    elif kind == "folder":
        place.mkdir()
    assert read_state(place, SECRET, tmp_path / "copy", MOST) is None


def test_a_state_that_is_too_large_is_none(kept, tmp_path):
    assert read_state(kept, SECRET, tmp_path / "copy", kept.stat().st_size - 1) is None
    assert not (tmp_path / "copy").exists()


def test_a_state_takes_the_place_of_the_one_before_and_of_what_was_left_behind(kept, tmp_path):
    kept.with_name(f".{kept.name}.{os.getpid()}").write_text("half a state")
    later = State(20.0, {"a.txt": b"later"}, ended=False)
    write_state(kept, SECRET, later, tmp_path / "dump")
    assert read_state(kept, SECRET, tmp_path / "copy", MOST) == later
