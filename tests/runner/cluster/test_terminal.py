"""The main process alone writes on the terminal."""

import subprocess
import sys

SCRIPT = """
import os, subprocess, sys
from pathlib import Path
from sinew.runner.cluster.terminal import children_write_to
child = [sys.executable, "-c", "import sys; print('child', file=sys.stderr)"]
with children_write_to(Path(sys.argv[1])):
    print("begins", file=sys.stderr)
    subprocess.run(child)
    print("ends", file=sys.stderr)
print("after", file=sys.stderr)
subprocess.run(child)
try:
    with children_write_to(Path(sys.argv[1])):
        raise ValueError("an error")
except ValueError as error:
    print(error, file=sys.stderr)
"""


def test_children_write_to_the_file_and_this_process_to_the_terminal(tmp_path):
    script = [sys.executable, "-c", SCRIPT, str(tmp_path / "errors")]
    done = subprocess.run(script, capture_output=True, text=True, check=True)
    assert done.stderr.split("\n") == ["begins", "ends", "after", "child", "an error", ""]
    assert (tmp_path / "errors").read_text() == "child\n"
