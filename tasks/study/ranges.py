"""A look at a study's ranges before any work: can they reach the measured forces, and is every parameter seen?

What was seen is kept in ``ranges.json`` of the result folder, so that a study that goes on does not look again.
"""

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from pydantic import BaseModel, ConfigDict, ValidationError

from sinew.runner.errors import BadInput, one_line
from sinew.tasks.data.cohort import Cohort
from sinew.tasks.model import Model, Parameter
from sinew.tasks.simulate.build import simulator_of
from sinew.tasks.simulate.reach import Reach, reach, unseen
from sinew.tasks.study.files import digest, read_json, write_json
from sinew.tasks.study.model import model_of
from sinew.tasks.study.study import Study

RANGES = "ranges.json"
VERSION = 1  # of what is looked at
MOST = 0.5  # of the specimens out of reach: with more of them, the ranges are wrong and not the specimens


class Ranges(BaseModel):
    """The ``reach`` of each measured curve, and the free parameters that are ``unseen``. ``inputs`` is its key."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    inputs: str
    reach: list[Reach]
    unseen: list[str]

    @property
    def out_of_reach(self) -> list[Reach]:
        """One curve of each specimen that has any out of reach, the farthest one."""
        worst: dict[str, Reach] = {}
        for one in self.reach:
            if not one.reached and (one.specimen not in worst or _distance(one) > _distance(worst[one.specimen])):
                worst[one.specimen] = one
        return list(worst.values())

    @property
    def hopeless(self) -> bool:
        """Whether the ranges, and not single specimens, are wrong."""
        return len(self.out_of_reach) > MOST * len({one.specimen for one in self.reach})

    def remarks(self) -> Iterator[str]:
        """What a person should know before the work begins, in a line each."""
        if far := self.out_of_reach:
            count = len({one.specimen for one in self.reach})
            yield one_line(f"ranges: {len(far)} of {count} specimens are out of reach, such as {_words(far[0])}")
        if self.unseen:
            values = "a fixed value" if len(self.unseen) == 1 else "fixed values"
            yield f"ranges: no force of these tests depends on {', '.join(self.unseen)}; {values} would save work"

    def refuse(self, study: Path, model: Model) -> None:
        """Raises :class:`BadInput` where the ranges cannot reach the data, with such as would."""
        if not self.hopeless:
            return
        far = self.out_of_reach
        if all(one.other_sign for one in far):
            raise BadInput(study, _words(far[0]), "forces of the other sign (tension is positive), or another column")
        ranges = ", ".join(f"{p.name}: {{min: {p.minimum:g}, max: {p.maximum:g}}}" for p in self.wider(model))
        raise BadInput(study, _words(far[0]), f"ranges such as {ranges}" if ranges else "other ranges")

    def wider(self, model: Model) -> tuple[Parameter, ...]:
        """The free moduli with ranges that would reach what is out of reach: forces are proportional to the moduli."""
        scales = [one.scale for one in self.reach if not one.reached and not one.other_sign]
        moduli = [one for one in model.free if one.unit == "MPa" and one.name not in self.unseen]
        return tuple(scaled(one, min(scales), max(scales)) for one in moduli) if scales else ()


def scaled(parameter: Parameter, low: float, high: float) -> Parameter:
    """The parameter with its ends times ``low`` and ``high``, rounded outwards to two digits."""
    minimum, maximum = rounded(parameter.minimum * low, up=False), rounded(parameter.maximum * high, up=True)
    return replace(parameter, minimum=minimum, maximum=maximum, reference=(minimum + maximum) / 2)


def rounded(value: float, *, up: bool) -> float:
    """A number of at least 0 with two digits, rounded up or down."""
    if value == 0.0:
        return 0.0
    digit = 10.0 ** (math.floor(math.log10(value)) - 1)
    return float(f"{(math.ceil if up else math.floor)(value / digit) * digit:.2g}")


def _distance(one: Reach) -> float:
    low, high = one.ratios
    return math.inf if high <= 0 else max(low, 1.0 / high)


def _words(one: Reach) -> str:
    measured, near, far = one.stresses_MPa
    has = f"{one.specimen} {one.protocol} has {measured:.3g} MPa at its peak"
    return f"{has}, the ranges of model.parameters give {near:.3g} to {far:.3g} MPa"


def look(study: Study, cohort: Cohort, out: Path) -> Ranges | None:
    """The look at a study's ranges, that of an earlier run if nothing changed. None where there is nothing to look at.

    The embedded simulator answers for those that are like it. Nobody knows the forces of a template.
    """
    if not study.simulator.like_embedded or not any(one.measured for one in cohort.specimens):
        return None
    model = model_of(study.model, study.simulator.law)
    ranges = [(one.name, one.minimum, one.maximum, one.reference) for one in model.parameters]
    effects = list(study.model.effects)
    specimens = [one.identity() | {"name": one.name} for one in cohort.specimens]
    inputs = digest(VERSION, model.identity(), ranges, effects, specimens)
    if (found := _read(out / RANGES)) is not None and found.inputs == inputs:
        return found
    simulator = simulator_of(study, "uniaxial", out)
    reaches = [each for specimen in cohort.specimens for each in reach(simulator, model, specimen)]
    return Ranges(inputs=inputs, reach=reaches, unseen=list(unseen(simulator, model, cohort.specimens)))


def keep(ranges: Ranges, out: Path) -> None:
    """Write a look into a result folder, unless it is there."""
    if _read(out / RANGES) != ranges:
        write_json(out / RANGES, ranges.model_dump())


def _read(path: Path) -> Ranges | None:
    try:
        return Ranges.model_validate(read_json(path) or {})
    except ValidationError:
        return None
