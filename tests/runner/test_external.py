"""Real processes: however a program ends, nothing of it is left, and its end is told as it was."""

import os
import secrets
import signal
import subprocess
import sys
import threading
import time
import tracemalloc
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import psutil
import pytest

from runner import external
from runner.external import OUTPUT_FILE, Stopped, run, tail

ROOT = Path(__file__).resolve().parents[2]
LINUX = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="needs Linux")
LONG_S = 20.0


@pytest.fixture
def mark():
    """A number of seconds to sleep that no other process has; whatever still sleeps so is killed at the end."""
    word = str(10**9 + secrets.randbelow(10**9))
    yield word
    for process in sleeping(word):
        process.kill()


def program(folder: Path, text: str, name: str = "program") -> list[str]:
    """A command that runs a shell script."""
    path = folder / name
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(0o755)
    return [str(path)]


def sleeping(mark: str) -> list[psutil.Process]:
    found = []
    for process in psutil.process_iter():
        try:
            if mark in process.cmdline() and process.status() != psutil.STATUS_ZOMBIE:
                found.append(process)
        except psutil.Error:
            continue
    return found


def zombies() -> set[int]:
    found = set()
    for process in psutil.Process().children():
        try:
            if process.status() == psutil.STATUS_ZOMBIE:
                found.add(process.pid)
        except psutil.Error:
            continue
    return found


def becomes(condition: Callable[[], bool], within_s: float) -> bool:
    deadline = time.monotonic() + within_s
    while time.monotonic() < deadline:
        if condition():
            return True
        time.sleep(0.02)
    return condition()


def daemon(mark: str, pid_file: str = "daemon.pid") -> str:
    """Shell lines that leave a process in a session of its own, and go on when it is there."""
    return f"""(setsid sh -c 'echo $$ > {pid_file}.new; mv {pid_file}.new {pid_file}; exec sleep {mark}' &)
while [ ! -s {pid_file} ]; do sleep 0.01; done"""


# ---- how a program ends


def test_a_normal_end(tmp_path):
    finished = run(program(tmp_path, "echo said; echo warned >&2; pwd; sleep 0.1"), tmp_path, timeout_s=LONG_S)
    assert (finished.returncode, finished.timed_out, finished.killed_by) == (0, False, None)
    assert finished.output == f"said\nwarned\n{tmp_path}\n"
    assert (tmp_path / OUTPUT_FILE).read_text() == finished.output
    assert 0.1 <= finished.seconds < 5


def test_an_exit_code(tmp_path):
    finished = run(program(tmp_path, "echo no; exit 7"), tmp_path, timeout_s=LONG_S)
    assert (finished.returncode, finished.timed_out, finished.killed_by) == (7, False, None)
    assert finished.output == "no\n"


@pytest.mark.parametrize("name", ["SIGSEGV", "SIGABRT", "SIGKILL"])
def test_death_by_a_signal(tmp_path, name):
    finished = run(program(tmp_path, f"kill -{name.removeprefix('SIG')} $$"), tmp_path, timeout_s=LONG_S)
    assert finished.killed_by == name
    assert finished.returncode == -signal.Signals[name]
    assert not finished.timed_out
    assert not list(tmp_path.glob("core*"))


@pytest.mark.parametrize("name", ["SIGTERM", "SIGINT", "SIGHUP"])
def test_a_solver_that_somebody_ends_is_not_a_failure(tmp_path, name):
    with pytest.raises(Stopped, match=f"was ended by {name}"):
        run(program(tmp_path, f"kill -{name.removeprefix('SIG')} $$"), tmp_path, timeout_s=LONG_S)


@LINUX
def test_death_by_a_signal_without_a_name(tmp_path):
    command = [sys.executable, "-c", "import os; os.kill(os.getpid(), 40)"]
    finished = run(command, tmp_path, timeout_s=LONG_S)
    assert finished.returncode == -40
    assert "40" in str(finished.killed_by)


