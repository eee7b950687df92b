"""Something that has to be looked after while something else goes on."""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager


@contextmanager
def every(seconds: float, work: Callable[[], None], name: str) -> Iterator[None]:
    """Call ``work`` in a thread, now and then, until the end."""
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
