"""The obvious ways to choose a model, from the same candidates, for comparison: the smallest of some number wins.

None of them can say AMBIGUOUS or OUTSIDE: each takes the model as it is, or one candidate.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from sinew.tasks.benchmark.score import DETECTABLE, FAILED, NULL, Case, Share, class_of, named_right, named_wrong
from sinew.tasks.discover.result import DiscoverResult


@dataclass(frozen=True)
class Option:
    """The model as it is (no ``effects``), or a candidate; losses and criterion as in :mod:`sinew.tasks.discover`.

    ``free`` counts the effects' parameters over all specimens. ``held_out``: gain on held-out data, None: not known.
    """

    effects: tuple[str, ...]
    loss: float
    free: int
    criterion: float
    held_out: float | None


Number = Callable[[Option], float]


def _held_out(option: Option) -> float:
    return math.inf if option.held_out is None else -option.held_out


SELECTORS: tuple[tuple[str, Number], ...] = (
    ("smallest training error", lambda option: option.loss),
    ("smallest AIC", lambda option: option.loss + 2.0 * option.free),
    ("smallest BIC", lambda option: option.criterion),
    ("smallest held-out error", _held_out),
)


@dataclass(frozen=True)
class Selected:
    """How a selector did: shares of the same cases as in the main table."""

    name: str
    right: Share
    wrong: Share
    alarms: Share


def selected(result: DiscoverResult, number: Number, singles: bool) -> tuple[str, ...]:
    """The effects that a selector takes, none for the model as it is; ``singles``: of single effects only.

    Equal numbers go to what has fewer effects.
    """
    bare = result.null.loss
    options = [Option((), bare, 0, bare, 0.0)]
    options += [
        Option(one.effects, one.loss, one.free, bare - one.gain, one.held_out)
        for one in result.candidates
        if not singles or len(one.effects) == 1
    ]
    return min(options, key=lambda one: (number(one), len(one.effects), one.effects)).effects


def compare(cases: Sequence[Case]) -> list[Selected]:
    """The discovery itself, then each selector among single effects, and among all candidates."""
    done = [case for case in cases if class_of(case) != FAILED]
    rated = [case for case in done if len(case.answer.truth) < 2]
    detectable = [case for case in rated if class_of(case) == DETECTABLE]
    nulls = [case for case in rated if class_of(case) == NULL]
    results = {id(case): case.result for case in done if case.result is not None}

    def rate(name: str, right: Callable[[Case], bool], named: Callable[[Case], bool]) -> Selected:
        return Selected(
            name,
            Share(name, sum(map(right, detectable)), len(detectable)),
            Share(name, sum(map(named, rated)), len(rated), high=False),
            Share(name, sum(map(named, nulls)), len(nulls), high=False),
        )

    found = [rate("sinew discover (names)", named_right, named_wrong)]
    for singles, words in ((True, "one effect"), (False, "one or two effects")):
        for name, number in SELECTORS:
            taken = {key: set(selected(one, number, singles)) for key, one in results.items()}
            found.append(
                rate(
                    f"{name}, {words}",
                    lambda case, taken=taken: taken[id(case)] == set(case.answer.truth),  # type: ignore[misc]
                    lambda case, taken=taken: not taken[id(case)] <= set(case.answer.truth),  # type: ignore[misc]
                )
            )
    return found
