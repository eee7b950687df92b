"""A small disk leaves nothing mounted, whatever was mounted inside it and however the test ended."""

import contextlib
import subprocess
from pathlib import Path

import pytest

from tests.small_disk import may_mount, small_disk


def mounts(folder: Path) -> int:
    return sum(str(folder) in line for line in Path("/proc/mounts").read_text().splitlines())


@may_mount
@pytest.mark.parametrize("fails", [False, True])
def test_nothing_stays_mounted(fails):
    with contextlib.suppress(TimeoutError), small_disk(megabytes=1) as folder:
        inner = folder / "inner"
        inner.mkdir()
        subprocess.run(["mount", "--bind", inner, inner], check=True)
        assert mounts(folder) == 2
        if fails:
            raise TimeoutError
    assert mounts(folder) == 0
    assert not folder.parent.exists()
