"""A whole study, killed again and again: no committed row is computed twice, and the arrays are the same to the byte.

The study is a real `sinew sobol` in a process of its own, on the FEBio simulator with a stand-in solver that writes
down each row it is asked for. What is killed, and when, is drawn at random from a fixed seed. A smaller one, on the
embedded simulator, has all tasks.
"""

import contextlib
import json
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import psutil
import pytest

from sinew.runner.store.store import open_store
from sinew.tasks.data.cohort import write_cohort
from sinew.tasks.data.virtual import virtual_cohort
from sinew.tasks.study.workspace import Workspace
from tests.runner.stores import contents
from tests.tasks.stand_in import ROWS_PER_BASE_SAMPLE, WITHOUT_FIGURES, committed, leftovers, prepare
from tests.tasks.study.test_pipeline import sinew
from tests.trusting import trusted


def start(study: Path, cohort: Path, out: Path, workers: int) -> subprocess.Popen[bytes]:
    """The command without figures and page, which take longer than all the rest and are made from finished results."""
    command = [sys.executable, str(WITHOUT_FIGURES), "sobol", str(study), "--data", str(cohort), "--out", str(out)]
    with open(study.with_name("errors"), "ab") as errors:
        return subprocess.Popen([*command, "--workers", str(workers), "--quiet"], stdout=errors, stderr=errors)


def finish(process: subprocess.Popen[bytes], study: Path) -> None:
    assert process.wait(200) == 0, study.with_name("errors").read_text()


def worker_processes(client: int) -> list[psutil.Process]:
    """The Dask workers below a client: those that start, and those that run and have given themselves a title."""
    try:
        children = psutil.Process(client).children()
        titles = ("spawn_main", "dask worker")
        return [child for child in children if any(title in " ".join(child.cmdline()) for title in titles)]
    except psutil.NoSuchProcess:
        return []


VICTIMS = ("worker", "client", "workers")


def kill(victim: str, process: subprocess.Popen[bytes]) -> None:
    """Kill the client, one of its workers, or all of them. Returns when the client's workers are gone with it."""
    workers = worker_processes(process.pid)
    if victim == "client":
        process.kill()
        process.wait()
        _, alive = psutil.wait_procs(workers, timeout=20)
        assert not alive, "workers outlive their client"
    else:
        for worker in workers if victim == "workers" else workers[:1]:
            worker.kill()


@pytest.mark.timeout(600)
def test_kills_lose_nothing_and_change_nothing(tmp_path, monkeypatch):
    """Three kills, spread over the study: a worker, the client and both workers. `make chaos` has a thousand."""
    base_samples = 4
    total = base_samples * ROWS_PER_BASE_SAMPLE
    for name in ("calm", "chaos"):
        (tmp_path / name).mkdir()
    undisturbed, cohort, order = prepare(tmp_path / "calm", base_samples=base_samples)
    with monkeypatch.context() as patch:
        patch.setattr(Workspace, "client", lambda _: None)  # evaluates in this process, row after row
        sinew("sobol", undisturbed, "--data", cohort, "--out", tmp_path / "calm" / "out", "--quiet")
    study, cohort, notes = prepare(tmp_path / "chaos", base_samples=base_samples)
    out = tmp_path / "chaos" / "out"
    dice = random.Random(20)
    snapshots: list[tuple[set[int], int]] = []
    process = start(study, cohort, out, workers=2)
    for number, victim in enumerate(VICTIMS):
        target = total * (number + dice.uniform(0.2, 0.9)) / (len(VICTIMS) + 1)
        deadline = time.monotonic() + 240
        while len(rows := committed(out)) < target:
            assert process.poll() is None, study.with_name("errors").read_text()
            assert time.monotonic() < deadline, f"{len(rows)} of {total} rows, none new for four minutes"
            time.sleep(dice.uniform(0.01, 0.2))
        kill(victim, process)
        rows = committed(out)
        snapshots.append((rows, len(notes.read_text().splitlines()) if notes.exists() else 0))
        if victim == "client":
            process = start(study, cohort, out, workers=2)
    finish(process, study)

    met = order.read_text().splitlines()
    row_of = {line.split()[0]: row for row, line in enumerate(met)}
    assert len(row_of) == len(met) == len(committed(tmp_path / "calm" / "out")) == total
    runs = [row_of[line.split()[0]] for line in notes.read_text().splitlines()]
    again = [row for rows, count in snapshots for row in runs[count:] if row in rows]
    print(f"{total} rows, {len(runs)} runs of the solver, rows at each kill: {[len(rows) for rows, _ in snapshots]}")
    assert not again, "committed rows were computed again"
    assert set(runs) == set(range(total))
    deadline = time.monotonic() + 5
    while (left := leftovers(tmp_path / "chaos" / "solver")) and time.monotonic() < deadline:
        time.sleep(0.1)
    assert not left, "solvers outlive the study"
    calm, chaos = (contents(tmp_path / name / "out" / "store.zarr") for name in ("calm", "chaos"))
    assert chaos == calm


TASKS = """
name: tasks
seed: 3
cohort: cohort
cluster: {name: local, workers: 2}
tasks: [sobol, importance, calibrate, infer, predict, compare]
store: {points_per_curve: 16}
sobol: {base_samples: 8, resamples: 20}
importance: {trees: 10, repeats: 2}
calibrate: {evaluations: 40, starts: 1, bayesian: {evaluations: 12}}
infer: {paper: true, population: 8, generations: 3, epsilon: 1.0, pending: 16}
predict: {draws: 8}
compare: {permutations: 20}
"""


