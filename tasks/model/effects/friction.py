"""Friction against the motion: the force is higher in loading than in unloading, at any speed."""

from typing import Any

import numpy as np

from sinew.runner.compiled import at_first_call
from sinew.tasks.model.effect import Array, Bars, Effect, Hook, Values
from sinew.tasks.model.parameters import Parameter


def _against_motion(bars: Bars, values: Values) -> Array:
    """Which part of the friction acts ``[n, t]``: 1 in loading, -1 in unloading, the last of them in a hold.

    It begins at 0 and follows the displacement of the grips, up to 1 in either direction (an elastic bar with a
    friction block behind it; Prandtl 1928).
    """
    steps = np.diff(bars.grips_mm, axis=1, prepend=bars.grips_mm[:, :1])
    acting = np.empty_like(steps)
    _stick_and_slide(np.ascontiguousarray(steps), np.ascontiguousarray(values["sliding_distance"][:, 0]), acting)
    return acting


@at_first_call()
def _stick_and_slide(steps: Any, distance: Any, acting: Any) -> None:
    """Write the part of the friction that acts ``[n, t]`` after ``steps`` ``[n, t]`` (mm)."""
    for row in range(steps.shape[0]):
        part = 0.0
        for t in range(steps.shape[1]):
            if distance[row] > 0.0:
                part = min(max(part + steps[row, t] / distance[row], -1.0), 1.0)
            elif steps[row, t] != 0.0:
                part = 1.0 if steps[row, t] > 0.0 else -1.0
            acting[row, t] = part


def _guided(bars: Bars, values: Values) -> Array:
    return bars.force_N + values["friction_force"] * _against_motion(bars, values)


def _pressed(bars: Bars, values: Values) -> Array:
    return bars.force_N + values["friction_part"] * np.abs(bars.force_N) * _against_motion(bars, values)


def _clamped(bars: Bars, values: Values) -> Array:
    largest = np.abs(bars.force_N).max(axis=1, keepdims=True)
    return bars.force_N + values["friction_of_peak"] * largest * _against_motion(bars, values)


def _form(
    form: str, title: str, description: str, equation: str, reading: Hook, size: Parameter, **more: Any
) -> Effect:
    return Effect(
        slug="friction",
        form=form,
        title=title,
        description=description,
        equation=equation,
        reference="Prandtl (1928) Z angew Math Mech 8:85",
        parameters=(
            size,
            Parameter("sliding_distance", "mm", 0.0, 0.1, 0.01, "displacement after a reversal until all of it slides"),
        ),
        null={size.name: 0.0},
        seen_by=("toe", "ramp", "unload", "valley", "later cycles"),
        confounded_with={
            "rate-viscosity": "both change sign at a reversal; friction stays in a hold, and is the same at all rates",
            "permanent-set": "both widen the loop of loading and unloading; friction does so at every strain",
            "time-lag": "both widen the loop; a lag does so where the force is steep",
        },
        shared=(size.name, "sliding_distance"),
        no_febio="the template prescribes the displacement of the specimen itself; there is no machine in it",
        around=True,
        reading=reading,
        **more,
    )


PRESSED = _form(
    "pressed",
    "Friction in proportion to the force",
    "Fibres, or a cable over a pulley, are pressed together by the pull itself, so friction grows with the force.",
    "reading = force + friction_part x |force| x d; d as above",
    _pressed,
    Parameter("friction_part", "1", 0.0, 0.3, 0.03, "friction in parts of the force"),
)

CLAMPED = _form(
    "clamped",
    "Friction in proportion to the peak",
    "Guides and clamps are tightened for each test, the more the higher its force is to be.",
    "reading = force + friction_of_peak x largest |force| of the test x d; d as above",
    _clamped,
    Parameter("friction_of_peak", "1", 0.0, 0.2, 0.02, "friction in parts of the largest force of the test"),
)

EFFECT = _form(
    "",
    "Friction against the motion",
    "A guide or a seal of the machine, or a sheath around the specimen, rubs against every motion; in a hold the "
    "friction stays what it was.",
    "reading = force + friction_force x d; d follows grip displacement / sliding_distance from 0 on, within -1 and 1",
    _guided,
    Parameter("friction_force", "N", 0.0, 100.0, 20.0, "friction while all slides"),
    other_forms=(PRESSED, CLAMPED),
)
