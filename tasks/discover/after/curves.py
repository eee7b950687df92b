"""The curves of a specimen for the store: measured, by the bare model, and by the model with the effects."""

from typing import Any

import xarray as xr

from sinew.tasks.discover.fit.fit import Fitted
from sinew.tasks.discover.fit.specimen_fits import Effects, SpecimenFits
from sinew.tasks.model import file_name


def stored_as(specimen: str) -> str:
    """The name of a specimen's curves in the store."""
    return f"discover/{file_name(specimen)}"


def simulated(one: SpecimenFits, bare_fit: Fitted, effects: Effects, fitted: Fitted | None) -> xr.Dataset:
    """Displacements (mm) and forces (N) of every curve; ``having_CURVE`` is there where there are ``effects``."""
    specimen, bare = one.measured.specimen, one.candidate()
    variables: dict[str, Any] = {}
    for curve in specimen.curves:
        dimension = f"time_{curve.name}"
        variables[f"displacement_{curve.name}"] = (dimension, curve.protocol.displacement_mm)
        variables[f"measured_{curve.name}"] = (dimension, curve.force_N)
        variables[f"bare_{curve.name}"] = (dimension, bare.forces(specimen, curve.protocol, bare_fit.at[None])[0])
        if fitted is not None:
            force = one.candidate(effects).forces(specimen, curve.protocol, fitted.at[None])[0]
            variables[f"having_{curve.name}"] = (dimension, force)
    times = {f"time_{curve.name}": curve.protocol.time_s for curve in specimen.curves}
    return xr.Dataset(variables, coords=times, attrs={"effects": [effect.slug for effect in effects]})