def test_many_programs_that_end_at_once(tmp_path):
    command = program(tmp_path, "exit 3")
    assert {run(command, tmp_path, timeout_s=LONG_S).returncode for _ in range(30)} == {3}


def test_a_program_that_is_not_there(tmp_path):
    with pytest.raises(FileNotFoundError):
        run([str(tmp_path / "nothing")], tmp_path, timeout_s=LONG_S)


def test_a_file_that_is_no_program(tmp_path):
    (tmp_path / "text").write_text("no program\n")
    with pytest.raises(PermissionError):
        run([str(tmp_path / "text")], tmp_path, timeout_s=LONG_S)
    (tmp_path / "text").chmod(0o755)
    with pytest.raises(OSError, match="format"):
        run([str(tmp_path / "text")], tmp_path, timeout_s=LONG_S)


def test_there_is_nothing_to_read(tmp_path):
    finished = run(program(tmp_path, "read line || echo nothing; cat; echo end"), tmp_path, timeout_s=LONG_S)
    assert finished.output == "nothing\nend\n"


def test_a_variable_is_added_to_the_environment(tmp_path, monkeypatch):
    monkeypatch.setenv("FROM_OUTSIDE", "outside")
    command = program(tmp_path, "echo $FROM_OUTSIDE $ADDED")
    assert run(command, tmp_path, timeout_s=LONG_S, environment={"ADDED": "added"}).output == "outside added\n"
    assert "ADDED" not in os.environ


# ---- limits


def test_a_hanging_program_ends_at_the_timeout_with_its_children(tmp_path, mark):
    finished = run(program(tmp_path, f"echo begun; sleep {mark} & sleep {mark}"), tmp_path, timeout_s=0.4)
    assert finished.timed_out
    assert finished.killed_by == "SIGKILL"
    assert finished.output == "begun\n"
    assert 0.4 <= finished.seconds < 3
    assert not sleeping(mark)


def test_a_program_that_ignores_signals_ends_at_the_timeout(tmp_path, mark):
    text = f"trap '' TERM INT HUP\nsleep {mark} &\nwhile :; do sleep 0.05; done"
    finished = run(program(tmp_path, text), tmp_path, timeout_s=0.4)
    assert finished.timed_out
    assert finished.seconds < 3
    assert not sleeping(mark)


def test_the_longest_timeout_of_a_study(tmp_path):
    assert run(program(tmp_path, "sleep 0.05"), tmp_path, timeout_s=30 * 86_400.0).returncode == 0


def test_much_output_is_kept_in_the_file_only(tmp_path):
    command = program(tmp_path, "head -c 40000000 /dev/zero | tr '\\0' x; echo; echo the end")
    run(command, tmp_path, timeout_s=LONG_S)
    tracemalloc.start()
    try:
        finished = run(command, tmp_path, timeout_s=LONG_S)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert finished.output.endswith("x\nthe end\n")
    assert len(finished.output) <= 4000
    assert (tmp_path / OUTPUT_FILE).stat().st_size == 40_000_009
    assert peak < 2**20


def test_output_that_is_not_text(tmp_path):
    finished = run(program(tmp_path, "head -c 100000 /dev/urandom; echo; echo the end"), tmp_path, timeout_s=LONG_S)
    assert finished.output.endswith("\nthe end\n")


@LINUX
def test_a_file_that_is_too_large(tmp_path):
    command = program(tmp_path, "exec head -c 3000000 /dev/zero > large")
    finished = run(command, tmp_path, timeout_s=LONG_S, max_file_bytes=1_000_000)
    assert finished.killed_by == "SIGXFSZ"
    assert (tmp_path / "large").stat().st_size <= 1_000_000
    assert run(command, tmp_path, timeout_s=LONG_S, max_file_bytes=3_000_000).returncode == 0


