"""How wide the bar of the embedded simulators becomes: in closed form, as nothing holds its sides.

The sides carry no stress, and the fibres run along the bar, so the matrix alone decides: its lateral Green-Lagrange
strain is E_xx = -nu_m E_zz at every time, whatever has relaxed. The strain that a camera sees, the change of the width
as a part of the width, is sqrt(1 + 2 E_xx) - 1.
"""

from collections.abc import Sequence

import numpy as np

from sinew.tasks.model import Model, Specimen
from sinew.tasks.simulate import Array, Output, rmse_of

OUTPUTS = {
    output.name: output for output in (Output("lateral_strain", "1", "min"), Output("width_change_mm", "mm", "min"))
}
SEEN = "nu_m"  # the parameter that all of these depend on
ROWS = 32  # computed at a time


def lateral(name: str, model: Model, specimen: Specimen, parameters: Array, strain: Array) -> Array:
    """The output ``name`` ``[n, t]`` at the Green-Lagrange strain along the bar, ``[t]`` or ``[n, t]``.

    NaN where the bar would have no width left.
    """
    nu = parameters[:, [model.names.index(SEEN)]]
    with np.errstate(invalid="ignore"):
        values = np.sqrt(1.0 - 2.0 * nu * strain) - 1.0
    return np.asarray(values * (specimen.width_mm if name == "width_change_mm" else 1.0))


def widths(
    names: Sequence[str], model: Model, specimen: Specimen, parameters: Array, strain: Array, force_N: Array
) -> dict[str, Array]:
    """Each output by name, as :func:`lateral`; NaN in rows that failed, whose ``force_N`` ``[n, t]`` is NaN."""
    there = np.isfinite(force_N[:, :1])
    return {name: np.where(there, lateral(name, model, specimen, parameters, strain), np.nan) for name in names}


def laterals(
    names: Sequence[str],
    model: Model,
    specimen: Specimen,
    measured: dict[str, Array],
    parameters: Array,
    strain: Array,
    keep: Array,
) -> tuple[dict[str, Array], dict[str, Array], dict[str, Array]]:
    """Of each output by name: values ``[n, k]`` at the points ``keep``, its summary ``[n]``, and its RMSE ``[n]``.

    ``measured`` ``[t]`` by name, NaN where nothing was measured; ``strain`` ``[t]`` or ``[n, t]``.
    """
    count = len(parameters)
    kept = {name: np.empty((count, keep.size)) for name in names}
    summaries = {name: np.empty(count) for name in names}
    rmse = {name: np.full(count, np.nan) for name in names}
    for first in range(0, count, ROWS):
        rows = slice(first, first + ROWS)
        along = strain if strain.ndim == 1 else strain[rows]
        for name in names:
            values = lateral(name, model, specimen, parameters[rows], along)
            kept[name][rows] = values[:, keep]
            summaries[name][rows] = OUTPUTS[name].summarised(values)
            if name in measured:
                rmse[name][rows] = rmse_of(values, measured[name])
    return kept, summaries, rmse
