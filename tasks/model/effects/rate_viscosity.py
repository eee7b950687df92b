"""A stress in proportion to the rate of strain."""

import numpy as np

from sinew.tasks.model.effect import Bars, Branch, Effect, Values
from sinew.tasks.model.parameters import Parameter


def _branches(bars: Bars, values: Values) -> tuple[Branch, ...]:
    viscosity = values["viscosity"]
    return (Branch("strain", viscosity, np.zeros_like(viscosity)),)


EFFECT = Effect(
    slug="rate-viscosity",
    title="Viscosity",
    description="Friction in proportion to the rate of strain, beside the relaxation: there while the bar moves, gone "
    "in a hold, with its sign turned in unloading. Rates are backward differences of the samples.",
    equation="S -> S + viscosity dE/dt",
    reference="Limbert and Middleton (2004) Int J Solids Struct 41:4237; Pioletti et al. (1998) J Biomech 31:753",
    parameters=(
        Parameter(
            "viscosity", "MPa s", 0.0, 300.0, 60.0, "stress per rate of the Green-Lagrange strain", strain_power=-1
        ),
    ),
    null={"viscosity": 0.0},
    seen_by=("toe", "ramp", "early hold", "unload", "valley", "other rates"),
    confounded_with={
        "tau_1m": "the fastest baseline mode at its shortest time is close to a dashpot at the rate of the protocols",
        "force-drift": "at one constant rate the stress of a ramp is an offset; turning points tell them apart",
        "time-lag": "both shift the force in time; a lag does so in proportion to the slope of the force",
    },
    # "Newtonian viscous solid" diverges in one element; a mode that is far faster than any step is the same dashpot
    febio={
        "matrix_memory": """\
<g5>{{ (parameters.viscosity / parameters.E_m / 1e-4) | full }}</g5>
<t5>1e-4</t5>"""
    },
    branches=_branches,
)
