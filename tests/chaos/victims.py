"""The processes of a run, whatever they call themselves, and signals to random ones of them."""

import os
import random
import signal
import time
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass, field

import psutil

MARK = "SINEW_CHAOS"
KINDS = (signal.SIGKILL, signal.SIGTERM, signal.SIGINT, signal.SIGSTOP)
#: how often a process of each role is chosen, if there is one
WEIGHTS = {"leader": 5, "worker": 35, "solver": 35, "other": 25}
STOPPED_S = (0.05, 1.5)


@dataclass
class Victims:
    """The processes of all runs of a round. Each has the round's mark in its environment, or was a child of one."""

    mark: str
    solver: str
    dice: random.Random
    seen: dict[int, psutil.Process] = field(default_factory=dict)
    stopped: list[tuple[float, psutil.Process]] = field(default_factory=list)
    hits: Counter[tuple[str, str]] = field(default_factory=Counter)

    def look(self) -> list[psutil.Process]:
        """The live processes of the round."""
        for process in psutil.process_iter():
            with suppress(psutil.Error, OSError):  # it has ended, or is somebody else's
                known = process.pid in self.seen and self.seen[process.pid] == process
                if not known and (process.ppid() in self.seen or process.environ().get(MARK) == self.mark):
                    self.seen[process.pid] = process
        alive = [process for process in self.seen.values() if is_alive(process)]
        self.seen = {process.pid: process for process in alive}
        return alive

    def role(self, process: psutil.Process, leader: int) -> str:
        words = " ".join(process.cmdline())
        if process.pid == leader:
            return "leader"
        if "dask worker" in words or "spawn_main" in words:
            return "worker"
        if "resource_tracker" in words:  # Python's own; it starts another, which prints what it does not know
            return "tracker"
        return "solver" if self.solver in words else "other"

    def strike(self, leader: int) -> str | None:
        """Send a random signal to a random live process; returns what was done."""
        roles: dict[str, list[psutil.Process]] = {}
        for process in self.look():
            with suppress(psutil.Error):
                roles.setdefault(self.role(process, leader), []).append(process)
        (role,) = self.dice.choices(list(WEIGHTS), list(WEIGHTS.values()))
        if role not in roles:
            return None
        number, process = self.dice.choice(KINDS), self.dice.choice(roles[role])
        if not send(process, number):
            return None
        self.hits[role, number.name] += 1
        if number == signal.SIGSTOP:
            self.stopped.append((time.monotonic() + self.dice.uniform(*STOPPED_S), process))
        return f"{number.name} to {role} {process.pid}"

    def wake(self, *, all_of_them: bool = False) -> None:
        """Send SIGCONT to processes that were stopped long enough."""
        due = [(at, process) for at, process in self.stopped if all_of_them or at <= time.monotonic()]
        for at, process in due:
            self.stopped.remove((at, process))
            self.hits["", "SIGCONT"] += send(process, signal.SIGCONT)


def is_alive(process: psutil.Process) -> bool:
    with suppress(psutil.Error):
        return process.is_running() and process.status() != psutil.STATUS_ZOMBIE
    return False


def send(process: psutil.Process, number: signal.Signals) -> bool:
    """Send a signal, if the process is alive."""
    if not is_alive(process):
        return False
    with suppress(ProcessLookupError):
        os.kill(process.pid, number)
        return True
    return False
