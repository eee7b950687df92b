"""The tasks of a study, in the order in which they build on each other."""

from typing import Literal

Task = Literal["sobol", "importance", "calibrate", "infer", "predict", "compare", "discover"]
