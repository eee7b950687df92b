"""What a discovery says of quantities that were compared beside the force: words, rows of cells, and tables."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from sinew.tasks.discover.misfit_map import CellMisfit, Cells, course_name
from sinew.tasks.discover.result import DiscoverResult
from sinew.tasks.drawing.blocks import number
from sinew.tasks.simulate import Array


def quantity_words(result: DiscoverResult) -> str:
    """What was compared beside the force, with the range of its noise over the specimens; empty where nothing was."""
    every: dict[str, list[float]] = {}
    units: dict[str, str] = {}
    for others in (result.compared or {}).values():
        for name, noise in others.items():
            every.setdefault(name, []).append(noise.sd)
            units[name] = ("" if noise.unit == "1" else f" {noise.unit}") + (", as given" if noise.given else "")
    return ", ".join(f"{name} (noise {_range(levels)}{units[name]})" for name, levels in every.items())


def _range(levels: Sequence[float]) -> str:
    low, high = (number(each(levels), 2) for each in (min, max))
    return low if low == high else f"{low} to {high}"


def rows_of(result: DiscoverResult, bare: str) -> list[tuple[str, list[CellMisfit]]]:
    """Cells by specimen, model and quantity, each with a title: the ``bare`` model, then that with the effects."""
    models: Sequence[tuple[str, Cells]] = (
        (bare, result.cells),
        (f"with {result.shown_name}", result.after or {}),
    )
    found: dict[str, list[CellMisfit]] = {}
    for model, every in models:
        for specimen, cells in every.items():
            for cell in cells:
                quantity = "" if cell.quantity is None else f", {cell.quantity}"
                found.setdefault(f"{specimen}{quantity}, {model}", []).append(cell)
    return list(found.items())


def mean_words(cell: CellMisfit, units: Mapping[str, str]) -> str:
    """The mean misfit of a cell in the unit of its quantity."""
    if cell.quantity is None:
        return f"{cell.mean_N:.1f} N"
    assert cell.mean is not None, "a result whose cells have none is refused"
    return f"{number(cell.mean, 2)} {units.get(cell.quantity, '')}".strip()


def units_of(result: DiscoverResult) -> dict[str, str]:
    """The units of what was compared beside the force."""
    every = (result.compared or {}).values()
    return {name: "" if one.unit == "1" else one.unit for others in every for name, one in others.items()}


def leftovers(kept: xr.Dataset, result: DiscoverResult, specimen: str) -> dict[str, dict[str, dict[str, Array]]]:
    """What either model leaves of each quantity beside the force, in units of its noise.

    By quantity, by protocol: ``time`` (s), and ``bare`` and ``having`` (measured less model) where it was measured.
    """
    found: dict[str, dict[str, dict[str, Array]]] = {}
    protocols = list(dict.fromkeys(cell.protocol for cell in result.cells[specimen]))
    for quantity, noise in (result.compared or {}).get(specimen, {}).items():
        for protocol in protocols:
            measured = kept[course_name("measured", quantity, protocol)].to_numpy()
            there = np.isfinite(measured)
            columns = {"time": kept[f"time_{protocol}"].to_numpy()[there]}
            for model in ("bare", "having"):
                if (name := course_name(model, quantity, protocol)) in kept:
                    columns[model] = ((measured - kept[name].to_numpy()) / noise.sd)[there]
            found.setdefault(quantity, {})[protocol] = columns
    return found


def quantities_table(kept: xr.Dataset, result: DiscoverResult, specimen: str) -> pd.DataFrame:
    """What was measured beside the force, and what both models give, each in its own unit."""
    parts = []
    for quantity, noise in (result.compared or {}).get(specimen, {}).items():
        for protocol in dict.fromkeys(cell.protocol for cell in result.cells[specimen]):
            columns: dict[str, Any] = {"quantity": quantity, "unit": noise.unit, "protocol": protocol}
            columns |= {"time_s": kept[f"time_{protocol}"].to_numpy()}
            named = (("measured", "measured"), ("bare", "as_it_is"), ("having", "with_effects"))
            there = [(course_name(kind, quantity, protocol), name) for kind, name in named]
            parts.append(pd.DataFrame(columns | {name: kept[key].to_numpy() for key, name in there if key in kept}))
    return pd.concat(parts, ignore_index=True).dropna(subset="measured")
