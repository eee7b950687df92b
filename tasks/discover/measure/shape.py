"""What the misfit of a model looks like where no effect of the library explains it.

A description, and no mechanism: which effects leave a similar trace, and how far the measured force lies from the model
in loading, unloading and holds, as a smooth curve that may grow or fade from one phase to the next. It says where to
look for a new effect; a curve that follows the misfit predicts no other test.

The smooth curves are penalised B-splines (Eilers and Marx 1996, Stat Sci 11): a ridge whose strength is that of the
smallest error of points left out in turn (generalised cross-validation; Golub, Heath and Wahba 1979, Technometrics 21).
It draws the correction towards zero where few points tell.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from threadpoolctl import threadpool_limits

from sinew.tasks.discover.fit.candidate import Candidate
from sinew.tasks.discover.fit.fit import derivatives, residuals
from sinew.tasks.discover.follow_up import Correction, Outside, Row, Similarity
from sinew.tasks.fitting.measured import Measured
from sinew.tasks.fitting.splines import (
    COEFFICIENTS,
    KINDS,
    Range,
    piece_of,
    ranges_of,
    spline_forces,
    splines_at,
)
from sinew.tasks.model import FORCE
from sinew.tasks.model.effect import Effect
from sinew.tasks.simulate import Array

TRACE_PART = 0.1  # of an effect's typical size, at which its trace is taken
MIN_OWN = 1e-3  # part of an effect's trace; when less is left, the bare model has taken it up
WORDS = {"load": "loading", "unload": "unloading", "hold": "holds"}
STRENGTHS = np.logspace(-4, 8, 37)  # of the ridge
MIN_DEVIATIONS = 3.0  # standard deviations, beyond which a misfit is not noise and a number is reported
MIN_EXPLAINED = 0.1  # part of the misfit that a shape must explain in phases that it has not seen
MIN_GROWTH = 1.25  # last to first, from which on growth is reported
PLACES = (0.1, 0.3, 0.5, 0.7, 0.9)  # of the range of a curve, in its table


def shape(
    bare: Candidate, measured: Sequence[Measured], fitted_at: Sequence[Array], effects: Mapping[str, Effect]
) -> Outside:
    """What is left by the bare model, fitted to each specimen at ``fitted_at`` (each ``[k]``, on the unit cube)."""
    corrections = tuple(correction(bare, one, at) for one, at in zip(measured, fitted_at, strict=True))
    what = "a description of what is left, not its mechanism"
    return Outside(what, largest_cosine(corrections), similarities(bare, measured, fitted_at, effects), corrections)


def largest_cosine(corrections: Sequence[Correction]) -> float:
    """The cosine of an effect whose trace is all of the misfit beyond noise."""
    beyond = sum(one.beyond for one in corrections)
    return float(np.sqrt(beyond / max(beyond + sum(one.freedom for one in corrections), 1)))


def similarities(
    bare: Candidate, measured: Sequence[Measured], fitted_at: Sequence[Array], effects: Mapping[str, Effect]
) -> tuple[Similarity, ...]:
    """How much the misfit of all specimens together looks like each effect, the most similar (or opposite) first.

    An effect has a trace for each of its parameters that can be null, at typical values of its others. Effects that
    the simulator cannot have are left out.
    """
    lefts, taken = [], []
    for one, at in zip(measured, fitted_at, strict=True):
        error, slopes = derivatives(bare, one, at, one.curves)
        inside = (at > 1e-3) & (at < 1.0 - 1e-3)  # a parameter on its bound does not follow
        taken.append(_basis(slopes[:, inside], bare.seen))
        lefts.append(_without(-error, taken[-1]))
    left = np.concatenate(lefts)
    similar = []
    for slug, effect in effects.items():
        if not bare.possible((effect,)):
            continue
        candidate = bare.having(effect)
        for number, parameter in enumerate(effect.names):
            if parameter not in effect.null:
                continue
            traces, wholes = [], []
            for one, at, basis in zip(measured, fitted_at, taken, strict=True):
                whole = _trace(candidate, one, at, number)
                wholes.append(whole)
                traces.append(_without(whole, basis))
            trace, whole = np.concatenate(traces), np.concatenate(wholes)
            size, all_of_it = float(np.linalg.norm(trace)), float(np.linalg.norm(whole))
            own = size / all_of_it if all_of_it > 0.0 else 0.0
            cosine = float(trace @ left) / (size * float(np.linalg.norm(left))) if own > MIN_OWN else 0.0
            similar.append(Similarity(slug, parameter, cosine, own))
    return tuple(sorted(similar, key=lambda each: -abs(each.cosine)))


def _trace(candidate: Candidate, measured: Measured, at: Array, number: int) -> Array:
    """What a small amount of an effect's parameter does to the whitened forces ``[g]``; zero where the model fails."""
    without = np.concatenate([at, candidate.null()])
    having = without.copy()
    index = at.size + number
    having[index] += TRACE_PART * (candidate.typical()[number] - candidate.null()[number])
    before, after = residuals(candidate, measured, np.array([without, having]), measured.curves)
    found = [
        candidate.courses(measured.specimen, measured.thinned[curve.name].protocol, np.array([without, having]))
        for curve in measured.curves
    ]
    whole = all(np.isfinite(course).all() for courses in found for course in courses.values())
    return after - before if whole else np.zeros_like(before)


