"""A segment is read completely or refused by name."""

import errno
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from safetensors import SafetensorError
from safetensors.numpy import save_file

from sinew.runner.errors import StoreError
from sinew.runner.store.schema import MAX_CHUNK_ROWS
from sinew.runner.store.segment import LONGEST_MESSAGE, LONGEST_WORKER, Segment, is_whole
from tests.runner.evaluations import Quick
from tests.runner.stores import some

BOTH = np.array([0, 1])
COLUMNS = ("attempts", "wall_seconds", "worker", "message", "y", "z")


def test_half_a_segment_is_named(tmp_path):
    path = tmp_path / "rows-000000000-00002.safetensors"
    one = np.zeros(1)
    values = {"y": np.zeros((1, 9))}
    Segment(np.array([0]), one.astype(np.int8), one.astype(np.int16), one, values, ("",), "w").write(path)
    path.write_bytes(path.read_bytes()[:-20])
    with pytest.raises(StoreError, match=path.name):
        Segment.read(path)


def segment(messages: tuple[str, ...] = ("", "it broke")) -> Segment:
    return Segment(
        np.array([4, 7]), np.array([0, 1], dtype=np.int8), np.array([1, 2], dtype=np.int16), np.array([0.5, 1.5]),
        {"y": np.array([[1.0, 2.0], [3.0, 4.0]]), "z": np.array([5.0, 6.0])}, messages, "node1",
    )  # fmt: skip


@pytest.mark.parametrize("whole", [True, False])
def test_what_is_written_is_read(tmp_path, whole):
    path = tmp_path / "one.safetensors"
    segment().write(path)
    assert list(tmp_path.iterdir()) == [path]
    found = Segment.read(path, whole=whole)
    assert found.rows.tolist() == [4, 7]
    assert found.status.tolist() == [0, 1]
    assert found.attempts.tolist() == [1, 2]
    assert found.wall_seconds.tolist() == [0.5, 1.5]
    assert (found.messages, found.worker) == (("", "it broke"), "node1")
    assert sorted(found.values) == ["y", "z"]
    assert len(found.values) == 2
    assert found.values["y"].tolist() == [[1.0, 2.0], [3.0, 4.0]]
    assert "x" not in found.values
    if whole:
        path.unlink()
        assert found.values["z"].tolist() == [5.0, 6.0], "nothing is left to be read"


def test_columns_of_a_table():
    one, both = np.array([1]), np.array([0, 1])
    found = segment()
    assert found.column("attempts", one).tolist() == [2]
    assert found.column("wall_seconds", one).tolist() == [1.5]
    assert found.column("worker", both).tolist() == ["node1", "node1"]
    assert found.column("message", both).tolist() == ["", "it broke"]
    assert segment(()).column("message", both).tolist() == ["", ""]
    assert found.column("y", one).tolist() == [[3.0, 4.0]]
    assert found.column("y", both).tolist() == [[1.0, 2.0], [3.0, 4.0]]
    assert np.isnan(found.column("x", both)), "a batch that failed as a whole has no numbers"


def test_a_segment_is_whole_or_not(tmp_path):
    path = tmp_path / "one.safetensors"
    assert not is_whole(path)
    segment().write(path)
    assert is_whole(path)
    path.write_bytes(path.read_bytes()[:-1])
    assert not is_whole(path)


def test_what_cannot_be_written_leaves_no_file(tmp_path, monkeypatch):
    def fails(words):
        def save(_arrays, path, _metadata):
            path.write_text("half")
            raise SafetensorError(words)

        return save

    for words, number in (("os error 28", errno.ENOSPC), ("os error 5", errno.EIO)):
        monkeypatch.setattr("safetensors.numpy.save_file", fails(words))
        with pytest.raises(OSError, match=words) as error:
            segment().write(tmp_path / "one.safetensors")
        assert error.value.errno == number
        assert not list(tmp_path.iterdir())


