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
import stat
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import psutil
import pytest

from runner.errors import StoreError
from runner.store import PENDING, Segment, open_store
from tasks.cohort import virtual_cohort, write_cohort
from tests.runner.test_store import contents

# Plays febio4: a spring and a dashpot, and one line in a file for each run.
SOLVER = """#!{python} -IS
import hashlib, os, re, sys, time
if sys.argv[1] == "-info":
    print("version 9.9.9")
    sys.exit()
text = open("model.feb").read()
stiffness = float(re.search("<E>(.*)</E>", text).group(1))
points = re.findall("<pt>(.*),(.*)</pt>", text.split("solver steps")[0])
time.sleep(0.02)
with open("reaction.txt", "w") as file:
    for step, (t, u) in enumerate(points[1:], 1):
        file.write("*Step  = %d\\n*Time  = %s\\n*Data  = reaction\\n5,%r\\n" % (step, t, stiffness * float(u)))
open("model.log", "w").write(" N O R M A L   T E R M I N A T I O N\\n")
row = hashlib.md5(text.split("</Material>")[0].encode()).hexdigest()
notes = os.open({notes!r}, os.O_WRONLY | os.O_APPEND | os.O_CREAT)
os.write(notes, ("%s %r\\n" % (row, stiffness)).encode())
"""

STUDY = """
name: survival
seed: 7
simulator: {name: febio, executable: SOLVER, timeout_s: 60}
store: {points_per_curve: 16}
model:
  parameters:
    alpha_f: {fixed: 500}
    nu_m: {fixed: 0.2}
sobol: {base_samples: 32}
"""


def prepare(folder: Path) -> tuple[Path, Path, Path]:
    """A study, its cohort and the solver's notes."""
    specimens, _ = virtual_cohort(seed=1, per_site=1, rate_hz=1.0)
    write_cohort(folder / "cohort", specimens[:1])
    for name in ("cyclic", "two_step"):
        (folder / "cohort" / specimens[0].name / f"{name}.csv").unlink()
    notes = folder / "notes"
    solver = folder / "solver"
    solver.write_text(SOLVER.format(python=sys.executable, notes=str(notes)))
    solver.chmod(solver.stat().st_mode | stat.S_IXUSR)
    study = folder / "study.yaml"
    study.write_text(STUDY.replace("SOLVER", str(solver)))
    return study, folder / "cohort", notes


def start(study: Path, cohort: Path, out: Path, workers: int) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "tasks.cli", "sobol", str(study), "--data", str(cohort), "--out", str(out)]
    with open(study.with_name("errors"), "ab") as errors:
        return subprocess.Popen([*command, "--workers", str(workers), "--quiet"], stdout=errors, stderr=errors)


def finish(process: subprocess.Popen[bytes], study: Path) -> None:
    assert process.wait(200) == 0, study.with_name("errors").read_text()


def worker_processes(client: int) -> list[psutil.Process]:
    """The Dask workers below a client: the children that started solvers or could."""
    try:
        children = psutil.Process(client).children()
        return [child for child in children if "spawn_main" in " ".join(child.cmdline())]
    except psutil.NoSuchProcess:
        return []


def committed(out: Path) -> set[int]:
    """Rows that count, in chunks or in the journal."""
    if not (out / "store.zarr" / "evaluations").exists():
        return set()
    rows: set[int] = set()
    for table in open_store(out).tables():
        for path in table.segments():
            with contextlib.suppress(StoreError):  # folded in meanwhile
                rows.update(Segment.read(path).rows.tolist())
        rows.update(np.flatnonzero(table.status != PENDING).tolist())
    return rows


def leftovers(solver: Path) -> list[psutil.Process]:
    found = []
    for process in psutil.process_iter():
        try:
            if str(solver) in process.cmdline():
                found.append(process)
        except psutil.Error:
            continue
    return found


def test_ten_kills_lose_nothing_and_change_nothing(tmp_path):
    (tmp_path / "calm").mkdir()
    study, cohort, notes = prepare(tmp_path / "calm")
    finish(start(study, cohort, tmp_path / "calm" / "out", workers=1), study)
    order = notes.read_text().split("\n")[:-1]  # one worker, so the solver met the rows in their order
    row_of = {line.split()[0]: row for row, line in enumerate(order)}
    total = len(order)
    assert len(row_of) == total == len(committed(tmp_path / "calm" / "out"))

    (tmp_path / "chaos").mkdir()
    study, cohort, notes = prepare(tmp_path / "chaos")
    out = tmp_path / "chaos" / "out"
    dice = random.Random(20)
    victims = ["worker", "workers", "client", "worker", "client", "workers", "worker", "client", "worker", "workers"]
    snapshots: list[tuple[set[int], int]] = []
    process = start(study, cohort, out, workers=2)
    for kill, victim in enumerate(victims):
        target = total * (kill + dice.uniform(0.2, 0.9)) / (len(victims) + 1)
        deadline = time.monotonic() + 60
        while len(rows := committed(out)) < target:
            assert process.poll() is None, study.with_name("errors").read_text()
            assert time.monotonic() < deadline, f"{len(rows)} of {total} rows, none new for a minute"
            time.sleep(dice.uniform(0.01, 0.2))
        workers = worker_processes(process.pid)
        if victim == "client":
            process.kill()
            process.wait()
            _, alive = psutil.wait_procs(workers, timeout=20)
            assert not alive, "workers outlive their client"
        else:
            for worker in workers if victim == "workers" else workers[:1]:
                worker.kill()
        rows = committed(out)
        snapshots.append((rows, len(notes.read_text().splitlines()) if notes.exists() else 0))
        if victim == "client":
            process = start(study, cohort, out, workers=2)
    finish(process, study)

    runs = [row_of[line.split()[0]] for line in notes.read_text().splitlines()]
    again = [row for rows, count in snapshots for row in runs[count:] if row in rows]
    print(f"{total} rows, {len(runs)} runs of the solver, {len(victims)} kills")
    assert not again, "committed rows were computed again"
    assert set(runs) == set(range(total))
    deadline = time.monotonic() + 5
    while (left := leftovers(tmp_path / "chaos" / "solver")) and time.monotonic() < deadline:
        time.sleep(0.1)
    assert not left, "solvers outlive the study"
    calm, chaos = (contents(tmp_path / name / "out" / "store.zarr") for name in ("calm", "chaos"))
    assert chaos == calm


