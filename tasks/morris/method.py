"""Elementary effects by Morris (1991), with the mean of absolute values of Campolongo et al. (2007), by SALib.

Failed rows. A trajectory with a failed row is left out: the effects along it would not be comparable.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from sinew.tasks.model import Model
from sinew.tasks.model.parameters import from_unit
from sinew.tasks.morris.result import Effects
from sinew.tasks.study.streams import state

Array = np.ndarray[Any, Any]


@dataclass(frozen=True, eq=False)
class Trajectories:
    """A design of ``count`` trajectories through a grid of ``levels``.

    ``unit`` ``[n, d]`` holds the free parameters ``names`` as parts of their ranges, ``rows`` ``[n, all]`` full sets.
    """

    names: tuple[str, ...]
    count: int
    levels: int
    unit: Array
    rows: Array

    @property
    def block(self) -> int:
        """Rows of one trajectory."""
        return len(self.names) + 1

    @property
    def problem(self) -> dict[str, Any]:
        """What SALib calls a problem, with ranges of 0 to 1."""
        return {"num_vars": len(self.names), "names": list(self.names), "bounds": [[0.0, 1.0]] * len(self.names)}


def trajectories(model: Model, count: int, levels: int, seed: int) -> Trajectories:
    """Random trajectories over the ranges of a model's free parameters."""
    import SALib.sample.morris as salib_sample

    names = tuple(parameter.name for parameter in model.free)
    problem = {"num_vars": len(names), "names": list(names), "bounds": [[0.0, 1.0]] * len(names)}
    unit = salib_sample.sample(problem, count, num_levels=levels, seed=state(seed, "morris trajectories"))
    return Trajectories(names, count, levels, unit, from_unit(model, unit))


def elementary_effects(
    design: Trajectories, outcomes: Array, whole: Array, *, resamples: int, confidence: float, seed: int
) -> Effects:
    """Statistics of the elementary effects on one outcome ``[n]``, over the whole range of each parameter.

    ``whole`` ``[trajectories]``: those without a failed row.
    """
    import SALib.analyze.morris as salib_analyze

    used = np.repeat(whole, design.block)
    if not np.isfinite(outcomes[used]).all():  # SALib would answer with NaN for every parameter
        raise ValueError("outcomes of whole trajectories must be numbers")
    found = salib_analyze.analyze(
        design.problem,
        design.unit[used],
        outcomes[used],
        num_resamples=resamples,
        conf_level=confidence,
        num_levels=design.levels,
        seed=state(seed, "morris bootstrap"),
    )
    return Effects(*(np.asarray(found[key], dtype=float) for key in ("mu", "mu_star", "mu_star_conf", "sigma")))
