"""A checkpoint survives crashes, and holds nothing that belongs to other inputs."""

import tracemalloc
from unittest import mock

import numpy as np
import pytest

from sinew.tasks.study.checkpoint import MAX_BYTES, MAX_LINES, Checkpoint, in_unit_cube, is_count
from tests.effort import at_most


def test_what_was_kept_is_there_again(tmp_path):
    path = tmp_path / "folder" / "checkpoint.jsonl"
    first = Checkpoint(path, "a")
    rows = [np.array([0.1, 1 / 3, 1e-300]), np.array([2.0])]
    for row in rows:
        first.append(row)
    again = Checkpoint(path, "a")
    assert [kept.tobytes() for kept in again.kept] == [row.tobytes() for row in rows]
    assert len(Checkpoint(path, "other inputs")) == 0
    assert len(Checkpoint(path, "a")) == 0, "other inputs began it anew"


@pytest.mark.parametrize(
    "harm",
    [
        b"[1.0, 2",
        b"[]\n",
        b"[[1.0]]\n",
        b"[NaN]\n",
        b"\xff\n",
        b'{"a": 1}\n',
        b"[1.0]",
        b"[1" + b"0" * 400 + b"]\n",
        b"[1e308]\n",
    ],
)
def test_a_broken_line_and_what_follows_do_not_count(tmp_path, harm):
    path = tmp_path / "checkpoint.jsonl"
    checkpoint = Checkpoint(path, "a")
    checkpoint.append(np.array([1.0]))
    path.write_bytes(path.read_bytes() + harm)
    again = Checkpoint(path, "a")
    assert len(again) == 1
    again.append(np.array([2.0]))
    assert [float(kept[0]) for kept in Checkpoint(path, "a").kept] == [1.0, 2.0]


def test_a_line_of_another_width_and_what_follows_do_not_count(tmp_path):
    path = tmp_path / "checkpoint.jsonl"
    checkpoint = Checkpoint(path, "a")
    for row in ([1.0, 2.0], [3.0], [4.0, 5.0]):
        checkpoint.append(np.array(row))
    assert [kept.tolist() for kept in Checkpoint(path, "a", 2).kept] == [[1.0, 2.0]]
    assert len(Checkpoint(path, "a")) == 1, "they are gone"


def test_numbers_that_cannot_be_and_what_follows_do_not_count(tmp_path):
    path = tmp_path / "checkpoint.jsonl"
    checkpoint = Checkpoint(path, "a")
    for row in ([0.0, 1.0 + 1e-12], [0.5, -9e14], [0.5, 0.5]):
        checkpoint.append(np.array(row))
    assert [kept.tolist() for kept in Checkpoint(path, "a", 2, in_unit_cube).kept] == [[0.0, 1.0 + 1e-12]]


@pytest.mark.parametrize(("number", "counts"), [(0.0, True), (12.0, True), (13.0, False), (-1.0, False), (5.5, False)])
def test_a_count_is_a_whole_number_in_bounds(number, counts):
    assert is_count(np.array([number]), 12) is counts


def test_lines_without_end_take_neither_memory_nor_time(tmp_path):
    """A file of the size of a photograph took gigabytes, or minutes."""
    path = tmp_path / "checkpoint.jsonl"
    with at_most(30):
        for content in (b"\n" * 2**26, b'{"inputs": "a"}\n' + b"[1]\n" * 2**24):
            path.write_bytes(content[:MAX_BYTES])
            tracemalloc.start()
            kept = len(Checkpoint(path, "a"))
            assert kept == (MAX_LINES if b"[" in content else 0)
            assert tracemalloc.get_traced_memory()[1] < 2**28
            tracemalloc.stop()


def test_links_that_appear_are_not_followed(tmp_path):
    """Neither where lines are added, nor where another checkpoint is begun."""
    path, victim = tmp_path / "checkpoint.jsonl", tmp_path / "victim"
    checkpoint = Checkpoint(path, "a")
    victim.write_text("precious")
    path.unlink()
    path.symlink_to(victim)
    with pytest.raises(OSError, match="is a link; remove it"):
        checkpoint.append(np.array([1.0]))
    with mock.patch("sinew.tasks.study.checkpoint.read_regular", side_effect=FileNotFoundError):  # it comes after this
        Checkpoint(path, "b")
    assert victim.read_text() == "precious"
    assert not path.is_symlink()


def test_a_kill_while_a_checkpoint_is_mended_loses_nothing(tmp_path):
    """A line was cut short; the file is there as it was until it is there anew."""
    path = tmp_path / "checkpoint.jsonl"
    checkpoint = Checkpoint(path, "a")
    checkpoint.append(np.array([1.0]))
    before = path.read_bytes() + b"[2.0"
    path.write_bytes(before)
    with mock.patch("os.replace", side_effect=KeyboardInterrupt), pytest.raises(KeyboardInterrupt):
        Checkpoint(path, "a")
    assert path.read_bytes() == before
    assert [float(kept[0]) for kept in Checkpoint(path, "a").kept] == [1.0]
    assert list(tmp_path.iterdir()) == [path]