def _basis(slopes: Array, seen: float) -> Array:
    """Orthonormal columns ``[g, r]`` that span derivatives ``[g, k]``, but what is below ``seen`` of the largest."""
    left, sizes, _ = np.linalg.svd(slopes, full_matrices=False)
    basis: Array = left[:, sizes > seen * max(float(sizes.max(initial=0.0)), np.finfo(float).tiny)]
    return basis


def _without(vector: Array, basis: Array) -> Array:
    left: Array = vector - basis @ (basis.T @ vector)
    return left


def correction(bare: Candidate, measured: Measured, at: Array) -> Correction:
    """The smooth correction of the forces of a model that fits at ``at`` ``[k]``."""
    wrong = -residuals(bare, measured, at[np.newaxis], measured.curves)[0]  # measured minus simulated
    return smooth(measured, wrong[measured.places[FORCE]], bare.size)


def smooth(measured: Measured, wrong: Array, parameters: int) -> Correction:
    """The smooth correction for whitened residuals ``wrong`` ``[g]`` of the forces, measured minus simulated.

    ``parameters``: how many were fitted to the same measurements.
    """
    with threadpool_limits(1):  # matrices are small: threads would wait for each other
        return _smooth(measured, wrong, parameters)


def _smooth(measured: Measured, wrong: Array, parameters: int) -> Correction:
    from sklearn.linear_model import Ridge, RidgeCV
    from sklearn.model_selection import LeaveOneGroupOut, cross_val_predict

    pieces = [piece_of(measured, curve) for curve in measured.curves]
    ranges = ranges_of(pieces)
    design = np.concatenate(
        [
            measured.thinned[curve.name].quantities[FORCE].weights @ spline_forces(piece, ranges)
            for curve, piece in zip(measured.curves, pieces, strict=True)
        ]
    )
    offsets = np.cumsum([0, *(piece.phase.max() + 1 for piece in pieces)])
    phase = np.concatenate(
        [
            offset + piece.phase[: measured.thinned[curve.name].quantities[FORCE].target.size]
            for offset, curve, piece in zip(offsets, measured.curves, pieces, strict=False)
        ]
    )
    used = np.any(design != 0.0, axis=0)
    columns = design[:, used]
    strength = float(RidgeCV(STRENGTHS, fit_intercept=False).fit(columns, wrong).alpha_)
    fitted = Ridge(strength, fit_intercept=False).fit(columns, wrong)
    weights, spread = np.zeros(used.size), np.zeros((used.size, used.size))
    weights[used] = fitted.coef_
    spread[np.ix_(used, used)] = np.linalg.inv(columns.T @ columns + strength * np.eye(columns.shape[1]))

    freedom = wrong.size - parameters
    beyond = float(wrong @ wrong) - freedom
    explained = 0.0
    if beyond > MIN_DEVIATIONS * np.sqrt(2.0 * freedom) and np.unique(phase).size > 1:
        unseen = cross_val_predict(
            Ridge(strength, fit_intercept=False), columns, wrong, groups=phase, cv=LeaveOneGroupOut()
        )
        explained = float(np.clip((wrong @ wrong - np.sum((wrong - unseen) ** 2)) / beyond, 0.0, 1.0))
    table = tuple(row for kind, within in ranges.items() if within for row in _rows(kind, within, weights, spread))
    name = measured.specimen.name
    return Correction(name, freedom, max(beyond, 0.0), explained, table, _sentence(explained, table))


def _rows(kind: str, within: Range, weights: Array, spread: Array) -> list[Row]:
    own = slice(2 * COEFFICIENTS * KINDS.index(kind), 2 * COEFFICIENTS * (KINDS.index(kind) + 1))
    rows = []
    for place in within.low + np.array(PLACES) * (within.high - within.low):
        first, last = within.ends(place)
        splines = splines_at(np.full(2, place), np.array([first, last]), within)
        newton = splines @ weights[own]
        error = np.sqrt(np.sum((splines @ spread[own, own]) * splines, axis=1)).max()
        x = float(np.exp(place) if kind == "hold" else place)
        rows.append(Row(kind, x, first, float(newton[0]), last, float(newton[1]), float(error)))
    return rows


def _sentence(explained: float, table: Sequence[Row]) -> str:
    """The largest clear number of the table, in words."""
    clear = [row for row in table if max(abs(row.first_N), abs(row.last_N)) > MIN_DEVIATIONS * row.error_N]
    if explained < MIN_EXPLAINED or not clear:
        return "what is left has no shape that returns from phase to phase"
    row = max(clear, key=lambda each: max(abs(each.first_N), abs(each.last_N)))
    newton = row.last_N if abs(row.last_N) >= abs(row.first_N) else row.first_N
    side = "above" if newton > 0.0 else "below"
    verb = "lie" if row.kind == "hold" else "lies"
    where = f"{row.x:.3g} s after their beginning" if row.kind == "hold" else f"at {100 * row.x:.2g} % strain"
    said = f"measured {WORDS[row.kind]} {verb} {abs(newton):.2g} N {side} the model {where}"
    if row.last == row.first or abs(row.last_N - row.first_N) < MIN_DEVIATIONS * row.error_N:
        return said
    ends = f"{row.first_N:+.2g} N in number {row.first}, {row.last_N:+.2g} N in number {row.last}"
    if row.first_N * row.last_N < 0.0 and min(abs(row.first_N), abs(row.last_N)) > row.error_N:
        return f"{said}, turning over: {ends}"
    if abs(row.last_N) > MIN_GROWTH * abs(row.first_N):
        return f"{said}, growing: {ends}"
    if abs(row.first_N) > MIN_GROWTH * abs(row.last_N):
        return f"{said}, fading: {ends}"
    return said
