"""The curves of a specimen for the store: measured, by the bare model, and by the model with the effects."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from sinew.tasks.discover.fit.fit import Fitted
from sinew.tasks.discover.fit.specimen_fits import Effects, SpecimenFits
from sinew.tasks.model import Specimen, file_name
from sinew.tasks.simulate import Array

if TYPE_CHECKING:
    import xarray as xr  # slow to import, and workers need none of it


def stored_as(specimen: str) -> str:
    """The name of a specimen's curves in the store."""
    return f"discover/{file_name(specimen)}"


def simulated(one: SpecimenFits, bare_fit: Fitted, effects: Effects, fitted: Fitted | None) -> dict[str, Array]:
    """Forces (N) of every curve: ``bare_CURVE`` and, where there are ``effects``, ``having_CURVE``."""
    specimen, models = one.measured.specimen, {"bare": (one.candidate(), bare_fit)}
    if fitted is not None:
        models["having"] = one.candidate(effects), fitted
    return {
        f"{name}_{curve.name}": candidate.forces(specimen, curve.protocol, at.at[None])[0]
        for curve in specimen.curves
        for name, (candidate, at) in models.items()
    }


def stored(specimen: Specimen, effects: Effects, forces: Mapping[str, Array]) -> "xr.Dataset":
    """What is kept of a specimen: displacements (mm), and measured and simulated ``forces`` (N), of every curve."""
    import xarray as xr

    variables: dict[str, Any] = {}
    for curve in specimen.curves:
        dimension = f"time_{curve.name}"
        variables[f"displacement_{curve.name}"] = (dimension, curve.protocol.displacement_mm)
        variables[f"measured_{curve.name}"] = (dimension, curve.force_N)
        for name in ("bare", "having"):
            if (force := forces.get(f"{name}_{curve.name}")) is not None:
                variables[f"{name}_{curve.name}"] = (dimension, force)
    times = {f"time_{curve.name}": curve.protocol.time_s for curve in specimen.curves}
    return xr.Dataset(variables, coords=times, attrs={"effects": [effect.slug for effect in effects]})
