"""The adaptive runs of a run: their threads, their messages, and the results that are due to each."""

import contextvars
import functools
import queue
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from typing import Any

from sinew.runner.evaluation.adaptive import AdaptiveRun, Message, RowResult, RunClosed, Session
from sinew.runner.evaluation.counts import Counts
from sinew.runner.evaluation.source import Source


@dataclass(eq=False)
class _State:
    """An adaptive run in progress: its session, its tables, and the rows whose results are still due."""

    session: Session
    sources: list[Source]
    asked: deque[tuple[Source, int]] = field(default_factory=deque)
    open: bool = True
    result: Any = None

    def ask(self, message: Message) -> None:
        source = self.sources[message.table]
        assert message.parameters is not None
        self.asked.extend((source, row) for row in source.ask(message.parameters))

    def due(self) -> Iterator[RowResult]:
        """The results that are there, in the order of asking."""
        while self.asked and self.asked[0][1] in self.asked[0][0].results:
            source, row = self.asked.popleft()
            yield source.results[row] if (source, row) in self.asked else source.results.pop(row)

    def close(self, result: Any) -> None:
        self.result, self.open = result, False
        for source in self.sources:
            source.close()


class Sessions:
    """All sessions of a run. Their threads only put messages into ``inbox``; the run's thread does all the rest.

    ``bell`` is notified of every message.
    """

    def __init__(self, counts: Counts) -> None:
        self.counts = counts
        self.inbox: queue.SimpleQueue[Message] = queue.SimpleQueue()
        self.bell = threading.Condition()
        self._states: dict[Session, _State] = {}

    def __bool__(self) -> bool:
        return bool(self._states)

    @contextmanager
    def running(
        self, runs: Sequence[AdaptiveRun], sources: Callable[[AdaptiveRun], list[Source]], *, here: bool
    ) -> Iterator[None]:
        """Run the ``work`` of adaptive runs in threads; at the end, also of an error, all of them have ended.

        ``here``: computations run in this process.
        """
        threads = []
        for adaptive in runs:
            session = Session(self._receive, here=here)
            state = self._states[session] = _State(session, sources(adaptive))
            for source in state.sources:
                source.open = True
            run = functools.partial(contextvars.copy_context().run, self._work, session, adaptive.work)
            threads.append(threading.Thread(target=run, name="sinew-session", daemon=True))
        try:
            for thread in threads:
                thread.start()
            yield
        finally:
            for session in self._states:
                session.tell(RunClosed())
            for thread in threads:
                while thread.is_alive():
                    self._refuse_messages()
                    thread.join(0.05)

    def results(self) -> list[Any]:
        """What the ``work`` of each adaptive run returned."""
        return [state.result for state in self._states.values()]

    @property
    def open(self) -> int:
        """The number of adaptive runs that still work."""
        return sum(state.open for state in self._states.values())

    def listen(self, compute: Callable[[Message], None] | None, *, wait: bool = False) -> None:
        """Handle the sessions' messages; with ``wait``, wait a moment for the first."""
        with suppress(queue.Empty):
            while True:
                message = self.inbox.get(block=wait, timeout=0.2 if wait else None)
                wait = False
                state = self._states[message.session]
                if message.error is not None:
                    raise message.error
                if message.parameters is not None:
                    state.ask(message)
                    self._tell(state)
                elif message.computation is not None and compute is not None:
                    compute(message)
                else:
                    state.close(message.result)

    def tell_of(self, source: Source) -> None:
        """Tell the sessions of a table what is new."""
        for state in self._states.values():
            if source in state.sources:
                self._tell(state)

    def _tell(self, state: _State) -> None:
        for result in state.due():
            self.counts.done += 1
            self.counts.failed += result.status > 0
            state.session.tell(result)
        self.counts.show()

    def _work(self, session: Session, work: Callable[[Session], Any]) -> None:
        """Run ``work`` and report its end; the target of a session's thread."""
        try:
            self._receive(Message(session, result=work(session)))
        except RunClosed:
            return
        except BaseException as error:  # noqa: BLE001 - the thread that leads the run raises it
            self._receive(Message(session, error=error))

    def _receive(self, message: Message) -> None:
        self.inbox.put(message)
        with self.bell:
            self.bell.notify_all()

    def _refuse_messages(self) -> None:
        with suppress(queue.Empty):
            while True:
                message = self.inbox.get_nowait()
                if message.answer is not None:
                    message.answer.put(RunClosed())
