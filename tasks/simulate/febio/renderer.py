"""Reading and rendering templates in a separate process with limits, kept for many rows.

Starting that process takes as long as a short run of the solver, so each worker keeps one. When it dies or is ended at
a limit, the next job starts another. What a template does in a study's check is bounded as a whole: all of its jobs
share one :class:`Allowance`. In the evaluation of a row, each input has these bounds.
"""

import atexit
import json
import os
import secrets
import subprocess
import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from threading import Lock, Timer
from typing import Any

from sinew.runner.evaluation import external
from sinew.tasks.simulate.febio.rendering import program, sandbox
from sinew.tasks.simulate.row_by_row import Failed

# its modules know each other by their place: nothing of sinew is imported, and nothing from the current folder
_START = "import sys; sys.path.insert(0, sys.argv.pop(1)); from rendering.program import main; main()"
WALL_S = 300.0  # for one job; program.SECONDS limits the processor time
GRACE_S = 5.0
LONG = ("displacement_points", "step_points")  # texts of many points


class WrongTemplate(Failed):
    """What is wrong with a template, in the three parts of :class:`sinew.runner.errors.BadInput`."""

    def __init__(self, where: str, problem: str, expected: str) -> None:
        super().__init__("bad_input", f"{where}: {problem}; expected {expected}")
        self.parts = (where, problem, expected)


@dataclass
class Allowance:
    """The processor time (s) that is left for several jobs about one template."""

    seconds: float = field(default_factory=lambda: program.SECONDS)


def render(
    files: Mapping[str, str],
    main: str,
    renders: Sequence[Mapping[str, Any]],
    outputs: Sequence[Mapping[str, Any]] | None,
    *,
    known: Sequence[str] | None = None,
    texts: bool = True,
    allowance: Allowance | None = None,
) -> dict[str, Any]:
    """Render ``main`` of ``files`` with each mapping of variables in ``renders``.

    The arguments and the result are those of :func:`sinew.tasks.simulate.febio.rendering.program.answer`. Raises
    :class:`Failed`.
    """
    job = {"kind": "render", "main": main, "renders": renders, "outputs": outputs, "known": known, "texts": texts}
    return _asked(job, allowance, dict(files))


def render_input(
    files: Mapping[str, str], main: str, variables: Mapping[str, Any], outputs: Sequence[Mapping[str, Any]] | None
) -> str:
    """The input that :func:`render` makes of one mapping of variables. Raises :class:`Failed`.

    Texts of thousands of points, which a template only prints, are put in afterwards: to read them as XML would take
    longer than all the rest. Nor are lists sent that it does not use.
    """
    used, printed = _variables(main, tuple(files.items()))
    long = [] if any("CDATA" in text for text in files.values()) else [name for name in LONG if name in printed]
    aside = {name: f"@{secrets.token_hex(8)}@" for name in long if name in variables}
    given = {name: aside.get(name, value) for name, value in variables.items() if name in used}
    text = str(render(files, main, [given], outputs)["texts"][0])
    size = len(text) + sum(text.count(mark) * len(variables[name]) for name, mark in aside.items())
    if size > sandbox.INPUT_BYTES:
        most = sandbox.INPUT_BYTES / 2**20
        raise WrongTemplate(main, f"renders to {size / 2**20:,.0f} MB", f"at most {most:.0f} MB")
    for name, mark in aside.items():
        text = text.replace(mark, variables[name])
    return text


@lru_cache(maxsize=8)
def _variables(main: str, files: tuple[tuple[str, str], ...]) -> tuple[frozenset[str], frozenset[str]]:
    """The variables that templates use, and those that are printed as they are. Raises :class:`Failed`."""
    found = _asked({"kind": "variables", "main": main}, None, dict(files))
    return frozenset(found["used"]), frozenset(found["printed"])


def included(name: str, text: str, allowance: Allowance) -> list[str | None]:
    """The names of the templates that the template ``text`` includes; None for a name that is computed.

    Raises :class:`Failed`.
    """
    names: list[str | None] = _asked({"kind": "included", "main": name, "text": text}, allowance)["names"]
    return names


