"""Polynomials that stand for an outcome of a model, and for what it has more than cheaper versions of it.

With cheaper versions, an outcome y is r c + d (Kennedy and O'Hagan 2000, Biometrika 87, 1): c are the polynomials of
the next cheaper version, trained with its own runs, r a factor and d polynomials, both trained with runs of y. In a
cheaper version some parameters do more than in the model and others less, so the own effect of each that matters has a
factor of its own, and so has the rest of c. That is used where it leaves clearly less of y unexplained than
polynomials of y alone. How much is left is measured with runs of y, at points at which c was not trained: a version
that tells nothing, or tells something wrong, costs runs but no truth.
"""

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sinew.tasks.fitting.chaos import Basis, basis, polynomials, together
from sinew.tasks.simulate import Array

MOST_OF_CHEAPER = 300  # polynomials: more of them take long to find, and say little more
HELPS = 0.8  # part of what polynomials of the outcome alone leave unexplained: chance alone makes it a little smaller
LEADING, RUNS_EACH = 0.005, 4  # part of the variance, and runs of the model for each factor


@dataclass(frozen=True, eq=False)
class Runs:
    """Runs of one version at ``share`` ``[n, d]``, the ``scramble`` ``[n]`` of each point, and an outcome ``[n]``."""

    share: Array
    scramble: Array
    outcome: Array


@dataclass(frozen=True, eq=False)
class Sum:
    """A sum of polynomials with ``exponents`` ``[t, d]`` and ``coefficients`` ``[t]``."""

    exponents: Array
    coefficients: Array

    def at(self, share: Array) -> Array:
        """Its values ``[n]`` at ``share`` ``[n, d]``."""
        return np.asarray(polynomials(share, self.exponents) @ self.coefficients)

    def parts(self, which: Sequence[int]) -> list["Sum"]:
        """The effects of ``which`` parameters, each alone, and all that is left but the constant, if anything is."""
        on = self.exponents > 0
        of = [on[:, j] & (on.sum(axis=1) == 1) for j in which]
        left = on.any(axis=1) & ~np.any([np.zeros(len(on), dtype=bool), *of], axis=0)
        return [Sum(self.exponents[each], self.coefficients[each]) for each in (*of, left) if each.any()]

    def plus(self, factor: float, other: "Sum") -> "Sum":
        """The sum of it and ``factor`` times another."""
        every = [(self.exponents, self.coefficients), (other.exponents, factor * other.coefficients)]
        exponents, coefficients = together(every)
        return Sum(exponents, coefficients.sum(axis=1))


@dataclass(frozen=True, eq=False)
class Fitted:
    """What stands for an outcome: of the ``whole`` design and ``without`` each scramble in turn.

    ``unexplained``: the part of its variance that is not explained, the larger of two estimates: by leave-one-out, and
    of each scramble by the polynomials without it. ``alone``: the same without cheaper versions, ``used``: whether one
    is used.
    """

    whole: Sum
    without: dict[int, Sum]
    unexplained: float
    alone: float = np.nan
    used: bool = False


def fitted(runs: Runs, cheaper: Fitted | None = None, *, stands_in: bool = False) -> Fitted:
    """Polynomials of a version, with those of the next ``cheaper`` one if they help.

    Those of a version that ``stands_in`` for the model are not chosen anew without each scramble: it has many runs.
    """
    own = basis(runs.share, runs.outcome, most=MOST_OF_CHEAPER if stands_in else None)
    again = None if stands_in else own.degree
    alone = _jackknifed(runs, own.unexplained, lambda kept, _: _alone(runs, kept, own, again))
    both = None if cheaper is None else _with_cheaper(runs, cheaper)
    if both is None or both.unexplained >= HELPS * alone.unexplained:
        return replace(alone, alone=alone.unexplained)
    return replace(both, alone=alone.unexplained, used=True)


def _with_cheaper(runs: Runs, cheaper: Fitted) -> Fitted | None:
    """With the polynomials of the next cheaper version; None where these do not vary."""
    which = _leading(cheaper.whole, len(runs.outcome))
    values = _values(cheaper.whole.parts(which), runs.share)
    if not values.shape[1]:
        return None
    found = basis(runs.share, runs.outcome, beside=values)

    def again(kept: Array, left_out: int | None) -> Sum:
        below = cheaper.whole if left_out is None else cheaper.without.get(left_out, cheaper.whole)
        parts, share, outcome = below.parts(which), runs.share[kept], runs.outcome[kept]
        values = _values(parts, share)
        chosen = found if left_out is None else basis(share, outcome, found.degree, beside=values)
        every = np.column_stack([values, polynomials(share, chosen.exponents)])
        coefficients = np.linalg.lstsq(every, outcome, rcond=None)[0]
        total = Sum(chosen.exponents, coefficients[len(parts) :])
        for factor, part in zip(coefficients, parts, strict=False):
            total = total.plus(float(factor), part)
        return total

    return _jackknifed(runs, found.unexplained, again)


def _leading(known: Sum, runs: int) -> list[int]:
    """The parameters whose own effects have a factor each: those that decide most, few beside the number of runs."""
    on = known.exponents > 0
    squares = known.coefficients**2
    alone = on.sum(axis=1) == 1
    effects = np.array([squares[alone & each].sum() for each in on.T])
    total = squares[on.any(axis=1)].sum()
    order = np.argsort(-effects, kind="stable")[: runs // RUNS_EACH]
    return [int(j) for j in order if effects[j] > LEADING * total]


def _values(parts: Sequence[Sum], share: Array) -> Array:
    """The values ``[n, k]`` of those of several sums that vary."""
    return np.column_stack([np.empty((len(share), 0)), *(part.at(share) for part in parts)])


def _alone(runs: Runs, kept: Array, own: Basis, again: int | None) -> Sum:
    """Polynomials of the outcome alone, of rows that are kept; chosen ``again`` up to a degree if not all are."""
    chosen = own if kept.all() or again is None else basis(runs.share[kept], runs.outcome[kept], again)
    return Sum(chosen.exponents, chosen.coefficients(runs.share[kept], runs.outcome[kept]))


def _jackknifed(runs: Runs, part: float, fit: Callable[[Array, int | None], Sum]) -> Fitted:
    """``fit`` of all rows, and of those without each scramble in turn; what is left of each by that without it."""
    whole = fit(np.ones(len(runs.outcome), dtype=bool), None)
    without, missed = {}, 0.0
    for each in np.unique(runs.scramble).tolist():
        kept = runs.scramble != each
        without[each] = fit(kept, each)
        missed += float(np.square(without[each].at(runs.share[~kept]) - runs.outcome[~kept]).sum())
    return Fitted(whole, without, max(part, missed / (len(runs.outcome) * runs.outcome.var())))


def stacked(versions: Sequence[Runs], known: dict[bytes, Fitted]) -> Fitted:
    """Of versions from the cheapest to the model itself; ``known``: fits so far, by all that they were made of."""
    made, below = hashlib.blake2b(digest_size=32), None
    for number, runs in enumerate(versions):
        made.update(runs.share.tobytes() + runs.outcome.tobytes())
        key = made.digest()
        if key not in known:
            known[key] = fitted(runs, below, stands_in=number < len(versions) - 1)
        below = known[key]
    assert below is not None, "the model itself is among them"
    return below
