"""The command on a profile and a stand-in for SLURM; it ends with one line, in this process."""

import re
import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace

import pytest

from sinew.tasks.cli.main import main
from tests.effort import at_most
from tests.tasks.cli.bad_input import listing, write, write_specimen, write_study
from tests.tasks.cluster.stand_in_slurm import FAKE, calls, write_profile


@pytest.fixture
def here(tmp_path, monkeypatch):
    folder, commands = tmp_path / "here", tmp_path / "bin"
    for name in ("sbatch", "squeue", "scancel"):
        write(str(commands / name), FAKE.format(name=name, calls=tmp_path / "calls", answer=commands / f"{name}-says"))
        (commands / name).chmod(0o755)
    write(str(commands / "sbatch-says"), "echo 123")
    folder.mkdir()
    for module in (
        "sinew.tasks.study.pipeline",
        "dask_jobqueue.slurm",
    ):  # so that no case is charged for the time of its imports
        import_module(module)
    monkeypatch.chdir(folder)
    monkeypatch.setenv("PATH", str(commands))
    monkeypatch.delenv("SLURM_JOB_ID", raising=False)
    write_study()
    write_specimen("cohort/s01")
    write_specimen("cohort/s02", "7")
    write_profile()
    return folder


@pytest.fixture
def sinew(here, monkeypatch, capfd) -> Callable[..., SimpleNamespace]:
    """Runs the command; what it printed never is a trace, and never moves a terminal's cursor."""

    def run(*arguments: str) -> SimpleNamespace:
        monkeypatch.setattr(sys, "argv", ["sinew", *arguments])
        with at_most(5):
            try:
                main()
                code = 0
            except SystemExit as stopped:
                code = stopped.code
        out, err = capfd.readouterr()
        assert all(line.isprintable() for line in (out + err).split("\n")), "characters that a terminal obeys"
        return SimpleNamespace(code=code, out=out, err=err)

    return run


@pytest.fixture
def refused(sinew, here) -> Callable[..., str]:
    """Runs the command on bad input and returns the line it printed. Only asking is allowed, not submitting."""

    def run(arguments: tuple[str, ...], *told: str, asked: bool = False) -> str:
        before = listing(here)
        said = sinew(*arguments)
        assert said.code == 2, said
        assert said.out == ""
        assert said.err.startswith("sinew: ")
        assert said.err.count("\n") == 1
        assert said.err.endswith("\n")
        assert [words for words in told if words not in said.err] == [], said.err
        assert not re.search(r"; expected\s*$", said.err), "what was expected is not said"
        if asked:
            assert all(call.startswith("sbatch --test-only ") for call in calls())
            assert not Path("out/jobs/jobs.jsonl").exists()
        else:
            assert calls() == []
            assert listing(here) == before, "something was written"
        return str(said.err)

    return run


@pytest.fixture
def accepted(sinew) -> Callable[..., str]:
    def run(*arguments: str) -> str:
        said = sinew(*arguments)
        assert (said.code, said.err) == (0, ""), said
        return str(said.out)

    return run
