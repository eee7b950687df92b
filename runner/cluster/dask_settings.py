"""Dask's settings and the environment variables of workers on all clusters; where a scheduler keeps its files."""

from sinew.runner.errors import ClusterError
from sinew.runner.files import temporary_folder
from sinew.runner.one_thread import ONE_THREAD

WAIT_FOR_WORKERS_S = 120.0
_PAGES = ("scheduler.prometheus", "scheduler.info", "scheduler.json", "health", "statics")
SETTINGS = {
    "distributed.scheduler.worker-saturation": 1.1,  # one batch runs and one waits on each worker
    "distributed.scheduler.allowed-failures": 3,
    "distributed.scheduler.work-stealing": False,
    "distributed.worker.profile.enabled": False,
    "distributed.diagnostics.nvml": False,
    # logs of messages would keep every batch in memory
    "distributed.admin.low-level-log-length": 10,
    "distributed.admin.log-length": 100,
    # by default fifty times a second, only to measure delays: four idle workers took a sixth of a core
    "distributed.admin.tick.interval": "1 s",
    "distributed.admin.tick.limit": "60 s",
    "distributed.comm.timeouts.connect": "60 s",
    "distributed.deploy.lost-worker-timeout": "60 s",  # its nanny restarts it; on a busy machine that takes a while
    # the journal holds the results; workers keep next to nothing in memory
    "distributed.worker.memory.target": False,
    "distributed.worker.memory.spill": False,
    "distributed.worker.memory.pause": False,  # it would also resume workers that pause because they leave
    "logging.distributed": "error",
    # Dask's own without its proxy, by which anyone who reaches the dashboard would reach other ports
    "distributed.scheduler.http.routes": [f"distributed.http.{name}" for name in _PAGES],
}
# glibc gives large arrays back to the system at once, by default, and takes new pages for the next: a third of all time
KEEP_MEMORY = {"MALLOC_MMAP_THRESHOLD_": str(32 * 2**20), "MALLOC_TRIM_THRESHOLD_": str(256 * 2**20)}  # bytes
# workers import nothing from the folder that they start in: it may be that of a study which somebody else wrote
ENVIRONMENT = {**ONE_THREAD, **KEEP_MEMORY, "PYTHONSAFEPATH": "1"}
DASHBOARD = "127.0.0.1:0"  # anyone who reaches it sees everything


def scheduler_folder() -> str:
    """The folder for a scheduler's files, which Dask puts on the path from which modules are imported.

    Every scheduler is told: one that asks Dask's settings may do so when an interrupt has taken them back. Raises
    ``ClusterError``.
    """
    try:
        return str(temporary_folder())
    except OSError as error:
        words = f"{error.filename}: {error.strerror}; expected that you remove it, or another TMPDIR"
        raise ClusterError(words) from None
