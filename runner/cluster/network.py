"""Network interfaces and TLS: each run has its own certificate."""

import os
import shutil
import socket
import time
from dataclasses import dataclass
from pathlib import Path

import psutil
from distributed.security import Security

from sinew.runner.cluster.dask_settings import WAIT_FOR_WORKERS_S
from sinew.runner.errors import ClusterError


@dataclass(frozen=True)
class Network:
    """The network between workers and scheduler, and whether it is encrypted.

    ``interface``: a network interface that all nodes have (None: Dask's choice).
    """

    interface: str | None = None
    tls: bool = True


def shared_certificate(folder: Path, *, create: bool) -> Security:
    """A certificate for one run, in files that only their owner can read; without ``create``, wait for the files.

    Raises ``ClusterError`` when they do not appear in time.
    """
    certificate, key = folder / "certificate.pem", folder / "key.pem"
    if create:
        made = Security.temporary()
        partial = folder.with_name(f".{folder.name}.partial")
        private_folder(partial)
        for path, content in ((certificate, made.tls_ca_file), (key, made.tls_scheduler_key)):
            with open(os.open(partial / path.name, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as file:
                file.write(content)
        shutil.rmtree(folder, ignore_errors=True)
        partial.rename(folder)
    until = time.monotonic() + WAIT_FOR_WORKERS_S
    while not key.exists():
        if time.monotonic() > until:
            raise ClusterError(f"{folder}: the task that leads wrote no certificate; look at the job's output")
        time.sleep(0.2)
    roles = {f"tls_{role}_{part}": str(path) for role in ("client", "scheduler", "worker")
             for part, path in (("cert", certificate), ("key", key))}  # fmt: skip
    return Security(tls_ca_file=str(certificate), require_encryption=True, **roles)


def private_folder(folder: Path) -> None:
    """Make an empty folder that only its owner can enter. Raises ``ClusterError``."""
    shutil.rmtree(folder, ignore_errors=True)
    try:
        folder.mkdir(mode=0o700, parents=True)
    except OSError as error:
        raise ClusterError(f"{folder}: {error.strerror}") from error


def check_interface(name: str | None) -> None:
    """Raise ``ClusterError`` if this machine does not have the interface."""
    known = sorted(psutil.net_if_addrs())
    if name is not None and name not in known:
        raise ClusterError(f"network interface '{name}' is not on {socket.gethostname()}; it has {', '.join(known)}")
