"""The data of a fit: what was measured, whitened by its noise, at the few points that carry its information.

Measured points are many and their noise is correlated, so errors are whitened first: with the noise's standard
deviation s and correlation r, (e_t - r e_{t-1}) / (s sqrt(1 - r^2)); between points that are farther apart than usual,
r is raised to the ratio. Late in a hold a model cannot change from point to
point, so whitened errors are taken together there, and the model is asked at the ends of each group only; in between it
is interpolated. What is left has unit variance if the model is true: its sum of squares is twice the negative log
likelihood, up to a constant, and has about as many degrees of freedom as there are groups less parameters.

Where more than the force is compared, each quantity is whitened by a noise of its own, at the points where it was
measured. Residuals stand curve by curve, and within each curve quantity by quantity, the force first.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.sparse import csr_matrix, diags_array

from sinew.tasks.data.noise import Noise, correlation_of, noise_of_each
from sinew.tasks.model import FORCE, Curve, Protocol, Specimen
from sinew.tasks.model.phases import phases
from sinew.tasks.simulate import Array, Courses

ALONE, LONGER = 16, 0.06  # first points of a hold, kept single; and the growth of groups, as part of the time before
OF_A_RAMP = 400  # groups, at most
FEW = 50  # points of a quantity in a specimen, below which its noise is hardly known
STRAIGHT = 1e-4  # of the range of the displacement: largest deviation from a straight line within a group


@dataclass(frozen=True, eq=False)
class Weighed:
    """A quantity along a thinned curve of ``k`` points.

    ``weights`` ``[g, k]`` makes of its values there what ``target`` ``[g]`` is of the measured ones: whitened, and
    summed over ``groups`` ``[g]``, by number, of those of the curve.
    """

    weights: csr_matrix
    target: Array
    groups: Array


@dataclass(frozen=True, eq=False)
class Thinned:
    """A curve as the fits use it.

    ``protocol`` has ``k`` points, which are the ``rows`` ``[k]`` of the measured ones; ``quantities``: all that is
    compared, by name, the force first.
    """

    protocol: Protocol
    rows: Array
    quantities: Mapping[str, Weighed]

    def by_group(self, squares: Array) -> Array:
        """Squared residuals ``[g]`` of all quantities, summed over those of the same group."""
        groups = np.concatenate([one.groups for one in self.quantities.values()])
        return np.bincount(groups, weights=squares)

    @property
    def size(self) -> int:
        """How many residuals it has."""
        return sum(one.target.size for one in self.quantities.values())

    def residuals(self, courses: Courses) -> Array:
        """``[n, g]`` of courses ``[n, k]`` at the points of ``protocol``."""
        every = [(one.weights @ courses[name].T).T - one.target for name, one in self.quantities.items()]
        return every[0] if len(every) == 1 else np.concatenate(every, axis=1)


@dataclass(frozen=True, eq=False)
class Measured:
    """A specimen, the noise of its forces, and that of ``others``: what is compared beside the force, by name."""

    specimen: Specimen
    noise: Noise
    others: Mapping[str, Noise] = field(default_factory=dict)

    @property
    def curves(self) -> tuple[Curve, ...]:
        return self.specimen.curves

    @property
    def quantities(self) -> Mapping[str, Noise]:
        """The noise of all that is compared, the force first."""
        return {FORCE: self.noise, **self.others}

    def having(self, curves: tuple[Curve, ...]) -> "Measured":
        """The same with these curves."""
        return replace(self, specimen=replace(self.specimen, curves=curves))

    @cached_property
    def thinned(self) -> Mapping[str, Thinned]:
        """Every curve by its name, as the fits use it."""
        return {curve.name: thinned(curve, self.quantities) for curve in self.curves}

    @property
    def places(self) -> Mapping[str, Array]:
        """Where each quantity stands among the residuals of all curves."""
        return dict(zip(self.quantities, _places([one.quantities for one in self.thinned.values()]), strict=True))

    def whitened(self, curve: Curve, courses: Courses) -> Array:
        """Errors ``[n, e]`` of courses ``[n, t]`` in units of the noise, with its correlation taken out.

        There is one for each measured point of each quantity, see :meth:`rows`.
        """
        parts = []
        for name, noise in self.quantities.items():
            own, there = _measured(curve, name)
            parts.append((_whitening(own, noise) @ (courses[name][:, there] - own.force_N).T).T)
        return parts[0] if len(parts) == 1 else np.concatenate(parts, axis=1)

    def rows(self, curve: Curve) -> dict[str, Array]:
        """The rows of a curve at which each quantity was measured: one for each of its errors."""
        return {name: _measured(curve, name)[1] for name in self.quantities}

    def by_row(self, curve: Curve, errors: Array) -> Array:
        """Errors ``[e, ...]`` of a curve by quantity and row: ``[quantities, t, ...]``, NaN where unmeasured."""
        found, begin = np.full((len(self.quantities), curve.force_N.size, *errors.shape[1:]), np.nan), 0
        for number, rows in enumerate(self.rows(curve).values()):
            found[number, rows] = errors[begin : begin + rows.size]
            begin += rows.size
        return found


def measured_of_each(specimens: Sequence[Specimen], force_sd: float | None = None) -> list[Measured]:
    """Specimens with the noise of all that is compared, as their curves show it.

    ``force_sd``: the standard deviation of the force's noise (N), where it is known; that of other quantities is
    their level in ``noise`` of the specimen. All of these have one correlation, in all specimens, as of one camera:
    that of few points is hardly known.
    """
    courses = [[curve.of(name) for curve in one.curves] for one in specimens for name in one.others]
    ar1 = correlation_of(courses) if courses else 0.0
    found = []
    for one, noise in zip(specimens, noise_of_each([one.curves for one in specimens]), strict=True):
        if force_sd is not None:
            noise = Noise(force_sd, 0.0 if np.isnan(noise.ar1) else noise.ar1)
        found.append(Measured(one, noise, {name: Noise(one.noise[name], ar1) for name in one.others}))
    return found


def remark_on_few(every: Sequence[Measured], given: Iterable[str]) -> str:
    """A line on quantities beside the force whose noise rests on few points, but those ``given``; empty without."""
    known, few = set(given), dict[str, int]()
    for one in every:
        for name in set(one.others) - known:
            points = sum(int(np.isfinite(curve.others[name]).sum()) for curve in one.curves)
            if points < FEW:
                few[name] = min(points, few.get(name, points))
    if not few:
        return ""
    name = min(few, key=lambda each: (few[each], each))
    more = f" (and {len(few) - 1} more)" if len(few) > 1 else ""
    return f"the noise of {name}{more} is estimated from {few[name]} points; measured.{name}.noise can give it"


def _places(curves: Sequence[Mapping[str, Weighed]]) -> Iterator[Array]:
    """Where each quantity stands among the residuals of all ``curves``, in the order of the quantities."""
    sizes = np.array([[one.target.size for one in quantities.values()] for quantities in curves])
    ends = np.cumsum(sizes.ravel()).reshape(sizes.shape)
    for begins, lengths in zip((ends - sizes).T, sizes.T, strict=True):
        yield np.concatenate([begin + np.arange(length) for begin, length in zip(begins, lengths, strict=True)])


def _measured(curve: Curve, name: str) -> tuple[Curve, Array]:
    """A quantity in place of the force, at the rows where it was measured; and these rows."""
    if name == FORCE:
        return curve, np.arange(curve.force_N.size)
    there = np.flatnonzero(np.isfinite(curve.others[name]))
    protocol = Protocol(curve.name, curve.protocol.time_s[there], curve.protocol.displacement_mm[there])
    return Curve(protocol, curve.others[name][there]), there


def thinned(curve: Curve, quantities: Mapping[str, Noise]) -> Thinned:
    """A curve as the fits use it; ``quantities``: the noise of all that is compared, by name."""
    first = groups(curve.protocol)
    count = curve.force_N.size
    which = np.repeat(np.arange(first.size), np.diff(first, append=count))
    nodes = np.union1d(first, [count - 1])
    time = curve.protocol.time_s
    left = np.clip(np.searchsorted(nodes, np.arange(count), side="right") - 1, 0, nodes.size - 2)
    share = (time - time[nodes[left]]) / (time[nodes[left + 1]] - time[nodes[left]])
    points = np.arange(count)
    between = csr_matrix(
        (np.concatenate([1.0 - share, share]), (np.tile(points, 2), np.concatenate([left, left + 1]))),
        shape=(count, nodes.size),
    )
    weighed = {}
    for name, noise in quantities.items():
        own, there = _measured(curve, name)
        groups_there, group, sizes = np.unique(which[there], return_inverse=True, return_counts=True)
        shape = (sizes.size, there.size)
        sums = csr_matrix((1.0 / np.sqrt(sizes[group]), (group, np.arange(there.size))), shape=shape)
        white = sums @ _whitening(own, noise)
        weighed[name] = Weighed(csr_matrix(white @ between[there]), white @ own.force_N, groups_there)
    protocol = Protocol(curve.name, time[nodes], curve.protocol.displacement_mm[nodes])
    return Thinned(protocol, nodes, weighed)


def _whitening(curve: Curve, noise: Noise) -> csr_matrix:
    """The matrix that turns errors ``[t]`` into whitened errors ``[t]``."""
    steps = np.diff(curve.protocol.time_s)
    if not steps.size:
        return csr_matrix(np.diag(1.0 / noise.sd_at(curve.force_N)))
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
