"""Another power in the exponent of the fibres' toe."""

from collections.abc import Mapping

from sinew.tasks.model.effect import Array, Bars, Effect, Values
from sinew.tasks.model.parameters import Parameter


def _material(bars: Bars, values: Values) -> Mapping[str, Array]:
    return {"beta": values["toe_exponent"]}


EFFECT = Effect(
    slug="toe-exponent",
    title="Shape of the toe",
    description="The fibres are recruited more abruptly than the square in the exponent of the baseline allows. "
    "FEBio refuses powers below 2.",
    equation="beta = toe_exponent in S_f = 2 xi exp(alpha (I-1)^beta) (I-1)^(beta-1)",
    reference="Maas et al., FEBio theory manual, section 5 (fiber-exp-pow-linear); Pekedis (2025), eqs. 2-4",
    parameters=(Parameter("toe_exponent", "1", 2.0, 6.0, 3.0, "power in the fibres' exponent", floor=2.0),),
    null={"toe_exponent": 2.0},
    seen_by=("toe", "ramp", "valley"),
    confounded_with={
        "alpha_f": "both shape the toe, which ends at 1 % stretch: few points see either",
        "toe-slack": "both lengthen the toe",
    },
    febio={"beta": "parameters.toe_exponent"},
    material=_material,
)
