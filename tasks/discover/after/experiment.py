"""The experiment that would separate effects that the measurements cannot.

Rivals are models with different effects that fit the measurements equally well. For each test that the laboratory could
do next, one rival is taken as the truth and gives the forces of the test; another one is refitted to all measurements,
old and new. The misfit that remains is what the test would show: the expected gain in twice the log likelihood, and the
largest remaining difference of forces. Tests are ranked by their hardest pair of rivals (Hunter and Reiner 1965,
Technometrics 7, with the maximin criterion; the parameters' uncertainty is included as in Box and Hill 1967,
Technometrics 9).

The refitted model is linearised about its present fit, within its bounds and with the same weak prior as the fits'
uncertainty. The truth stays at its fit: where that is uncertain, a test may show more or less than predicted. Each test
is on a fresh specimen, clamped as before; what a specimen remembers from one test to the next is not included.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import lsq_linear

from sinew.tasks.discover.after.menu import Test, menu, usual
from sinew.tasks.discover.fit.candidate import Candidate
from sinew.tasks.discover.fit.fit import derivatives, residuals, spreads
from sinew.tasks.discover.follow_up import MenuEntry, NextExperiment, PairSeparation, RivalPair
from sinew.tasks.fitting.discrepancy import WIDTH
from sinew.tasks.fitting.measured import Measured
from sinew.tasks.model import Curve
from sinew.tasks.model.effect import Effect
from sinew.tasks.simulate import Array

OPEN = 0.9  # of the spread before anything was measured: such a parameter was not seen


@dataclass(frozen=True, eq=False)
class Rival:
    """A model with ``effects`` and, for each specimen, where it fits: ``at`` ``[k]`` on its candidate's unit cube."""

    effects: tuple[Effect, ...]
    at: tuple[Array, ...]

    @property
    def slugs(self) -> tuple[str, ...]:
        return tuple(effect.slug for effect in self.effects)


@dataclass(frozen=True)
class Separation:
    """What a test shows when the ``truth`` has some effects (slugs) and ``other`` ones are fitted, in all specimens.

    ``gain``: expected gain in twice the log likelihood of the truth over the other, beside what is known now.
    ``newtons``: largest force (N) by which the other is off, however it is calibrated, ``at_s`` into the test of
    ``specimen``.
    """

    truth: tuple[str, ...]
    other: tuple[str, ...]
    gain: float
    newtons: float
    at_s: float
    specimen: str


@dataclass(frozen=True)
class Prospect:
    """What a test promises: the separation of every pair of rivals, the hardest first."""

    test: Test
    separations: tuple[Separation, ...]

    @property
    def hardest(self) -> Separation:
        return self.separations[0]


@dataclass(frozen=True)
class Experiment:
    """The test to do next, and what every test of the menu promises, the best first."""

    best: Prospect
    table: tuple[Prospect, ...]

    def result(self) -> NextExperiment:
        """What ``discover.json`` says of it."""
        test, hardest = self.best.test, self.best.hardest
        pair = RivalPair(hardest.truth, hardest.other)
        menu = tuple(
            MenuEntry(
                each.test.name,
                each.test.words,
                tuple(PairSeparation(one.truth, one.other, one.gain, one.newtons) for one in each.separations),
            )
            for each in self.table
        )
        return NextExperiment(
            test.name, test.words, hardest.gain, hardest.newtons, hardest.at_s, hardest.specimen, pair, menu
        )


def next_experiment(
    bare: Candidate, rivals: Sequence[Rival], measured: Sequence[Measured], tests: Sequence[Test] | None = None
) -> Experiment | None:
    """The test of a menu (that of the specimens' own usual tests) which tells the hardest pair of rivals apart best.

    ``bare`` is the model without effects, which may be a rival, too. A truth whose effects another rival has,
    too, can never be told from it by a misfit, so that direction of a pair is left out. None where there is no pair,
    and where no test can be simulated with every rival.
    """
    pairs = [
        (a, b)
        for a in range(len(rivals))
        for b in range(len(rivals))
        if a != b and not set(rivals[a].slugs) <= set(rivals[b].slugs)
    ]
    if not pairs:
        return None
    chosen = menu(usual([one.specimen for one in measured])) if tests is None else tests
    candidates = [bare.having(*rival.effects) for rival in rivals]
    before = [
        [_Before.of(candidate, one, believed(candidate, one, at)) for one, at in zip(measured, rival.at, strict=True)]
        for candidate, rival in zip(candidates, rivals, strict=True)
    ]
    table = []
    for test in chosen:
        pulled = [_pulled(test, one, candidates[0], rivals[0].at[i]) for i, one in enumerate(measured)]
        new = [
            [_After.of(candidate, one, known.at) for one, known in zip(pulled, each, strict=True)]
            for candidate, each in zip(candidates, before, strict=True)
        ]
        if not all(np.isfinite(one.white).all() and np.isfinite(one.slopes).all() for each in new for one in each):
            continue
        separations = [
            _separation(rivals[a].slugs, rivals[b].slugs, measured, new[a], new[b], before[b]) for a, b in pairs
        ]
        table.append(Prospect(test, tuple(sorted(separations, key=lambda one: one.gain))))
    if not table:
        return None
    table.sort(key=lambda prospect: -prospect.hardest.gain)
    return Experiment(table[0], tuple(table))


