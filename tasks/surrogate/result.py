"""The result of a surrogate study: what ``surrogate.json`` holds."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from sinew.tasks.fitting.limits import COMPONENTS, HIGHEST, KINDS
from sinew.tasks.study.result import Count, NotNegative, NotNegatives, Numbers, Result, Share, check_lengths
from sinew.tasks.surrogate.settings import MOST_RUNS


@dataclass(frozen=True, eq=False)
class OfCourse:
    """How well the course of an ``output`` (``force``, or one of a template's) along a ``protocol`` is emulated.

    ``spread`` (``unit``): its standard deviation over runs, root mean square along time. ``error``: of left-out runs,
    root mean square, in parts of the spread. ``factor``: of standard deviations, so that 95 % of left-out points lie in
    their intervals. ``fresh_error`` and ``fresh_inside``: the error at runs of the last batch, which the emulator
    before it had not seen, and the part of their points inside 95 % intervals; NaN where there was one batch.
    """

    output: str
    protocol: str
    unit: str
    spread: NotNegative
    error: NotNegative
    factor: NotNegative
    fresh_error: NotNegative
    fresh_inside: Share


@dataclass(frozen=True, eq=False)
class OfComponent:
    """How a principal component is emulated, see :class:`sinew.tasks.fitting.emulator.Fit`."""

    kind: str
    degree: Count
    theta: Numbers
    error: NotNegative


@dataclass(frozen=True, eq=False)
class OfSpecimen:
    """The emulator of a specimen from ``runs``, of which ``failed``; ``table`` names its evaluations in the store.

    ``sizes`` ``[k]``: runs at which it was looked at, with the largest error of a course then, ``errors`` ``[k]``.
    ``courses`` by the field of the store. ``caught`` and ``mistaken``: parts of left-out runs that were expected to
    fail, of those that failed and of the others; NaN where too few failed to learn from.
    """

    table: str
    runs: Count
    failed: Count
    sizes: list[int]
    errors: NotNegatives
    courses: Mapping[str, OfCourse]
    components: list[OfComponent]
    caught: Share
    mistaken: Share

    @property
    def error(self) -> float:
        """The largest error of a course."""
        return max(one.error for one in self.courses.values())


@dataclass(frozen=True, eq=False)
class SurrogateResult(Result):
    """Emulators of each specimen. ``names`` and ``bounds`` are of the free parameters; ``asked``: the largest error."""

    TASK = "surrogate"
    VERSION = 2  # the store tells parameters, ranges and courses, too
    LIBRARIES = ("scikit-learn", "scikit-optimize")

    names: list[str]
    bounds: list[list[int | float]]
    asked: NotNegative
    growth: str
    specimens: Mapping[str, OfSpecimen]
    inputs: str

    def __post_init__(self) -> None:
        """Raises :class:`ValueError` for numbers that contradict each other."""
        check_lengths(self.names, self, ())
        if len(self.bounds) != len(self.names) or any(len(one) != 2 or not one[0] < one[1] for one in self.bounds):
            raise ValueError("bounds: not two numbers in order for each name")
        if not self.specimens:
            raise ValueError("no specimens")
        for name, one in self.specimens.items():
            if one.failed > one.runs or one.runs > MOST_RUNS:
                raise ValueError(f"{name}: {one.failed} of {one.runs} runs failed")
            rises = all(before < after for before, after in pairwise([0, *one.sizes]))
            if one.errors.shape != (len(one.sizes),) or one.sizes[-1:] != [one.runs] or not rises:
                raise ValueError(f"{name}: {one.runs} runs, sizes {one.sizes[-3:]}")
            if not one.courses:
                raise ValueError(f"{name}: no courses")
            if not np.isfinite([each.factor for each in one.courses.values()]).all():
                raise ValueError(f"{name}: a factor that is not finite")
            if len(one.components) > COMPONENTS:
                raise ValueError(f"{name}: {len(one.components)} components")
            for each in one.components:
                right = each.theta.shape == (len(self.names) + 2,) and 0 < each.degree <= HIGHEST
                if each.kind not in KINDS or not right:
                    raise ValueError(f"{name}: a component of kind {each.kind!r} with {each.theta.size} numbers")
                if not np.isfinite([*each.theta, each.error]).all():
                    raise ValueError(f"{name}: a component whose numbers are not finite")

    @property
    def error(self) -> float:
        """The largest error of any course of any specimen."""
        return max(one.error for one in self.specimens.values())

    @property
    def reached(self) -> bool:
        """Whether all errors are as small as asked."""
        return self.error <= self.asked


RESULT = SurrogateResult
