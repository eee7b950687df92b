"""One run of the solver for one row, in its own directory. Failed runs are kept for inspection."""

import errno
import hashlib
import json
import logging
import os
import re
import shutil
import stat
import tempfile
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Protocol as Interface
from typing import TypeVar

from sinew.runner import confine
from sinew.runner.errors import BadInput
from sinew.runner.evaluation import external
from sinew.runner.evaluation.interim import STATES
from sinew.runner.files import remove_folder, what_is
from sinew.runner.temporary import temporary_folder
from sinew.tasks.simulate.febio.restarts import LOG, Interim, NotTheSame, begun
from sinew.tasks.simulate.row_by_row import Failed

log = logging.getLogger("sinew")

INPUT = "model.feb"
LARGEST_PROGRAM = 2**31  # bytes; a solver with all of its libraries has a tenth of it
VERSION_TRIES, VERSION_S = 3, 20.0
DEEPEST = 50  # folders in each other in an attempt that is kept
#: One thread. Intel's library for threads warns that it cannot share memory, which it does not need.
_ENVIRONMENT = {"OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1", "KMP_WARNINGS": "0"}


class Solver(Interface):
    """A solver program and how its runs are limited; ``scratch`` holds the attempts, at most ``keep_failed`` failed.

    ``confirmed``: the hash of a program that its user had to confirm, None for others.
    """

    @property
    def executable(self) -> str: ...

    @property
    def confirmed(self) -> bytes | None: ...

    @property
    def scratch(self) -> Path: ...

    @property
    def timeout_s(self) -> float: ...

    @property
    def max_file_bytes(self) -> int: ...

    @property
    def keep_failed(self) -> int: ...

    @property
    def version(self) -> str: ...

    @property
    def restart_s(self) -> float | None:
        """How often the state of a run is kept (s), from which it goes on when it is interrupted; None for never."""
        ...


T = TypeVar("T")


def attempt(
    solver: Solver,
    prepare: Callable[[Path], None],
    read: Callable[[Path], T],
    parameters: Mapping[str, float],
    logs: Sequence[str],
) -> T:
    """Run the solver in a directory of its own, on the input that ``prepare`` writes there; returns what ``read`` says.

    ``parameters`` are written beside a failed attempt that is kept. ``logs``: the files that are read. A run that was
    interrupted goes on where it was, see :mod:`sinew.tasks.simulate.febio.restarts`; one that fails then is run once
    from its beginning. Raises :class:`Failed`, and ``OSError`` for a full disk.
    """
    scratch = external.scratch(solver.scratch)
    scratch.mkdir(parents=True, exist_ok=True)
    options: tuple[str, ...] = ("-silent",)
    while True:
        try:
            return _in_new_folder(solver, scratch, prepare, read, parameters, logs, *options)
        except _Silent:  # what that run left is not looked at again
            options = ()
        except _FromItsBeginning:
            continue


class _Silent(Exception):
    """The solver refused its input and, with ``-silent``, did not say why."""


class _FromItsBeginning(Exception):
    """A run that went on from where it was interrupted has failed, and is run once from its beginning."""


def _in_new_folder(
    solver: Solver,
    scratch: Path,
    prepare: Callable[[Path], None],
    read: Callable[[Path], T],
    parameters: Mapping[str, float],
    logs: Sequence[str],
    *options: str,
) -> T:
    """The same, with these options; raises also :class:`_Silent` and :class:`_FromItsBeginning`."""
    directory = Path(tempfile.mkdtemp(prefix="attempt-", dir=scratch))
    folder, interim = _identity(directory), None
    try:
        prepare(directory)
        interim = _interim(solver, directory, logs)
        if interim is not None and interim.restore():
            found = read(directory)
            remove_folder(directory)
            return found
        finished = _run(solver, directory, interim, *options)
        if not os.path.lexists(directory):  # by somebody who clears up, as at the end of a job
            raise external.Stopped(errno.ENOENT, "the folder of the run was removed meanwhile", str(directory))
        if folder != _identity(directory):
            raise Failed("crashed", f"the solver replaced its own folder. {finished.output}")
        directory.chmod(0o700)  # the solver may have changed it
        going_on = interim is not None and interim.before is not None
        if options and not going_on and finished.returncode == 1 and not os.path.lexists(directory / LOG):
            raise _Silent
        _check_end(finished, directory, solver.timeout_s)
        if interim is not None:
            interim.join()
        found = read(directory)
    except (Failed, NotTheSame) as error:
        if _is_full(scratch):
            remove_folder(directory)
            raise _no_space(scratch) from None
        if interim is not None and _may_start_over(interim, error):
            log.warning("restart", extra={"error": f"an interrupted run failed ({error}); it starts over"})
            interim.start_over()
            remove_folder(directory)
            raise _FromItsBeginning from None
        failed = error if isinstance(error, Failed) else Failed("bad_output", f"after an interruption: {error}")
        if folder == _identity(directory):
            if interim is not None:
                interim.file.unlink(missing_ok=True)
                interim.remove_dumps()
            _keep(solver, directory, failed, parameters)
        raise failed from None
    except BaseException as error:
        full = isinstance(error, OSError) and _is_full(scratch)
        remove_folder(directory)
        if full:
            raise _no_space(scratch) from None
        raise
    remove_folder(directory)
    return found


