"""What libraries log: their errors belong in a log file. On a terminal, tracebacks would hide what the run says.

When a worker is killed, Dask and Tornado log what they were doing at that moment; the run goes on. Each record becomes
one line: the first one of its message, and why and where without a traceback. Dask also waits for workers without
looking at how that ended; asyncio tells of each that did not start, long after the run has started another.

What libraries warn of, damaged files for example, is logged too: the command has a line of its own for such a file.
"""

import logging
import traceback
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from sinew.runner.errors import brief

LIBRARIES = ("distributed", "tornado", "asyncio", "bokeh")
NOBODY = "exception was never retrieved"  # in asyncio's words


@contextmanager
def libraries_log_to(handler: logging.Handler) -> Iterator[None]:
    """Give what libraries log to ``handler`` and to nothing else."""
    before = [(logger, logger.handlers, logger.propagate) for logger in _loggers()]
    try:
        let_libraries_log_to(handler)
        yield
    finally:
        for logger, handlers, propagate in before:
            logger.handlers, logger.propagate = handlers, propagate


def let_libraries_log_to(handler: logging.Handler) -> None:
    """As :func:`libraries_log_to`, for the rest of this process."""
    passing_on = _PassingOn(handler)
    for logger in _loggers():
        top = logger.name in LIBRARIES
        logger.handlers, logger.propagate = ([passing_on] if top else []), not top


class _PassingOn(logging.Handler):
    """Hands records to another handler; Dask changes the level of the handlers that it finds."""

    def __init__(self, to: logging.Handler) -> None:
        super().__init__(logging.ERROR)
        self.to = to

    def emit(self, record: logging.LogRecord) -> None:
        self.to.handle(_in_one_line(record))


def _in_one_line(record: logging.LogRecord) -> logging.LogRecord:
    message, _, more = record.getMessage().partition("\n")
    if NOBODY in message:
        message, more = "a task of a library failed, and nobody waited for it", ""
    facts: dict[str, Any] = {"msg": brief(message), "args": (), "exc_info": None, "exc_text": None}
    error = record.exc_info[1] if record.exc_info else None
    if error is not None:
        facts |= {"reason": brief(f"{type(error).__name__}: {error}")}
        while error.__cause__ is not None:
            error = error.__cause__
            facts |= {"cause": brief(f"{type(error).__name__}: {error}")}
        for frame in traceback.extract_tb(error.__traceback__)[-1:]:
            facts |= {"where": f"{Path(frame.filename).name}:{frame.lineno} {frame.name}"}
    elif more:
        facts |= {"reason": brief(more)}
    return logging.makeLogRecord(vars(record) | facts)


@contextmanager
def warnings_are_logged() -> Iterator[None]:
    """Warnings of libraries go to the log in this block, and not to the terminal."""
    before = warnings.showwarning
    warnings.showwarning = _log_warning
    try:
        yield
    finally:
        warnings.showwarning = before


def _log_warning(
    message: Warning | str, category: type[Warning], filename: str, lineno: int, file: Any = None, line: Any = None
) -> None:
    facts = {"reason": brief(f"{category.__name__}: {message}"), "where": f"{Path(filename).name}:{lineno}"}
    logging.getLogger("sinew").warning("a library warns", extra=facts)


def _loggers() -> list[logging.Logger]:
    """The loggers of the libraries that are imported; Dask gives some of them handlers of their own."""
    known = list(logging.Logger.manager.loggerDict.items())
    inner = [log for name, log in known if isinstance(log, logging.Logger) and name.split(".")[0] in LIBRARIES]
    return list({id(log): log for log in (*map(logging.getLogger, LIBRARIES), *inner)}.values())
