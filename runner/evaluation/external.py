"""Run a solver process such that no part of it outlives its evaluation.

Each run has its own process group and session, a time limit and a limit on file sizes. At its end, all remaining
processes are killed: children in the group, and daemons that left it. If the worker itself is killed, even by SIGKILL,
a small guard process notices and kills every solver that the worker had started.
"""

import atexit
import ctypes
import os
import resource
import secrets
import select
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import psutil

from sinew.runner.confine import is_confined, start
from sinew.runner.files import NotReadable, new_file, own_folder, read_regular, refuse_open_way

OUTPUT_FILE = "solver-output.txt"
MARK = "SINEW_SOLVER_OF"
SCRATCH = "SINEW_SCRATCH"
SAFE_PATH = "PYTHONSAFEPATH"
_KILL_GRACE_S = 5.0
MEANWHILE_S = 1.0
_KILLED_TOO_S = 1.0
_FROM_OUTSIDE = ("SIGTERM", "SIGINT", "SIGHUP")


class Stopped(OSError):
    """A solver was ended from outside, by a signal that no solver sends to itself."""


@dataclass(frozen=True)
class Finished:
    """How a process ended.

    ``returncode`` is negative for death by that signal; ``timed_out`` says that the time limit ended it;
    ``output`` holds the last few kilobytes of its output.
    """

    returncode: int
    seconds: float
    timed_out: bool
    output: str

    @property
    def killed_by(self) -> str | None:
        """Name of the signal that ended the process, or None."""
        if self.returncode >= 0:
            return None
        try:
            return signal.Signals(-self.returncode).name
        except ValueError:  # a real-time signal
            return f"signal {-self.returncode}"


def run(
    command: Sequence[str],
    directory: Path,
    *,
    timeout_s: float,
    environment: Mapping[str, str] | None = None,
    max_file_bytes: int = 2**31,
    max_memory_bytes: int | None = None,
    confined: bool = False,
    meanwhile: Callable[[], None] | None = None,
) -> Finished:
    """Run ``command`` in ``directory``, in which nothing else has run before, and wait for it.

    Its output goes to ``directory/solver-output.txt``, a new file. A file larger than ``max_file_bytes`` ends it
    (SIGXFSZ). It gets at most ``max_memory_bytes``. If ``confined``, it can write in ``directory`` only, see
    :mod:`sinew.runner.confine`. ``meanwhile`` is called about once a second while it runs. Raises ``OSError`` when the
    program cannot be started, and :class:`Stopped` when it is ended from outside, as batch systems do with all
    processes of a job.
    """
    _start_guard()
    _adopt_orphans()
    attempt = f"{_worker_token()}/{secrets.token_hex(8)}"
    full_environment = {**os.environ, **(environment or {}), MARK: attempt}
    full_environment.pop(SAFE_PATH, None)  # for this program; the solver may be one that imports what lies beside it
    started = time.perf_counter()
    with new_file(directory / OUTPUT_FILE) as output:
        with _limited(max_file_bytes):
            process = start(command, directory, output, full_environment, confined=confined)
        try:
            if max_memory_bytes is not None:
                _limit_memory(process, max_memory_bytes)
            timed_out = not _wait(process, timeout_s, meanwhile)
        finally:
            _kill_group(process.pid)
            process.wait(_KILL_GRACE_S)
            _kill_escaped(attempt, process.pid)
    finished = Finished(process.returncode, time.perf_counter() - started, timed_out, tail(directory / OUTPUT_FILE))
    refuse_stopped(finished, command[0])
    return finished


def refuse_stopped(finished: Finished, program: str) -> None:
    """Raise :class:`Stopped` if a batch system or a person ended the program: that says nothing about its input."""
    if finished.killed_by in _FROM_OUTSIDE:
        raise Stopped(f"{program} was ended by {finished.killed_by}")
    if finished.killed_by == "SIGKILL" and not finished.timed_out:
        time.sleep(_KILLED_TOO_S)  # whoever kills everything in a job kills this process in a moment, too


def scratch(default: Path) -> Path:
    """The folder on this machine in which solvers run: from the job's environment, or else ``default``.

    The former may lie where all users may write. Raises ``OSError`` when others can write into it, or put another
    folder in its place.
    """
    if not os.environ.get(SCRATCH):
        return default
    folder = Path(os.environ[SCRATCH])
    folder.parent.mkdir(parents=True, exist_ok=True)
    refuse_open_way(folder.parent)
    return own_folder(folder)


def scratch_line(folder: str, job_variable: str) -> str:
    """The line of a job script that gives the job its own folder below ``folder``, in shell syntax.

    ``job_variable``: the environment variable that holds the job's number.
    """
    return f'export {SCRATCH}="{folder}/sinew-${job_variable}"'


def tail(path: Path, size: int = 4000) -> str:
    """The last ``size`` bytes of a text file; bytes that are not UTF-8 are replaced. Empty if there is no such file."""
    try:
        return read_regular(path, 0, last=size).decode("utf-8", errors="replace")
    except (OSError, NotReadable):  # what a solver left may be anything
        return ""


def _wait(process: subprocess.Popen[bytes], timeout_s: float, meanwhile: Callable[[], None] | None) -> bool:
    """Wait until the process ends (True) or the time is up (False)."""
    until = time.monotonic() + timeout_s
    while meanwhile is not None and time.monotonic() + MEANWHILE_S < until:
        if _ends(process, MEANWHILE_S):
            return True
        meanwhile()
    return _ends(process, until - time.monotonic())


