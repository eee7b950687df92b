"""Studies of tests whose solver is a script: their author confirms them, as a user does by ``sinew trust``."""

from pathlib import Path

from sinew.tasks.cluster.spec import cluster_request
from sinew.tasks.simulate.build import solver_request
from sinew.tasks.study.study import read_study
from sinew.tasks.study.trust import allow


def trusted(study: Path) -> Path:
    """The study, which may run its solver now."""
    read = read_study(study)
    allow([request for request in (solver_request(read), cluster_request(read)) if request is not None])
    return study
