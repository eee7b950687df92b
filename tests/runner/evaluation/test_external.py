"""Real processes: however a program ends, nothing of it is left, and its end is told as it was."""

import os
import signal
import subprocess
import sys
import threading
import time
import tracemalloc

import numpy as np
import psutil
import pytest

from sinew.runner.evaluation import external
from sinew.runner.evaluation.external import OUTPUT_FILE, SCRATCH, Stopped, run, scratch, tail
from tests.runner.evaluation.solver_processes import LINUX, LONG_S, ROOT, becomes, daemon, program, sleeping, zombies

# ---- how a program ends


def test_a_normal_end(tmp_path):
    finished = run(program(tmp_path, "echo said; echo warned >&2; pwd; sleep 0.1"), tmp_path, timeout_s=LONG_S)
    assert (finished.returncode, finished.timed_out, finished.killed_by) == (0, False, None)
    assert finished.output == f"said\nwarned\n{tmp_path}\n"
    assert (tmp_path / OUTPUT_FILE).read_text() == finished.output
    assert 0.1 <= finished.seconds < LONG_S


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
    assert 0.4 <= finished.seconds < LONG_S
    assert not sleeping(mark)


def test_a_program_that_ignores_signals_ends_at_the_timeout(tmp_path, mark):
    text = f"trap '' TERM INT HUP\nsleep {mark} &\nwhile :; do sleep 0.05; done"
    finished = run(program(tmp_path, text), tmp_path, timeout_s=0.4)
    assert finished.timed_out
    assert finished.seconds < LONG_S
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
from sinew.runner.evaluation.external import run
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
    assert finished.seconds < LONG_S
    assert becomes(lambda: not sleeping(mark), LONG_S)


def test_background_processes_of_a_failed_program_are_gone(tmp_path, mark):
    finished = run(program(tmp_path, f"sleep {mark} &\nkill -SEGV $$"), tmp_path, timeout_s=LONG_S)
    assert finished.killed_by == "SIGSEGV"
    assert becomes(lambda: not sleeping(mark), LONG_S)


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
    assert becomes(lambda: not sleeping(mark), LONG_S)


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
    assert becomes(lambda: not sleeping(mark), LONG_S)


@LINUX
def test_a_daemon_of_a_daemon_is_gone(tmp_path, mark):
    (tmp_path / "inner").write_text(f"echo $$ > inner.pid\nexec sleep {mark}\n")
    (tmp_path / "outer").write_text(f"setsid sh inner &\nexec sleep {mark}\n")
    text = "(setsid sh outer &)\nwhile [ ! -s inner.pid ]; do sleep 0.01; done"
    run(program(tmp_path, text), tmp_path, timeout_s=LONG_S)
    assert becomes(lambda: not sleeping(mark), LONG_S)


@LINUX
def test_no_zombies_are_left(tmp_path, mark):
    command = program(tmp_path, f"sleep {mark} &\n(sleep {mark} &)\n{daemon(mark)}")
    before = zombies()
    for _ in range(3):
        (tmp_path / "daemon.pid").unlink(missing_ok=True)
        run(command, tmp_path, timeout_s=LONG_S)
    assert becomes(lambda: zombies() <= before, LONG_S), "a worker that lives for days would run out of process ids"


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


# ---- what others may have put there


def test_something_else_is_done_while_it_runs(tmp_path, monkeypatch):
    monkeypatch.setattr(external, "MEANWHILE_S", 0.05)
    calls = []

    def meanwhile():
        calls.append(time.monotonic())
        if len(calls) == 3:
            (tmp_path / "end").touch()

    command = [sys.executable, "-c", "import os, time\nwhile not os.path.exists('end'): time.sleep(0.01)"]
    finished = run(command, tmp_path, timeout_s=60.0, meanwhile=meanwhile)
    assert finished.returncode == 0
    assert len(calls) >= 3
    assert np.diff(calls[:3]).min() >= 0.05


def test_an_error_of_what_is_done_meanwhile_ends_it(tmp_path, monkeypatch):
    monkeypatch.setattr(external, "MEANWHILE_S", 0.01)

    def meanwhile():
        raise OSError(28, "No space left on device")

    with pytest.raises(OSError, match="No space"):
        run(["sleep", "1000"], tmp_path, timeout_s=60.0, meanwhile=meanwhile)
    children = [child for child in psutil.Process().children() if child.name() == "sleep"]
    assert not children


def test_the_time_limit_holds_beside_it(tmp_path, monkeypatch):
    monkeypatch.setattr(external, "MEANWHILE_S", 0.01)
    assert run(["sleep", "1000"], tmp_path, timeout_s=0.2, meanwhile=lambda: None).timed_out


def test_the_guard_imports_nothing_from_the_current_folder(tmp_path):
    """In a process of its own, which starts its own guard."""
    for name in ("signal", "psutil"):
        (tmp_path / f"{name}.py").write_text("open('ran', 'w').close()\n")
    code = "from pathlib import Path; from sinew.runner.evaluation import external as e; "
    code += "e.run(['true'], Path('in'), timeout_s=60)"
    (tmp_path / "in").mkdir()
    subprocess.run([sys.executable, "-P", "-c", code], cwd=tmp_path, check=True)
    assert not (tmp_path / "ran").exists()


def test_a_solver_does_not_get_what_protects_this_program(tmp_path, monkeypatch):
    """A solver may be a script in Python that imports what lies beside it."""
    monkeypatch.setenv("PYTHONSAFEPATH", "1")
    assert run(program(tmp_path, "echo ${PYTHONSAFEPATH-unset}"), tmp_path, timeout_s=LONG_S).output == "unset\n"


@pytest.mark.parametrize("kind", ["link", "open to others"])
def test_a_scratch_folder_that_others_can_write_to_is_refused(tmp_path, monkeypatch, kind):
    folder = tmp_path / "scratch"
    if kind == "link":
        folder.symlink_to(tmp_path)
    else:
        folder.mkdir()
        folder.chmod(0o777)
    monkeypatch.setenv(SCRATCH, str(folder))
    with pytest.raises(PermissionError, match="only you can write to"):
        scratch(tmp_path)
    (tmp_path / "all").mkdir()
    (tmp_path / "all").chmod(0o777)
    monkeypatch.setenv(SCRATCH, str(tmp_path / "all" / "sinew-7"))
    with pytest.raises(PermissionError, match="all users may rename"):
        scratch(tmp_path)
    monkeypatch.setenv(SCRATCH, str(tmp_path / "node" / "mine"))
    assert scratch(tmp_path).stat().st_mode & 0o777 == 0o700