def test_a_field_that_was_lost_after_the_segment_was_opened_is_named(tmp_path):
    path = tmp_path / "journal" / "key" / "one.safetensors"
    path.parent.mkdir(parents=True)
    segment().write(path)
    found = Segment.read(path)
    path.unlink()
    with pytest.raises(StoreError, match=f"^{path}: not a whole segment .*; `sinew repair {tmp_path}` removes it"):
        found.values["y"]


def unmarked(path: Path) -> None:
    """Write a segment as versions without checksums did."""
    one = segment()
    arrays = {f"value:{name}": array for name, array in one.values.items()}
    arrays |= {"rows": one.rows, "status": one.status, "attempts": one.attempts, "wall": one.wall_seconds}
    save_file(arrays, path, {"messages": json.dumps(one.messages), "worker": one.worker})


def test_segments_without_checksums_are_read(tmp_path):
    path = tmp_path / "one.safetensors"
    unmarked(path)
    for whole in (True, False):
        found = Segment.read(path, whole=whole)
        assert found.rows.tolist() == [4, 7]
        assert found.values["y"].tolist() == [[1.0, 2.0], [3.0, 4.0]]


def test_every_damaged_byte_is_seen(tmp_path):
    path = tmp_path / "a" / "b" / "c" / "one.safetensors"
    path.parent.mkdir(parents=True)
    segment().write(path)
    content = path.read_bytes()
    seen = 0
    for at in range(len(content)):
        path.write_bytes(content[:at] + bytes([content[at] ^ 4]) + content[at + 1 :])
        try:
            found = Segment.read(path, whole=True)
        except StoreError as error:
            seen += str(error).startswith(f"{path}: not a whole segment (")
        else:  # in what the header does not need, or in the name of the checksums
            assert same(found, segment())
    assert seen > 0.9 * len(content)


def same(one: Segment, other: Segment) -> bool:
    return all(np.array_equal(one.column(name, BOTH), other.column(name, BOTH)) for name in COLUMNS)


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ({"status": np.array([0, 55], dtype=np.int8)}, "a status of 55"),
        ({"status": np.array([0, -1], dtype=np.int8)}, "a status of -1"),
        ({"rows": np.array([-4, 7])}, "negative"),
        ({"rows": np.array([7, 7])}, "not different"),
        ({"rows": np.array([4.0, 7.0])}, "types or lengths"),
        ({"rows": np.array([4, 5, 6])}, "types or lengths"),
        ({"wall_seconds": np.ones((2, 2))}, "types or lengths"),
        ({"values": {"y": np.zeros((3, 2))}}, "values"),
        ({"values": {"y": np.array(3.0)}}, "values"),
        ({"messages": ("one",)}, "messages"),
        ({"messages": (1, 2)}, "messages"),
        ({"wall_seconds": np.array([0.1, np.inf])}, "a time that no evaluation takes"),
        ({"wall_seconds": np.array([0.1, -1.0])}, "a time that no evaluation takes"),
        ({"values": {"y": np.zeros((2, 2), dtype=np.uint8)}}, "values"),
    ],
)
def test_what_no_worker_writes_is_refused(tmp_path, change, problem):
    path = tmp_path / "one.safetensors"
    replace(segment(), **change).write(path)
    with pytest.raises(StoreError, match=problem):
        Segment.read(path)


def test_a_segment_that_is_larger_than_any_is_refused_unread(tmp_path):
    """A sparse file of gigabytes takes no place on the disk, and all of it in memory."""
    path = tmp_path / "one.safetensors"
    header = b'{"rows":{"dtype":"I64","shape":[800000000],"data_offsets":[0,6400000000]}}'
    with path.open("wb") as file:
        file.write(len(header).to_bytes(8, "little") + header)
        file.truncate(8 + len(header) + 6_400_000_000)
    with pytest.raises(StoreError, match="larger than any"):
        Segment.read(path)
    assert not is_whole(path)


def test_words_of_a_segment_that_would_fill_the_memory_are_refused_unread(tmp_path):
    path = tmp_path / "one.safetensors"
    words = b'{"__metadata__":{"messages":"[' + b"[]," * 7_000_000 + b'[]]"}}'
    path.write_bytes(len(words).to_bytes(8, "little") + words)
    with pytest.raises(StoreError, match="larger than any"):
        Segment.read(path)


