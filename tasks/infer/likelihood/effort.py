"""How often the model is computed to explore a specimen: more often where that costs next to nothing."""

from dataclasses import dataclass

from sinew.tasks.fitting.few_runs import most_runs


@dataclass(frozen=True)
class Effort:
    """Numbers of model runs.

    Fits begin at the best ``starts`` of so many ``candidates`` and take at most so many ``steps``; ``again``: at how
    many where a former fit is known, beside that. ``few``: derivatives are found anew in only so many of these steps,
    and follow the others. An emulator is trained in ``rounds`` of at least ``fewest`` points,
    and ``ratio`` for each coefficient of a polynomial, and judged by ``checked`` draws.
    """

    candidates: int
    starts: int
    again: int
    steps: int
    few: bool
    rounds: int
    fewest: int
    ratio: float
    checked: int


FULL = Effort(candidates=6, starts=6, again=6, steps=60, few=False, rounds=5, fewest=100, ratio=2.0, checked=256)
SPARING = Effort(candidates=32, starts=2, again=0, steps=4, few=True, rounds=4, fewest=40, ratio=1.3, checked=48)


def most_rows(size: int, *, discrepancy: bool) -> int:
    """The most runs that :data:`SPARING` takes for ``size`` parameters, with fits that look for a discrepancy.

    The last fit begins where those ended, if there are any.
    """
    one = most_runs(size, SPARING.steps)
    fits = SPARING.candidates + SPARING.starts * one + (3 * (1 + size) + 3 * one if discrepancy else 0)
    return fits + SPARING.rounds * points_of_a_round(size, SPARING) + SPARING.checked


def points_of_a_round(size: int, effort: Effort) -> int:
    """How many points an emulator of ``size`` parameters is trained with in a round."""
    return max(effort.fewest, int(effort.ratio * (1 + size + size * (size + 1) / 2)))
