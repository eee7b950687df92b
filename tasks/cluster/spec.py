"""The cluster that a study describes."""

import re

from sinew.runner.cluster.client import Address, ClusterSpec, free_cores
from sinew.runner.cluster.local import Local
from sinew.runner.errors import BadInput, shown
from sinew.tasks.study.study import ADDRESS, AddressSettings, LocalSettings, SlurmSettings, Study
from sinew.tasks.study.trust import Request, require


def cluster_of(study: Study, workers: int | None = None, scheduler: str | None = None) -> ClusterSpec:
    """Where evaluations run; ``workers`` replaces the number of local workers, ``scheduler`` the study's cluster.

    Raises :class:`BadInput` for a batch system, which needs a profile as well, and for what the user has not allowed.
    """
    if scheduler is not None:
        if not re.fullmatch(ADDRESS, scheduler):
            raise BadInput("--scheduler", shown(scheduler), "tls://HOST:PORT or tcp://HOST:PORT")
        return Address(scheduler)
    settings = study.cluster
    require(cluster_request(study))
    if isinstance(settings, AddressSettings):
        return Address(settings.address)
    if isinstance(settings, SlurmSettings):
        problem, expected = "slurm without a profile", "`sinew submit STUDY --profile PROFILE.yaml`"
        raise BadInput(f"{study.path}: cluster", problem, expected)
    return Local(workers or settings.workers or free_cores(), settings.tls)


def cluster_request(study: Study) -> Request | None:
    """What a study asks of the network, if only the user may allow it."""
    settings = study.cluster
    if isinstance(settings, AddressSettings):
        words = f"work would be sent to {settings.address}, and code taken from there"
        return Request(study.path, study.text, "cluster.address", words, "--scheduler")
    if isinstance(settings, LocalSettings) and not settings.tls:
        words = "false: any user of this machine could run code as you"
        return Request(study.path, study.text, "cluster.tls", words, "true")
    return None
