"""Adaptive runs: work that chooses the next rows from the results of earlier ones, by ask and tell.

The ``work`` of an :class:`AdaptiveRun` runs in its own thread. It asks its :class:`Session` for rows; the runner
evaluates them and tells the session each :class:`RowResult`.
"""

import queue
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sinew.runner.evaluation.batch import Evaluation
from sinew.runner.store.schema import Array
from sinew.runner.store.table import Table


@dataclass(frozen=True)
class RowResult:
    """The outcome of one row: ``values[field]`` ``[...]``, NaN if the row failed; ``status`` indexes ``STATUSES``."""

    status: int
    values: Mapping[str, Array]


@dataclass(frozen=True)
class AdaptiveRun:
    """Work that asks for rows step by step: at most ``rows`` of them, from any number of ``tables``.

    ``work`` runs in its own thread. What it does must depend only on what its session returns.
    """

    tables: Sequence[tuple[Table, Evaluation]]
    rows: int
    work: "Callable[[Session], Any]"


class RunClosed(Exception):
    """Raised in the threads of adaptive runs that still wait when the run ends early."""


@dataclass(frozen=True)
class Message:
    """From a session to the run: rows, a computation, or the end of its work."""

    session: "Session"
    parameters: Array | None = None
    table: int = 0
    computation: tuple[Callable[..., Any], tuple[Any, ...]] | None = None
    answer: "queue.SimpleQueue[Any] | None" = None
    result: Any = None
    error: BaseException | None = None
    tries: int = 0


_computing = threading.Lock()


class Session:
    """Where the ``work`` of an :class:`AdaptiveRun` asks for rows. Results come in the order of asking."""

    def __init__(self, send: Callable[[Message], None], *, here: bool) -> None:
        self._send = send
        self._here = here
        self._results: queue.SimpleQueue[Any] = queue.SimpleQueue()

    def ask(self, parameters: Array, table: int = 0) -> None:
        """Ask for ``parameters`` ``[n, d]`` of the given table; does not wait."""
        self._send(Message(self, parameters=np.array(parameters, dtype=np.float64), table=table))

    def next(self) -> RowResult:
        """Wait for the result of the next row, in the order of asking."""
        result = self._results.get()
        if isinstance(result, BaseException):
            raise result
        assert isinstance(result, RowResult)
        return result

    def ask_all(self, parameters: Array) -> list[RowResult]:
        """Ask for ``parameters`` ``[n, d]`` and wait for all results."""
        self.ask(parameters)
        return [self.next() for _ in parameters]

    def compute(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """Run ``function(*arguments)`` on a worker and wait for its value. Raises what the function raises."""
        if self._here:
            with _computing:  # for libraries that are not thread-safe
                return function(*arguments)
        answer: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self._send(Message(self, computation=(function, arguments), answer=answer))
        value = answer.get()
        if isinstance(value, BaseException):
            raise value
        return value

    def tell(self, result: RowResult | RunClosed) -> None:
        """Deliver the next result, or an exception for :meth:`next` to raise. Only the runner calls this."""
        self._results.put(result)
