"""A pipe, a device or a file without end in place of an input or of a result is refused at once by every reader."""

import os
import signal
import socket
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from sinew.runner.cluster.job_table import JobTable
from sinew.runner.errors import SinewError
from sinew.runner.progress import PROGRESS, read_progress
from sinew.runner.store.planned import PlannedRows
from sinew.tasks.benchmark.answers import read_answers as hidden_answers
from sinew.tasks.cluster.profile import read_profile
from sinew.tasks.data.answers import read_answers
from sinew.tasks.data.cohort import read_cohort
from sinew.tasks.data.exports import read_export
from sinew.tasks.data.sheets import read_sheets
from sinew.tasks.model import Model
from sinew.tasks.registry import TASKS
from sinew.tasks.report.folder import _read_log
from sinew.tasks.report.status import logged_tasks
from sinew.tasks.simulate.febio.files import read_text
from sinew.tasks.simulate.febio.kept_files import contents
from sinew.tasks.simulate.febio.model_file.source import read_source
from sinew.tasks.simulate.febio.output import read_records
from sinew.tasks.simulate.febio.plot_file import read_plot_file
from sinew.tasks.simulate.row_by_row import Failed
from sinew.tasks.simulate.rows import read_parameters
from sinew.tasks.study import range_check as ranges
from sinew.tasks.study.checkpoint import Checkpoint
from sinew.tasks.study.files import read_json
from sinew.tasks.study.study import read_study


def cohort_with(path: Path) -> Any:
    path.with_name("pull.csv").write_text("time_s,displacement_mm,force_N\n0,0,0\n1,1,1\n2,2,2\n")
    return read_cohort(path.parents[1])


READERS: dict[str, tuple[str, Callable[[Path], Any]]] = {
    "study": ("study.yaml", read_study),
    "profile": ("profile.yaml", read_profile),
    "specimen": ("cohort/one/specimen.json", cohort_with),
    "curve": ("cohort/one/other.csv", cohort_with),
    "export": ("export.csv", read_export),
    "parameters": ("rows.csv", lambda path: read_parameters(path, Model())),
    "template": ("bar.feb", read_text),
    "FEBio model": ("cube.feb", read_source),
    "answers": ("answers.yaml", read_answers),
    "hidden effects": ("answers.json", lambda path: hidden_answers(path.parent)),
    "spreadsheet": ("a.xlsx", lambda path: list(read_sheets(path))),
    "plot file": ("model.xplt", lambda path: read_plot_file(path, 2**20)),
    "output": ("force.txt", lambda path: read_records(path, 2**20)),
    "kept runs": ("runs.safetensors", lambda path: list(contents(path))),
    "ranges": (ranges.RANGES, ranges.read),
    "JSON": ("any.json", read_json),
    "progress": (PROGRESS, lambda path: read_progress(path.parent)),
    "log": ("log.jsonl", lambda path: logged_tasks(path.parent)),
    "log of a page": ("log.jsonl", lambda path: _read_log(path, [])),
    "jobs": ("jobs.jsonl", lambda path: JobTable(path.parent).read()),
    "checkpoint": ("fits.jsonl", lambda path: Checkpoint(path, "inputs").kept),
    "planned rows": ("planned", lambda path: list(PlannedRows(path).read(2))),
    **{
        f"result of {name}": (f"{name}.json", lambda path, task=task: task.read(path.parent))
        for name, task in TASKS.items()
    },
}


def a_socket(path: Path) -> None:
    server = socket.socket(socket.AF_UNIX)
    here = Path.cwd()
    os.chdir(path.parent)  # the name of a socket is short
    server.bind(path.name)
    os.chdir(here)
    server.close()


KINDS: dict[str, Callable[[Path], Any]] = {
    "pipe": os.mkfifo,
    "socket": a_socket,
    "terminal": lambda path: path.symlink_to("/dev/ptmx"),
    "zeros": lambda path: path.symlink_to("/dev/zero"),
    "kernel's messages": lambda path: path.symlink_to("/proc/kmsg"),
    "endless": lambda path: os.truncate(os.open(path, os.O_CREAT | os.O_WRONLY), 2**40),
    "folder": Path.mkdir,
}


@pytest.fixture(autouse=True)
def no_hang() -> Iterator[None]:
    def hangs(*_: Any) -> None:
        raise AssertionError("it hangs")

    before = signal.signal(signal.SIGALRM, hangs)
    signal.alarm(10)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("reader", READERS)
def test_what_is_no_file_is_refused_at_once(tmp_path, reader, kind):
    name, read = READERS[reader]
    path = tmp_path / name
    path.parent.mkdir(parents=True, exist_ok=True)
    KINDS[kind](path)
    try:
        found = read(path)
    except Failed as failed:  # of a row
        assert failed.status == "bad_output"
        assert "\n" not in failed.words
    except SinewError as error:
        assert str(error).startswith(str(tmp_path))
        assert "\n" not in str(error)
    else:
        assert not found
