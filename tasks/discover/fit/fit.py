"""Fits of one specimen, with or without effects, by generalised least squares on whitened residuals."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Protocol as Callback

import numpy as np
from scipy.optimize import OptimizeResult, least_squares, lsq_linear
from scipy.stats import chi2

from sinew.tasks.discover.fit.candidate import Candidate
from sinew.tasks.fitting import starts as begins
from sinew.tasks.fitting.discrepancy import WIDTH
from sinew.tasks.fitting.few_runs import least_squares_of_few
from sinew.tasks.fitting.measured import Measured, Thinned
from sinew.tasks.model import Curve
from sinew.tasks.model.effect import Effect
from sinew.tasks.simulate import Array, Courses
from sinew.tasks.simulate.near import Known
from sinew.tasks.study.checkpoint import in_unit_cube

STEP, SOLVER_STEP = 1e-5, 3e-3  # of the unit cube, for derivatives; a solver's forces are less exact
FAR = 1e3  # standard deviations: where a model fails
TOLERANCE = 1e-5
EVALUATIONS = 60  # iterations of one fit, at most
PARTS = (0.05, 0.2, 0.6, 1.0)  # of an effect's typical size, from which its fit may begin
PARTS_BY_SOLVER = (0.2, 0.8)
RISE = float(chi2.ppf(0.9, 1))  # of the loss, by chance alone in one case of ten


@dataclass(frozen=True, eq=False)
class Fitted:
    """Where a fit ended: ``at`` ``[k]`` on the unit cube, ``loss`` (whitened sum of squares), ``points`` it is over.

    ``uncertainty`` ``[k]``: standard deviations on the unit cube, from the curvature; ``pull`` ``[k]``: by how much the
    loss would fall if a parameter were free to leave its range, 0 within it.
    """

    at: Array
    loss: float
    points: int
    uncertainty: Array = field(default_factory=lambda: np.empty(0))
    pull: Array = field(default_factory=lambda: np.empty(0))

    @property
    def at_bound(self) -> Array:
        """Which parameters ``[k]`` are on a bound."""
        return on_bound(self.at)

    @property
    def pressed(self) -> Array:
        """Which parameters ``[k]`` are on a bound because of the data, not for want of anything that says where."""
        return self.at_bound & (self.pull > RISE)

    def numbers(self) -> Array:
        """All of it in a row ``[2 + 3 k]``."""
        return np.concatenate([[self.loss, self.points], self.at, self.uncertainty, self.pull])

    @staticmethod
    def possible(numbers: Array) -> bool:
        """Whether ``numbers`` can be those of a fit."""
        loss, points, at = numbers[0], numbers[1], np.split(numbers[2:], 3)[0]
        return bool(loss >= 0.0 and points >= 0.0 and points.is_integer()) and in_unit_cube(at)

    @classmethod
    def of(cls, numbers: Array) -> "Fitted":
        """What ``numbers`` were made from."""
        at, uncertainty, pull = np.split(numbers[2:], 3)
        return cls(at, float(numbers[0]), int(numbers[1]), uncertainty, pull)


def errors(
    candidate: Candidate, measured: Measured, at: Array, curves: Sequence[Curve], *, nearby: bool = False
) -> Array:
    """Whitened errors ``[n, all measured points]`` at points ``[n, k]``; what fails is far away."""
    parts = []
    for curve in curves:
        white = measured.whitened(curve, candidate.courses(measured.specimen, curve.protocol, at, nearby=nearby))
        parts.append(np.where(np.isfinite(white), white, FAR))
    return np.concatenate(parts, axis=1)


def residuals(
    candidate: Candidate, measured: Measured, at: Array, curves: Sequence[Curve], *, nearby: bool = False
) -> Array:
    """Whitened residuals ``[n, groups of all curves]`` at points ``[n, k]``; what fails is far away."""
    thinned = [measured.thinned[curve.name] for curve in curves]
    every = [candidate.courses(measured.specimen, thin.protocol, at, nearby=nearby) for thin in thinned]
    return _white(thinned, every)


def _white(thinned: Sequence[Thinned], every: Sequence[Courses]) -> Array:
    """Whitened residuals ``[n, groups of all curves]`` of the courses along ``every`` curve; what fails is far away."""
    whites = [thin.residuals(courses) for thin, courses in zip(thinned, every, strict=True)]
    return np.concatenate([np.where(np.isfinite(white), white, FAR) for white in whites], axis=1)


@dataclass(frozen=True, eq=False)
class _Nearly:
    """As :func:`residuals`, without a run, by what earlier ones have shown of a candidate with effects around it.

    ``whole`` makes all parameters of those that are not fixed; ``white``: see :func:`minimum`. See
    :class:`Approximation`.
    """

    candidate: Candidate
    measured: Measured
    curves: Sequence[Curve]
    whole: Callable[[Array], Array]
    white: Callable[[Array], Array]
    kept: dict[str, Known] = field(default_factory=dict)

    def __call__(self, at: Array) -> Array | None:
        points, specimen = np.array([self.whole(each) for each in at]), self.measured.specimen
        thinned = [self.measured.thinned[curve.name] for curve in self.curves]
        every = [self.candidate.nearly(specimen, thin.protocol, points) for thin in thinned]
        known = [courses for courses in every if courses is not None]
        if len(known) < len(every):  # it failed there
            return None
        return self.white(_white(thinned, known).T).T

    def keep(self) -> None:
        self.kept.clear()
        self.kept.update(self._known)

    def go_back(self) -> None:
        self._known.clear()
        self._known.update(self.kept)

    @property
    def _known(self) -> dict[str, Known]:
        assert self.candidate.near is not None
        return self.candidate.near


class Whitened(Callback):
    """:func:`residuals`, or a function like it."""

    def __call__(
        self, candidate: Candidate, measured: Measured, at: Array, curves: Sequence[Curve], *, nearby: bool = False
    ) -> Array: ...


def derivatives(
    candidate: Candidate,
    measured: Measured,
    at: Array,
    curves: Sequence[Curve],
    of: Whitened = residuals,
    fixed: Sequence[int] = (),
) -> tuple[Array, Array]:
    """Residuals ``[t]`` at a point ``[k]`` of the unit cube, and their derivatives ``[t, v]`` by what is not fixed.

    Derivatives are the embedded simulator's wherever it has the model.
    """
    near = candidate.stand_in
    step = STEP if near.solver is None else SOLVER_STEP
    steps = np.delete(np.where(at + step <= 1.0, step, -step), fixed)
    moves = np.delete(np.eye(at.size), fixed, axis=0) * steps[:, np.newaxis]
    moved = of(near, measured, np.concatenate([at[np.newaxis], at + moves]), curves, nearby=True)
    slopes = ((moved[1:] - moved[0]) / steps[:, np.newaxis]).T
    return moved[0] if near is candidate else of(candidate, measured, at[np.newaxis], curves)[0], slopes


def known_derivatives(base: Candidate, measured: Measured, at: Array, curves: Sequence[Curve]) -> Array | None:
    """Derivatives ``[t, k]`` at the fit ``at`` ``[k]`` of a user's own model, for fits with one more effect.

    They are nearly those with the effect, and cost fewer runs. None where derivatives are the embedded simulator's.
    """
    if base.stand_in.solver is None:
        return None
    return derivatives(base, measured, np.clip(at, 1e-6, 1.0 - 1e-6), curves)[1]


def further_derivatives(
    candidate: Candidate, measured: Measured, at: Array, curves: Sequence[Curve], known: Array | None
) -> tuple[Array, Array]:
    """As :func:`derivatives`, where those by the first parameters are ``known`` ``[t, k]``; None: all are found."""
    fixed = range(0 if known is None else known.shape[1])
    seen, slopes = derivatives(candidate, measured, at, curves, fixed=fixed)
    return seen, slopes if known is None else np.column_stack([known, slopes])


def together(both: Callable[[Array], tuple[Array, Array]]) -> tuple[Callable[[Array], Array], Callable[[Array], Array]]:
    """Residuals and their slopes as two functions of a point, each of which finds both and remembers the last.

    Least squares asks for the slopes at nearly every point whose residuals it has seen.
    """
    last: tuple[Array, tuple[Array, Array]] | None = None

    def at_point(at: Array) -> tuple[Array, Array]:
        nonlocal last
        if last is None or not np.array_equal(last[0], at):
            last = at.copy(), both(at)
        return last[1]

    return lambda at: at_point(at)[0], lambda at: at_point(at)[1]


def fit(
    candidate: Candidate,
    measured: Measured,
    start: Array,
    curves: Sequence[Curve] | None = None,
    *,
    fixed: Sequence[int] = (),
) -> Fitted:
    """The nearest minimum to ``start`` ``[k]`` on the unit cube, over ``curves`` (all of the specimen's).

    What is ``fixed``, by number, stays where it is. A fit of the tissue with a solver goes on from where that with the
    embedded simulator ended, and takes its derivatives from there: near the minimum they need not be exact.
    """
    chosen = measured.curves if curves is None else curves
    if candidate.stand_in is not candidate:
        start = fit(candidate.stand_in, measured, start, chosen, fixed=fixed).at
    free = np.delete(np.arange(start.size), fixed)
    begin = np.clip(start[free], 1e-6, 1 - 1e-6)

    def whole(at: Array) -> Array:
        every = start.copy()
        every[free] = at
        return every

    solution = minimum(candidate.remembering(), measured, begin, chosen, whole=whole, fixed=fixed)
    spread, pull = np.zeros((2, start.size))
    spread[free] = spreads(solution.jac)
    pull[free] = pulls(solution.x, solution.grad, solution.jac)
    return Fitted(whole(solution.x), float(2.0 * solution.cost), int(solution.fun.size), spread, pull)


def _as_it_is(vectors: Array) -> Array:
    return vectors


def minimum(
    candidate: Candidate,
    measured: Measured,
    begin: Array,
    curves: Sequence[Curve],
    *,
    whole: Callable[[Array], Array] = _as_it_is,
    fixed: Sequence[int] = (),
    white: Callable[[Array], Array] = _as_it_is,
    ftol: float = TOLERANCE,
    xtol: float = 1e-7,
    evaluations: int = EVALUATIONS,
) -> OptimizeResult:
    """The nearest minimum to ``begin`` ``[v]`` of the sum of squared residuals, as of SciPy's ``least_squares``.

    ``whole`` makes all parameters ``[k]`` of those that are not ``fixed``; ``white`` whitens residuals ``[t]``, or
    several ``[t, n]``, further. Tolerances and the number of ``evaluations`` are those of a candidate whose derivatives
    are the embedded simulator's. Others are fitted with few runs, see :mod:`sinew.tasks.fitting.few_runs`, and must be
    :meth:`Candidate.remembering`.
    """

    def both(at: Array) -> tuple[Array, Array]:
        seen, slopes = derivatives(candidate, measured, whole(at), curves, fixed=fixed)
        return white(seen), white(slopes)

    if candidate.stand_in.solver is None:
        loss, slope = together(both)
        return least_squares(
            loss, begin, jac=slope, bounds=(0.0, 1.0), ftol=ftol, xtol=xtol, gtol=1e-7, max_nfev=evaluations
        )
    return least_squares_of_few(
        lambda at: white(residuals(candidate, measured, whole(at)[np.newaxis], curves)[0]),
        both,
        begin,
        nearly=_Nearly(candidate, measured, curves, whole, white) if candidate.surrounded else None,
    )


def on_bound(at: Array) -> Array:
    """Which coordinates of a point are on a bound of the unit cube."""
    touching: Array = (at < 1e-3) | (at > 1.0 - 1e-3)
    return touching


def spreads(slopes: Array) -> Array:
    """Standard deviations ``[k]`` on the unit cube of slopes ``[t, k]``."""
    deviations: Array = np.sqrt(np.diag(covariance(slopes)))
    return deviations


def covariance(slopes: Array) -> Array:
    """``[k, k]`` on the unit cube, all of which is as likely before the data, of slopes ``[t, k]``.

    Slopes towards points where the model fails are so large that, squared, they would swamp the prior's precision.
    """
    _, sizes, directions = np.linalg.svd(np.linalg.qr(slopes, mode="r"))
    precision = np.full(slopes.shape[1], WIDTH)
    precision[: sizes.size] += sizes**2
    inverse: Array = (directions.T / precision) @ directions
    return inverse


def pulls(at: Array, gradient: Array, slopes: Array) -> Array:
    """How much the loss would fall if one parameter on a bound were free to move with those that are on none."""
    falls = np.zeros(at.size)
    on = on_bound(at)
    outward = np.where(at < 0.5, gradient, -gradient)
    for number in np.flatnonzero(on & (outward > 0.0)):
        moving = ~on
        moving[number] = True
        within = moving[:number].sum()
        falls[number] = outward[number] ** 2 * covariance(slopes[:, moving])[within, within]
    return falls


def look_ahead(
    base: Candidate, at: Array, effect: Effect, measured: Measured, curves: Sequence[Curve] | None = None
) -> tuple[float, Array]:
    """A prediction of the loss with one more effect, and the start of its fit.

    From the fit ``at`` ``[k]`` of ``base``, with a fraction of the effect's typical size, one bounded step of linear
    least squares predicts a loss. Returns the smallest over the fractions, and the point ``[k + m]`` of that fraction.
    Of a user's own model, derivatives by what ``base`` has are those without the effect: they cost fewer runs.
    """
    candidate, alone = base.stand_in.having(*base.effects, effect), base.having(effect)
    null, typical = alone.null(), alone.typical()
    chosen = measured.curves if curves is None else curves
    attempts = []
    known = known_derivatives(base, measured, at, chosen)
    for part in PARTS if known is None else PARTS_BY_SOLVER:
        point = np.clip(np.concatenate([at, null + part * (typical - null)]), 1e-6, 1.0 - 1e-6)
        seen, slopes = further_derivatives(candidate, measured, point, chosen, known)
        basis, upper = np.linalg.qr(slopes)
        along = basis.T @ seen
        step = lsq_linear(upper, -along, bounds=(-point - 1e-9, 1.0 - point + 1e-9))
        attempts.append((float(seen @ seen - along @ along + 2.0 * step.cost), point))
    return min(attempts, key=lambda one: one[0])


def extended(base: Candidate, at: Array, effect: Effect, measured: Measured) -> Fitted:
    """The best fit of ``base``, which has its fit at ``at`` ``[k]``, with one more effect.

    It is started from the point of :func:`look_ahead` and, for the first effect, also from a gentle model with a
    typical effect, because the fit without the effect may have ended in the wrong place.
    """
    candidate = base.having(*base.effects, effect)
    points = [look_ahead(base, at, effect, measured)[1]]
    if not base.effects:
        points.append(np.concatenate([gentle(candidate), candidate.typical()]))
    return min((fit(candidate, measured, point) for point in points), key=lambda one: one.loss)


def gentle(candidate: Candidate) -> Array:
    """The middle of the bare model's ranges, with a gentle toe."""
    return begins.gentle(candidate.varied)


def starts(candidate: Candidate, rng: np.random.Generator, count: int) -> list[Array]:
    """Starts ``[k]`` for fits of the bare model, see :func:`sinew.tasks.fitting.starts.starts`.

    Of a user's own model: the middle, and points drawn at random.
    """
    if candidate.model.law != "tendon":
        return [np.full(candidate.size, 0.5), *rng.random((count - 1, candidate.size))]
    return begins.starts(candidate.varied, rng, count)
