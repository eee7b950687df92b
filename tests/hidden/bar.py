"""A tendon bar pulled through time, written from the equations of docs/methods.md alone: the truth of hidden cohorts.

Nothing is shared with the simulators of the project. Each viscous term keeps the stress that it has let go already,
tau dy/dt = S - y, and bears g (S - y). Between substeps the elastic stress S is linear in time; there are several to a
sample while anything but relaxation happens. A bar can have other physics than the baseline, piece by piece.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np
from scipy.optimize import brentq

Array = np.ndarray[Any, np.dtype[Any]]
Material = Mapping[str, float]

MOVING, COUPLED = 8, 4  # substeps of a sample: while the displacement moves, and in holds where that matters
TOE_END = 1.01


@dataclass
class Past:
    """What a bar has gone through until now. Strains are Green-Lagrange strains of the bar."""

    time_s: float = 0.0
    strain: float = 0.0
    largest_strain: float = 0.0
    largest_fibre_MPa: float = 0.0  # elastic, before anything is lost
    largest_N: float = 0.0
    strain_time: float = 0.0  # integral of the strain over time (s)
    cycles: int = 0  # loadings that began anew
    falling: bool = False
    matrix_set: float = 0.0  # plastic strain

    def now(self, strain: float, fibre_MPa: float, force_N: float, step_s: float) -> None:
        """Take note of the next state."""
        if strain < self.strain - 1e-12:
            self.falling = True
        elif self.falling and strain > self.strain + 1e-12:
            self.falling, self.cycles = False, self.cycles + 1
        self.strain_time += 0.5 * step_s * (self.strain + strain)
        self.time_s += step_s
        self.strain = strain
        self.largest_strain = max(self.largest_strain, strain)
        self.largest_fibre_MPa = max(self.largest_fibre_MPa, fibre_MPa)
        self.largest_N = max(self.largest_N, force_N)


def fibre_stress(material: Material, stretch: float) -> float:
    """Second Piola-Kirchhoff stress (MPa) of the baseline's fibres."""
    square, end = stretch**2, TOE_END**2
    if square <= 1.0:
        return 0.0
    modulus, alpha = material["E_f"], material["alpha_f"]
    scale = 4.0 * end**1.5 * (1.0 + 2.0 * alpha * (end - 1.0) ** 2)
    if square < end:
        return 2.0 * modulus / scale * (square - 1.0) * np.exp(alpha * ((square - 1.0) ** 2 - (end - 1.0) ** 2))
    return 2.0 * modulus * (2.0 * end * (1.5 + 2.0 * alpha * (end - 1.0) ** 2) - 1.0) / scale - modulus / stretch


def matrix_stress(material: Material, strain: float, past: Past) -> tuple[float, float]:
    """Stress (MPa) of the baseline's matrix, and the plastic strain, which stays what it was."""
    return material["E_m"] * strain, past.matrix_set


def all_of_it(past: Past, strain: float, fibre_MPa: float) -> float:
    return 1.0


@dataclass(frozen=True)
class Physics:
    """What a bar is made of and how it is held and read; what is left out is the baseline's.

    ``fibre_left``, ``matrix_left``: factors on the elastic stress. ``fibre_terms``: further terms (strength, time in s)
    driven by the fibres' stress; ``strain_terms``: (MPa, s) driven by the strain. ``pace``: factor on the baseline's
    times at a strain. ``viscous``: MPa at a rate of strain (1/s). ``lost``: displacement (mm) that grips and machine
    take at a force. ``grown``: stretch of the length at rest. ``reading``: what is recorded along times (s) and
    displacements (mm) of forces (N).
    """

    fibre: Callable[[Material, float], float] = fibre_stress
    matrix: Callable[[Material, float, Past], tuple[float, float]] = matrix_stress
    fibre_left: Callable[[Past, float, float], float] = all_of_it
    matrix_left: Callable[[Past, float, float], float] = all_of_it
    fibre_terms: tuple[tuple[float, float], ...] = ()
    strain_terms: tuple[tuple[float, float], ...] = ()
    pace: Callable[[float], float] | None = None
    viscous: Callable[[float], float] | None = None
    lost: Callable[[float, Past], float] | None = None
    grown: Callable[[Past], float] | None = None
    area_factor: float = 1.0
    reading: Callable[[Array, Array, Array], Array] | None = None


BARE = Physics()


def both(one: Physics, other: Physics) -> Physics:
    """A bar with the peculiarities of two. Raises :class:`ValueError` where both change the same thing."""
    changes: dict[str, Any] = {}
    for piece in fields(Physics):
        plain, first, second = (getattr(physics, piece.name) for physics in (BARE, one, other))
        if first is not plain and second is not plain and first != plain and second != plain:
            raise ValueError(f"both change {piece.name}")
        changes[piece.name] = second if first == plain else first
    return replace(BARE, **changes)


