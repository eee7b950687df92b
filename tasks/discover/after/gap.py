"""The gap between the error on held-out data, without and with the effects, and the error of a true model."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from sinew.tasks.discover.fit.candidate import Candidate
from sinew.tasks.discover.fit.fit import Fitted, covariance, derivatives, errors
from sinew.tasks.discover.fit.held_out import SquaredErrors
from sinew.tasks.discover.fit.specimen_fits import Effects
from sinew.tasks.discover.measure.splits import LATER, PROTOCOL, SPECIMEN, splits
from sinew.tasks.discover.result import Gap, SplitGap
from sinew.tasks.fitting.measured import Measured
from sinew.tasks.simulate import Array

Expected = Mapping[str, Sequence[Array]]
"""By kind of split: the expected squared errors of a true model on each held-out curve of a specimen.

``[quantities, t]``; NaN where nothing was measured.
"""


def gap(errors: SquaredErrors, effects: Effects, expected: Sequence[Expected], before: Effects = ()) -> Gap:
    """The gap on each kind of split, and first that of the most informative kind that there is.

    The model with ``effects`` is compared with that ``before``, the bare one. First come splits by specimen: there, an
    effect is judged on every curve. Splits by protocol come last: a protocol that is left out may be the only one in
    which the effect shows, so that the fit of the others knows nothing of it.
    """
    by_split = {
        kind: _split_gap(errors[before][kind], errors[effects][kind], [each for one in expected for each in one[kind]])
        for kind in (SPECIMEN, LATER, PROTOCOL)
        if kind in errors.get(before, {})
    }
    if not by_split:
        return Gap()
    kind, first = next(iter(by_split.items()))
    return Gap(kind, first.before, first.after, first.floor, first.closed, by_split)


def _split_gap(bare: Mapping[str, Array], extended: Mapping[str, Array], expected: Sequence[Array]) -> SplitGap:
    """Root mean squares of the whitened errors of all curves, without and with effects.

    ``floor`` is what the model with the effects would come to if it were true: noise, which is 1, and what the fit of
    the rest does not know of its parameters (a parametric bootstrap with refit, linearised at the fit).
    """
    before, after = (_root_mean_square(curves.values()) for curves in (bare, extended))
    floor = _root_mean_square(expected or [np.ones(1)])
    return SplitGap(before, after, floor, (before - after) / (before - floor) if before > floor else None)


def _root_mean_square(squares: Iterable[Array]) -> float:
    return float(np.sqrt(np.mean(np.concatenate([one[np.isfinite(one)] for one in squares]))))


def expected_errors(candidate: Candidate, measured: Measured, fitted: Fitted) -> Expected:
    """The expected squared errors of a true model of a specimen on what is held out, with derivatives at a fit."""
    variances: dict[str, list[Array]] = {SPECIMEN: [], LATER: [], PROTOCOL: []}
    for split in splits(measured):
        _, seen = derivatives(candidate, split.seen, fitted.at, split.seen.curves)
        spread = covariance(seen)
        for curve in measured.curves:
            if curve.name in split.judged:
                _, slopes = derivatives(candidate, measured, fitted.at, [curve], errors)
                own = measured.by_row(curve, slopes)[:, split.judged[curve.name] :]
                variances[split.kind].append(1.0 + np.sum((own @ spread) * own, axis=-1))
    return variances
