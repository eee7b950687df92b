"""Work in a process of its own: its death is told, its errors come back, its files stay."""

import errno
import os
import signal

import pytest

from sinew.runner.evaluation.isolation import run_apart


def test_work_that_ends_leaves_its_files(tmp_path):
    path = tmp_path / "result"
    assert run_apart(lambda: path.write_text(f"{os.getpid()}")) is None
    assert int(path.read_text()) != os.getpid()


@pytest.mark.parametrize("name", ["SIGSEGV", "SIGKILL", "SIGABRT"])
def test_death_is_told(name):
    number = signal.Signals[name]
    assert run_apart(lambda: os.kill(os.getpid(), number)) == name


def test_an_exception_is_told_in_its_own_words():
    def work() -> None:
        raise ArithmeticError("no such tissue")

    assert run_apart(work) == "exit code 1: ArithmeticError: no such tissue"


def test_an_error_of_the_system_comes_back(tmp_path):
    def work() -> None:
        raise OSError(errno.ENOSPC, "No space left on device", str(tmp_path))

    with pytest.raises(OSError, match="No space left") as raised:
        run_apart(work)
    assert raised.value.errno == errno.ENOSPC
    assert raised.value.filename == str(tmp_path)
