"""A fourth relaxation time of the fibres."""

from sinew.tasks.model.effect import Bars, Branch, Effect, Values
from sinew.tasks.model.parameters import Parameter


def _branches(bars: Bars, values: Values) -> tuple[Branch, ...]:
    return (Branch("fibre", values["g_4f"] * values["tau_4f"], values["tau_4f"]),)


EFFECT = Effect(
    slug="relaxation-mode",
    title="Fourth relaxation mode",
    description="The fibres relax at a time scale that the three Prony terms leave out: slower than the holds, faster "
    "than the ramps, or between.",
    equation="G_f(t) -> G_f(t) + g_4f exp(-t / tau_4f)",
    reference="Puso and Weiss (1998) J Biomech Eng 120:62; Pioletti and Rakotomanana (2000) Eur J Mech A 19:749",
    parameters=(
        Parameter("g_4f", "1", 0.0, 2.0, 0.8, "fibre relaxation, fourth strength"),
        Parameter("tau_4f", "s", 0.01, 2000.0, 500.0, "fibre relaxation, fourth time", exclusive=True),
    ),
    null={"g_4f": 0.0},
    seen_by=("ramp", "peak", "early hold", "middle hold", "late hold"),
    confounded_with={
        "tau_3f": "the slowest baseline mode takes its part; a mode slower than the hold looks like a stiffer fibre",
        "E_f": "a mode much slower than the test is elastic in it",
        "fluid-flow": "both are an exponential in a hold; strains in the toe tell fibre from bar",
        "rate-viscosity": "a mode faster than the sampling is a dashpot",
    },
    febio={
        "fibre_memory": """\
<g4>{{ parameters.g_4f | full }}</g4>
<t4>{{ parameters.tau_4f | full }}</t4>"""
    },
    branches=_branches,
)
