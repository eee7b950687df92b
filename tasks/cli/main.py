"""Where the command ``sinew`` begins and ends: every error is one line, with an exit code."""

import codecs
import io
import logging
import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

import click

from sinew.runner.errors import BadInput, SinewError, WalltimeReached, brief, of_the_system, one_line, shown
from sinew.runner.library_logs import warnings_are_logged
from sinew.runner.printing import put
from sinew.tasks.cli import benchmarks, clusters, files, results, studies, trust
from sinew.tasks.cli.group import sinew
from sinew.tasks.cli.terminal import COMPLETION, PROGRAM

__all__ = ["main", "sinew"]
COMMANDS = (studies, files, results, clusters, benchmarks, trust)  # importing them adds their commands to the group

INTERRUPTED = "interrupted; run the same command again; rows that were evaluated are kept"
AGAIN_S = 0.01
READ_FROM_HERE = {"matplotlibrc": "Matplotlib", ".numba_config.yaml": "Numba", "arvizrc": "ArviZ"}


def main() -> None:
    """Entry point: one clear line and exit code 2 for whatever the user can mend, 130 for Ctrl-C."""
    for name in ("sinew", "bokeh"):  # without one, both would print what is wrong with a damaged result
        logging.getLogger(name).addHandler(logging.NullHandler())
    _print_anything()
    sys.unraisablehook = _unraisable
    interrupts: list[int] = []
    try:
        with _noted(interrupts), warnings_are_logged():
            _distrust_this_folder()
            sinew.main(standalone_mode=False, prog_name=PROGRAM, complete_var=COMPLETION)
    except (click.exceptions.Abort, KeyboardInterrupt):
        _fail(INTERRUPTED, 130)
    except click.UsageError as error:
        words = " ".join(error.format_message().split()).rstrip(".")
        more = f"`{error.ctx.command_path if error.ctx else PROGRAM} --help` says more"
        _fail(f"{words}{' ' if words.endswith('?') else '; '}{more}", 2)
    except click.ClickException as error:
        _fail(" ".join(error.format_message().split()), 2)
    except WalltimeReached as error:
        _fail(str(error), 75)  # the job script takes this for: once more
    except SinewError as error:
        _fail(str(error), 2)
    except OSError as error:  # a path that the system refuses, of whatever kind; a solver that somebody stopped
        _fail(f"{error.filename}: {of_the_system(error)}" if error.filename else of_the_system(error), 2)
    except MemoryError as error:
        why = f" ({one_line(str(error))})" if str(error) else ""
        _fail(f"not enough memory{why}; rows that were evaluated are kept", 2)
    except Exception:
        if interrupts:  # in the midst of an import, for example, Ctrl-C becomes an error of another kind
            _fail(INTERRUPTED, 130)
        raise


@contextmanager
def _noted(interrupts: list[int]) -> Iterator[None]:
    """Note every Ctrl-C, and raise KeyboardInterrupt as Python does by itself."""

    def note(number: int, frame: FrameType | None) -> None:
        interrupts.append(number)
        if _is_inside(frame):
            _send_again()
        else:
            signal.default_int_handler(number, frame)

    if signal.getsignal(signal.SIGINT) is not signal.default_int_handler:  # a shell's background jobs ignore it
        yield
        return
    signal.signal(signal.SIGINT, note)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def _distrust_this_folder() -> None:
    """Let nothing in the folder where the command is started run code: somebody else may have written what is there."""
    os.environ["PYTHONSAFEPATH"] = "1"  # for the processes of Python that are started from here
    if "PATH" in os.environ:  # an empty entry is this folder, too
        places = os.environ["PATH"].split(os.pathsep)
        os.environ["PATH"] = os.pathsep.join(place for place in places if Path(place).is_absolute())
    for name, reader in READ_FROM_HERE.items():
        if os.path.lexists(name):
            expected = "another folder to start in, or that you remove it"
            raise BadInput(Path.cwd() / name, f"{reader} would take its settings from there", expected)


def _print_anything() -> None:
    """Let units and names be printed in every locale: C means UTF-8 here, others show a question mark at worst."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            ascii_only = codecs.lookup(stream.encoding).name == "ascii"
            stream.reconfigure(encoding="utf-8" if ascii_only else None, errors="replace")


def _unraisable(unraisable: "sys.UnraisableHookArgs") -> None:
    """An error where Python cannot raise it, in a callback of the garbage collector for example: it is logged.

    Ctrl-C at such a moment would be lost, so it is sent again.
    """
    if issubclass(unraisable.exc_type, KeyboardInterrupt):
        _send_again()
        return
    why = f"{unraisable.exc_type.__name__}: {shown(unraisable.exc_value)} in {shown(unraisable.object)}"
    logging.getLogger("sinew").error("an error that could not be raised", extra={"reason": one_line(why)})


def _send_again() -> None:
    """Send Ctrl-C to this process in a moment."""
    again = threading.Timer(AGAIN_S, os.kill, (os.getpid(), signal.SIGINT))
    again.daemon = True
    again.start()


def _is_inside(frame: FrameType | None) -> bool:
    """Whether :func:`_unraisable` has not returned yet: on a slow machine, the signal that it sends may be faster."""
    while frame is not None and frame.f_code is not _unraisable.__code__:
        frame = frame.f_back
    return frame is not None


def _fail(message: str, code: int) -> None:
    put(brief(f"sinew: {message}"), error=True)
    sys.exit(code)
