"""Preloaded by local workers: they ignore Ctrl-C, which a terminal sends to them too; the main process ends them."""

import logging
import signal

from distributed import Worker

from sinew.runner.library_logs import let_libraries_log_to


def dask_setup(worker: Worker) -> None:
    """Ignore SIGINT, and print nothing on the main process's terminal: scheduler and other workers may end any time."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})  # blocked while the worker started
    let_libraries_log_to(logging.NullHandler())
