"""Whether one set of parameters can be right for all protocols: a test for conflict between their own best parameters.

A model that is right fits all curves of a specimen together nearly as well as each of them alone. How much is lost
(T: the loss of the fit to all, less the losses of the fits to each) is compared with what noise alone would lose. With
a model that is linear about the fit to all, residuals are the noise without its projection on the derivatives, so T is
|n - P n|^2 - sum over curves of |n_c - P_c n_c|^2: chi-square with sum(rank J_c) - rank(J) degrees of freedom, the
parameters' own goodness of fit (Maltoni and Schwetz 2003, Phys Rev D 68:033020).

Parameters on a bound do not follow the noise, and directions that move no force are not counted. No effect is asked, so
the test also sees what no effect of the library would explain.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.stats import chi2

from sinew.tasks.discover.fit.candidate import SEEN, Candidate
from sinew.tasks.discover.fit.fit import Fitted, derivatives, spreads
from sinew.tasks.discover.result import Apart, Conflict, SpecimenConflict
from sinew.tasks.fitting.measured import Measured
from sinew.tasks.simulate import Array

NOTHING = 1e-3  # of the unit cube: smaller standard errors are below the tolerance of the fits


def conflict(candidate: Candidate, measured: Measured, pooled: Fitted, own: Sequence[Fitted]) -> SpecimenConflict:
    """The test of one specimen: ``pooled`` is the fit to all of its curves, ``own`` those to each alone, in order.

    Fits of curves alone should begin where the pooled fit ended: ``fit(candidate, measured, pooled.at, [curve])``.
    With one curve there is nothing to compare, and p is 1.
    """
    parts = [derivatives(candidate, measured, pooled.at, [curve]) for curve in measured.curves]
    losses = [float(error @ error) for error, _ in parts]
    by_curve = tuple(
        (curve.name, loss - one.loss) for curve, loss, one in zip(measured.curves, losses, own, strict=True)
    )
    statistic = sum(loss for _, loss in by_curve)
    bounds = pooled.at_bound, [one.at_bound for one in own]
    freedom = degrees_of_freedom([slopes for _, slopes in parts], *bounds, candidate.seen)
    p = float(chi2.sf(max(statistic, 0.0), freedom)) if freedom > 0 else 1.0
    return SpecimenConflict(statistic, freedom, p, by_curve, _apart(candidate, measured, parts, own))


def together(conflicts: Mapping[str, SpecimenConflict]) -> Conflict:
    """The test of all specimens together: chi-square statistics add up."""
    statistic = sum(max(one.statistic, 0.0) for one in conflicts.values())
    freedom = sum(one.freedom for one in conflicts.values())
    p = float(chi2.sf(statistic, freedom)) if freedom > 0 else 1.0
    return Conflict(statistic, freedom, p, conflicts)


def degrees_of_freedom(
    slopes: Sequence[Array], pooled_bound: Array, own_bound: Sequence[Array], seen: float = SEEN
) -> int:
    """Of T, from the derivatives ``[t, k]`` of each curve, and which parameters ``[k]`` ended on a bound in each fit.

    Singular values below ``seen`` times the largest are not counted.

    A parameter that is on its bound in a curve's own fit follows that curve's noise half of the time at most, so it is
    left out there; this counts too few rather than too many.
    """
    alone = sum(rank(each[:, ~bound], seen) for each, bound in zip(slopes, own_bound, strict=True))
    return max(alone - rank(np.concatenate(list(slopes))[:, ~pooled_bound], seen), 0)


def rank(slopes: Array, seen: float = SEEN) -> int:
    """Directions of the parameters that move some force."""
    if not slopes.size:
        return 0
    sizes = np.linalg.svd(slopes, compute_uv=False)
    return int(np.sum(sizes > seen * sizes[0])) if sizes[0] > 0.0 else 0


def _apart(
    candidate: Candidate, measured: Measured, parts: Sequence[tuple[Array, Array]], own: Sequence[Fitted]
) -> tuple[Apart, ...]:
    """For each parameter, the two curves that disagree most about it.

    The standard errors have the weak prior of a uniform range in them, so that a parameter which a curve does not see
    is not far from anything.
    """
    errors = [spreads(slopes) for _, slopes in parts]
    low, high = candidate.bounds()
    names = [*candidate.varied, *(name for effect in candidate.effects for name in effect.names)]
    pairs = [(a, b) for a in range(len(own)) for b in range(a)]
    apart = []
    for k, name in enumerate(names):
        distances = [
            abs(own[a].at[k] - own[b].at[k]) / max(float(np.hypot(errors[a][k], errors[b][k])), NOTHING)
            for a, b in pairs
        ]
        if not distances:
            continue
        b, a = pairs[int(np.argmax(distances))]
        first, second = (float(low[k] + (high[k] - low[k]) * own[one].at[k]) for one in (a, b))
        curves = (measured.curves[a].name, measured.curves[b].name)
        apart.append(Apart(name, float(max(distances)), curves, (first, second)))
    return tuple(sorted(apart, key=lambda one: -one.errors))
