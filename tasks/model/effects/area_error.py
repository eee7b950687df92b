"""A cross-section that is not what was measured."""

from collections.abc import Mapping

from sinew.tasks.model.effect import Array, Bars, Effect, Values
from sinew.tasks.model.parameters import Parameter


def _material(bars: Bars, values: Values) -> Mapping[str, Array]:
    return {"area_mm2": bars.material["area_mm2"] * values["area_factor"]}


EFFECT = Effect(
    slug="area-error",
    title="Error of the area",
    description="Soft tissue has no sharp edges: the cross-section that carries load is not width x thickness.",
    equation="area = area_factor x width x thickness",
    reference="Hayes et al. (2019) J Orthop Surg Res 14:18 (measuring tendon dimensions)",
    parameters=(Parameter("area_factor", "1", 0.7, 1.3, 1.15, "true area to measured area", exclusive=True),),
    null={"area_factor": 1.0},
    seen_by=("ramp", "peak"),
    confounded_with={
        "E_f": "area x moduli is all that reaches the force: unless E_f and E_m are known, it cannot be told from them",
        "E_m": "as with E_f",
    },
    febio={"thickness_mm": "specimen.thickness_mm * parameters.area_factor"},
    around=True,
    material=_material,
)
