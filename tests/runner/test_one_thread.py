"""The command does its linear algebra in one thread, as its workers do."""

import subprocess
import sys

from sinew.runner.one_thread import ONE_THREAD

COUNT = """
import os, sys
sys.argv = ["sinew", "--version"]
import sinew.__main__
import numpy, scipy.linalg
from threadpoolctl import threadpool_info
print(sorted({one["num_threads"] for one in threadpool_info() if one["user_api"] == "blas"}))
"""


def test_the_command_uses_one_thread(monkeypatch):
    for name in ONE_THREAD:
        monkeypatch.setenv(name, "2")
    done = subprocess.run([sys.executable, "-c", COUNT], capture_output=True, text=True, check=True)
    assert done.stdout == "[1]\n"


def test_tests_run_as_the_command_does():
    import threadpoolctl

    found = [one["num_threads"] for one in threadpoolctl.threadpool_info() if one["user_api"] == "blas"]
    assert set(found) == {1}
