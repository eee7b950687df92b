"""Processes that look at a file: what they may do."""

import subprocess
import sys

from sinew.runner.limits import START
from tests.runner.test_confine import CONFINED

LOOK = """
from sinew.runner.limits import limit
limit(2**31, 60)
open({path!r}, "a")
"""

THREADS = """
import os
def main():
    print(os.environ["OPENBLAS_NUM_THREADS"])
"""


def test_one_thread_does_its_linear_algebra(tmp_path):
    """Whatever the node has; each thread would reserve memory of the process."""
    (tmp_path / "probe.py").write_text(THREADS)
    command = [sys.executable, "-I", "-c", START.format("probe"), str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, env={"OPENBLAS_NUM_THREADS": "64"})
    assert (done.stdout, done.stderr) == ("1\n", "")


@CONFINED
def test_what_looks_at_a_file_writes_none(tmp_path):
    path = tmp_path / "file"
    path.write_text("kept")
    done = subprocess.run([sys.executable, "-c", LOOK.format(path=str(path))], capture_output=True, text=True)
    assert "PermissionError" in done.stderr
    assert path.read_text() == "kept"
