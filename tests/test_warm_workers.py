"""Workers that tests share: kept while they have nothing to do, and closed where a run left them at work."""

import os
import time

from sinew.runner.cluster.local import Local
from tests.warm_workers import WarmWorkers


def test_idle_workers_are_kept_and_busy_ones_are_not():
    warm, pids = WarmWorkers(), []
    try:
        for work in (0.0, 60.0, 0.0):
            with warm.open_client(Local(1)) as client:
                pids.append(client.submit(os.getpid).result(timeout=60))
                if work:
                    given_up = client.submit(time.sleep, work)
                    while not any(client.processing().values()):
                        time.sleep(0.05)
                    del given_up
    finally:
        warm.close()
    assert pids[0] == pids[1] != pids[2]
