"""A checkpoint survives crashes, and holds nothing that belongs to other inputs."""

import numpy as np
import pytest

from sinew.tasks.study.checkpoint import Checkpoint


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
    "harm", [b"[1.0, 2", b"[[1.0]]\n", b"[NaN]\n", b"\xff\n", b'{"a": 1}\n', b"[1.0]", b"[1" + b"0" * 400 + b"]\n"]
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