def _may_start_over(interim: Interim, error: Exception) -> bool:
    """Whether the interruption may be to blame. A run starts over once, and never after the time for all of it."""
    in_time = not isinstance(error, Failed) or error.status != "timeout"
    return interim.before is not None and not interim.again and in_time


def _identity(directory: Path) -> tuple[int, int] | None:
    """Which folder a path leads to without links; None for none."""
    try:
        status = os.lstat(directory)
    except OSError:
        return None
    return (status.st_dev, status.st_ino) if stat.S_ISDIR(status.st_mode) else None


def _interim(solver: Solver, directory: Path, logs: Sequence[str]) -> Interim | None:
    """What is kept of a run for the case that it is interrupted, if the study asks for it."""
    if solver.restart_s is None:
        return None
    program = {"version": solver.version, "program": program_hash(Path(solver.executable)).hex()}
    text = (directory / INPUT).read_bytes()
    folder, most = solver.scratch / STATES, solver.max_file_bytes
    return begun(folder, solver.restart_s, most, directory, logs, text, program)


def _run(solver: Solver, directory: Path, interim: Interim | None, *options: str) -> external.Finished:
    _refuse_another(Path(solver.executable), solver.confirmed)
    before = None if interim is None else interim.before
    given = ("-i", INPUT) if before is None else ()
    kept = () if interim is None else interim.options
    return external.run(
        [solver.executable, *given, *kept, "-o", LOG, *options],
        directory,
        timeout_s=solver.timeout_s if before is None else max(1.0, solver.timeout_s - before.seconds),
        environment=_ENVIRONMENT,
        max_file_bytes=solver.max_file_bytes,
        max_memory_bytes=os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"),
        confined=is_compiled(Path(solver.executable)),
        meanwhile=None if interim is None else interim.look,
    )


def is_compiled(program: Path) -> bool:
    """Whether a program is confined to its folder. A script is not: it may start a container, which could not begin."""
    with open(program, "rb") as file:
        return file.read(4) == b"\x7fELF"


def confinement(program: Path) -> str:
    """What its runs can write, in words."""
    if not is_compiled(program):
        return "a script, whose runs can write wherever you may"
    means = ", ".join(confine.means()) or "no Landlock"
    if not confine.is_whole():
        return f"this system cannot confine its runs, or not wholly ({means}): see docs/security.md"
    return f"its runs can write in their own folder only ({means})"


def _refuse_another(program: Path, confirmed: bytes | None) -> None:
    """Raises ``PermissionError`` for another program than the one that its user had to confirm, by its hash."""
    if confirmed is not None and confirmed != program_hash(program):
        raise PermissionError(errno.EPERM, "not the program that you confirmed by `sinew trust`", str(program))


def _keep(solver: Solver, directory: Path, failed: Failed, parameters: Mapping[str, float]) -> None:
    """Keep a failed attempt with its parameters for inspection, unless there are many already."""
    solver.scratch.mkdir(parents=True, exist_ok=True)
    if sum(1 for _ in solver.scratch.glob("failed-*")) >= solver.keep_failed:
        remove_folder(directory)
        return
    if not _leave_only_files(directory):
        remove_folder(directory)
        return
    report = {"status": failed.status, "message": failed.words, "parameters": dict(parameters)}
    (directory / "failure.json").write_text(json.dumps(report, indent=1) + "\n", "utf-8")
    shutil.move(directory, solver.scratch / directory.name.replace("attempt-", f"failed-{failed.status}-"))


def _leave_only_files(directory: Path) -> bool:
    """Remove links, pipes, devices, and what stands where ``failure.json`` is written: a solver may leave anything.

    Returns whether the folder can be kept: not one of folders in each other without end, or that cannot be read.
    """
    failure = directory / "failure.json"
    folders = [(directory, 0)]
    try:
        if failure.is_dir() and not failure.is_symlink():
            remove_folder(failure)
        else:
            failure.unlink(missing_ok=True)
        while folders:
            folder, depth = folders.pop()
            for path in list(folder.iterdir()):
                mode = os.lstat(path).st_mode
                if stat.S_ISDIR(mode):
                    folders.append((path, depth + 1))
                elif not stat.S_ISREG(mode):
                    path.unlink()
            if depth > DEEPEST:
                return False
    except OSError:
        return False
    return True


_BOX = re.compile(r"^ \* {10,}ERROR {10,}\*\n((?: \* .*\*\n)+)", re.MULTILINE)
_MEMORY = re.compile(r"bad_alloc|memory allocation fail|out of memory|cannot allocate memory", re.IGNORECASE)


