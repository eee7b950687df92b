"""A look at a study's ranges before any work: can they reach the measured forces, and is every parameter seen?

What was seen is kept in ``ranges.json`` of the result folder, so that a study that goes on does not look again.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from pydantic import BaseModel, ConfigDict, ValidationError

from sinew.runner.errors import BadInput, brief
from sinew.tasks.data.cohort import Cohort
from sinew.tasks.model import Model, Parameter, Specimen
from sinew.tasks.simulate import Simulator
from sinew.tasks.simulate.build import simulator_of
from sinew.tasks.simulate.lateral import SEEN
from sinew.tasks.simulate.reach import Reach, reach, unseen
from sinew.tasks.study.files import digest, read_json, write_json
from sinew.tasks.study.model import model_of
from sinew.tasks.study.study import Study

RANGES = "ranges.json"
VERSION = 3  # of what is looked at
LARGEST_MPA = 1e9  # of a modulus that is proposed
Advice = tuple[str, float, float]  # a parameter and the ends of its range
MOST = 0.5  # of the specimens out of reach: with more of them, the ranges are wrong and not the specimens


class Ranges(BaseModel):
    """The ``reach`` of each measured curve, and the free parameters that are ``unseen``.

    ``advice``: ranges that reach the forces, where these are refused. ``inputs`` is the key of what was looked at.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    inputs: str
    reach: list[Reach]
    unseen: list[str]
    advice: list[Advice]

    @property
    def out_of_reach(self) -> list[Reach]:
        """One curve of each specimen that has any out of reach, the farthest one."""
        return out_of_reach(self.reach)

    @property
    def hopeless(self) -> bool:
        """Whether the ranges, and not single specimens, are wrong."""
        return _hopeless(self.reach)

    def remarks(self) -> Iterator[str]:
        """What a person should know before the work begins, in a line each."""
        count = len({one.specimen for one in self.reach})
        if far := self.out_of_reach:
            yield brief(f"ranges: {len(far)} of {count} specimens are out of reach; for example, {words(far[0])}")
        elif near := farthest_of_each([one for one in self.reach if not one.ratios[0] <= 1.0 <= one.ratios[1]]):
            beyond = f"the peaks of {len(near)} of {count} specimens lie outside what they give"
            said = f"ranges: {beyond}; for example, {words(near[0])}"
            yield brief(
                f"{said}; fits will be pushed against the bounds (`sinew init` on the cohort chooses other ranges)"
            )
        if self.unseen:
            values = "a fixed value" if len(self.unseen) == 1 else "fixed values"
            names = ", ".join(self.unseen)
            yield brief(f"ranges: no force of these tests depends on {names}; {values} would save work")

    def refuse(self, study: Path) -> None:
        """Raises :class:`BadInput` where the ranges cannot reach the data, with such as would."""
        if not self.hopeless:
            return
        far = self.out_of_reach
        if all(one.at_rest for one in far):
            first = far[0]
            problem = (
                f"{first.specimen} {first.protocol} has {first.measured_N:.3g} N, but its displacement pulls nothing"
            )
            raise BadInput(study, problem, "a displacement in mm that moves the specimen, or another column")
        if all(one.other_sign for one in far):
            raise BadInput(study, words(far[0]), "forces of the other sign (tension is positive), or another column")
        ranges = ", ".join(f"{name}: {{min: {low:g}, max: {high:g}}}" for name, low, high in self.advice)
        raise BadInput(study, words(far[0]), f"ranges such as {ranges}" if ranges else "other ranges")


def advised(simulator: Simulator, model: Model, specimens: Sequence[Specimen], found: Sequence[Reach]) -> list[Advice]:
    """Ranges of the free moduli that reach what the present ones reach and more; nothing where none are found."""
    scales = [one.scale for one in found if not one.reached and not one.other_sign]
    if not scales:
        return []
    low, high = min([1.0, *scales]), max([1.0, *scales])
    if all(not one.reached for one in found):
        low, high = min(scales), max(scales)
    moduli = [widened(one, low, high) for one in model.free if one.unit == "MPa"]
    wider = model
    for one in moduli:
        wider = wider.with_parameter(one)
    if not all(0 <= one.minimum < one.maximum < LARGEST_MPA for one in moduli):
        return []
    again = [each for specimen in specimens for each in reach(simulator, wider, specimen)]
    return [(one.name, one.minimum, one.maximum) for one in moduli] if not _hopeless(again) else []


def out_of_reach(reaches: Sequence[Reach]) -> list[Reach]:
    """One curve of each specimen that has any out of reach, the farthest one."""
    return farthest_of_each([one for one in reaches if not one.reached])


def farthest_of_each(reaches: Sequence[Reach]) -> list[Reach]:
    """The farthest curve of each specimen."""
    worst: dict[str, Reach] = {}
    for one in reaches:
        if one.specimen not in worst or one.distance > worst[one.specimen].distance:
            worst[one.specimen] = one
    return list(worst.values())


def _hopeless(reaches: Sequence[Reach]) -> bool:
    return len(out_of_reach(reaches)) > MOST * len({one.specimen for one in reaches})


def widened(parameter: Parameter, low: float, high: float) -> Parameter:
    """The parameter with its ends times ``low`` and ``high``, rounded outwards to two digits."""
    minimum, maximum = rounded(parameter.minimum * low, up=False), rounded(parameter.maximum * high, up=True)
    return replace(parameter, minimum=minimum, maximum=maximum, reference=(minimum + maximum) / 2)


def rounded(value: float, *, up: bool) -> float:
    """A number of at least 0 with two digits, rounded up or down."""
    if value == 0.0:
        return 0.0
    digit = 10.0 ** (math.floor(math.log10(value)) - 1)
    if not digit:  # of a value that has no two digits, next to the smallest number there is
        return value
    return float(f"{(math.ceil if up else math.floor)(value / digit) * digit:.2g}")


def words(one: Reach) -> str:
    """The measured peak of a curve as a nominal stress, and what the ranges give there."""
    measured, near, far = one.stresses_MPa
    has = f"{one.specimen} {one.protocol} has {measured:.3g} MPa at its peak (median of 3 points)"
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
    if (found := read(out / RANGES)) is not None and found.inputs == inputs:
        return found
    simulator = simulator_of(study, "uniaxial", out)
    reaches = [each for specimen in cohort.specimens for each in reach(simulator, model, specimen)]
    return Ranges(
        inputs=inputs,
        reach=reaches,
        unseen=[name for name in unseen(simulator, model, cohort.specimens) if not (study.compared and name == SEEN)],
        advice=advised(simulator, model, cohort.specimens, reaches) if _hopeless(reaches) else [],
    )


def keep(ranges: Ranges, out: Path) -> None:
    """Write a look into a result folder, unless it is there."""
    if read(out / RANGES) != ranges:
        write_json(out / RANGES, ranges.model_dump())


def read(path: Path) -> Ranges | None:
    """What an earlier run saw; None where there is nothing that can be used."""
    try:
        found = Ranges.model_validate(read_json(path) or {})
    except ValidationError:
        return None
    return found if all(one.possible for one in found.reach) else None
