"""Arrays that an unfinished task keeps: those of other inputs, shapes or numbers do not count."""

import json
import os
import shutil
import struct
import tracemalloc

import numpy as np
import pytest
import safetensors.numpy

from sinew.runner.errors import BadInput
from sinew.tasks.study import kept
from sinew.tasks.study.kept import KeptArrays

SHAPES = {"rows": ("n", 2), "sums": ("n",), "one": ()}
ARRAYS = {"rows": np.arange(6.0).reshape(3, 2), "sums": np.arange(3.0), "one": np.array(7.0)}


def test_arrays_are_read_as_they_were_written(tmp_path):
    file = KeptArrays(tmp_path / "kept.safetensors", "inputs")
    file.write(ARRAYS)
    found = file.read(SHAPES)
    assert found is not None
    assert all(np.array_equal(found[name], array) for name, array in ARRAYS.items())
    assert KeptArrays(file.path, "others").read(SHAPES) is None
    assert KeptArrays(tmp_path / "nothing", "inputs").read(SHAPES) is None


def test_what_another_user_wrote_or_what_was_changed_or_renamed_does_not_count(tmp_path, monkeypatch):
    file = KeptArrays(tmp_path / "kept.safetensors", "inputs")
    file.write(ARRAYS)
    content = safetensors.numpy.load_file(file.path)
    shorter, others = content["signature"][:-1], np.zeros(32, np.uint8)
    for change in ({"one": np.array(8.0)}, {"signature": shorter}, {"signature": others}):
        safetensors.numpy.save_file({**content, **change}, file.path)
        assert file.read(SHAPES) is None
    safetensors.numpy.save_file(content, file.path)
    assert file.read(SHAPES) is not None
    other = KeptArrays(tmp_path / "other.safetensors", "inputs")
    shutil.copy(file.path, other.path)
    assert other.read(SHAPES) is None
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "of another user"))
    assert file.read(SHAPES) is None


def test_without_a_secret_nothing_is_kept_and_the_log_says_so(tmp_path, monkeypatch, caplog):
    (tmp_path / "state").write_text("no folder")
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    file = KeptArrays(tmp_path / "kept.safetensors", "inputs")
    file.write(ARRAYS)
    assert not file.path.exists()
    assert "nothing is kept of an unfinished task" in caplog.records[0].error


@pytest.mark.parametrize(
    "change",
    [
        {"sums": np.arange(4.0)},  # n is 3 elsewhere
        {"rows": np.zeros((3, 3))},
        {"rows": np.zeros(6)},
        {"one": np.array(np.nan)},
        {"one": np.array(np.inf)},
        {"one": np.array(1e76)},
        {"more": np.zeros(1)},
    ],
)
def test_what_does_not_belong_together_does_not_count(tmp_path, change):
    file = KeptArrays(tmp_path / "kept.safetensors", "inputs")
    file.write({**ARRAYS, **change})
    assert file.read(SHAPES) is None


def test_a_file_larger_than_any_is_refused_before_it_takes_memory(tmp_path):
    """The file is sparse: it takes no room on the disk."""
    size = kept.MAX_BYTES
    header = json.dumps({"x": {"dtype": "F64", "shape": [size // 8], "data_offsets": [0, size]}}).encode()
    path = tmp_path / "kept.safetensors"
    path.write_bytes(struct.pack("<Q", len(header)) + header)
    os.truncate(path, 8 + len(header) + size)
    tracemalloc.start()
    try:
        with pytest.raises(BadInput, match="268,435,456"):
            KeptArrays(path, "inputs").read(SHAPES)
        assert tracemalloc.get_traced_memory()[1] < 2**20
    finally:
        tracemalloc.stop()
