"""Small file systems that really fill up, for the tests that may mount one.

They lie outside pytest's own folders: pytest deletes the folders of earlier sessions, and one that still holds a mount,
because its session was killed, would fail the session that deletes it.
"""

import contextlib
import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

may_mount = pytest.mark.skipif(os.geteuid() != 0, reason="only root can mount a file system")


@contextlib.contextmanager
def small_disk(megabytes: int) -> Iterator[Path]:
    """An empty file system of that size, in a folder of its own with room beside it; gone at the end with that folder.

    What was mounted inside is gone as well.
    """
    around = Path(tempfile.mkdtemp(prefix="sinew-disk-"))
    folder = around / "disk"
    folder.mkdir()
    subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={megabytes}m", "tmpfs", folder], check=True)
    try:
        yield folder
    finally:
        unmount_below(folder)
        shutil.rmtree(around)


def unmount_below(folder: Path) -> None:
    """Take away what is mounted at a folder or inside it, the innermost first."""
    mounted = [Path(line.split()[1]) for line in Path("/proc/mounts").read_text().splitlines()]
    for point in sorted((p for p in mounted if p.is_relative_to(folder)), reverse=True):
        subprocess.run(["umount", "--lazy", point], check=True)
