"""Loaded first by workers on this machine: a terminal sends Ctrl-C to them, too, but who leads them ends them."""

import logging
import signal

from distributed import Worker

LOST = "Failed to communicate with scheduler during heartbeat"


def dask_setup(worker: Worker) -> None:
    """The scheduler may be gone first; a worker that it leaves behind ends, and need not tell of it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    logging.getLogger("distributed.worker").addFilter(lambda record: not record.getMessage().startswith(LOST))