def _check_end(finished: external.Finished, directory: Path, timeout_s: float) -> None:
    """Say how a run failed. Raises :class:`Failed` unless the solver ended normally."""
    if os.path.lexists(directory / LOG) and not stat.S_ISREG(mode := os.lstat(directory / LOG).st_mode):
        raise Failed("bad_output", f"{LOG} is {what_is(mode)}, not a file")
    log = external.tail(directory / LOG, 20_000)
    words = _last_words(log, finished.output)
    if finished.timed_out:
        raise Failed("timeout", f"no end after {timeout_s:g} s. {words}")
    if _MEMORY.search(log) or _MEMORY.search(finished.output):
        raise Failed("out_of_memory", words)
    if finished.killed_by == "SIGXFSZ":
        raise Failed("bad_output", "the solver wrote a file larger than max_file_mb")
    if finished.killed_by is not None:
        raise Failed("crashed", f"ended by {finished.killed_by}. {words}")
    if "E R R O R   T E R M I N A T I O N" in log:
        if re.search(r"negative jacobian", words, re.IGNORECASE):
            raise Failed("negative_jacobian", words)
        stepped = re.search(r"===== beginning time step|Retrying time step|AUTO STEPPER|Nonlinear solution", log)
        raise Failed("diverged" if stepped else "bad_input", words)
    if finished.returncode == 1 and not (directory / LOG).exists():
        raise Failed("bad_input", words or "the solver could not read its input")
    if finished.returncode != 0:
        refused = re.search(r"initializ|FATAL ERROR|Failed reading|failed to read|parse|syntax", words, re.IGNORECASE)
        raise Failed("bad_input" if refused else "crashed", f"exit code {finished.returncode}. {words}")
    if "N O R M A L   T E R M I N A T I O N" not in log:
        raise Failed("crashed", f"ended without NORMAL TERMINATION. {words}")


def _last_words(log: str, output: str) -> str:
    """The solver's own error message: its last error boxes, or else the last lines that it wrote."""
    boxes = [" ".join(line.strip(" *") for line in box.splitlines()) for box in _BOX.findall(f"{log}\n{output}")]
    if boxes:
        return "; ".join(dict.fromkeys(" ".join(box.split()) for box in boxes[-3:]))
    lines = [line.strip() for line in f"{log}\n{output}".splitlines() if line.strip(" *=-\t")]
    return "; ".join(line for line in lines[-3:] if not line.startswith("Reading configuration"))


def _is_full(scratch: Path) -> bool:
    """Stop the run when the disk is full, instead of failing rows by the thousand."""
    return shutil.disk_usage(scratch).free < 2**20


def _no_space(scratch: Path) -> OSError:
    return OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(scratch))


def program_hash(program: Path) -> bytes:
    """The hash of a program's content, computed anew where its file has changed.

    Raises :class:`BadInput` for a file larger than any solver, and ``OSError``.
    """
    status = os.stat(program)
    if status.st_size > LARGEST_PROGRAM:
        expected = f"a solver program of at most {LARGEST_PROGRAM / 2**30:g} GB"
        raise BadInput(program, f"{status.st_size / 2**30:,.1f} GB", expected)
    return _hash_of(program, status.st_dev, status.st_ino, status.st_size, status.st_mtime_ns, status.st_ctime_ns)


@lru_cache(maxsize=16)
def _hash_of(program: Path, *_: int) -> bytes:
    with open(program, "rb") as file:
        return hashlib.file_digest(file, "blake2b").digest()


def solver_version(executable: Path, confirmed: bytes | None = None) -> str:
    """The version that ``febio4 -info`` reports, or a hash of the program when it ends well without naming one.

    The version is part of every result's identity: results of another solver are never taken for this one's, and those
    of this one are found again. So a program that fails, is killed or does not end in time is asked again.
    ``confirmed``: the hash of a program that its user had to confirm. Raises :class:`BadInput` when it cannot be run,
    or never answers.
    """
    reason = ""
    for _ in range(VERSION_TRIES):
        with temporary_folder() as directory:
            try:
                _refuse_another(executable, confirmed)
                confined = is_compiled(executable)
                finished = external.run([str(executable), "-info"], directory, timeout_s=VERSION_S, confined=confined)
            except external.Stopped as stopped:
                reason = str(stopped)
                continue
            except OSError as error:
                raise BadInput(executable, f"cannot be run ({error.strerror})", "a solver program") from None
        said = re.search(r"version\s*=?\s*(\d+\.\d+[\w.]*)", finished.output)
        if said:
            return said.group(1)
        if finished.returncode == 0:
            return f"unknown-{program_hash(executable).hex()[:16]}"
        code = finished.killed_by or f"exit code {finished.returncode}"
        reason = f"no answer in {VERSION_S:g} s" if finished.timed_out else code
    problem = f"asked {VERSION_TRIES} times for its version by `-info`, it does not answer ({reason})"
    raise BadInput(executable, problem, "a solver that answers; on a busy machine, the same command again")
