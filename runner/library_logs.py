"""What libraries log: their errors belong in a log file. On a terminal, tracebacks would hide what the run says.

When a worker is killed, Dask and Tornado log what they were doing at that moment; the run goes on.
"""

import logging
from collections.abc import Iterator
from contextlib import contextmanager

LIBRARIES = ("distributed", "tornado", "asyncio", "bokeh")


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
        self.to.handle(record)


def _loggers() -> list[logging.Logger]:
    """The loggers of the libraries that are imported; Dask gives some of them handlers of their own."""
    known = list(logging.Logger.manager.loggerDict.items())
    inner = [log for name, log in known if isinstance(log, logging.Logger) and name.split(".")[0] in LIBRARIES]
    return list({id(log): log for log in (*map(logging.getLogger, LIBRARIES), *inner)}.values())
