"""Solvers of several threads and of workers that die: each worker ends its own solvers, and only those."""

import signal
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor

import psutil
import pytest

from sinew.runner.evaluation import external
from sinew.runner.evaluation.external import run
from tests.runner.evaluation.solver_processes import LINUX, LONG_S, ROOT, becomes, daemon, program, sleeping

# ---- several runs at once


@LINUX
def test_runs_in_threads_leave_each_other_alone(tmp_path, mark):
    """Some leave processes, some are timed out, while others go on for longer than all of them."""
    waits = f"{daemon(mark)}\nsleep 1.2\nkill -0 $(cat daemon.pid) && echo its daemon lives\necho end"
    kinds = [
        (waits, LONG_S, (0, False, "its daemon lives\nend\n")),
        (f"sleep {mark} &\n{daemon(mark)}\necho end", LONG_S, (0, False, "end\n")),
        (f"echo begun\nexec sleep {mark}", 0.5, (-signal.SIGKILL, True, "begun\n")),
        ("sleep 0.6\nsleep 0.6\necho end", LONG_S, (0, False, "end\n")),
    ]

    def one(number: int) -> tuple[int, bool, str]:
        folder = tmp_path / str(number)
        finished = run([str(folder / "program")], folder, timeout_s=kinds[number % 4][1])
        return finished.returncode, finished.timed_out, finished.output

    for number in range(12):
        (tmp_path / str(number)).mkdir()
        program(tmp_path / str(number), kinds[number % 4][0])
    with ThreadPoolExecutor(12) as threads:
        assert list(threads.map(one, range(12))) == [expected for _, _, expected in kinds] * 3
    assert becomes(lambda: not sleeping(mark), LONG_S)


def test_one_guard_for_all_threads_of_a_process(tmp_path):
    started = threading.Barrier(6)

    def one(number: int) -> int:
        folder = tmp_path / str(number)
        folder.mkdir()
        started.wait(10)
        run(["true"], folder, timeout_s=LONG_S)
        assert external._guard is not None
        return external._guard[2].pid

    with ThreadPoolExecutor(6) as threads:
        assert len(set(threads.map(one, range(6)))) == 1


def test_other_children_of_the_worker_stay(tmp_path, mark):
    other = subprocess.Popen(["sleep", mark], start_new_session=True)
    try:
        run(program(tmp_path, "exit 0"), tmp_path, timeout_s=LONG_S)
        assert other.poll() is None
    finally:
        other.kill()
        other.wait()


# ---- the end of the worker

WORKER = """
import sys
from pathlib import Path
from sinew.runner.evaluation.external import run
run([sys.argv[1]], Path(sys.argv[2]), timeout_s=1000)
"""


@LINUX
@pytest.mark.parametrize("how", ["SIGKILL", "SIGTERM", "SIGINT"])
def test_a_killed_worker_leaves_nothing(tmp_path, mark, how):
    text = f"sleep {mark} &\n{daemon(mark)}\ntouch ready\nexec sleep {mark}"
    command = [sys.executable, "-c", WORKER, *program(tmp_path, text), str(tmp_path)]
    worker = subprocess.Popen(command, cwd=ROOT, stderr=subprocess.DEVNULL)
    try:
        assert becomes(lambda: (tmp_path / "ready").exists() and len(sleeping(mark)) == 3, LONG_S)
        everything = psutil.Process(worker.pid).children(recursive=True)
        assert len(everything) >= 3
        worker.send_signal(signal.Signals[how])
        worker.wait(3)
    finally:
        worker.kill()
        worker.wait()
    assert becomes(lambda: not sleeping(mark), LONG_S)
    assert becomes(lambda: not any(map(alive, everything)), LONG_S), "the guard stays"


def alive(process: psutil.Process) -> bool:
    try:
        return process.is_running() and process.status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


@LINUX
def test_a_killed_worker_takes_only_its_own_solvers_with_it(tmp_path, mark):
    for name in ("first", "second"):
        (tmp_path / name).mkdir()
        program(tmp_path / name, f"touch ready\nexec sleep {mark}")
    workers = [
        subprocess.Popen(
            [sys.executable, "-c", WORKER, str(tmp_path / name / "program"), str(tmp_path / name)],
            cwd=ROOT,
            stderr=subprocess.DEVNULL,
        )
        for name in ("first", "second")
    ]
    try:
        assert becomes(lambda: len(sleeping(mark)) == 2, LONG_S)
        workers[0].kill()
        workers[0].wait()
        assert becomes(lambda: len(sleeping(mark)) == 1, LONG_S)
        assert not becomes(lambda: len(sleeping(mark)) == 0, 0.5)
    finally:
        for worker in workers:
            worker.kill()
            worker.wait()
    assert becomes(lambda: not sleeping(mark), LONG_S)


@LINUX
def test_a_worker_that_ends_by_itself_takes_its_guard_with_it(tmp_path):
    script = f"{WORKER}\nimport sinew.runner.evaluation.external\nprint(sinew.runner.evaluation.external._guard[2].pid)"
    command = [sys.executable, "-W", "error", "-c", script, *program(tmp_path, "exit 0"), str(tmp_path)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=60)
    guard = int(done.stdout)
    assert becomes(lambda: not psutil.pid_exists(guard) or psutil.Process(guard).status() == "zombie", LONG_S)
    assert (done.returncode, done.stderr) == (0, "")


@LINUX
def test_a_guard_that_was_killed_is_replaced(tmp_path, mark):
    kills_its_guard = """
import sinew.runner.evaluation.external
run(["true"], Path(sys.argv[2]), timeout_s=20)
sinew.runner.evaluation.external._guard[2].kill()
sinew.runner.evaluation.external._guard[2].wait()
run("""
    script = WORKER.replace("\nrun(", kills_its_guard)
    command = [sys.executable, "-c", script, *program(tmp_path, f"exec sleep {mark}"), str(tmp_path)]
    worker = subprocess.Popen(command, cwd=ROOT, stderr=subprocess.DEVNULL)
    try:
        assert becomes(lambda: len(sleeping(mark)) == 1, LONG_S)
    finally:
        worker.kill()
        worker.wait()
    assert becomes(lambda: not sleeping(mark), LONG_S)


@LINUX
def test_a_worker_that_was_forked_removes_daemons_too(tmp_path, mark):
    forks = """
import os, sys
from pathlib import Path
from sinew.runner.evaluation.external import run
folder = Path(sys.argv[2])
run(["true"], folder, timeout_s=20)
child = os.fork()
if child == 0:
    daemon_lives = True
    try:
        run([sys.argv[1]], folder, timeout_s=20)
        proc = Path("/proc", (folder / "daemon.pid").read_text().strip())
        daemon_lives = proc.exists() and "sleep" in (proc / "cmdline").read_text()
    finally:
        os._exit(daemon_lives)
sys.exit(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
"""
    command = [sys.executable, "-c", forks, *program(tmp_path, daemon(mark)), str(tmp_path)]
    assert subprocess.run(command, cwd=ROOT, timeout=60).returncode == 0
