"""Processes that look at a file: what they may do."""

import subprocess
import sys

from tests.runner.test_confine import CONFINED

LOOK = """
from sinew.runner.limits import limit
limit(2**31, 60)
open({path!r}, "a")
"""


@CONFINED
def test_what_looks_at_a_file_writes_none(tmp_path):
    path = tmp_path / "file"
    path.write_text("kept")
    done = subprocess.run([sys.executable, "-c", LOOK.format(path=str(path))], capture_output=True, text=True)
    assert "PermissionError" in done.stderr
    assert path.read_text() == "kept"
