"""`sinew watch`: a picture of a folder from its files alone, in a real terminal, in a pipe, and as JSON lines."""

import io
import json
import os
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pexpect
import psutil
import pytest
from rich.console import Console

from sinew.runner.errors import BadInput
from sinew.runner.progress import open_board, progress
from sinew.runner.store.schema import Field, TableSpec
from sinew.runner.store.store import Store
from sinew.tasks.cli.watch import watch
from sinew.tasks.cli.watch_screen import line, picture
from sinew.tasks.cli.watch_state import Rows, look

COMMAND = ["-m", "sinew", "watch"]
CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f\x1b]")
SPEC = TableSpec("s01 uniaxial", {"what": "x"}, ("x",), ("1",), (Field("y", (), "N", "y"),), ())


def folder_of(
    path: Path, *, state: str = "running", tasks: dict[str, str] | None = None, age_s: float = 0.0, **facts: Any
) -> Path:
    """A result folder as a run of two tasks leaves it."""
    with Store.writing(path, "check") as store:
        store.table(SPEC).plan(np.arange(8.0)[:, np.newaxis])
    tasks = tasks or {"sobol": "finished", "calibrate": "running", "infer": "waiting"}
    content: dict[str, Any] = {
        "title": "calibrate", "of": "rows", "done": 3, "total": 8, "failed": 1, "running": 2, "rows_per_s": 2.5,
        "eta_s": 130.0, "state": state, "tasks": tasks, "task": "calibrate", "workers": 2,
        "notes": {"calibrate": {"distal/1": {"words": "best 3.21 N after 40", "value": 3.21, "unit": "N"}}},
        "process": {"host": socket.gethostname(), "pid": os.getpid(), "since": psutil.Process().create_time()},
        "dashboard": {"host": socket.gethostname(), "port": 4711}, "time": time.time() - age_s,
    }  # fmt: skip
    (path / "progress.json").write_text(json.dumps(content | facts))
    log = [{"message": "task started", "task": "sobol"}, {"message": "task finished", "task": "sobol", "seconds": 7.5}]
    (path / "log.jsonl").write_text("".join(json.dumps(event) + "\n" for event in log))
    return path


def seen(folder: Path) -> dict[str, Any]:
    rows = Rows(folder)
    rows.look()
    return look(folder, rows)


def drawn(found: dict[str, Any], width: int = 100) -> str:
    console = Console(width=width, record=True, file=io.StringIO())
    console.print(picture(found))
    return console.export_text()


def files(folder: Path) -> dict[str, tuple[int, int]]:
    return {str(f): (f.stat().st_mtime_ns, f.stat().st_size) for f in [folder, *folder.rglob("*")]}


def test_a_run_that_goes_on(tmp_path):
    found = seen(folder_of(tmp_path / "out"))
    assert found["state"] == "running"
    assert found["tasks"] == [
        {"task": "sobol", "state": "finished", "seconds": 7.5},
        {"task": "calibrate", "state": "running"},
        {"task": "infer", "state": "waiting"},
    ]
    assert found["notes"]["distal/1"]["value"] == 3.21
    assert found["rows"] == [{"table": "s01 uniaxial", "rows": 8, "done": 0, "failed": 0}]
    text = drawn(found)
    assert "check: " in text
    assert "running, 2 workers" in text
    assert "sobol done 8 s" in text
    assert "3 of 8 rows, 2.5/s, 2.2 min left, 2 run, 1 failed" in text
    assert "distal/1  best 3.21 N after 40" in text
    assert "dashboard: http://127.0.0.1:4711/status" in text
    assert "2.2 min left; distal/1: best 3.21 N after 40" in line(found)


@pytest.mark.parametrize("width", [20, 40, 80, 200])
def test_a_picture_fits_its_terminal(tmp_path, width):
    text = drawn(seen(folder_of(tmp_path / "out")), width)
    assert max(map(len, text.splitlines())) <= width


