"""The data of a fit: measured curves, whitened by their noise, at the few points that carry their information.

Measured points are many and their noise is correlated, so errors are whitened first: with the noise's standard
deviation s and correlation r, (e_t - r e_{t-1}) / (s sqrt(1 - r^2)); between points that are farther apart than usual,
r is raised to the ratio. Late in a hold a model cannot change from point to
point, so whitened errors are taken together there, and the model is asked at the ends of each group only; in between it
is interpolated. What is left has unit variance if the model is true: its sum of squares is twice the negative log
likelihood, up to a constant, and has about as many degrees of freedom as there are groups less parameters.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import csr_matrix, diags_array

from sinew.tasks.data.noise import Noise
from sinew.tasks.model import Curve, Protocol, Specimen
from sinew.tasks.model.phases import phases
from sinew.tasks.simulate import Array

ALONE, LONGER = 16, 0.06  # first points of a hold, kept single; and the growth of groups, as part of the time before
OF_A_RAMP = 400  # groups, at most
STRAIGHT = 1e-4  # of the range of the displacement: largest deviation from a straight line within a group


@dataclass(frozen=True, eq=False)
class Thinned:
    """A curve as the fits use it.

    ``protocol`` has ``k`` points, which are the ``rows`` ``[k]`` of the measured ones; ``weights`` ``[g, k]`` makes of
    forces there (N) what ``target`` ``[g]`` is of the measured ones: whitened, and summed over groups.
    """

    protocol: Protocol
    rows: Array
    weights: csr_matrix
    target: Array

    def residuals(self, force_N: Array) -> Array:
        """``[n, g]`` of forces ``[n, k]`` (N) at the points of ``protocol``."""
        errors: Array = (self.weights @ force_N.T).T - self.target
        return errors


@dataclass(frozen=True, eq=False)
class Measured:
    """A specimen and the noise of its curves."""

    specimen: Specimen
    noise: Noise

    @property
    def curves(self) -> tuple[Curve, ...]:
        return self.specimen.curves

    @cached_property
    def thinned(self) -> Mapping[str, Thinned]:
        """Every curve by its name, as the fits use it."""
        return {curve.name: thinned(curve, self.noise) for curve in self.curves}

    def whitened(self, curve: Curve, error_N: Array) -> Array:
        """Errors ``[n, t]`` (N) of a curve in units of its noise, with its correlation taken out."""
        whitened: Array = (_whitening(curve, self.noise) @ error_N.T).T
        return whitened


def thinned(curve: Curve, noise: Noise) -> Thinned:
    """A curve with noise, as the fits use it."""
    first = groups(curve.protocol)
    count = curve.force_N.size
    sizes = np.diff(first, append=count)
    which = np.repeat(np.arange(first.size), sizes)
    sums = csr_matrix((1.0 / np.sqrt(sizes[which]), (which, np.arange(count))), shape=(first.size, count))
    nodes = np.union1d(first, [count - 1])
    time = curve.protocol.time_s
    left = np.clip(np.searchsorted(nodes, np.arange(count), side="right") - 1, 0, nodes.size - 2)
    share = (time - time[nodes[left]]) / (time[nodes[left + 1]] - time[nodes[left]])
    points = np.arange(count)
    between = csr_matrix(
        (np.concatenate([1.0 - share, share]), (np.tile(points, 2), np.concatenate([left, left + 1]))),
        shape=(count, nodes.size),
    )
    white = sums @ _whitening(curve, noise)
    protocol = Protocol(curve.name, time[nodes], curve.protocol.displacement_mm[nodes])
    return Thinned(protocol, nodes, csr_matrix(white @ between), white @ curve.force_N)


def _whitening(curve: Curve, noise: Noise) -> csr_matrix:
    """The matrix that turns errors ``[t]`` (N) into whitened errors ``[t]``."""
    steps = np.diff(curve.protocol.time_s)
    ar1 = np.sign(noise.ar1) * np.abs(noise.ar1) ** (
        steps / np.median(steps)
    )  # correlation falls with the distance of points
    scale = np.concatenate([[1.0], 1.0 / np.sqrt(1.0 - ar1**2)])
    each = 1.0 / noise.sd_at(curve.force_N)
    return csr_matrix(diags_array([scale * each, -ar1 * scale[1:] * each[:-1]], offsets=[0, -1]))


def groups(protocol: Protocol) -> Array:
    """First points ``[g]`` of the groups of a protocol: single points, except late in holds and in very long ramps."""
    chosen_points = [np.arange(0)]
    taken = 0
    for phase in phases(protocol):
        points = np.arange(max(phase.start, taken), phase.stop)
        taken = phase.stop
        if phase.kind == "hold" and points.size > ALONE:
            count = int(np.log(points.size / ALONE) / np.log1p(LONGER)) + 1
            later = np.unique(np.geomspace(ALONE, points.size, count + 1)[:-1].astype(int))
            chosen = np.concatenate([np.arange(ALONE), later[later >= ALONE]])
        else:
            chosen = np.arange(0, points.size, max(1, -(-points.size // OF_A_RAMP)))
        chosen_points.append(_straight(protocol, points, chosen))
    return np.concatenate(chosen_points)


def _straight(protocol: Protocol, points: Array, chosen: Array) -> Array:
    """``points[chosen]``, and all points of groups in which the displacement is not linear in time."""
    time, moved = protocol.time_s, protocol.displacement_mm
    within = STRAIGHT * float(np.ptp(moved))
    kept = []
    for begin, end in zip(chosen, [*chosen[1:], points.size], strict=True):
        group = points[begin:end]
        if group.size > 1:
            ends = np.array([group[0], min(group[-1] + 1, time.size - 1)])
            if np.abs(moved[group] - np.interp(time[group], time[ends], moved[ends])).max() > within:
                kept.append(group)
                continue
        kept.append(group[:1])
    return np.concatenate(kept) if kept else points
