"""Confined programs: what they can still do, and what they cannot."""

import os
import socket
import sys
from pathlib import Path

import psutil
import pytest

from sinew.runner import confine
from sinew.runner.evaluation import external
from tests.runner.evaluation.solver_processes import LONG_S

CONFINED = pytest.mark.skipif(not confine.is_whole(), reason="this system confines no programs")


CALLS = """
import ctypes, os, socket
libc = ctypes.CDLL(None, use_errno=True)
def check(found):
    if found < 0:
        raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))
def call(*arguments):
    check(libc.syscall(*arguments))
"""


def run(tmp_path: Path, statement: str) -> external.Finished:
    """Run a statement of Python in the folder ``inside``, beside the folder ``outside`` with a file ``there``."""
    for name in ("inside", "outside"):
        (tmp_path / name).mkdir()
    (tmp_path / "outside" / "there").write_text("kept")
    code = CALLS + f"outside = {str(tmp_path / 'outside')!r}; {statement}"
    return external.run([sys.executable, "-c", code], tmp_path / "inside", timeout_s=LONG_S, confined=True)


@CONFINED
@pytest.mark.parametrize(
    "statement",
    [
        "open(outside + '/there', 'w')",
        "open(outside + '/there', 'a')",
        "open(outside + '/new', 'w')",
        "open('/dev/shm/sinew-test', 'w')",
        "os.truncate(outside + '/there', 0)",
        "os.unlink(outside + '/there')",
        "os.mkdir(outside + '/folder')",
        "os.symlink('x', outside + '/link')",
        "open('own', 'w'); os.rename('own', outside + '/there')",
        "os.symlink(outside + '/there', 'link'); open('link', 'w')",
        "os.chmod(outside + '/there', 0o777)",
        "os.chown(outside + '/there', os.getuid(), os.getgid())",
        "os.setxattr(outside + '/there', 'user.a', b'1')",
        "socket.socket(socket.AF_UNIX)",
        "socket.socket(socket.AF_INET)",
        "os.kill(os.getppid(), 0)",
        "socket.socketpair()",
        "os.utime(outside + '/there', (1, 1))",
        "call(463, -100, (outside + '/there').encode(), 0, b'user.a', b'', 16)",
        "call(466, -100, (outside + '/there').encode(), 0, b'user.a')",
        "call(469, -100, (outside + '/there').encode(), b'', 24, 0)",
        "import resource; resource.prlimit(os.getppid(), resource.RLIMIT_CPU, (1, 1))",
        "os.setpriority(os.PRIO_PROCESS, os.getppid(), 5)",
        "os.sched_setaffinity(os.getppid(), [0])",
        "import fcntl; fcntl.ioctl(os.open(outside + '/there', os.O_RDONLY), 0x40086602, b'\\0' * 8)",
        "libc.shmget.restype = ctypes.c_int; check(libc.shmget(0, 4096, 0o1600))",
        "open(f'/proc/{os.getppid()}/mem', 'rb')",
        "import subprocess, sys; subprocess.run([sys.executable, '-c', f'open({outside!r} + chr(47) + chr(98), chr(119))'], check=True)",  # noqa: E501
    ],
)
def test_what_a_confined_program_cannot_do(tmp_path, statement):
    finished = run(tmp_path, statement)
    assert finished.returncode == 1
    assert "PermissionError" in finished.output
    assert [(path.name, path.read_text()) for path in (tmp_path / "outside").iterdir()] == [("there", "kept")]
    assert (tmp_path / "outside" / "there").stat().st_mode & 0o777 == 0o666 & ~_umask()


def _umask() -> int:
    os.umask(mask := os.umask(0))
    return mask


def test_what_a_confined_program_can_do(tmp_path):
    finished = run(
        tmp_path,
        "os.makedirs('a/b'); open('a/b/file', 'w').write('one'); os.rename('a/b/file', 'file'); os.rmdir('a/b'); "
        "os.truncate('file', 2); print(open('file').read(), open(outside + '/there').read()); "
        "open(os.devnull, 'w').write('x'); os.kill(os.getpid(), 0); os.system('echo child')",
    )
    assert (finished.returncode, sorted(finished.output.split())) == (0, ["child", "kept", "on"])


def test_a_confined_program_sets_its_own_limits(tmp_path):
    own = "import resource; resource.setrlimit(resource.RLIMIT_NOFILE, (64, 64)); os.sched_setaffinity(0, {0})"
    assert run(tmp_path, own).returncode == 0


@CONFINED
def test_a_daemon_without_its_environment_is_gone(tmp_path):
    """It leaves the group and forgets the mark of its run."""
    daemon = "import os, time; open('pid', 'w').write(str(os.getpid())); time.sleep(1000)"
    again = f"os.setsid() or os.execve({sys.executable!r}, ['python', '-c', {daemon!r}], {{}})"
    wait = "import time\nwhile not os.path.exists('pid') or not open('pid').read(): time.sleep(0.01)"
    assert run(tmp_path, f"os.fork() or {again}\n{wait}").returncode == 0
    assert not psutil.pid_exists(int((tmp_path / "inside" / "pid").read_text()))


def test_the_program_that_starts_it_stays_free(tmp_path):
    assert run(tmp_path, "pass").returncode == 0
    (tmp_path / "outside" / "there").write_text("changed")
    socket.socket().close()
    assert "NoNewPrivs:\t0" in Path("/proc/self/status").read_text() or not confine.means()


def test_a_program_that_is_not_there_is_told(tmp_path):
    with pytest.raises(FileNotFoundError):
        external.run([str(tmp_path / "none")], tmp_path, timeout_s=LONG_S, confined=True)


@pytest.mark.parametrize("confined", [True, False])
def test_memory_is_limited(tmp_path, confined):
    code = "import resource as r\nwhile r.getrlimit(r.RLIMIT_AS)[0] != 2**30: pass\nbytearray(2**31)"
    finished = external.run(
        [sys.executable, "-c", code], tmp_path, timeout_s=LONG_S, max_memory_bytes=2**30, confined=confined
    )
    assert "MemoryError" in finished.output


def test_a_system_without_any_means_runs_programs_as_they_are(tmp_path, monkeypatch):
    monkeypatch.setattr(confine, "_landlock", lambda: 0)
    monkeypatch.setattr(confine, "_filter", lambda: None)
    assert confine.means() == ()
    assert run(tmp_path, "open(outside + '/new', 'w')").returncode == 0
