"""Run a solver process so that nothing of it outlives its evaluation.

Each run has a process group and a session of its own, a time limit and a limit on what it may write. Whatever is left
when it ends (children in the group, daemons that left it) is killed. Should the worker itself be killed, even by
SIGKILL, a small guard process notices and kills every solver that the worker had started.
"""

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
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import psutil

OUTPUT_FILE = "solver-output.txt"
MARK = "SINEW_SOLVER_OF"
_KILL_GRACE_S = 5.0


@dataclass(frozen=True)
class Finished:
    """How a process ended.

    ``returncode`` is negative for death by that signal; ``timed_out`` says that the time limit ended it;
    ``output`` holds the last few kilobytes of what it printed.
    """

    returncode: int
    seconds: float
    timed_out: bool
    output: str

    @property
    def killed_by(self) -> str | None:
        """Name of the signal that ended the process, or None."""
        return signal.Signals(-self.returncode).name if self.returncode < 0 else None


def run(
    command: Sequence[str],
    directory: Path,
    *,
    timeout_s: float,
    environment: Mapping[str, str] | None = None,
    max_file_bytes: int = 2**31,
) -> Finished:
    """Run ``command`` in ``directory`` and wait for it.

    What it prints goes to ``directory/solver-output.txt``. No file that it writes may exceed ``max_file_bytes`` (the
    kernel ends it by SIGXFSZ). Raises ``OSError`` when the program cannot be started at all.
    """
    _start_guard()
    _adopt_orphans()
    attempt = f"{_worker_token()}/{secrets.token_hex(8)}"
    full_environment = {**os.environ, **(environment or {}), MARK: attempt}
    started = time.perf_counter()
    with open(directory / OUTPUT_FILE, "wb") as output:
        process = subprocess.Popen(
            list(command),
            cwd=directory,
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
            env=full_environment,
            start_new_session=True,
        )
        try:
            _limit_files(process.pid, max_file_bytes)
            timed_out = not _wait(process, timeout_s)
        finally:
            _kill_group(process.pid)
            process.wait(_KILL_GRACE_S)
            _kill_escaped(attempt)
    return Finished(process.returncode, time.perf_counter() - started, timed_out, tail(directory / OUTPUT_FILE))


def tail(path: Path, size: int = 4000) -> str:
    """The last ``size`` bytes of a text file; bytes that are not UTF-8 are replaced. Empty if there is none."""
    try:
        with open(path, "rb") as file:
            file.seek(0, os.SEEK_END)
            file.seek(max(0, file.tell() - size))
            return file.read().decode("utf-8", errors="replace")
    except FileNotFoundError:
        return ""


def _wait(process: subprocess.Popen[bytes], timeout_s: float) -> bool:
    """Wait until the process ends (True) or the time is up (False)."""
    if hasattr(os, "pidfd_open"):  # Popen.wait polls every 50 ms, a tenth of a short solver run
        descriptor = os.pidfd_open(process.pid)
        try:
            poller = select.poll()
            poller.register(descriptor, select.POLLIN)
            return bool(poller.poll(timeout_s * 1000))
        finally:
            os.close(descriptor)
    try:
        process.wait(timeout_s)
    except subprocess.TimeoutExpired:
        return False
    return True


def _limit_files(pid: int, max_file_bytes: int) -> None:
    if hasattr(resource, "prlimit"):
        try:
            resource.prlimit(pid, resource.RLIMIT_FSIZE, (max_file_bytes, max_file_bytes))
            resource.prlimit(pid, resource.RLIMIT_CORE, (0, 0))
        except ProcessLookupError:
            return  # it has ended already


def _kill_group(group: int) -> None:
    try:
        os.killpg(group, signal.SIGKILL)
    except ProcessLookupError:
        return  # nothing is left of it


def _kill_escaped(attempt: str) -> None:
    """Kill processes of this attempt that left its group: the kernel has made them children of this process."""
    if not sys.platform.startswith("linux"):
        return
    for pid in _children():
        try:
            if psutil.Process(pid).environ().get(MARK) == attempt:
                os.kill(pid, signal.SIGKILL)
                os.waitpid(pid, 0)
        except (psutil.Error, ProcessLookupError, ChildProcessError):
            continue  # it ended by itself meanwhile


def _children() -> list[int]:
    pids: list[int] = []
    for task in Path("/proc/self/task").iterdir():
        try:
            pids += [int(word) for word in (task / "children").read_text().split()]
        except OSError:
            continue  # the thread has ended
    return pids


_adopting = False


def _adopt_orphans() -> None:
    """Become the parent of solvers' orphaned grandchildren, so that they can be found (Linux)."""
    global _adopting
    if not _adopting and sys.platform.startswith("linux"):
        PR_SET_CHILD_SUBREAPER = 36
        ctypes.CDLL(None, use_errno=True).prctl(PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)
        _adopting = True


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
    """One guard per worker process: it waits for the worker's end of a pipe to close, then kills its solvers."""
    global _guard
    with _guard_lock:
        if _guard is not None and _guard[0] == os.getpid() and _guard[2].poll() is None:
            return
        token = _guard[1] if _guard is not None and _guard[0] == os.getpid() else secrets.token_hex(8)
        process = subprocess.Popen(
            [sys.executable, "-c", _GUARD, MARK, token],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        _guard = (os.getpid(), token, process)


def _worker_token() -> str:
    assert _guard is not None
    return _guard[1]