@pytest.mark.parametrize(
    ("facts", "state", "words"),
    [
        ({"state": "finished"}, "finished", "finished"),
        ({"state": "failed", "error": "study.yaml: line 3\nbad"}, "failed", "study.yaml: line 3\\nbad"),
        ({"state": "interrupted"}, "interrupted", "run the same command again"),
        ({"age_s": 7200, "process": {"host": "elsewhere", "pid": 3, "since": 1.0}}, "interrupted", "2.0 h ago"),
        ({"age_s": 20, "process": {"host": "elsewhere", "pid": 3, "since": 1.0}}, "running", "running"),
        ({"process": {"host": socket.gethostname(), "pid": 2**22 + 1, "since": 1.0}}, "interrupted", "interrupted"),
        ({"process": {"host": socket.gethostname(), "pid": os.getpid(), "since": 1.0}}, "interrupted", "interrupted"),
    ],
)
def test_how_a_run_is(tmp_path, facts, state, words):
    found = seen(folder_of(tmp_path / "out", **facts))
    assert found["state"] == state
    assert words in " ".join(drawn(found, 300).split())
    calibrate = next(task for task in found["tasks"] if task["task"] == "calibrate")
    assert calibrate["state"] == {"finished": "finished"}.get(state, state)


def test_a_task_that_failed_while_others_go_on(tmp_path):
    states = {"sobol": "finished", "calibrate": "failed", "infer": "not run", "discover": "running"}
    found = seen(folder_of(tmp_path / "out", tasks=states, task="discover"))
    assert {one["task"]: one["state"] for one in found["tasks"]} == states
    assert "calibrate failed  infer not run  discover running" in drawn(found)


def test_a_study_that_waits_in_slurms_queue(tmp_path):
    jobs = tmp_path / "jobs" / "jobs.jsonl"
    jobs.parent.mkdir()
    event = {"time": 1.0, "job": "7", "event": "submitted", "role": "coordinator", "name": "sinew-x", "cores": 1}
    jobs.write_text(json.dumps(event) + "\n")
    found = seen(tmp_path)
    assert (found["state"], found["jobs"]) == ("queued", {"running": 0, "waiting": 1, "all": 1})
    assert "waits in the queue" in " ".join(drawn(found).split())


ODD = [None, True, -1, 1e300, "x", [[]], {"a": 1}, "\x1b[2J", {"calibrate": {"a\x1b": {"words": "\x1b[2J"}}}]


FIELDS = [
    "state",
    "error",
    "tasks",
    "task",
    "notes",
    "dashboard",
    "workers",
    "process",
    "of",
    "title",
    "eta_s",
    "failed",
]


@pytest.mark.parametrize("field", FIELDS)
def test_whatever_the_files_hold_nothing_breaks(tmp_path, field):
    folder = folder_of(tmp_path / "out")
    facts = json.loads((folder / "progress.json").read_text())
    for value in ODD:
        (folder / "progress.json").write_text(json.dumps(facts | {field: value}))
        found = seen(folder)
        text = drawn(found) + line(found)
        assert not CONTROL.search(text.replace("\n", "")), value
        json.dumps(found, allow_nan=False)


@pytest.mark.parametrize("content", ["", "{", "[]", "\0", '{"message": 3}\n{"task": []}', "[" * 100_000])
def test_damaged_logs(tmp_path, content):
    folder = folder_of(tmp_path / "out")
    (folder / "log.jsonl").write_text(content)
    assert seen(folder)["state"] == "running"


def test_what_older_versions_left(tmp_path):
    folder = folder_of(tmp_path / "out")
    (folder / "progress.json").unlink()
    assert seen(folder)["state"] == "finished"
    with open(folder / "log.jsonl", "a") as log:
        log.write(json.dumps({"message": "task started", "task": "infer"}) + "\n")
    assert seen(folder)["state"] == "interrupted"


def test_watching_writes_nothing(tmp_path):
    folder = folder_of(tmp_path / "out", state="finished")
    before = files(tmp_path)
    watch(folder)
    watch(folder, once=True)
    watch(folder, form="json")
    watch(tmp_path / "out", once=True, form="json")
    assert files(tmp_path) == before


