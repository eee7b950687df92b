"""Indices by surrogate: of polynomial chaos that stands for the model, with intervals that hold its error.

============  ===============================================================================================
what          how
============  ===============================================================================================
sampling      rows come from several scrambles in turn; each is left out in turn (jackknife, Student's t)
emulation     the part of the variance that the polynomials do not explain: it could belong to any index
failed rows   twice their share: nobody knows what they would have shown
============  ===============================================================================================

The variance of an outcome is the sum of the squares of its coefficients, and its Sobol indices are parts of that sum
(Sudret 2008, Reliab. Eng. Syst. Saf. 93, 964). The half-width of an interval is the root of the sum of the squares of
the first two, and the third. Polynomials are chosen anew without each scramble. Curves are principal components, each
with polynomials of its own.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from threadpoolctl import threadpool_limits

from sinew.tasks.fitting.chaos import together
from sinew.tasks.simulate import Array
from sinew.tasks.simulate.saltelli import Design
from sinew.tasks.sobol.method import Intervals, moderate
from sinew.tasks.sobol.polynomials import Fitted, Runs, Sum, stacked
from sinew.tasks.sobol.result import KEYS, Analysis, Convergence

CONSTANT = 1e-12  # part of its size by which an outcome varies at least
LIMIT = 0.05  # of all rows: if more of them failed, polynomials would speak for where there is no model
FEWEST = 32  # runs of a cheaper version that are worth a fit
EXPLAINED, COMPONENTS = 1e-4, 8  # part of all curves' variance that is left out, and principal components at most


@dataclass(frozen=True, eq=False)
class Version:
    """A cheaper version of the model: the design of its runs, plain, and their ``share`` ``[n, free]``."""

    design: Design
    share: Array


@dataclass(frozen=True, eq=False)
class ByChaos:
    """Indices of any outcomes of a plain design with ``share`` ``[n, free]``; ``ok`` ``[n]``: its rows that ran.

    ``sizes``: how many rows there were when intervals were looked at. ``fits``: polynomials so far, by what they were
    made of; a design that grows hands them on. ``cheaper``: versions of the model, the cheapest first. Outcomes
    ``[N, ...]`` are those of the model, then those of each of these, NaN where a run of theirs failed.
    """

    design: Design
    share: Array
    ok: Array
    intervals: Intervals
    second_order: bool = False
    sizes: tuple[int, ...] = ()
    rule: str = "the emulators were trained with the rows that ran"
    refuses: bool = False
    fits: dict[bytes, Fitted] = field(default_factory=dict, repr=False)
    cheaper: tuple[Version, ...] = ()

    @property
    def whole(self) -> Array:
        """Rows ``[n]`` that ran."""
        return self.ok

    def of(self, outcomes: Array) -> dict[str, Array]:
        """S1, S1_conf, ST, ST_conf ``[d, m]`` of outcomes ``[N, m]`` that change little from one to the next."""
        used = moderate(outcomes[: self.ok.size][self.ok])
        varies = _varies(used)
        found = {key: np.full((len(self.design.names), outcomes.shape[1]), np.nan) for key in KEYS}
        if varies.any():
            with threadpool_limits(1):  # sums in one order, on whatever machine
                for key, values in self._of_curves(outcomes[:, varies]).items():
                    found[key][:, varies] = values
        return found

    def analysis(self, outcomes: Array) -> Analysis:
        """The same of one output ``[N]``, with indices of second order if they were asked for."""
        if (known := self.fitted(outcomes)) is None:
            return Analysis(*(np.full(len(self.design.names), np.nan) for _ in KEYS))
        every = [_indices(each, self.design, self.second_order) for each in (known.whole, *known.without.values())]
        found = dict(zip(("S1", "ST", "S2"), zip(*every, strict=True), strict=False))
        parts = {key: each[0] for key, each in found.items()}
        parts |= {f"{key}_conf": self._half(np.array(each[1:]), known.unexplained) for key, each in found.items()}
        return Analysis(**parts)

    def fitted(self, outcomes: Array) -> Fitted | None:
        """What stands for one output ``[N]``; None where it does not vary."""
        values = moderate(outcomes[: self.ok.size][self.ok])
        if not _varies(values):
            return None
        with threadpool_limits(1):
            return stacked([*self._runs_of_cheaper(outcomes), self._runs(values)], self.fits)

    def unexplained(self, outcomes: Array) -> float:
        """The part of one output's variance that its polynomials do not explain."""
        known = self.fitted(outcomes)
        return 0.0 if known is None else known.unexplained

    def first(self, rows: int) -> "ByChaos":
        """That of the first ``rows`` of the design."""
        design = replace(self.design, base_samples=rows, rows=self.design.rows[:rows])
        return replace(self, design=design, share=self.share[:rows], ok=self.ok[:rows])

    def if_failed_had(self, outcomes: Array) -> dict[str, Array]:
        """Nothing: intervals hold what failed rows might have shown."""
        return {}

    def convergence(self, outcomes: Array) -> Convergence:
        """Indices of one output ``[N]`` from the first rows, of each of the sizes."""
        others = outcomes[self.ok.size :]
        every = [self.first(size).analysis(np.concatenate([outcomes[:size], others])) for size in self.sizes]
        shape = (len(self.sizes), len(self.design.names))
        return Convergence(
            list(self.sizes), *(np.array([getattr(one, key) for one in every]).reshape(shape) for key in KEYS)
        )

    def _runs(self, values: Array) -> Runs:
        """The rows of the model that ran, with their values ``[n]``."""
        return Runs(self.share[self.ok], self.design.scramble[self.ok], values)

    def _of_cheaper(self, outcomes: Array) -> Iterator[tuple[Version, Array, Array]]:
        """Cheaper versions that can be used, which of their rows ran ``[n]``, and their outcomes ``[ran, ...]``."""
        start = self.ok.size
        for version in self.cheaper:
            values = outcomes[start : start + len(version.share)]
            start += len(version.share)
            ran = np.asarray(np.isfinite(values.reshape(len(values), -1)).all(axis=1))
            if ran.sum() >= FEWEST and _varies(values[ran]).all():
                yield version, ran, moderate(values[ran])

    def _runs_of_cheaper(self, outcomes: Array) -> list[Runs]:
        return [
            Runs(version.share[ran], version.design.scramble[ran], values)
            for version, ran, values in self._of_cheaper(outcomes)
        ]

    def _half(self, without: Array, unexplained: Array | float) -> Array:
        """Half-widths of intervals from indices ``[r, ...]`` without each scramble in turn."""
        _, factor = self.intervals.resampled(self.design.scramble[self.ok])
        return np.hypot(factor * without.std(axis=0, ddof=1), unexplained) + 2.0 * (~self.ok).mean()

    def _of_curves(self, outcomes: Array) -> dict[str, Array]:
        """Of curves ``[N, m]``: chaos of their principal components, combined point by point."""
        members = self.design.members
        scaled = _standard(moderate(outcomes[: self.ok.size][self.ok]))
        scores, sizes, directions = np.linalg.svd(scaled, full_matrices=False)
        lost = 1.0 - np.cumsum(sizes**2) / np.sum(sizes**2)
        count = min(int(np.argmax(lost <= EXPLAINED)) + 1, COMPONENTS, len(sizes))
        scores, directions = scores[:, :count] * sizes[:count], directions[:count]
        below = [
            (version.share[ran], version.design.scramble[ran], _standard(values) @ directions.T)
            for version, ran, values in self._of_cheaper(outcomes)
        ]
        known = [
            stacked([*(Runs(share, of, each[:, j]) for share, of, each in below), self._runs(scores[:, j])], self.fits)
            for j in range(count)
        ]
        variances = scores.var(axis=0)[:, np.newaxis] * directions**2  # [components, m]
        parts = np.array([one.unexplained for one in known])[:, np.newaxis] * variances
        left = np.sqrt(parts).sum(axis=0) ** 2 + np.maximum(1.0 - variances.sum(axis=0), 0.0)  # as if all errors agreed

        def indices(sums: Sequence[Sum]) -> tuple[Array, Array]:
            exponents, coefficients = together([(one.exponents, one.coefficients) for one in sums])
            first, total = first_and_total(exponents, coefficients @ directions, members)
            return np.nan_to_num(first), np.nan_to_num(total)

        whole = indices([one.whole for one in known])
        without = [indices([one.without[each] for one in known]) for each in known[0].without]
        found = {}
        for number, key in enumerate(("S1", "ST")):
            found[key] = whole[number]
            found[f"{key}_conf"] = self._half(np.array([each[number] for each in without]), left)
        return found


