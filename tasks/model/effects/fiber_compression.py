"""Fibres that resist compression."""

from sinew.tasks.model.effect import Array, Effect, Law, Values
from sinew.tasks.model.parameters import Parameter


def _both_ways(law: Law, values: Values) -> Law:
    def stress(stretch: Array) -> Array:
        mirrored = 1.0 + (1.0 - stretch)
        return law(stretch) - values["compressed_part"] * law(mirrored)

    return stress


EFFECT = Effect(
    slug="fiber-compression",
    title="Fibres in compression",
    description="Fibres embedded in the matrix do not buckle at once: below their own length they push back with a "
    "part of what they bear in tension.",
    equation="S_f(stretch) -> S_f(stretch) - compressed_part x S_f(2 - stretch)",
    reference="Ault and Hoffman (1992) J Biomech Eng 114:137; Van Loocke et al. (2006) J Biomech 39:2999",
    parameters=(Parameter("compressed_part", "1", 0.0, 1.0, 0.3, "stress in compression to stress in tension"),),
    null={"compressed_part": 0.0},
    seen_by=("compression",),
    confounded_with={
        "E_m": "where the fibres are below their length throughout, both are one stiffness",
        "toe-slack": "slack fibres are compressed at the gauge length, so the pair shows where each alone does not",
    },
    no_febio="its fibre materials carry tension only, and one with an axial stiffness would resist tension as well",
    fibre_law=_both_ways,
)
