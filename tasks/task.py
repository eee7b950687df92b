"""The tasks of a study, in the order in which they build on each other."""

from typing import Literal, get_args

Task = Literal["sobol", "importance", "calibrate", "infer", "predict", "compare", "discover"]
TASKS: tuple[str, ...] = get_args(Task)
