"""How large effects may be. Their ranges are for tendons of 10 mm, 1,000 N and 4 % strain, and are scaled.

A slip in millimetres or an offset in newtons means nothing without the size of the specimen. Ranges are multiplied by
the nearest power of ten of the ratio of lengths, forces, stresses or strains. Most cohorts keep the ranges as written.
A fascicle of 5 N gets ranges of a hundredth of the force, skin at 50 % strain ten times the strains.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sinew.tasks.model import Specimen
from sinew.tasks.model.effect import Effect
from sinew.tasks.model.effects import effect_named, library
from sinew.tasks.model.parameters import Parameter

LENGTH_MM, FORCE_N, AREA_MM2, STRAIN = 10.0, 1000.0, 32.0, 0.04


@dataclass(frozen=True)
class Size:
    """A cohort's length, peak force, peak stress and largest strain, as powers of ten of those of the ranges."""

    length: float = 1.0
    force: float = 1.0
    stress: float = 1.0
    strain: float = 1.0

    def of(self, unit: str) -> float:
        """The factor of a range in ``unit``; 1 for units without a length, force or stress."""
        return {
            "mm": self.length,
            "N": self.force,
            "N/s": self.force,
            "mm/N": self.length / self.force,
            "mm/(N s)": self.length / self.force,
            "MPa": self.stress,
            "MPa s": self.stress,
            "1/(MPa s)": 1.0 / self.stress,
            "MPa^0.5": self.stress**0.5,
        }.get(unit, 1.0)


def size_of(specimens: Sequence[Specimen]) -> Size:
    """The size of a cohort, by the median of its specimens."""
    peaks = np.array([max(float(np.abs(curve.force_N).max()) for curve in one.curves) for one in specimens])
    strains = [max(float(np.abs(one.stretch(c.protocol) - 1.0).max()) for c in one.curves) for one in specimens]
    areas = np.array([one.area_mm2 for one in specimens])
    return Size(
        _power_of_ten(np.median([one.length_mm for one in specimens]) / LENGTH_MM),
        _power_of_ten(np.median(peaks) / FORCE_N),
        _power_of_ten(np.median(peaks / areas) / (FORCE_N / AREA_MM2)),
        _power_of_ten(np.median(strains) / STRAIN),
    )


def _power_of_ten(ratio: float) -> float:
    return float(10.0 ** round(float(np.log10(ratio)))) if ratio > 0 else 1.0


def library_for(specimens: Sequence[Specimen]) -> dict[str, Effect]:
    """All effects by slug, with ranges for specimens of this size."""
    size = size_of(specimens)
    return {slug: sized(effect, size) for slug, effect in library().items()}


def by_name(names: Sequence[str], specimens: Sequence[Specimen]) -> tuple[Effect, ...]:
    """Effects by their names in a study, with ranges for specimens of this size."""
    size = size_of(specimens)
    return tuple(sized(effect_named(name), size) for name in names)


def sized(effect: Effect, size: Size) -> Effect:
    """The effect, and its other forms, with the ranges of a cohort's size."""
    parameters = tuple(_sized(parameter, size, effect.null.get(parameter.name, 0.0)) for parameter in effect.parameters)
    forms = tuple(sized(form, size) for form in effect.other_forms)
    if parameters == effect.parameters and all(a is b for a, b in zip(forms, effect.other_forms, strict=True)):
        return effect
    null = {one.name: effect.null[one.name] * size.of(one.unit) for one in parameters if one.name in effect.null}
    return replace(effect, parameters=parameters, null=null, other_forms=forms)


def _sized(parameter: Parameter, size: Size, null: float) -> Parameter:
    """With the strain, a range grows from its null value on: a stretch of 1 stays one."""
    units, strain = size.of(parameter.unit), size.strain**parameter.strain_power

    def scaled(value: float) -> float:
        return units * (null + strain * (value - null)) if strain != 1.0 else units * value

    low, high, typical = (scaled(each) for each in (parameter.minimum, parameter.maximum, parameter.reference))
    if parameter.floor == parameter.minimum:
        return replace(parameter, minimum=low, maximum=high, reference=typical, floor=low)
    low = low if parameter.possible(low) else parameter.floor
    return replace(parameter, minimum=low, maximum=high, reference=typical)
