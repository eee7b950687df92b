"""Run a function periodically in a thread while other code runs."""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager


@contextmanager
def every(seconds: float, work: Callable[[], None], name: str) -> Iterator[None]:
    """Call ``work`` every ``seconds`` seconds in a thread named ``name`` until the ``with`` block ends."""
    end = threading.Event()

    def watch() -> None:
        while not end.wait(seconds):
            work()

    thread = threading.Thread(target=watch, name=name, daemon=True)
    thread.start()
    try:
        yield
    finally:
        end.set()
        thread.join()