def job_script(name: str, text: str, variables: Mapping[str, Any]) -> str:
    """The template ``text`` of a job script, rendered. Raises :class:`Failed`."""
    job = {"kind": "script", "main": name, "text": text, "variables": dict(variables)}
    return str(_asked(job, None)["text"])


def _asked(job: dict[str, Any], allowance: Allowance | None, files: dict[str, str] | None = None) -> dict[str, Any]:
    """The answer to a job, which uses some of the allowance. Raises :class:`Failed`."""
    allowance = allowance or Allowance()
    if allowance.seconds <= 0:
        raise _too_long(job["main"])
    reply, took = _renderer.ask(job | {"seconds": allowance.seconds}, files)
    allowance.seconds -= took
    if "wrong" in reply:
        raise WrongTemplate(*reply["wrong"])
    return reply


class _Renderer:
    """The rendering process of this worker. Threads take turns."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._process: subprocess.Popen[bytes] | None = None
        self._owner = 0
        self._files: dict[str, str] | None = None

    def ask(self, job: dict[str, Any], files: dict[str, str] | None) -> tuple[dict[str, Any], float]:
        """The answer to a job, and the processor time (s) that it took. Raises :class:`Failed` when there is none."""
        with self._lock:
            process = self._started()
            if files is not None and files != self._files:
                job, self._files = job | {"files": files}, files
            late = Timer(WALL_S, process.kill)
            late.start()
            facts, answer = _exchange(process, json.dumps(job).encode() + b"\n")
            in_time = late.is_alive()
            late.cancel()
            if not answer.endswith(b"\n"):
                raise _why(job["main"], external.Finished(self._stop(), 0.0, not in_time, ""))
            said = json.loads(facts)
            if said["last"]:
                self._stop()
            return json.loads(answer), said["took"]

    def close(self) -> None:
        """End the rendering process."""
        with self._lock:
            self._stop()

    def _started(self) -> subprocess.Popen[bytes]:
        if self._owner != os.getpid():  # in a forked process, the renderer belongs to the parent
            self._process = None
        elif self._process is not None and self._process.poll() is not None:
            self._stop()
        if self._process is None:
            self._files, self._owner = None, os.getpid()
            self._process = subprocess.Popen(
                [sys.executable, "-I", "-c", _START, str(Path(__file__).resolve().parent)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                start_new_session=True,  # an interrupt from the terminal then reaches the worker alone
            )
        return self._process

    def _stop(self) -> int:
        """Wait for the process, whose input ends; returns its exit code, or minus the number of its signal."""
        process, self._process = self._process, None
        if process is None or self._owner != os.getpid():
            return 0
        assert process.stdin is not None
        assert process.stdout is not None
        with suppress(BrokenPipeError):  # what it has not read
            process.stdin.close()
        process.stdout.close()
        try:
            return process.wait(GRACE_S)
        except subprocess.TimeoutExpired:
            process.kill()
            return process.wait()


def _exchange(process: subprocess.Popen[bytes], job: bytes) -> tuple[bytes, bytes]:
    """The two lines that the process answers; incomplete if the process ends before."""
    assert process.stdin is not None
    assert process.stdout is not None
    with suppress(BrokenPipeError):
        process.stdin.write(job)
        process.stdin.flush()
    return process.stdout.readline(), process.stdout.readline()


def _why(main: str, finished: external.Finished) -> Failed:
    """Why a rendering process ended without an answer."""
    if finished.timed_out or finished.killed_by == "SIGXCPU":
        return _too_long(main)
    external.refuse_stopped(finished, f"rendering {main}")
    return Failed("crashed", f"rendering {main} ended by {finished.killed_by or f'exit code {finished.returncode}'}")


def _too_long(main: str) -> WrongTemplate:
    return WrongTemplate(main, f"takes more than {program.SECONDS} s of a processor", "a simpler template")


_renderer = _Renderer()
atexit.register(_renderer.close)