def test_a_segment_has_no_more_rows_than_a_chunk(tmp_path):
    count = MAX_CHUNK_ROWS + 1
    zeros = np.zeros(count)
    many = Segment(np.arange(count), zeros.astype(np.int8), zeros.astype(np.int16), zeros, {}, (), "w")
    many.write(tmp_path / "one.safetensors")
    with pytest.raises(StoreError, match="its rows"):
        Segment.read(tmp_path / "one.safetensors")


def test_messages_are_cut_where_they_are_written_and_where_they_are_read(tmp_path, monkeypatch):
    """A solver, or a folder from elsewhere, may say megabytes, which nobody reads."""
    outcome = Quick()(some(2))
    ones = np.ones(2)
    segment = Segment(
        np.arange(2), outcome.status, ones.astype(np.int16), ones, outcome.values, ("x" * 10**6, "short"), "node:1"
    )
    segment.write(tmp_path / "short")
    assert (tmp_path / "short").stat().st_size < 10**5
    assert [len(one) for one in Segment.read(tmp_path / "short").messages] == [LONGEST_MESSAGE, 5]
    monkeypatch.setattr("sinew.runner.store.segment.LONGEST_MESSAGE", 10**7)
    segment.write(tmp_path / "long")
    monkeypatch.undo()
    assert [len(one) for one in Segment.read(tmp_path / "long").messages] == [LONGEST_MESSAGE, 5]


def test_the_name_of_a_worker_is_cut_where_it_is_written_and_where_it_is_read(tmp_path, monkeypatch):
    """The table repeats it for each row."""
    long = replace(segment(), worker="w" * 10**6)
    long.write(tmp_path / "short")
    assert (tmp_path / "short").stat().st_size < 10**4
    assert Segment.read(tmp_path / "short").worker == "w" * LONGEST_WORKER
    monkeypatch.setattr("sinew.runner.store.segment.LONGEST_WORKER", 10**7)
    long.write(tmp_path / "long")
    monkeypatch.undo()
    assert Segment.read(tmp_path / "long").worker == "w" * LONGEST_WORKER


def test_a_segment_belongs_to_its_table(tmp_path):
    for name in ("one", "other"):
        (tmp_path / "journal" / name).mkdir(parents=True)
    path = tmp_path / "journal" / "one" / "a"
    segment().write(path)
    assert same(Segment.read(path), segment())
    moved = path.rename(tmp_path / "journal" / "other" / "a")
    with pytest.raises(StoreError, match="it is of another table"):
        Segment.read(moved)


@pytest.mark.parametrize("whole", [True, False])
def test_what_a_table_does_not_have_is_named(tmp_path, whole):
    segment().write(tmp_path / "a")
    found = Segment.read(tmp_path / "a", whole=whole)
    widths = {"y": (2,), "z": (), "more": (9,)}
    assert found.misfit(8, widths) == ""
    assert found.misfit(7, widths) == "rows that were never planned"
    assert found.misfit(8, widths | {"y": (1,)}) == "values of 'y' with another shape than those of its table"
    assert found.misfit(8, {"y": (2,)}) == "values of 'z' with another shape than those of its table"


def test_bytes_of_names_that_are_no_text_do_not_spoil_a_segment(tmp_path):
    replace(segment(), messages=("", "no file \udcff"), worker="node\udcff").write(tmp_path / "a")
    found = Segment.read(tmp_path / "a")
    assert (found.messages, found.worker) == (("", "no file ?"), "node?")


@pytest.mark.parametrize("number", [errno.EMFILE, errno.EIO, errno.EACCES])
def test_a_segment_that_cannot_be_read_now_may_be_whole(tmp_path, monkeypatch, number):
    segment().write(tmp_path / "a")

    def fails(_path):
        raise OSError(number, "not now")

    monkeypatch.setattr("sinew.runner.store.segment._opened", fails)
    with pytest.raises(OSError, match="not now"):
        Segment.read(tmp_path / "a")
