"""sinew: finite-element ensembles of soft tissue, from a laptop to a cluster.

``import sinew`` gives what the command does, for notebooks and scripts::

    study = sinew.read_study("study.yaml")
    results = sinew.run(study, "calibrate", "infer")
    results.infer.plot()

Each name is imported when it is first used, so that the import itself costs nothing.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sinew.notebook import run as run
    from sinew.result_folder import Results as Results
    from sinew.result_folder import TaskResult as TaskResult
    from sinew.result_folder import results as results
    from sinew.runner.errors import BadInput as BadInput
    from sinew.tasks.data.cohort import read_cohort as read_cohort
    from sinew.tasks.data.cohort import write_cohort as write_cohort
    from sinew.tasks.data.exports import Reading as Reading
    from sinew.tasks.data.exports import read_exports as read_exports
    from sinew.tasks.data.virtual import virtual_cohort as virtual_cohort
    from sinew.tasks.model.effects import library as library
    from sinew.tasks.study.study import Study as Study
    from sinew.tasks.study.study import read_study as read_study
    from sinew.tasks.surrogate.reading import surrogate as surrogate

_FROM = {
    "BadInput": "sinew.runner.errors",
    "Reading": "sinew.tasks.data.exports",
    "Results": "sinew.result_folder",
    "Study": "sinew.tasks.study.study",
    "TaskResult": "sinew.result_folder",
    "library": "sinew.tasks.model.effects",
    "read_cohort": "sinew.tasks.data.cohort",
    "read_exports": "sinew.tasks.data.exports",
    "read_study": "sinew.tasks.study.study",
    "results": "sinew.result_folder",
    "run": "sinew.notebook",
    "surrogate": "sinew.tasks.surrogate.reading",
    "virtual_cohort": "sinew.tasks.data.virtual",
    "write_cohort": "sinew.tasks.data.cohort",
}
__all__ = sorted(_FROM)


def __getattr__(name: str) -> Any:
    if name not in _FROM:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_FROM[name]), name)


def __dir__() -> list[str]:
    return __all__