@dataclass
class _Bar:
    """The state of a bar: ``gone`` ``[k]``, what each term has let go (MPa), and what drove it last."""

    material: Material
    area_mm2: float
    physics: Physics
    past: Past = field(default_factory=Past)

    def __post_init__(self) -> None:
        m, p = self.material, self.physics
        base = [(0, m[f"g_{i}m"], m[f"tau_{i}m"]) for i in (1, 2, 3)]
        base += [(1, m[f"g_{i}f"], m[f"tau_{i}f"]) for i in (1, 2, 3)]
        more = [*((1, *term) for term in p.fibre_terms), *((2, *term) for term in p.strain_terms)]
        self.driver = np.array([driver for driver, _, _ in [*base, *more]])
        self.strength = np.array([strength for _, strength, _ in [*base, *more]])
        self.times = np.array([time for _, _, time in [*base, *more]])
        self.paced = np.arange(self.times.size) < len(base)
        self.known: dict[float, tuple[Array, Array]] = {}

    def elastic(self, stretch: float) -> tuple[Array, float, float]:
        """Stress of matrix and fibres and the strain ``[3]``, the fibres' stress before losses, the plastic strain."""
        strain = 0.5 * (stretch**2 - 1.0)
        matrix, plastic = self.physics.matrix(self.material, strain, self.past)
        fibre = self.physics.fibre(self.material, stretch)
        left = [f(self.past, strain, fibre) for f in (self.physics.matrix_left, self.physics.fibre_left)]
        return np.array([matrix * left[0], fibre * left[1], strain]), fibre, plastic

    def rest(self, stretch: float) -> float:
        """Begin at a stretch at which everything has relaxed. Returns the force (N)."""
        self.drive, fibre, self.past.matrix_set = self.elastic(stretch)
        self.gone = self.drive[self.driver]
        force = float(self.area_mm2 * stretch * (self.drive[0] + self.drive[1]))
        self.past.now(self.drive[2], fibre, force, 0.0)
        return force

    def weights(self, step_s: float, strain: float) -> tuple[Array, Array]:
        """What is left of ``gone`` after a step, and the part of the step that counts for its beginning."""
        if self.physics.pace is None and step_s in self.known:
            return self.known[step_s]
        factor = 1.0 if self.physics.pace is None else self.physics.pace(0.5 * (self.past.strain + strain))
        ratio = step_s / np.where(self.paced, factor * self.times, self.times)
        kept = np.exp(-ratio)
        found = kept, -np.expm1(-ratio) / ratio
        if self.physics.pace is None:
            self.known[step_s] = found
        return found

    def pulled(self, stretch: float, step_s: float) -> tuple[float, Array, Array, float, float]:
        """Force (N) at a stretch after a step, and what the state becomes there."""
        drive, fibre, plastic = self.elastic(stretch)
        kept, mean = self.weights(step_s, drive[2])
        end = drive[self.driver]
        gone = kept * self.gone + (mean - kept) * self.drive[self.driver] + (1.0 - mean) * end
        stress = drive[0] + drive[1] + self.strength @ (end - gone)
        if self.physics.viscous is not None:
            stress += self.physics.viscous((drive[2] - self.past.strain) / step_s)
        return float(self.area_mm2 * stretch * stress), drive, gone, fibre, plastic

    def step(self, stretch: float, step_s: float) -> float:
        """Go to a stretch. Returns the force (N)."""
        force, self.drive, self.gone, fibre, plastic = self.pulled(stretch, step_s)
        self.past.matrix_set = plastic
        self.past.now(self.drive[2], fibre, force, step_s)
        return force


def pull(
    material: Material,
    size_mm: tuple[float, float, float],
    time_s: Array,
    displacement_mm: Array,
    physics: Physics = BARE,
    substeps: int = MOVING,
) -> Array:
    """Recorded force ``[t]`` (N) of a bar of length, width and thickness ``size_mm``, linear between samples."""
    length, width, thickness = size_mm
    bar = _Bar(material, physics.area_factor * width * thickness, physics)
    alone = physics.lost is None and physics.grown is None and physics.pace is None
    force = np.empty(time_s.size)
    force[0] = bar.rest(1.0 + displacement_mm[0] / length)
    for t in range(1, time_s.size):
        moves = displacement_mm[t] != displacement_mm[t - 1]
        count = substeps if moves else (1 if alone else COUPLED)
        step_s = round((time_s[t] - time_s[t - 1]) / count, 12)
        for k in range(1, count + 1):
            share = k / count
            displacement = (1.0 - share) * displacement_mm[t - 1] + share * displacement_mm[t]
            force[t] = bar.step(_stretch(bar, displacement, length, step_s), step_s)
    return force if physics.reading is None else physics.reading(time_s, displacement_mm, force)


def _stretch(bar: _Bar, displacement_mm: float, length_mm: float, step_s: float) -> float:
    """The bar's stretch, where grips and machine take what they take at the force that it causes."""
    physics = bar.physics
    rest = length_mm if physics.grown is None else length_mm * physics.grown(bar.past)
    free = (length_mm + displacement_mm) / rest
    if physics.lost is None:
        return free
    lost = physics.lost

    def wanting(stretch: float) -> float:
        return stretch - free + lost(bar.pulled(stretch, step_s)[0], bar.past) / rest

    too_much = wanting(free)
    other = free - too_much  # with the loss at the force of no loss at all, which is the largest
    if abs(too_much) < 1e-14 or wanting(other) * too_much > 0.0:
        return other
    return float(brentq(wanting, other, free, xtol=1e-14, rtol=1e-14))
