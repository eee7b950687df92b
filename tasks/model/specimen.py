"""Specimens, their displacement histories, and the forces measured along them."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

Array = np.ndarray[Any, np.dtype[Any]]
FORCE = "force"  # what the force is called among the quantities that are compared


@dataclass(frozen=True, eq=False)
class Protocol:
    """A displacement history: ``time_s`` ``[t]`` (s, increasing) and ``displacement_mm`` ``[t]`` (mm).

    ``seen``: rows at which more than the force was measured, and which should be among those that are kept.
    ``paced_by``: the protocol by which a solver chooses where to stop, where this one is what a machine leaves of it.
    """

    name: str
    time_s: Array
    displacement_mm: Array
    seen: Array | None = None
    paced_by: "Protocol | None" = None

    @property
    def pace(self) -> "Protocol":
        """The protocol by which a solver chooses where to stop."""
        return self if self.paced_by is None else self.paced_by

    @property
    def digest(self) -> str:
        """A hash of the name and the history: all that a run of a solver sees of a protocol."""
        return _hash(np.frombuffer(self.name.encode(), np.uint8), self.time_s, self.displacement_mm)

    @cached_property
    def distinct_steps(self) -> tuple[Array, Array]:
        """The distinct time steps ``[k]`` (s) and which of them leads to each point ``[t]``.

        Steps that differ by no more than the rounding of the times themselves count as one: 0.07 - 0.06 is not 0.01.
        """
        steps = np.diff(self.time_s)
        step_of = np.zeros(self.time_s.size, dtype=np.int64)
        if not steps.size:
            return np.ones(1), step_of
        order = np.argsort(steps, kind="stable")
        rounding = 8 * np.finfo(float).eps * float(np.abs(self.time_s).max())
        group = np.concatenate([[0], np.cumsum(np.diff(steps[order]) > rounding)])
        step_of[1 + order] = group
        return np.bincount(group, weights=steps[order]) / np.bincount(group), step_of


@dataclass(frozen=True, eq=False)
class Curve:
    """A protocol and the force ``force_N`` ``[t]`` (N) that was measured along it; NaN where nothing was measured.

    ``others``: what was measured beside the force, ``[t]`` by name. Unlike the force, it may be NaN at some points.
    ``source``: for people, the file it was read from, its columns with their units, and what was changed.
    """

    protocol: Protocol
    force_N: Array
    others: Mapping[str, Array] = field(default_factory=dict)
    source: str = ""

    @cached_property
    def measured(self) -> bool:
        return not bool(np.isnan(self.force_N).all())

    @property
    def name(self) -> str:
        return self.protocol.name

    @property
    def digest(self) -> str:
        """A hash of the protocol and the force."""
        return _hash(self.protocol.time_s, self.protocol.displacement_mm, self.force_N)

    def of(self, name: str) -> "Curve":
        """One of the ``others`` in place of the force, in its own unit; NaN where it was not measured."""
        return Curve(self.protocol, self.others[name])


def _hash(*arrays: Array) -> str:
    hashed = hashlib.blake2b(digest_size=16)
    for array in arrays:
        hashed.update(np.ascontiguousarray(array, dtype=np.float64).tobytes())
    return hashed.hexdigest()


def file_name(name: str) -> str:
    """The ``name`` of a specimen as part of a file name: ``distal_3`` for ``distal/3``."""
    return name.replace("/", "_")


@dataclass(frozen=True, eq=False)
class Specimen:
    """A bar of gauge ``length_mm`` x ``width_mm`` x ``thickness_mm`` and its measured curves.

    ``name`` is its folder below the cohort, with the site in front where there is one (``distal/3``). Sizes are NaN
    where nothing is known of them: the specimen of a template that has its own. ``noise``: where more than the force is
    compared, the noise level of each quantity in its own unit, ``force`` first; else empty.
    """

    name: str
    length_mm: float
    width_mm: float
    thickness_mm: float
    curves: tuple[Curve, ...] = ()
    donor: str | None = None
    noise: Mapping[str, float] = field(default_factory=dict)

    @property
    def others(self) -> tuple[str, ...]:
        """What is compared beside the force, by the names of the simulator's outputs."""
        return tuple(name for name in self.noise if name != FORCE)

    @property
    def site(self) -> str | None:
        return self.name.rpartition("/")[0] or None

    @property
    def measured(self) -> bool:
        return all(curve.measured for curve in self.curves)

    @property
    def area_mm2(self) -> float:
        return self.width_mm * self.thickness_mm

    def stretch(self, protocol: Protocol) -> Array:
        """Stretch ``[t]`` of the gauge length."""
        return 1.0 + protocol.displacement_mm / self.length_mm

    def size(self) -> dict[str, float | None]:
        """Length, width and thickness, None where nothing is known of them."""
        size = {"length_mm": self.length_mm, "width_mm": self.width_mm, "thickness_mm": self.thickness_mm}
        return {name: value if np.isfinite(value) else None for name, value in size.items()}

    def identity(self) -> dict[str, Any]:
        """What an evaluation depends on: geometry, the numbers of every curve, and what is compared besides."""
        return {
            **self.size(),
            "curves": {curve.name: curve.digest for curve in self.curves},
            **({"compared": self._compared()} if self.noise else {}),
        }

    def _compared(self) -> dict[str, Any]:
        return {
            name: [level, *(_hash(curve.others[name]) for curve in self.curves if name in curve.others)]
            for name, level in self.noise.items()
        }
