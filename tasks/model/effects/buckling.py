"""A specimen that bends out of the way when it is pushed, instead of pushing back."""

import numpy as np

from sinew.tasks.model.effect import Array, Bars, Effect, GivingWay, Values
from sinew.tasks.model.parameters import Parameter


def _yielding(bars: Bars, values: Values) -> Array:
    return bars.force_N - values["buckling_part"] * np.minimum(bars.force_N, 0.0)


def _bent(bars: Bars, values: Values) -> Array:
    return bars.displacement_mm - values["bending_compliance"] * np.minimum(bars.force_N, 0.0)


def _bending(bars: Bars, values: Values) -> tuple[GivingWay, ...]:
    return (GivingWay(values["bending_compliance"] * (bars.force_N < 0.0), np.zeros_like(bars.force_N)),)


_CONFOUNDED = {
    "E_m": "a softer matrix also pushes back less",
    "toe-slack": "with slack fibres the matrix alone bears the load, in tension as well",
    "permanent-set": "both change the valleys; a set pushes back there",
}

BENT = Effect(
    slug="buckling",
    form="bending",
    title="Bending of a slack specimen",
    description="A slender specimen that is pushed bends sideways like a soft spring, and keeps its own length "
    "meanwhile, so that it goes on relaxing at the length at which it became slack.",
    equation="gauge displacement = grip displacement - bending_compliance x min(F, 0)",
    reference="Timoshenko and Gere (1961) Theory of Elastic Stability, chapter 2",
    parameters=(
        Parameter(
            "bending_compliance", "mm/N", 0.0, 0.1, 0.005, "displacement that bending takes per force of pushing"
        ),
    ),
    null={"bending_compliance": 0.0},
    seen_by=("unload", "valley", "later cycles", "compression"),
    confounded_with=_CONFOUNDED,
    no_febio="a bar of one element has no way to bend",
    displacement=_bent,
    giving_way=_bending,
)

EFFECT = Effect(
    slug="buckling",
    title="Buckling of the slack specimen",
    description="Unloaded soft tissue is slack: it buckles in place of pushing back, and the force stays near zero.",
    equation="F -> F - buckling_part x min(F, 0)",
    reference="Fung (1993) Biomechanics, chapter 7 (slack tissue)",
    parameters=(Parameter("buckling_part", "1", 0.0, 1.0, 0.8, "part of the pushing force that is not borne"),),
    null={"buckling_part": 0.0},
    seen_by=("unload", "valley", "later cycles", "compression"),
    confounded_with=_CONFOUNDED,
    no_febio="a bar of one element has no way to bend",
    around=True,
    other_forms=(BENT,),
    reading=_yielding,
)