def _ends(process: subprocess.Popen[bytes], timeout_s: float) -> bool:
    """Whether the process ends within this time."""
    if hasattr(os, "pidfd_open"):  # Popen.wait polls every 50 ms, a tenth of a short solver run
        descriptor = os.pidfd_open(process.pid)
        try:
            poller = select.poll()
            poller.register(descriptor, select.POLLIN)
            until = time.monotonic() + timeout_s
            while (left := until - time.monotonic()) > 0:  # poll takes at most 24 days
                if poller.poll(min(left, 86_400.0) * 1000):
                    return True
            return False
        finally:
            os.close(descriptor)
    try:
        process.wait(timeout_s)
    except subprocess.TimeoutExpired:
        return False
    return True


_limiting = threading.Lock()


@contextmanager
def _limited(max_file_bytes: int) -> Iterator[None]:
    """Limit the processes that are started in this block; limits set on a running process miss its first writes."""
    with _limiting:
        before = {kind: resource.getrlimit(kind) for kind in (resource.RLIMIT_FSIZE, resource.RLIMIT_CORE)}
        soft, hard = before[resource.RLIMIT_FSIZE]
        limits = [limit for limit in (max_file_bytes, soft, hard) if limit != resource.RLIM_INFINITY]
        resource.setrlimit(resource.RLIMIT_FSIZE, (min(limits), hard))
        resource.setrlimit(resource.RLIMIT_CORE, (0, before[resource.RLIMIT_CORE][1]))
        try:
            yield
        finally:
            for kind, limit in before.items():
                resource.setrlimit(kind, limit)


def _limit_memory(process: subprocess.Popen[bytes], most: int) -> None:
    """Limit a process that has just begun; the limits of this one cannot be lowered for it, as it may use more."""
    if hasattr(resource, "prlimit"):
        with suppress(ProcessLookupError):  # it has ended
            hard = resource.prlimit(process.pid, resource.RLIMIT_AS)[1]
            most = most if hard == resource.RLIM_INFINITY else min(most, hard)
            resource.prlimit(process.pid, resource.RLIMIT_AS, (most, hard))


def _kill_group(group: int) -> None:
    try:
        os.killpg(group, signal.SIGKILL)
    except ProcessLookupError:
        return  # no process is left


def _kill_escaped(attempt: str, group: int) -> None:
    """Reap the group and kill processes that left it: when their parents die, they become children of this process.

    Killed processes may have had children, so this repeats until it finds nothing.
    """
    if not sys.platform.startswith("linux"):
        return
    until = time.monotonic() + _KILL_GRACE_S
    while time.monotonic() < until:
        left = _reap_group(group)
        for pid in _children():
            try:
                if _escaped(pid, attempt):
                    os.kill(pid, signal.SIGKILL)
                    os.waitpid(pid, 0)
                    left = True
            except (psutil.Error, ProcessLookupError, ChildProcessError):
                continue  # it has ended meanwhile
        if not left:
            return
        time.sleep(0.001)


def _escaped(pid: int, attempt: str) -> bool:
    """Whether a child is of this run: by its mark, or confined as solvers are, but without any mark.

    One that has the command line of this process has just been forked, and gets its mark in a moment.
    """
    process = psutil.Process(pid)
    mark = process.environ().get(MARK)
    return mark == attempt or (mark is None and is_confined(pid) and process.cmdline() != psutil.Process().cmdline())


def _reap_group(group: int) -> bool:
    """Whether processes of a killed group are left."""
    try:
        while os.waitpid(-group, os.WNOHANG)[0]:
            pass
    except ChildProcessError:
        pass
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True


def _children() -> list[int]:
    pids: list[int] = []
    for task in Path("/proc/self/task").iterdir():
        try:
            pids += [int(word) for word in (task / "children").read_text().split()]
        except OSError:
            continue  # the thread has ended
    return pids


_adopting: int | None = None


def _adopt_orphans() -> None:
    """Become the parent of orphaned descendants, so that they can be found (Linux)."""
    global _adopting
    if _adopting != os.getpid() and sys.platform.startswith("linux"):
        PR_SET_CHILD_SUBREAPER = 36
        ctypes.CDLL(None, use_errno=True).prctl(PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)
        _adopting = os.getpid()  # a forked worker does not inherit it


_GUARD = """
import os, signal, sys
for name in ("SIGINT", "SIGTERM", "SIGHUP"):
    signal.signal(getattr(signal, name), signal.SIG_IGN)
sys.stdin.buffer.read()
import psutil
for _ in range(3):
    for process in psutil.process_iter():
        try:
            if process.environ().get(sys.argv[1], "").startswith(sys.argv[2]):
                process.kill()
        except psutil.Error:
            pass
"""
_guard: tuple[int, str, subprocess.Popen[bytes]] | None = None
_guard_lock = threading.Lock()


def _start_guard() -> None:
    """Start the guard of this worker process: when the worker's end of a pipe closes, it kills the worker's solvers."""
    global _guard
    with _guard_lock:
        if _guard is not None and _guard[0] == os.getpid() and _guard[2].poll() is None:
            return
        token = _guard[1] if _guard is not None and _guard[0] == os.getpid() else secrets.token_hex(8)
        process = subprocess.Popen(
            [sys.executable, "-P", "-c", _GUARD, MARK, token],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        _guard = (os.getpid(), token, process)


def _worker_token() -> str:
    assert _guard is not None
    return _guard[1]


@atexit.register
def _end_guard() -> None:
    if _guard is not None and _guard[0] == os.getpid() and _guard[2].stdin is not None:
        _guard[2].stdin.close()
        _guard[2].wait(_KILL_GRACE_S)