@LINUX
def test_endless_output(tmp_path):
    finished = run(program(tmp_path, "exec yes"), tmp_path, timeout_s=LONG_S, max_file_bytes=1_000_000)
    assert finished.killed_by == "SIGXFSZ"
    assert (tmp_path / OUTPUT_FILE).stat().st_size <= 1_000_000


@LINUX
def test_the_file_limit_holds_from_the_start_in_a_busy_worker(tmp_path):
    """Other threads keep the interpreter, while the program begins to write at once."""
    done = threading.Event()

    def compute() -> None:
        while not done.is_set():
            sum(range(1000))

    threads = [threading.Thread(target=compute) for _ in range(8)]
    for thread in threads:
        thread.start()
    try:
        command = program(tmp_path, "exec head -c 30000000 /dev/zero > large")
        finished = run(command, tmp_path, timeout_s=LONG_S, max_file_bytes=1_000_000)
    finally:
        done.set()
        for thread in threads:
            thread.join()
    assert finished.killed_by == "SIGXFSZ"
    assert (tmp_path / "large").stat().st_size <= 1_000_000


@LINUX
def test_a_lower_limit_of_the_system_stays(tmp_path):
    """A hard limit that only root may raise: programs run below it."""
    worker = """
import sys
from pathlib import Path
from runner.external import run
finished = run([sys.argv[1]], Path(sys.argv[2]), timeout_s=20, max_file_bytes=2**31)
print(finished.returncode, finished.output)
"""
    lower = """
import ctypes, os, resource, sys
CAP_SYS_RESOURCE, PR_CAPBSET_DROP = 24, 24
ctypes.CDLL(None).prctl(PR_CAPBSET_DROP, CAP_SYS_RESOURCE, 0, 0, 0)
resource.setrlimit(resource.RLIMIT_FSIZE, (10**7, 10**7))
os.execv(sys.executable, [sys.executable, "-c", *sys.argv[1:]])
"""
    command = [sys.executable, "-c", lower, worker, *program(tmp_path, "echo ran"), str(tmp_path)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=60)
    assert done.stdout.split() == ["0", "ran"], done.stderr


# ---- what a program leaves


def test_background_processes_are_gone(tmp_path, mark):
    text = f"sleep {mark} &\nsleep {mark} &\n(sleep {mark} &)\necho left them"
    finished = run(program(tmp_path, text), tmp_path, timeout_s=LONG_S)
    assert finished.returncode == 0
    assert finished.seconds < 5
    assert becomes(lambda: not sleeping(mark), 0.1)


def test_background_processes_of_a_failed_program_are_gone(tmp_path, mark):
    finished = run(program(tmp_path, f"sleep {mark} &\nkill -SEGV $$"), tmp_path, timeout_s=LONG_S)
    assert finished.killed_by == "SIGSEGV"
    assert becomes(lambda: not sleeping(mark), 0.1)


@LINUX
def test_a_daemon_is_gone(tmp_path, mark):
    finished = run(program(tmp_path, daemon(mark)), tmp_path, timeout_s=LONG_S)
    assert finished.returncode == 0
    assert (tmp_path / "daemon.pid").is_file()
    assert not sleeping(mark)


@LINUX
def test_a_daemon_of_a_hanging_program_is_gone(tmp_path, mark):
    finished = run(program(tmp_path, f"{daemon(mark)}\nsleep {mark}"), tmp_path, timeout_s=1.0)
    assert finished.timed_out
    assert (tmp_path / "daemon.pid").is_file()
    assert becomes(lambda: not sleeping(mark), 0.1)


@LINUX
def test_a_daemon_whose_parent_dies_slowly_is_gone(tmp_path, mark):
    """The daemon becomes an orphan only when its parent, killed with the group, has given back its memory."""
    (tmp_path / "parent").write_text(
        "import subprocess, sys, time\n"
        "memory = b'x' * 400_000_000\n"
        "daemon = subprocess.Popen(['sleep', sys.argv[1]], start_new_session=True)\n"
        "open('ready', 'w').write('ready')\n"
        "time.sleep(1000)\n"
    )
    text = f"{sys.executable} parent {mark} &\nwhile [ ! -s ready ]; do sleep 0.01; done"
    run(program(tmp_path, text), tmp_path, timeout_s=LONG_S)
    assert becomes(lambda: not sleeping(mark), 0.1)


