"""States of interrupted runs: read as they were written, and only if this user wrote them."""

import os

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sinew.runner.files import NotReadable
from sinew.tasks.simulate.febio.states import State, read_state, write_state

SECRET, MOST = b"s" * 32, 2**20
FOREIGN = "was not signed by you, or with another home; remove it"
STATE = State({"a.txt": b"*Step  = 1\n\xff\x00", "b.txt": b""}, 12.5, step=0.5, again=True)


@pytest.fixture
def kept(tmp_path):
    """A state with a dump."""
    dump = tmp_path / "dump"
    dump.write_bytes(bytes(range(256)) * 40)
    write_state(tmp_path / "run.state", SECRET, STATE, dump, MOST)
    return tmp_path / "run.state"


def test_a_state_is_read_as_it_was_written(kept, tmp_path):
    assert read_state(kept, SECRET, tmp_path / "copy", MOST) == STATE
    assert (tmp_path / "copy").read_bytes() == (tmp_path / "dump").read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["copy", "dump", "run.state"]


def test_a_run_that_has_ended_has_no_dump(tmp_path):
    ended = State({"a.txt": b"x"}, 3.0, ended=True)
    write_state(tmp_path / "run.state", SECRET, ended, None, MOST)
    assert read_state(tmp_path / "run.state", SECRET, tmp_path / "copy", MOST) == ended
    assert not (tmp_path / "copy").exists()


@pytest.mark.parametrize("at", [0, 31, 5000, -1, -32, -33, -40, -41, -60])
def test_a_state_with_a_changed_byte_is_refused(kept, tmp_path, at):
    content = bytearray(kept.read_bytes())
    content[at] ^= 1
    kept.write_bytes(content)
    with pytest.raises(PermissionError, match=FOREIGN):
        read_state(kept, SECRET, tmp_path / "copy", MOST)


@given(content=st.binary(max_size=200))
def test_any_bytes_are_no_state(tmp_path_factory, content):
    folder = tmp_path_factory.mktemp("any")
    (folder / "run.state").write_bytes(content)
    with pytest.raises(PermissionError, match=FOREIGN):
        read_state(folder / "run.state", SECRET, folder / "copy", MOST)


@pytest.mark.parametrize("size", [0, 20, 36, 100, 5000])
def test_a_state_that_is_cut_short_is_refused(kept, tmp_path, size):
    kept.write_bytes(kept.read_bytes()[:size])
    with pytest.raises(PermissionError, match=FOREIGN):
        read_state(kept, SECRET, tmp_path / "copy", MOST)


def test_a_state_of_another_user_or_another_run_is_refused(kept, tmp_path):
    with pytest.raises(PermissionError, match=FOREIGN):
        read_state(kept, b"t" * 32, tmp_path / "copy", MOST)
    kept.rename(tmp_path / "other.state")
    with pytest.raises(PermissionError, match=FOREIGN):
        read_state(tmp_path / "other.state", SECRET, tmp_path / "copy", MOST)


@pytest.mark.parametrize(("kind", "words"), [("link", "a link"), ("pipe", "a named pipe"), ("folder", "a folder")])
def test_what_is_no_file_is_refused(kept, tmp_path, kind, words):
    place = tmp_path / "here" / "run.state"
    place.parent.mkdir()
    assert read_state(place, SECRET, tmp_path / "copy", MOST) is None
    if kind == "link":
        place.symlink_to(kept)
    elif kind == "pipe":
        os.mkfifo(place)
    else:
        place.mkdir()
    with pytest.raises(PermissionError, match=f"is {words}, no state of a run; remove it"):
        read_state(place, SECRET, tmp_path / "copy", MOST)


@pytest.mark.parametrize("kind", ["link", "pipe", "folder"])
def test_only_a_file_is_kept_as_a_dump(kept, tmp_path, kind):
    """What stands there is the solver's."""
    place = tmp_path / "other dump"
    if kind == "link":
        place.symlink_to(tmp_path / "dump")
    elif kind == "pipe":
        os.mkfifo(place)
    else:
        place.mkdir()
    before = kept.read_bytes()
    with pytest.raises(NotReadable):
        write_state(kept, SECRET, STATE, place, MOST)
    assert kept.read_bytes() == before
    assert not list(tmp_path.glob(".*"))


def test_a_state_that_is_too_large_is_refused(kept, tmp_path):
    with pytest.raises(PermissionError, match=FOREIGN):
        read_state(kept, SECRET, tmp_path / "copy", kept.stat().st_size - 33)


def test_a_state_takes_the_place_of_the_one_before_and_of_what_was_left_behind(kept, tmp_path):
    kept.with_name(f".{kept.name}.{os.getpid()}").write_text("half a state")
    later = State({"a.txt": b"later"}, 20.0)
    write_state(kept, SECRET, later, tmp_path / "dump", MOST)
    assert read_state(kept, SECRET, tmp_path / "copy", MOST) == later
