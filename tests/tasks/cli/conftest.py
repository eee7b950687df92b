"""Fixtures of tests of bad input: a folder with one valid study, and the command that must refuse it once broken."""

import sys
from importlib import import_module
from typing import Any

import pytest

from sinew.tasks.cli.main import main
from tests.effort import at_most
from tests.tasks.cli.bad_input import EXPORT, PARAMETERS, listing, write, write_specimen, write_study


@pytest.fixture
def here(tmp_path, monkeypatch):
    """A working directory with everything that is valid. An evaluation would mean that the input was accepted."""

    def accepted(*_: Any) -> None:
        raise AssertionError("the input was accepted: an evaluation was started")

    import_module("sinew.tasks.study.pipeline")  # so that no case is charged for the time of its imports
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sinew.tasks.study.workspace.evaluate", accepted)
    write_study()
    write_specimen("cohort/s01")
    write_specimen("cohort/s02", "7")
    write("rows.csv", PARAMETERS)
    write("test.csv", EXPORT)
    return tmp_path


@pytest.fixture
def refused(here, monkeypatch, capfd):
    """Runs the command on bad input and returns the line it printed."""

    def run(arguments: tuple[str, ...], *told: str) -> str:
        before = listing(here)
        monkeypatch.setattr(sys, "argv", ["sinew", *arguments])
        with at_most(5), pytest.raises(SystemExit) as stopped:
            main()
        out, err = capfd.readouterr()
        assert stopped.value.code == 2
        assert out == ""
        assert err.startswith("sinew: ")
        assert err.endswith("\n")
        assert err[:-1].isprintable(), "more than one line, or characters that a terminal obeys"
        assert "Traceback" not in err
        assert [words for words in told if words not in err] == [], err
        assert listing(here) == before, "something was written"
        return err

    return run
