"""Dask's settings for all of sinew's clusters, and how long to wait for what."""

WAIT_FOR_WORKERS_S = 120.0
SETTINGS = {
    "distributed.scheduler.worker-saturation": 1.1,  # one batch runs and one waits on each worker
    "distributed.scheduler.allowed-failures": 3,
    "distributed.scheduler.work-stealing": False,
    "distributed.worker.profile.enabled": False,
    "distributed.diagnostics.nvml": False,
    # logs of messages would keep every batch that was ever sent
    "distributed.admin.low-level-log-length": 10,
    "distributed.admin.log-length": 100,
    # fifty times a second in each process, only to measure how late it is: four idle workers took a sixth of a core
    "distributed.admin.tick.interval": "1 s",
    "distributed.admin.tick.limit": "60 s",
    "distributed.comm.timeouts.connect": "60 s",
    "distributed.deploy.lost-worker-timeout": "4 s",
    # the journal holds the results; workers keep next to nothing in memory
    "distributed.worker.memory.target": False,
    "distributed.worker.memory.spill": False,
    "distributed.worker.memory.pause": False,  # it would also wake up workers that pause to leave
    "logging.distributed": "error",
}
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
DASHBOARD = "127.0.0.1:0"  # whoever reaches it sees everything