def believed(candidate: Candidate, measured: Measured, at: Array) -> Array:
    """Where a rival is taken to be ``[k]``, which fits at ``at`` ``[k]``.

    Those parameters of its effects that the measurements leave open get typical values: a fit leaves them where it
    began, which may be where the effect does next to nothing.
    """
    _, slopes = derivatives(candidate, measured, at, measured.curves)
    spread = spreads(slopes)
    own = np.arange(at.size) >= len(candidate.varied)
    moved = np.where(own & (spread > OPEN / np.sqrt(WIDTH)), np.concatenate([at[~own], candidate.typical()]), at)
    before, after = np.sum(residuals(candidate, measured, np.array([at, moved]), measured.curves) ** 2, axis=1)
    return moved if after < before + 1.0 else at


@dataclass(frozen=True, eq=False)
class _Before:
    """What is known of a rival in one specimen: ``at`` ``[k]``, and its linearised misfit there.

    ``rows`` ``[k + 1, k + 1]``: |rows (delta, 1)|^2 is the loss of the measured data, and of the prior, at
    ``at + delta``; ``lowest`` is its minimum.
    """

    at: Array
    rows: Array
    lowest: float

    @classmethod
    def of(cls, candidate: Candidate, measured: Measured, at: Array) -> "_Before":
        error, slopes = derivatives(candidate, measured, at, measured.curves)
        prior = np.column_stack([np.sqrt(WIDTH) * np.eye(at.size), np.zeros(at.size)])
        rows = _few(np.concatenate([np.column_stack([slopes, error]), prior]))
        return cls(at, rows, _minimum(rows, at)[0])


@dataclass(frozen=True, eq=False)
class _After:
    """A rival in a test to come: forces ``[t]`` (N) at ``time_s`` ``[t]``, derivatives ``[t, k]``, both whitened, too.

    ``white`` ``[g, k + 1]``: derivatives and courses of all that is compared, in units of the noise.
    """

    time_s: Array
    force: Array
    slopes: Array
    white: Array

    @classmethod
    def of(cls, candidate: Candidate, pulled: Measured, at: Array) -> "_After":
        thin = pulled.thinned[pulled.curves[0].name]
        points = thin.protocol.time_s.size
        with np.errstate(all="ignore"):  # a model that fails leaves NaN
            courses, slopes = derivatives(candidate, pulled, at, pulled.curves, _courses)
            both = np.split(np.column_stack([slopes, courses]), len(thin.quantities))
            white = np.concatenate([one.weights @ own for one, own in zip(thin.quantities.values(), both, strict=True)])
        return cls(thin.protocol.time_s, courses[:points], slopes[:points], white)


def _pulled(test: Test, measured: Measured, candidate: Candidate, at: Array) -> Measured:
    """A specimen in a test to come, and the noise it will have.

    Noise that grows with the force is that of the first rival's: one level, so that rivals are weighed alike. Other
    quantities are measured as often as they were so far.
    """
    specimen = test.specimen(measured.specimen)
    protocol = test.protocol(specimen.length_mm)
    level = np.zeros(protocol.time_s.size)
    if measured.noise.proportional:
        level = candidate.forces(specimen, protocol, at[np.newaxis])[0]
    others = {name: _seldom(protocol.time_s, _interval(measured.curves, name)) for name in measured.others}
    return replace(measured, specimen=replace(specimen, curves=(Curve(protocol, level, others),)))


def _interval(curves: Sequence[Curve], name: str) -> float:
    """The time (s) from one measurement of a quantity to the next, as it mostly was."""
    times = [curve.protocol.time_s[np.isfinite(curve.others[name])] for curve in curves]
    return float(np.median(np.concatenate([np.diff(each) for each in times])))


def _seldom(time_s: Array, interval_s: float) -> Array:
    """Values ``[t]`` that are there every ``interval_s`` at most, and NaN in between."""
    number = np.floor((time_s - time_s[0]) / interval_s + 1e-9)
    return np.where(np.diff(number, prepend=-1.0) > 0.0, 0.0, np.nan)


def _courses(
    candidate: Candidate, measured: Measured, at: Array, curves: Sequence[Curve], *, nearby: bool = False
) -> Array:
    """All that is compared ``[n, quantities x t]``, at the points at which fits ask the model."""
    asked = [measured.thinned[curve.name].protocol for curve in curves]
    every = [candidate.courses(measured.specimen, protocol, at, nearby=nearby) for protocol in asked]
    return np.concatenate([course for courses in every for course in courses.values()], axis=1)


def _separation(
    truth: tuple[str, ...],
    other: tuple[str, ...],
    measured: Sequence[Measured],
    true: Sequence[_After],
    rival: Sequence[_After],
    before: Sequence[_Before],
) -> Separation:
    gain, largest, when, where = 0.0, -1.0, 0.0, ""
    for one, pulled, wrong, known in zip(measured, true, rival, before, strict=True):
        rows = wrong.white.copy()
        rows[:, -1] -= pulled.white[:, -1]
        lowest, change = _minimum(np.concatenate([known.rows, _few(rows)]), known.at)
        gain += lowest - known.lowest
        left = np.abs(wrong.force + wrong.slopes @ change - pulled.force)
        if left.max() > largest:
            largest, when = float(left.max()), float(pulled.time_s[left.argmax()])
            where = one.specimen.name
    return Separation(truth, other, float(gain), largest, when, where)


def _few(rows: Array) -> Array:
    """As many rows as columns with the same sum of squares at every point."""
    if len(rows) <= rows.shape[1]:
        return rows
    return np.asarray(np.linalg.qr(rows, mode="r"))


def _minimum(rows: Array, at: Array) -> tuple[float, Array]:
    """Lowest |rows (delta, 1)|^2, and the delta ``[k]`` that has it, with ``at + delta`` on the unit cube."""
    inside = np.clip(at, 0.0, 1.0)
    solution = lsq_linear(rows[:, :-1], -rows[:, -1], (-inside, 1.0 - inside), method="bvls")
    return float(2.0 * solution.cost), solution.x