def start_all(study: Path, out: Path) -> subprocess.Popen[bytes]:
    """The command with all that it starts in a process group of its own."""
    command = [sys.executable, str(WITHOUT_FIGURES), "run", str(study), "--out", str(out), "--quiet"]
    with open(study.with_name("errors"), "ab") as errors:
        return subprocess.Popen(command, stdout=errors, stderr=errors, start_new_session=True)


def told(out: Path) -> list[dict[str, object]]:
    """What the log says of tasks, the line that is being written left out."""
    path = out / "log.jsonl"
    lines = path.read_text().split("\n")[:-1] if path.exists() else []
    return [line for line in map(json.loads, lines) if "task" in line]


def in_group(group: int) -> list[psutil.Process]:
    found = []
    for process in psutil.process_iter():
        with contextlib.suppress(OSError, psutil.Error):
            if os.getpgid(process.pid) == group and process.status() != psutil.STATUS_ZOMBIE:
                found.append(process)
    return found


def results(out: Path) -> dict[str, bytes]:
    files = [*out.glob("*.json"), *out.glob("*.csv")]
    return {file.name: file.read_bytes() for file in files if file.name != "progress.json"}


def known(out: Path) -> int:
    """The number of rows of all tables that are committed."""
    return sum(table.finished() + table.waiting() for table in open_store(out).tables())


def killed_in(task: str, study: Path, out: Path, rows: float) -> str:
    """Run a study and kill its process group when a task has committed so many rows; returns the log's last message."""
    before = len(told(out))
    process = start_all(study, out)

    def until(ready: Callable[[], bool], what: str) -> None:
        deadline = time.monotonic() + 120
        while not ready():
            assert process.poll() is None, study.with_name("errors").read_text()
            assert time.monotonic() < deadline, f"{task} does not {what}"
            time.sleep(0.02)

    until(lambda: any(line["task"] == task for line in told(out)[before:]), "begin")
    if rows:
        target = known(out) + rows
        until(lambda: known(out) >= target, f"commit {rows} rows")
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    deadline = time.monotonic() + 10
    while (left := in_group(process.pid)) and time.monotonic() < deadline:
        time.sleep(0.1)
    assert not left, "workers outlive the command"
    last = told(out)[-1]
    return f"{last['task']}: {last['message']}"


@pytest.mark.timeout(600)
@pytest.mark.thorough
def test_all_tasks_killed_at_any_moment_end_with_the_same_bytes(tmp_path, monkeypatch):
    """The whole process group dies by SIGKILL in two of the tasks, after numbers of rows drawn from a fixed seed."""
    specimens, _ = virtual_cohort(seed=1, per_site=1, rate_hz=1.0)
    write_cohort(tmp_path / "cohort", specimens[:2])
    study, calm, cut = tmp_path / "study.yaml", tmp_path / "calm", tmp_path / "cut"
    study.write_text(TASKS)
    with monkeypatch.context() as patch:
        patch.setattr(Workspace, "client", lambda _: None)  # evaluates in this process
        sinew("run", study, "--out", calm, "--quiet")
    new = {line["task"]: line["new_simulations"] for line in told(calm) if line["message"] == "task finished"}
    assert list(new) == ["sobol", "importance", "calibrate", "infer", "predict", "compare"]

    dice = random.Random(8)
    ends = [killed_in(task, study, cut, dice.uniform(0.1, 0.6) * new[task]) for task in ("calibrate", "infer")]
    print(ends)
    assert ends == ["calibrate: task started", "infer: task started"]
    finish(start_all(study, cut), study)
    assert results(cut) == results(calm)
    assert contents(cut / "store.zarr") == contents(calm / "store.zarr")


@pytest.mark.thorough
def test_an_interrupt_from_the_terminal_is_one_line_and_nothing_is_left(tmp_path):
    """Ctrl-C reaches the command and all of its workers at once; finished rows are there when it goes on.

    What is finished is not computed again.
    """
    study, cohort, notes = prepare(tmp_path, seconds=0.5, base_samples=2)
    out, errors = tmp_path / "out", tmp_path / "errors"
    command = [sys.executable, "-m", "sinew", "sobol", str(study), "--data", str(cohort), "--out", str(out)]
    with open(errors, "wb") as file:
        process = subprocess.Popen(command, stdout=file, stderr=file, start_new_session=True)
    deadline = time.monotonic() + 120
    while not committed(out):
        assert process.poll() is None, errors.read_text()
        assert time.monotonic() < deadline, "no row is finished"
        time.sleep(0.05)
    os.killpg(process.pid, signal.SIGINT)
    assert process.wait(60) == 130
    deadline = time.monotonic() + 10  # workers that die with it may take a moment
    while (left := in_group(process.pid)) and time.monotonic() < deadline:
        time.sleep(0.1)
    assert not left
    said = errors.read_text()
    assert "sinew: interrupted; run the same command again; rows that were evaluated are kept" in said
    assert "Traceback" not in said
    rows = committed(out)
    assert len(rows) < 2 * ROWS_PER_BASE_SAMPLE
    solver = tmp_path / "solver"
    solver.write_text(solver.read_text().replace("time.sleep(0.5)", "time.sleep(0.01)"))
    finish(start(trusted(study), cohort, out, workers=2), study)
    assert rows < committed(out)
    ran = notes.read_text()
    sinew("sobol", study, "--data", cohort, "--out", out, "--quiet")
    assert notes.read_text() == ran
    assert not np.any(open_store(out).tables()[0].status)
