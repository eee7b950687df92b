"""Polynomials that stand for an outcome of a model, and for what it has more than cheaper versions of it.

With cheaper versions, an outcome y is r c + d (Kennedy and O'Hagan 2000, Biometrika 87, 1): c are the polynomials of
the next cheaper version, trained with its own runs, r a factor and d polynomials, both trained with runs of y. That is
used where it leaves less of y unexplained than polynomials of y alone. How much is left is measured with runs of y, at
points at which c was not trained: a version that tells nothing, or tells something wrong, costs runs but no truth.
"""

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from sinew.tasks.fitting.chaos import Basis, basis, polynomials
from sinew.tasks.simulate import Array

MOST_OF_CHEAPER = 300  # polynomials: more of them take long to find, and say little more
EVEN = 1e-12  # part of its size by which something varies at least


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

    def plus(self, factor: float, other: "Sum") -> "Sum":
        """The sum of it and ``factor`` times another."""
        exponents, place = np.unique(np.concatenate([self.exponents, other.exponents]), axis=0, return_inverse=True)
        coefficients = np.zeros(len(exponents))
        np.add.at(coefficients, place.ravel(), np.concatenate([self.coefficients, factor * other.coefficients]))
        return Sum(exponents, coefficients)


@dataclass(frozen=True, eq=False)
class Fitted:
    """What stands for an outcome: of the ``whole`` design and ``without`` each scramble in turn.

    ``unexplained``: the part of its variance that is not explained, the larger of two estimates: by leave-one-out, and
    of each scramble by the polynomials without it. ``alone``: the same by leave-one-out without cheaper versions, and
    ``used``: whether one is used.
    """

    whole: Sum
    without: dict[int, Sum]
    unexplained: float
    alone: float
    used: bool = False


def fitted(runs: Runs, cheaper: Fitted | None = None, *, stands_in: bool = False) -> Fitted:
    """Polynomials of a version, with those of the next ``cheaper`` one if they help.

    Those of a version that ``stands_in`` for the model are not chosen anew without each scramble: it has many runs.
    """
    own = basis(runs.share, runs.outcome, most=MOST_OF_CHEAPER if stands_in else None)
    if cheaper is not None and (both := _with_cheaper(runs, cheaper, own)) is not None:
        return both
    again = None if stands_in else own.degree
    return _jackknifed(runs, own.unexplained, own.unexplained, lambda kept, _: _alone(runs, kept, own, again))


def _with_cheaper(runs: Runs, cheaper: Fitted, own: Basis) -> Fitted | None:
    """None where polynomials of the outcome alone leave less unexplained."""
    factor = _slope(cheaper.whole.at(runs.share), runs.outcome)
    if factor is None:
        return None
    rest = runs.outcome - factor * cheaper.whole.at(runs.share)
    degree: int | None = 0
    part = float(rest.var() / runs.outcome.var()) * len(rest) / (len(rest) - 2)  # two numbers are fitted
    if np.ptp(rest) > EVEN * np.abs(runs.outcome).max():
        found = basis(runs.share, rest)
        if found.unexplained < 1.0:
            degree, part = found.degree, found.unexplained * part
    if part >= own.unexplained:
        return None

    def again(kept: Array, left_out: int | None) -> Sum:
        below = cheaper.whole if left_out is None else cheaper.without.get(left_out, cheaper.whole)
        lower = below.at(runs.share[kept])
        slope = _slope(lower, runs.outcome[kept])
        if slope is None:
            return _alone(runs, kept, own, own.degree)
        rest = runs.outcome[kept] - slope * lower
        if not degree or np.ptp(rest) <= EVEN * np.abs(runs.outcome).max():
            constant = np.zeros((1, runs.share.shape[1]), dtype=int)
            return Sum(constant, np.array([rest.mean()])).plus(slope, below)
        chosen = basis(runs.share[kept], rest, degree)
        return Sum(chosen.exponents, chosen.coefficients(runs.share[kept], rest)).plus(slope, below)

    return _jackknifed(runs, part, own.unexplained, again, used=True)


def _alone(runs: Runs, kept: Array, own: Basis, again: int | None) -> Sum:
    """Polynomials of the outcome alone, of rows that are kept; chosen ``again`` up to a degree if not all are."""
    chosen = own if kept.all() or again is None else basis(runs.share[kept], runs.outcome[kept], again)
    return Sum(chosen.exponents, chosen.coefficients(runs.share[kept], runs.outcome[kept]))


def _jackknifed(
    runs: Runs, part: float, alone: float, fit: Callable[[Array, int | None], Sum], *, used: bool = False
) -> Fitted:
    """``fit`` of all rows, and of those without each scramble in turn; what is left of each by that without it."""
    whole = fit(np.ones(len(runs.outcome), dtype=bool), None)
    without, missed = {}, 0.0
    for each in np.unique(runs.scramble).tolist():
        kept = runs.scramble != each
        without[each] = fit(kept, each)
        missed += float(np.square(without[each].at(runs.share[~kept]) - runs.outcome[~kept]).sum())
    return Fitted(whole, without, max(part, missed / (len(runs.outcome) * runs.outcome.var())), alone, used)


def _slope(lower: Array, values: Array) -> float | None:
    """The factor of least squares; None where the cheaper version does not vary."""
    centred = lower - lower.mean()
    size = float(centred @ centred)
    return None if size <= (EVEN * np.abs(lower).max()) ** 2 * len(lower) else float(centred @ values / size)


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


def together(sums: Sequence[Sum]) -> tuple[Array, Array]:
    """All polynomials ``[t, d]`` of several sums, and their coefficients ``[t, q]`` in each."""
    exponents, place = np.unique(np.concatenate([one.exponents for one in sums]), axis=0, return_inverse=True)
    coefficients = np.zeros((len(exponents), len(sums)))
    ends = np.cumsum([len(one.exponents) for one in sums])
    for number, (one, end) in enumerate(zip(sums, ends, strict=True)):
        coefficients[place.ravel()[end - len(one.exponents) : end], number] = one.coefficients
    return exponents, coefficients