def test_wrong_folders(tmp_path):
    (tmp_path / "file").write_text("x")
    for once in (True, False):
        with pytest.raises(BadInput, match="is a file"):
            watch(tmp_path / "file", once=once)
    with pytest.raises(BadInput, match="is not there"):
        watch(tmp_path / "absent", once=True)
    assert "nothing has run here yet" in line(watch(tmp_path, once=True))


def test_a_program_hears_of_every_change(tmp_path):
    """From a folder that is not there yet to the end of its run."""
    out = tmp_path / "out"
    command = [sys.executable, *COMMAND, str(out), "--json", "--every", "0.1"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as watching:
        assert watching.stdout is not None
        assert json.loads(watching.stdout.readline())["state"] == "absent"
        out.mkdir()
        with open_board(out) as board, progress("count", 4, board, show="nothing") as report:
            board.put(tasks={"calibrate": "running"}, task="calibrate")
            board.note("calibrate", "s01", "best 2 N", value=2.0)
            board.write()
            states = [json.loads(watching.stdout.readline())["state"]]
            while states[-1] != "running":
                states.append(json.loads(watching.stdout.readline())["state"])
            report(4, 0, 0)
        lines = [json.loads(text) for text in watching.stdout]
        assert watching.wait(20) == 0
    assert (lines[-1]["state"], lines[-1]["now"]["done"]) == ("finished", 4)
    assert lines[-1]["notes"]["s01"]["value"] == 2.0


# ---- a real terminal


@contextmanager
def terminal(folder: Path, **environment: str) -> Iterator[pexpect.spawn]:
    child = pexpect.spawn(
        sys.executable, [*COMMAND, str(folder), "--every", "0.2"], encoding="utf-8", timeout=150, dimensions=(30, 100),
        env={**os.environ, "TERM": "xterm-256color", **environment},
    )  # fmt: skip
    try:
        yield child
    finally:
        child.close(force=True)


@pytest.mark.parametrize("leave", ["q", "\x03"])
def test_in_a_terminal_q_and_ctrl_c_leave_and_put_everything_back(tmp_path, leave):
    folder = folder_of(tmp_path / "out", age_s=-3600)
    before = files(tmp_path)
    with terminal(folder) as child:
        child.expect("best 3.21 N after 40")
        child.expect("q or Ctrl-C leaves")
        child.send(leave)
        child.expect("next: sinew watch")
        child.expect(pexpect.EOF)
        child.wait()
        assert child.exitstatus == 0
        assert child.before.rstrip().endswith("out")
    assert files(tmp_path) == before


def test_a_terminal_without_colours(tmp_path):
    with terminal(folder_of(tmp_path / "out", state="finished"), NO_COLOR="1") as child:
        child.expect(pexpect.EOF)
    assert "best 3.21 N" in child.before
    assert not re.search(r"\x1b\[[0-9;]*3[0-9][;m]", child.before), "a colour"
    with terminal(folder_of(tmp_path / "other", state="finished")) as child:
        child.expect(pexpect.EOF)
    assert re.search(r"\x1b\[[0-9;]*3[0-9][;m]", child.before)
    assert "next: sinew report" in child.before


def test_sigterm_puts_the_terminal_back(tmp_path):
    with terminal(folder_of(tmp_path / "out", age_s=-3600)) as child:  # it may take its time on a busy machine
        child.expect("q or Ctrl-C leaves")
        assert not child.getecho()
        child.kill(signal.SIGTERM)
        child.expect(pexpect.EOF)
        assert "\x1b[?25h" in child.before, "the cursor is shown again"


def test_a_pipe_gets_lines_without_control_characters(tmp_path):
    folder = folder_of(tmp_path / "out", state="failed", error="\x1b[2Jboom")
    done = subprocess.run([sys.executable, *COMMAND, str(folder)], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stderr) == (0, "")
    assert "boom" in done.stdout
    assert not CONTROL.search(done.stdout.replace("\n", ""))
    assert done.stdout.splitlines()[-1] == f"next: sinew status {folder}"