def _standard(curves: Array) -> Array:
    """Curves ``[n, m]`` less their mean, in units of the spread of each point."""
    return np.asarray((curves - curves.mean(axis=0)) / curves.std(axis=0))


def _varies(outcomes: Array) -> Array:
    """Whether outcomes ``[n, ...]`` vary from row to row ``[...]``."""
    return np.asarray(np.ptp(outcomes, axis=0) > CONSTANT * np.abs(outcomes).max(axis=0))


def _indices(known: Sum, design: Design, second_order: bool) -> tuple[Array, ...]:
    """First and total order indices, and those of second order if they are asked for; 0 where nothing is explained."""
    first, total = first_and_total(known.exponents, known.coefficients, design.members)
    found = (np.nan_to_num(first), np.nan_to_num(total))
    return (*found, second(known.exponents, known.coefficients, design.members)) if second_order else found


def first_and_total(exponents: Array, coefficients: Array, members: tuple[tuple[int, ...], ...]) -> tuple[Array, Array]:
    """First and total order indices ``[f, ...]`` of factors from coefficients ``[t, ...]``.

    ``members``: which parameters move as one. NaN where nothing varies.
    """
    on, of_variance = _parts(exponents, coefficients, members)
    alone = on & (on.sum(axis=1, keepdims=True) == 1)
    return np.tensordot(alone.T, of_variance, 1), np.tensordot(on.T, of_variance, 1)


def second(exponents: Array, coefficients: Array, members: tuple[tuple[int, ...], ...]) -> Array:
    """Second order indices ``[f, f]`` of one outcome, NaN on and below the diagonal, as SALib has them."""
    on, of_variance = _parts(exponents, coefficients, members)
    found = np.full((len(members), len(members)), np.nan)
    for i, j in zip(*np.triu_indices(len(members), 1), strict=True):
        both = on[:, i] & on[:, j] & (on.sum(axis=1) == 2)
        found[i, j] = of_variance[both].sum()
    return found


def _parts(exponents: Array, coefficients: Array, members: tuple[tuple[int, ...], ...]) -> tuple[Array, Array]:
    """Which factors each polynomial has ``[t, f]``, and its part of the variance ``[t, ...]``."""
    on = np.stack([(exponents[:, list(at)] > 0).any(axis=1) for at in members], axis=1)
    squares = np.where(exponents.any(axis=1).reshape(-1, *[1] * (coefficients.ndim - 1)), coefficients**2, 0.0)
    total = squares.sum(axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        return on, np.where(total > 0.0, squares / total, np.nan)
