"""The curves of a specimen for the store: measured, by the bare model, and by the model with the effects."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from sinew.tasks.discover.fit.fit import Fitted
from sinew.tasks.discover.fit.specimen_fits import Effects, SpecimenFits
from sinew.tasks.discover.misfit_map import course_name
from sinew.tasks.model import FORCE, Specimen, file_name
from sinew.tasks.simulate import Array

if TYPE_CHECKING:
    import xarray as xr  # slow to import, and workers need none of it


def stored_as(specimen: str) -> str:
    """The name of a specimen's curves in the store."""
    return f"discover/{file_name(specimen)}"


def simulated(one: SpecimenFits, bare_fit: Fitted, effects: Effects, fitted: Fitted | None) -> dict[str, Array]:
    """Forces (N) of every curve: ``bare_CURVE`` and, where there are ``effects``, ``having_CURVE``.

    Other quantities that are compared are ``bare_QUANTITY_CURVE`` and ``having_QUANTITY_CURVE``.
    """
    specimen, models = one.measured.specimen, {"bare": (one.candidate(), bare_fit)}
    if fitted is not None:
        models["having"] = one.candidate(effects), fitted
    return {
        _name(name, quantity, curve.name): course[0]
        for curve in specimen.curves
        for name, (candidate, at) in models.items()
        for quantity, course in candidate.courses(specimen, curve.protocol, at.at[None]).items()
    }


def _name(model: str, quantity: str, curve: str) -> str:
    return course_name(model, None if quantity == FORCE else quantity, curve)


def stored(specimen: Specimen, effects: Effects, courses: Mapping[str, Array]) -> "xr.Dataset":
    """What is kept of a specimen: displacements (mm), and measured and simulated ``courses``, of every curve."""
    import xarray as xr

    variables: dict[str, Any] = {}
    for curve in specimen.curves:
        dimension = f"time_{curve.name}"
        variables[f"displacement_{curve.name}"] = (dimension, curve.protocol.displacement_mm)
        for quantity in (FORCE, *specimen.others):
            measured = curve.force_N if quantity == FORCE else curve.others[quantity]
            variables[_name("measured", quantity, curve.name)] = (dimension, measured)
            for model in ("bare", "having"):
                name = _name(model, quantity, curve.name)
                if (course := courses.get(name)) is not None:
                    variables[name] = (dimension, course)
    times = {f"time_{curve.name}": curve.protocol.time_s for curve in specimen.curves}
    return xr.Dataset(variables, coords=times, attrs={"effects": [effect.slug for effect in effects]})
