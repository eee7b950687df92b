"""Studies of few free parameters: fits of them take a third of the time, and verdicts follow the same rules."""

from collections.abc import Mapping

import numpy as np

from sinew.tasks.model import Model

FREE = ("E_m", "E_f", "alpha_f", "g_1f", "g_3f")
#: The section ``model`` of a study: all other parameters are known.
SECTION = "model:\n  parameters:\n" + "".join(
    f"    {parameter.name}: {{fixed: {parameter.reference}}}\n"
    for parameter in Model().parameters
    if parameter.name not in FREE
)


def row(truth: Mapping[str, float]) -> np.ndarray:
    """Parameters ``[1, d]``: those of a specimen that are free, and the others as they are known."""
    return np.array([[min(truth[p.name], p.maximum) if p.name in FREE else p.reference for p in Model().parameters]])