def test_a_finished_study_is_not_computed_again(tmp_path):
    study, cohort, notes = prepare(tmp_path)
    for _ in range(2):
        finish(start(study, cohort, tmp_path / "out", workers=2), study)
    status = open_store(tmp_path / "out").tables()[0].status
    assert len(notes.read_text().splitlines()) == status.size
    assert not np.any(status)


TASKS = """
name: tasks
seed: 3
cohort: cohort
cluster: {name: local, workers: 2}
tasks: [sobol, importance, calibrate, infer, predict, compare]
store: {points_per_curve: 16}
sobol: {base_samples: 32, resamples: 20}
importance: {trees: 10, repeats: 2}
calibrate: {evaluations: 60, bayesian: {evaluations: 20}}
infer: {population: 8, generations: 3, epsilon: 1.0, pending: 16}
predict: {draws: 8}
compare: {permutations: 20}
"""
# `sinew run` but for the figures, which take longer than all the rest and are drawn from finished results
WITHOUT_FIGURES = "from tasks import cli, pipeline; pipeline._draw = lambda *_: None; cli.main()"


def start_all(study: Path, out: Path) -> subprocess.Popen[bytes]:
    """The command with all that it starts in a process group of its own."""
    command = [sys.executable, "-c", WITHOUT_FIGURES, "run", str(study), "--out", str(out), "--quiet"]
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


@pytest.mark.timeout(900)
def test_all_tasks_killed_at_any_moment_end_with_the_same_bytes(tmp_path):
    """The whole process group dies by SIGKILL in three of the tasks, at moments drawn from a fixed seed."""
    specimens, _ = virtual_cohort(seed=1, per_site=1, rate_hz=1.0)
    write_cohort(tmp_path / "cohort", specimens[:2])
    study, calm, cut = tmp_path / "study.yaml", tmp_path / "calm", tmp_path / "cut"
    study.write_text(TASKS)
    finish(start_all(study, calm), study)
    took = {line["task"]: line["seconds"] for line in told(calm) if line["message"] == "task finished"}
    assert list(took) == ["sobol", "importance", "calibrate", "infer", "predict", "compare"]

    dice = random.Random(8)
    died_in = []
    for victim in ("calibrate", "infer", "predict"):
        process, before = start_all(study, cut), len(told(cut))
        deadline = time.monotonic() + 120
        while not any(line["task"] == victim for line in told(cut)[before:]):
            assert process.poll() is None, study.with_name("errors").read_text()
            assert time.monotonic() < deadline, f"{victim} does not begin"
            time.sleep(0.02)
        time.sleep(dice.uniform(0.1, 0.8) * took[victim])
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        last = told(cut)[-1]
        died_in.append((last["task"], last["message"]))
        deadline = time.monotonic() + 10
        while (left := in_group(process.pid)) and time.monotonic() < deadline:
            time.sleep(0.1)
        assert not left, "workers outlive the command"
    print(died_in)
    assert sum(message == "task started" for _, message in died_in) >= 2, f"killed between tasks: {died_in}"
    finish(start_all(study, cut), study)
    assert results(cut) == results(calm)
    assert contents(cut / "store.zarr") == contents(calm / "store.zarr")


def test_an_interrupt_from_the_terminal_is_one_line_and_nothing_is_left(tmp_path):
    """Ctrl-C reaches the command and all of its workers at once; finished rows are there when it goes on."""
    study, cohort, _ = prepare(tmp_path)
    out, errors = tmp_path / "out", tmp_path / "errors"
    command = [sys.executable, "-m", "tasks.cli", "sobol", str(study), "--data", str(cohort), "--out", str(out)]
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
    assert "sinew: interrupted; run the same command again to go on" in said
    assert "Traceback" not in said
    rows = committed(out)
    finish(start(study, cohort, out, workers=2), study)
    assert rows < committed(out)
