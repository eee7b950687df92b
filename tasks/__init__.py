"""What is studied: study files, measured curves, the tissue model, simulators, and one module for each task.

``import tasks`` gives what the command does, for notebooks and scripts::

    study = tasks.read_study("study.yaml")
    results = tasks.run(study, "calibrate", "infer")
    results.infer.plot()

Each name is imported when it is first used, so that the import itself costs nothing.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tasks.bench_exports import Reading as Reading
    from tasks.bench_exports import read_exports as read_exports
    from tasks.cohort import virtual_cohort as virtual_cohort
    from tasks.cohort import write_cohort as write_cohort
    from tasks.measurements import read_cohort as read_cohort
    from tasks.model.effects import library as library
    from tasks.notebook import run as run
    from tasks.opened import Results as Results
    from tasks.opened import TaskResult as TaskResult
    from tasks.opened import results as results
    from tasks.problems import BadInput as BadInput
    from tasks.study import Study as Study
    from tasks.study import read_study as read_study

_FROM = {
    "BadInput": "tasks.problems",
    "Reading": "tasks.bench_exports",
    "Results": "tasks.opened",
    "Study": "tasks.study",
    "TaskResult": "tasks.opened",
    "library": "tasks.model.effects",
    "read_cohort": "tasks.measurements",
    "read_exports": "tasks.bench_exports",
    "read_study": "tasks.study",
    "results": "tasks.opened",
    "run": "tasks.notebook",
    "virtual_cohort": "tasks.cohort",
    "write_cohort": "tasks.cohort",
}
__all__ = sorted(_FROM)


def __getattr__(name: str) -> Any:
    if name not in _FROM:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_FROM[name]), name)


def __dir__() -> list[str]:
    return __all__
