"""Ctrl-C at a moment when the command has not begun yet: it ends, and prints nothing."""

import os
import signal
import subprocess
import sys
import time

import pytest

WAITS = """
import pathlib, time
pathlib.Path({ready!r}).touch()
time.sleep(100)
"""


@pytest.mark.parametrize("entry", [["-m", "sinew"], ["-c", "from sinew.__main__ import command; command()"]])
def test_an_interrupt_during_the_imports_ends_it_silently(tmp_path, entry):
    """Its first library waits while it is imported."""
    ready = tmp_path / "ready"
    (tmp_path / "click.py").write_text(WAITS.format(ready=str(ready)))
    environment = os.environ | {"PYTHONPATH": str(tmp_path)}
    process = subprocess.Popen([sys.executable, *entry, "--help"], stderr=subprocess.PIPE, env=environment)
    deadline = time.monotonic() + 100
    while not ready.exists():
        assert process.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=100)
    assert process.returncode == -signal.SIGINT
    assert said == b""


def test_an_interrupt_that_its_shell_ignores_stays_ignored():
    code = "import signal; signal.signal(signal.SIGINT, signal.SIG_IGN); import sinew.__main__ as it\n"
    code += "it.main = lambda: print(signal.getsignal(signal.SIGINT).name)\nit.command()"
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert said.stdout.split() == ["SIG_IGN"]
