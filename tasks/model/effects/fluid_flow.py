"""Fluid pressure that a change of strain builds up and flow takes away."""

from sinew.tasks.model.effect import Bars, Branch, Effect, Values
from sinew.tasks.model.parameters import Parameter


def _branches(bars: Bars, values: Values) -> tuple[Branch, ...]:
    time_s = values["diffusion_time"]
    return (Branch("strain", values["fluid_modulus"] * time_s, time_s),)


EFFECT = Effect(
    slug="fluid-flow",
    title="Fluid flow",
    description="Stretching squeezes fluid out across the fibres. The pressure rises with the rate of strain and "
    "diffuses away. This is the slowest term of the poroelastic solution: it has one diffusion time where the exact "
    "solution begins with the square root of time, and no dependence of the permeability on strain.",
    equation="dp/dt = fluid_modulus dE/dt - p / diffusion_time; S -> S + p",
    reference="Armstrong et al. (1984) J Biomech Eng 106:165; Atkinson et al. (1997) J Biomech Eng 119:400",
    parameters=(
        Parameter("fluid_modulus", "MPa", 0.0, 300.0, 80.0, "pressure per strain when it is fast", strain_power=-1),
        Parameter("diffusion_time", "s", 0.1, 300.0, 10.0, "time in which the pressure is gone", exclusive=True),
    ),
    null={"fluid_modulus": 0.0},
    seen_by=("toe", "ramp", "early hold", "middle hold", "unload", "valley", "other rates"),
    confounded_with={
        "g_2m": "a matrix mode with the same time is the same stress: within those ranges of strength and time "
        "the baseline takes it up; specimens of different thickness, with other diffusion times, tell them apart",
        "relaxation-mode": "both are an exponential in a hold; the toe tells bar from fibre",
        "rate-viscosity": "a diffusion time below the sampling is a dashpot",
    },
    febio={
        "matrix_memory": """\
<g4>{{ (parameters.fluid_modulus / parameters.E_m) | full }}</g4>
<t4>{{ parameters.diffusion_time | full }}</t4>"""
    },
    branches=_branches,
)
