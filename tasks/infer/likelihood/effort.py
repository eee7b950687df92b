"""How often the model is computed to explore a specimen: more often where that costs next to nothing."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Effort:
    """Numbers of model runs.

    Fits begin at the best ``starts`` of so many ``candidates`` and take at most so many ``steps``; ``again``: at how
    many where a former fit is known, beside that. An emulator is trained in ``rounds`` of at least ``fewest`` points,
    and ``ratio`` for each coefficient of a polynomial, and judged by ``checked`` draws.
    """

    candidates: int
    starts: int
    again: int
    steps: int
    rounds: int
    fewest: int
    ratio: float
    checked: int


FULL = Effort(candidates=6, starts=6, again=6, steps=60, rounds=5, fewest=100, ratio=2.0, checked=256)
SPARING = Effort(candidates=32, starts=2, again=0, steps=8, rounds=4, fewest=40, ratio=1.3, checked=48)


def most_rows(size: int, *, discrepancy: bool) -> int:
    """The most runs that :data:`SPARING` takes for ``size`` parameters, with fits that look for a discrepancy.

    Those begin anew, so that there are fits twice.
    """
    fits = SPARING.candidates + SPARING.starts * SPARING.steps * (size + 1)
    beside = fits + 3 * SPARING.steps * (size + 1) if discrepancy else 0
    return fits + beside + SPARING.rounds * points_of_a_round(size, SPARING) + SPARING.checked


def points_of_a_round(size: int, effort: Effort) -> int:
    """How many points an emulator of ``size`` parameters is trained with in a round."""
    return max(effort.fewest, int(effort.ratio * (1 + size + size * (size + 1) / 2)))
