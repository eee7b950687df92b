"""Which measured quantities a study compares with the model, beside the force, and how noisy each of them is."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from sinew.runner.errors import BadInput, shown
from sinew.tasks.data.noise import noise_of_all
from sinew.tasks.model import FORCE, Curve, Specimen
from sinew.tasks.study.fields import Positive
from sinew.tasks.study.settings_file import FieldError, Section

FEWEST = 3  # points of a quantity along a protocol
MOST_TIMES = 1e9  # that noise is larger or smaller than the range of what was measured
UNITS = ("mm", "um", "cm", "m", "N", "mN", "kN", "Pa", "kPa", "MPa", "GPa", "deg", "rad", "s", "ms", "percent")
"""Endings of column names that say a unit."""


class QuantitySettings(Section):
    """A measured quantity that is compared: the ``column`` of the files that holds it (left out: that of its name).

    ``noise`` is the standard deviation of its noise in its own unit, by default estimated from the curves.
    """

    column: Annotated[str, Field(min_length=1, max_length=100)] | None = None
    noise: Literal["estimated"] | Positive = "estimated"


Quantities = Annotated[dict[str, QuantitySettings], Field(min_length=1, max_length=100)]


def key_of_quantities(compared: Sequence[str], force_noise: float | None) -> list[Any]:
    """What the key of a result has of ``compared`` quantities besides their curves; nothing where the force is all.

    What is kept of an unfinished result has them in this order.
    """
    return [["with quantities", list(compared), force_noise]] if compared else []


def check_quantities(measured: Mapping[str, QuantitySettings], units: Mapping[str, str], gives_force: bool) -> None:
    """Check what is compared against the simulator's outputs, ``units`` by name. Raises :class:`FieldError`."""
    if FORCE not in measured:
        raise FieldError("measured", "without the force", "force: {} among the quantities")
    if not gives_force:
        raise FieldError("measured.force", "no output is the force", "simulator.force: the name of an output")
    if measured[FORCE].column not in (None, "force_N"):
        raise FieldError("measured.force.column", shown(measured[FORCE].column), "force_N, or nothing")
    if len(measured) == 1 and measured[FORCE].noise != "estimated":
        expected = "no noise where the force alone is compared"
        raise FieldError("measured.force.noise", f"{measured[FORCE].noise:g}", expected)
    for name, quantity in measured.items():
        if name == FORCE:
            continue
        if name not in units:
            has = ", ".join(units) or "nothing besides the force"
            raise FieldError(f"measured.{name}", "the simulator has no such output", f"force or one of its: {has}")
        ending = (quantity.column or name).rpartition("_")[2]
        if ending in UNITS and ending != units[name] and (quantity.column or name) != ending:
            unit = "a number without unit" if units[name] == "1" else f"in {units[name]}"
            problem = f"{shown(quantity.column or name)} is in {ending}, the simulator's {name} is {unit}"
            raise FieldError(f"measured.{name}.column", problem, "a column in the unit of the simulator")


def with_measured(
    study: Path, folder: Path, specimens: Sequence[Specimen], measured: Mapping[str, QuantitySettings] | None
) -> tuple[Specimen, ...]:
    """The specimens of the cohort in ``folder`` with what is compared, by the names of the outputs, and its noise.

    Raises :class:`BadInput` for columns that are not there or hold nothing to compare.
    """
    wanted: dict[str, QuantitySettings] = {}
    if measured is not None and len(measured) > 1:  # the force first, in whatever order the study lists them
        wanted = {FORCE: measured[FORCE], **measured}
    found = []
    for one in specimens:
        curves = tuple(_with_others(curve, _chosen(folder / one.name, curve, wanted)) for curve in one.curves)
        bare = replace(one, curves=curves)
        found.append(replace(bare, noise={name: _level(study, bare, name, each) for name, each in wanted.items()}))
    return tuple(found)


def _with_others(curve: Curve, others: dict[str, np.ndarray]) -> Curve:
    """The curve with these others, and its protocol with the rows at which they were measured."""
    there = [np.isfinite(values) for values in others.values()]
    both, any_of = np.all(there, axis=0), np.any(there, axis=0)
    seen = np.flatnonzero(both if np.sum(both) >= FEWEST else any_of) if others else None
    return replace(curve, protocol=replace(curve.protocol, seen=seen), others=others)


def _chosen(folder: Path, curve: Curve, wanted: Mapping[str, QuantitySettings]) -> dict[str, np.ndarray]:
    chosen = {}
    for name, quantity in wanted.items():
        if name == FORCE:
            continue
        column = quantity.column or name
        file = folder / f"{curve.name}.csv"
        if column not in curve.others:
            has = ", ".join(curve.others) or "none behind force_N"
            raise BadInput(f"{file}: {column}", "no such column", f"the measured {name}; columns: {has}")
        values = curve.others[column]
        there = values[np.isfinite(values)]
        if there.size < FEWEST:
            problem = "the column is empty" if not there.size else f"{there.size} numbers"
            raise BadInput(f"{file}: {column}", problem, f"at least {FEWEST} numbers of the measured {name}")
        if np.ptp(there) == 0.0:
            raise BadInput(f"{file}: {column}", f"{there[0]:g} in every row", f"a measured course of {name}")
        chosen[name] = values
    return chosen


def _level(study: Path, specimen: Specimen, name: str, quantity: QuantitySettings) -> float:
    """The noise level of a quantity: one number for all curves of a specimen."""
    where = f"{study}: measured.{name}.noise"
    curves = [curve if name == FORCE else curve.of(name) for curve in specimen.curves]
    if quantity.noise != "estimated":
        level = quantity.noise
    else:
        level = noise_of_all(curves, proportional=False).sd_N
        if not level > 0.0:
            problem = f"cannot be estimated from the curves of {specimen.name}"
            raise BadInput(where, problem, "a standard deviation in the unit of the quantity")
    moved = max(float(np.ptp(curve.force_N[np.isfinite(curve.force_N)])) for curve in curves)
    if not moved / MOST_TIMES <= level <= MOST_TIMES * moved:  # squares of such errors are no numbers
        problem = f"{level:.3g}, in {specimen.name}, where {name} moves by {moved:.3g}"
        raise BadInput(where, problem, f"from {1 / MOST_TIMES:.0e} to {MOST_TIMES:.0e} times that")
    return level
