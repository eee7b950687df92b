"""Whether an effect inside a model of the user's own does what it should: found by running the solver.

FEBio takes a wrapped material without a word where the wrapper does nothing, and where it does something though the
effect is at its null value. So each effect is run at both, at the fit of the model as it is, along one measured curve.
"""

from collections.abc import Sequence

import numpy as np

from sinew.runner.evaluation.batch import RETRIED
from sinew.runner.store.schema import STATUSES
from sinew.tasks.discover.fit.candidate import Candidate
from sinew.tasks.model import Curve, Specimen
from sinew.tasks.simulate import Array

SAME = 1e-3  # of the peak: what a solver's tolerance may change
CHANGED, CLEARLY = 1e-4, 10.0  # of the peak, and times the change at the null value: the least that is a change


def tried(candidate: Candidate, specimen: Specimen, at: Array) -> Array:
    """What the effect of a candidate does to all that is compared, at a fit ``at`` ``[k]`` of the model without it.

    ``[3]``: the status of a run that failed, or 0; the change at the null value and at the typical one, in parts of the
    peak of the force or of another quantity, whichever changes more, or 0 where a run failed.
    """
    protocol = _telling(specimen.curves).protocol
    without = candidate.having().simulated(specimen, protocol, at[np.newaxis])
    points = np.array([np.concatenate([at, values]) for values in (candidate.null(), candidate.typical())])
    having = candidate.simulated(specimen, protocol, points)
    status = np.concatenate([without.status, having.status])
    if status.any():
        return np.array([float(status[status > 0][0]), 0.0, 0.0])
    before, after = (done.courses(candidate.compared) for done in (without, having))
    peaks = {name: float(np.abs(course).max()) for name, course in before.items()}
    changes = [np.abs(after[name] - before[name]).max(axis=1) / peak for name, peak in peaks.items() if peak > 0.0]
    return np.array([0.0, *np.max(changes, axis=0)]) if changes else np.zeros(3)


def why_not(numbers: Array) -> str | None:
    """Why an effect cannot be a candidate, by what :func:`tried` found; None where it can."""
    failed, at_null, at_typical = numbers
    if failed:
        return f"the solver does not run with it ({STATUSES[int(failed)]})"
    if at_null > SAME:
        return f"at its null value what is compared changes by {at_null:.2g} of its peak"
    if at_typical < max(CHANGED, CLEARLY * at_null):
        changes = f"what is compared changes by {at_typical:.2g} of its peak"
        return f"it does next to nothing here: at its typical size {changes}"
    return None


def by_accident(numbers: Array) -> bool:
    """Whether a run failed by an accident, which says nothing about the effect."""
    return STATUSES[int(numbers[0])] in RETRIED


def possible(numbers: Array) -> bool:
    """Whether :func:`tried` can have found these."""
    return bool(numbers[0] in range(len(STATUSES)) and (numbers[1:] >= 0.0).all())


def _telling(curves: Sequence[Curve]) -> Curve:
    """The curve that moves farthest; of several that move nearly as far, that with the fewest points."""
    ranges = [float(np.ptp(one.protocol.displacement_mm)) for one in curves]
    far = [one for one, moved in zip(curves, ranges, strict=True) if moved > 0.9 * max(ranges)]
    return min(far or curves, key=lambda one: one.protocol.time_s.size)
