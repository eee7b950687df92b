"""The variables that every input template receives: the specimen and its displacement history."""

from typing import Any

import numpy as np

from sinew.tasks.model import Specimen
from sinew.tasks.simulate import Array
from sinew.tasks.simulate.febio.rendering.sandbox import CONSTANTS, FUNCTIONS
from sinew.tasks.simulate.febio.stepping import load_points

TAKEN = {
    *("displacement_points", "step_points", "first_step_s", "end_s", "steps", "time_s", "displacement_mm", "protocol"),
    *("specimen", "range", "namespace", "loop", "self", "super", "caller", "varargs", "kwargs"),
    *("true", "false", "none", "True", "False", "None", "and", "or", "not", "if", "else", "elif", "in", "is", "for"),
    *("import", "include", *FUNCTIONS, *CONSTANTS),
}
"""Names that a parameter of a user's template cannot have."""


def history(protocol: str, times: Array, displacements: Array) -> dict[str, Any]:
    """The history at the solver's ``times`` ``[t]`` (s), as ``displacements`` ``[t]`` (mm)."""
    displacement_points, step_points = load_points(times.tobytes(), displacements.tobytes())
    return {
        "displacement_points": displacement_points,
        "step_points": step_points,
        "first_step_s": float(times[1] - times[0]),
        "end_s": float(times[-1]),
        "steps": times.size - 1,
        "time_s": times.tolist(),
        "displacement_mm": displacements.tolist(),
        "protocol": protocol,
    }


def size(specimen: Specimen) -> dict[str, Any]:
    """The specimen's geometry (mm), if it has one."""
    if not np.isfinite(specimen.length_mm):
        return {}
    return {
        "specimen": {
            "length_mm": specimen.length_mm,
            "width_mm": specimen.width_mm,
            "half_width_mm": specimen.width_mm / 2,
            "thickness_mm": specimen.thickness_mm,
        }
    }