@LINUX
def test_a_daemon_of_a_daemon_is_gone(tmp_path, mark):
    (tmp_path / "inner").write_text(f"echo $$ > inner.pid\nexec sleep {mark}\n")
    (tmp_path / "outer").write_text(f"setsid sh inner &\nexec sleep {mark}\n")
    text = "(setsid sh outer &)\nwhile [ ! -s inner.pid ]; do sleep 0.01; done"
    run(program(tmp_path, text), tmp_path, timeout_s=LONG_S)
    assert becomes(lambda: not sleeping(mark), 0.1)


@LINUX
def test_no_zombies_are_left(tmp_path, mark):
    command = program(tmp_path, f"sleep {mark} &\n(sleep {mark} &)\n{daemon(mark)}")
    before = zombies()
    for _ in range(3):
        (tmp_path / "daemon.pid").unlink(missing_ok=True)
        run(command, tmp_path, timeout_s=LONG_S)
    assert becomes(lambda: zombies() <= before, 0.5), "a worker that lives for days would run out of process ids"


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
    assert becomes(lambda: not sleeping(mark), 0.1)


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
from runner.external import run
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
    assert becomes(lambda: not sleeping(mark), 3.0)
    assert becomes(lambda: not any(map(alive, everything)), 3.0), "the guard stays"


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
        assert becomes(lambda: len(sleeping(mark)) == 1, 3.0)
        assert not becomes(lambda: len(sleeping(mark)) == 0, 0.5)
    finally:
        for worker in workers:
            worker.kill()
            worker.wait()
    assert becomes(lambda: not sleeping(mark), 3.0)


@LINUX
def test_a_worker_that_ends_by_itself_takes_its_guard_with_it(tmp_path):
    script = f"{WORKER}\nimport runner.external\nprint(runner.external._guard[2].pid)"
    command = [sys.executable, "-W", "error", "-c", script, *program(tmp_path, "exit 0"), str(tmp_path)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=60)
    guard = int(done.stdout)
    assert becomes(lambda: not psutil.pid_exists(guard) or psutil.Process(guard).status() == "zombie", 3.0)
    assert (done.returncode, done.stderr) == (0, "")


@LINUX
def test_a_guard_that_was_killed_is_replaced(tmp_path, mark):
    kills_its_guard = """
import runner.external
run(["true"], Path(sys.argv[2]), timeout_s=20)
runner.external._guard[2].kill()
runner.external._guard[2].wait()
run("""
    script = WORKER.replace("\nrun(", kills_its_guard)
    command = [sys.executable, "-c", script, *program(tmp_path, f"exec sleep {mark}"), str(tmp_path)]
    worker = subprocess.Popen(command, cwd=ROOT, stderr=subprocess.DEVNULL)
    try:
        assert becomes(lambda: len(sleeping(mark)) == 1, LONG_S)
    finally:
        worker.kill()
        worker.wait()
    assert becomes(lambda: not sleeping(mark), 3.0)


@LINUX
def test_a_worker_that_was_forked_removes_daemons_too(tmp_path, mark):
    forks = """
import os, sys
from pathlib import Path
from runner.external import run
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


# ---- the tail of a file


def test_tail(tmp_path):
    path = tmp_path / "text"
    assert tail(path) == ""
    path.write_text("")
    assert tail(path) == ""
    path.write_text("one two")
    assert tail(path) == "one two"
    assert tail(path, 3) == "two"
    path.write_text("ä" * 10)
    assert tail(path, 3) == "\N{REPLACEMENT CHARACTER}ä"
