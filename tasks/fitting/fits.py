"""Fits of one specimen: Bayesian optimisation, least squares, or both in turn, in a session of the runner.

Points are on the unit cube of the model's free parameters: 0 is the lower bound of a parameter, 1 the upper.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.optimize import lsq_linear

from sinew.runner.evaluation.adaptive import Session
from sinew.tasks.fitting.bayesian import Search, Surrogate, bayesian, propose
from sinew.tasks.fitting.least_squares import STEP, Fit, Seen, Weighing, curvature_of, least_squares
from sinew.tasks.fitting.starts import ALIKE, FAST, SLOW
from sinew.tasks.model import Model
from sinew.tasks.model.parameters import from_unit
from sinew.tasks.simulate import Array
from sinew.tasks.simulate.evaluation import SpecimenEvaluation, kept_points
from sinew.tasks.study.checkpoint import Checkpoint

APART = 0.1  # least distance of two starts (of the cube's diagonal); nearer ones would lead to the same minimum
WATCHED = 96  # points of a curve, at most, whose residuals the Bayesian optimisation uses
FIRST = 0.13  # of the evaluations, for each of several fits, before the worse half of them is dropped


@dataclass(frozen=True)
class BestFit:
    """The best point of a method: ``at`` ``[d]``, the RMSE of each curve there ``[p]`` (N), and the way to it.

    ``trace`` holds numbers of evaluations and the best total so far (N); ``converged``: None where there is no test.
    """

    at: Array
    objective: Array
    trace: tuple[tuple[int, float], ...]
    converged: bool | None
    starts: int = 1

    @property
    def total(self) -> float:
        return float(self.objective.sum())

    def total_after(self, evaluations: int) -> float | None:
        """The best total (N) within so many evaluations; None when the first took more."""
        reached = [total for used, total in self.trace if used <= evaluations]
        return reached[-1] if reached else None


@dataclass(frozen=True)
class FitSession:
    """Where the fits of one specimen have their points evaluated.

    ``report`` is called with the total objective (N; NaN: failed) of each row.
    """

    session: Session
    model: Model
    evaluation: SpecimenEvaluation
    report: Callable[[float], None] = lambda total: None

    @property
    def size(self) -> int:
        return len(self.model.free)

    def ask(self, points: Array) -> None:
        self.session.ask(from_unit(self.model, points))

    def next_result(self, count: int) -> Seen:
        """The results of the next ``count`` points."""
        results = []
        for _ in range(count):
            results.append(self.session.next())
            self.report(float(results[-1].values["objective"].sum()))
        return Seen(
            np.array([self.evaluation.parts(one.values) for one in results]),
            tuple(
                np.array([one.values[series.field] for one in results]) / series.level
                for series in self.evaluation.series()
            ),
        )

    def seen(self, points: Array) -> Seen:
        self.ask(points)
        return self.next_result(len(points))


def search(
    fitting: FitSession,
    *,
    budget: int,
    initial: int,
    pending: int,
    seeds: Search,
    seed: tuple[int, ...],
    checkpoint: Checkpoint,
) -> tuple[Search, BestFit | None]:
    """Bayesian optimisation; proposals go to ``checkpoint``. Returns all points, and the best (None: all failed)."""
    objectives: list[Array] = []
    proposed = 0

    def next_result() -> tuple[float, Array]:
        evaluated = fitting.next_result(1)
        objectives.append(evaluated.objective[0])
        total = float(objectives[-1].sum())
        return total if np.isfinite(total) else np.inf, residuals_of(fitting.evaluation, evaluated.forces)[0]

    def propose_one(number: int, surrogate: Surrogate) -> tuple[Array, Array]:
        nonlocal proposed
        if proposed == len(checkpoint):
            point, theta = fitting.session.compute(propose, surrogate, (*seed, number))
            checkpoint.append(np.concatenate([point, theta]))
        proposed += 1
        kept = checkpoint.kept[proposed - 1]
        return kept[: fitting.size], kept[fitting.size :]

    seen = bayesian(
        fitting.ask,
        next_result,
        propose_one,
        size=fitting.size,
        budget=budget,
        initial=initial,
        pending=pending,
        seeds=seeds,
        rng=np.random.default_rng(seed),
    )
    if not np.isfinite(seen.totals).any():
        return seen, None
    best = int(np.argmin(seen.totals))
    lowest = np.minimum.accumulate(seen.totals)
    first = int(np.argmax(np.isfinite(lowest)))
    trace = tuple((n + 1, float(lowest[n])) for n in range(first, len(lowest)))
    return seen, BestFit(seen.points[best], objectives[best], trace, None)


def polished(
    fitting: FitSession, starts: Iterable[Array], budget: int, most: int, before: BestFit | None = None
) -> BestFit | None:
    """Least squares with ``budget`` evaluations from up to ``most`` starts, in a race.

    The first of ``starts`` is followed by those that :func:`exchanged` makes of its fit, then by the others. Each gets
    ``FIRST`` of the evaluations; the better half goes on for twice as long, then the better half of these, until one is
    left, which has what remains. ``before``: what was found, and used of another budget, before. None when the model
    fails at every start.
    """
    trace = list(before.trace) if before else []
    offset, used = trace[-1][0] if trace else 0, 0
    quota = budget if most == 1 else max(int(FIRST * budget), fitting.size + 4)
    descents: list[Descent] = []

    def advance(one: Descent, until: int) -> None:
        nonlocal used
        known, since = len(one.trace), one.used
        one.go_on(min(until, one.used + budget - used))
        for count, total in one.trace[known:]:
            trace.append((offset + used + count - since, min(total, trace[-1][1] if trace else np.inf)))
        used += one.used - since

    others = iter(starts)
    after: Iterator[Array] = iter(())
    tried = 0
    while tried < most and (tried == 0 or used < budget):
        start = next(after, None) if descents else None
        start = next(others, None) if start is None else start
        if start is None:
            break
        tried += 1
        one = Descent(fitting, start, budget)
        advance(one, quota)
        if one.fit is not None:
            descents.append(one)
            if len(descents) == 1 and most > 1:
                after = iter(exchanged(fitting, one.fit))
    racing = descents
    while racing and used < budget and any(not one.ended for one in racing):
        racing = sorted(racing, key=lambda one: one.total)[: (len(racing) + 1) // 2]
        quota = 2 * quota if len(racing) > 1 else budget
        before_round = used
        for one in racing:
            advance(one, quota)
        if used == before_round and len(racing) == 1:
            break
    best = min(descents, key=lambda one: one.total, default=None)
    if best is None or best.fit is None or (before is not None and before.total < best.total):
        return before and BestFit(before.at, before.objective, tuple(trace), False, tried)
    return BestFit(best.fit.at, best.fit.objective, tuple(trace), best.fit.converged, tried)


class Descent:
    """A least-squares fit in progress: ``fit`` is its state (None before the first step), ``used`` its evaluations."""

    def __init__(self, fitting: FitSession, start: Array, budget: int) -> None:
        self.fitting = fitting
        self.fit: Fit | None = None
        self.used = 0
        self._steps = least_squares(start, weighing_of(fitting.evaluation), budget, self._after_step)
        self._asked: Array | None = next(self._steps)

    @property
    def ended(self) -> bool:
        return self._asked is None

    @property
    def total(self) -> float:
        """The total objective (N) so far."""
        return np.inf if self.fit is None else float(self.fit.objective.sum())

    @property
    def trace(self) -> tuple[tuple[int, float], ...]:
        return () if self.fit is None else self.fit.trace

    def go_on(self, until: int) -> None:
        """Continue until the fit has ended, or its next step would exceed ``until`` evaluations in all."""
        while self._asked is not None and self.used + len(self._asked) <= until:
            seen = self.fitting.seen(self._asked)
            self.used += len(self._asked)
            try:
                self._asked = self._steps.send(seen)
            except StopIteration as end:
                self._asked = None
                self.fit = end.value

    def _after_step(self, fit: Fit) -> None:
        self.fit = fit


def exchanged(fitting: FitSession, fit: Fit) -> Iterable[Array]:
    """Starts for further fits: of each pair of relaxation times, one at the slow end of its range, one at the fast end.

    A slow fibre with a fast matrix relaxes much like a fast fibre with a slow matrix, and the objective rises between
    the two. The other parameters follow as the fit's derivatives say.
    """
    names = [parameter.name for parameter in fitting.model.free]
    pairs = [pair for pair in ALIKE if set(pair) <= set(names)]
    chosen = np.array([names.index(name) for pair in pairs for name in pair], dtype=int)
    others = np.setdiff1d(np.arange(fitting.size), chosen)
    if not chosen.size or not others.size:
        return
    curvature = curvature_of(fit.jacobians, weighing_of(fitting.evaluation), fit.objective)
    curvature += np.diag(1e-3 * np.diag(curvature) + 1e-10 * (np.trace(curvature) or 1.0))
    upper = np.linalg.cholesky(curvature[np.ix_(others, others)]).T
    for each in product(((FAST, SLOW), (SLOW, FAST)), repeat=len(pairs)):
        ends = np.concatenate(each)
        pull = curvature[np.ix_(others, chosen)] @ (ends - fit.at[chosen])
        bounds = (-fit.at[others] - 1e-12, 1.0 - fit.at[others] + 1e-12)
        point = fit.at.copy()
        point[others] += lsq_linear(upper, -np.linalg.solve(upper.T, pull), bounds=bounds).x
        point[chosen] = ends
        yield np.clip(point, 0.0, 1.0)


def best_apart(seen: Search) -> Iterable[Array]:
    """Points of a search, the best first, without those near a better one."""
    chosen: list[Array] = []
    for number in np.argsort(seen.totals, kind="stable"):
        point = seen.points[number]
        distances = [float(np.linalg.norm(point - other)) for other in chosen]
        if np.isfinite(seen.totals[number]) and all(d > APART * np.sqrt(point.size) for d in distances):
            chosen.append(point)
            yield point


def jacobians_at(fitting: FitSession, at: Array) -> tuple[Array, ...]:
    """Derivatives ``[d, k]`` (N per unit) of the kept forces of every curve at a point; 0 where the model fails."""
    steps = np.where(at + STEP <= 1.0, STEP, -STEP)
    seen = fitting.seen(np.concatenate([at[np.newaxis], at + np.diag(steps)]))
    alive = np.asarray(np.isfinite(seen.objective).all(axis=1))[1:, np.newaxis]
    return tuple(np.where(alive, (force[1:] - force[0]) / steps[:, np.newaxis], 0.0) for force in seen.forces)


def weighing_of(evaluation: SpecimenEvaluation) -> Weighing:
    """How many measured points each kept point of each curve stands for."""
    counts, shares = [], []
    protocols = {curve.name: curve.protocol for curve in evaluation.specimen.curves}
    for series in evaluation.series():
        counts.append(series.count)
        shares.append(series.shares(kept_points(protocols[series.protocol], evaluation.points_per_curve)))
    return Weighing(tuple(counts), tuple(shares))


def residuals_of(evaluation: SpecimenEvaluation, forces: tuple[Array, ...]) -> Array:
    """Simulated less measured force ``[n, p, k]`` (N) at up to ``WATCHED`` of the kept points of every curve.

    Each is times the root of its share of the measured points, so the norm of a curve's residuals is about its RMSE.
    Where a curve has fewer points than others, the rest is 0. ``forces`` hold ``[n, kept]`` (N) for each curve. Where
    several quantities are compared, each has its own curves, in multiples of its noise level.
    """
    kept = evaluation.points_per_curve
    most = WATCHED if kept == "all" else min(kept, WATCHED)
    protocols = {curve.name: curve.protocol for curve in evaluation.specimen.curves}
    curves = []
    for series, force in zip(evaluation.series(), forces, strict=True):
        protocol = protocols[series.protocol]
        keep = kept_points(protocol, kept)
        watched = np.unique(np.searchsorted(keep, kept_points(protocol, most)))
        rows = keep[watched]
        share = series.shares(rows) / series.count
        residuals = np.sqrt(share) * (force[:, watched] - series.at(rows))
        curves.append(np.pad(residuals, ((0, 0), (0, most - rows.size))))
    return np.stack(curves, axis=1)


def uncertainty(
    jacobians: tuple[Array, ...], objective: Array, weighing: Weighing, inflation: list[float]
) -> tuple[Array, Array]:
    """Standard deviations ``[d]``, as parts of each range, and correlations ``[d, d]`` from the curvature at a fit.

    ``objective`` ``[p]`` (N): a curve's residuals are taken for noise of the size of their RMSE, of which ``inflation``
    points weigh as much as one (correlation in time; not a number: taken for 1), and each parameter as uniform over its
    range before the data were seen (precision 12). Where the model itself is wrong, the residuals are no noise and all
    of this is too bold.
    """
    precision = 12.0 * np.eye(len(jacobians[0]))
    for jacobian, share, rmse, factor in zip(jacobians, weighing.shares, objective, inflation, strict=True):
        variance = max(rmse, 1e-12) ** 2 * (factor if np.isfinite(factor) else 1.0)
        precision += (jacobian * share) @ jacobian.T / variance
    covariance = np.linalg.inv(precision)
    sd = np.sqrt(np.diag(covariance))
    return sd, covariance / np.outer(sd, sd)
