"""An effect: a physical mechanism that the baseline model lacks, as data and a few plain functions.

The embedded simulator computes a test in these stages, and an effect may change any of them:

1. ``material``      constants: the baseline's parameters, beta, lambda_0 and area_mm2
2. ``displacement``  displacement of the gauge length, from that of the grips and from the force; ``giving_way`` is
   its dependence on the force, so that both are solved for together
3. ``fibre_stretch`` stretch of the fibres, from that of the bar
4. ``fibre_law``     the fibres' law, from the baseline's;  ``matrix_stress``, ``fibre_stress``  elastic second
   Piola-Kirchhoff stress of each constituent
5. ``branches``      further viscous branches;  ``slowing``  factor on the baseline's relaxation times
6. ``reading``       the force as the load cell reports it

Each function receives the state so far (:class:`Bars`) and the effect's own values by name, each ``[n, 1]`` so that
it broadcasts over time, and returns what the stage is named after. Where several effects change one stage, they act in
the alphabetical order of their slugs.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np

from sinew.tasks.model.parameters import Model, Parameter
from sinew.tasks.model.specimen import Protocol

Array = np.ndarray[Any, np.dtype[Any]]
Values = Mapping[str, Array]

PHASES = (
    *("rest", "toe", "ramp", "peak", "early hold", "middle hold", "late hold", "unload", "valley"),
    *("later cycles", "compression", "other rates"),
)
"""Where in a test an effect may show; the last two need protocols beyond one_step, two_step and cyclic."""

PLACES = ("fibre_elastic", "matrix_elastic", "fibre_memory", "matrix_memory", "beta", "thickness_mm")
"""Where a FEBio partial may stand.

``fibre_elastic`` and ``matrix_elastic`` wrap the constituent's elastic material, which stands where they say
``[[ elastic ]]``; ``fibre_memory`` and ``matrix_memory`` are added to its Prony series; ``beta`` and ``thickness_mm``
are expressions that replace the constant.
"""


_OF_EACH = ("grips_mm", "displacement_mm", "stretch", "fibre_stretch", "matrix_MPa", "fibre_MPa", "force_N", "rigid_N")


@dataclass(frozen=True, eq=False)
class Bars:
    """The state of ``n`` bars between two stages, along one protocol of ``t`` points.

    ``time_s`` ``[t]``; ``material`` by name ``[n, 1]`` (MPa, s, mm2 or none); ``displacement_mm`` of the gauge length
    and, as it was prescribed, of the grips (``grips_mm``), ``stretch`` of bar and fibres, elastic stresses (MPa) and
    force (N) ``[n, t]``. What a later stage gives is zero
    before it, except that ``displacement`` receives the force of the iteration before, and ``rigid_N`` ``[n, t]``: the
    force (N) if nothing gave way between grips and gauge length.
    """

    time_s: Array
    length_mm: float
    material: Mapping[str, Array]
    grips_mm: Array
    displacement_mm: Array
    stretch: Array
    fibre_stretch: Array
    matrix_MPa: Array
    fibre_MPa: Array
    force_N: Array
    rigid_N: Array

    @classmethod
    def at_grips(cls, protocol: Protocol, length_mm: float, material: Mapping[str, Array], count: int) -> "Bars":
        """So many bars at the displacement of the grips; nothing else is known yet."""
        displacement = np.tile(np.asarray(protocol.displacement_mm, dtype=np.float64), (count, 1))
        nothing = np.zeros_like(displacement)
        return cls(
            np.asarray(protocol.time_s, dtype=np.float64),
            length_mm,
            material,
            displacement,
            displacement,
            stretch=nothing,
            fibre_stretch=nothing,
            matrix_MPa=nothing,
            fibre_MPa=nothing,
            force_N=nothing,
            rigid_N=nothing,
        )

    @cached_property
    def steps_s(self) -> Array:
        """The time step (s) that leads to each point ``[t]``, 0 for the first."""
        steps: Array = np.diff(self.time_s, prepend=self.time_s[0])
        return steps

    def row(self, row: int) -> "Bars":
        """One of the bars, alone."""
        material = {name: value[row : row + 1] for name, value in self.material.items()}
        each = {name: getattr(self, name)[row : row + 1] for name in _OF_EACH}
        return replace(self, material=material, **each)

    def with_row(self, row: int, bar: "Bars") -> "Bars":
        """These bars with what ``bar`` holds along its curve in the place of one of them."""
        each = {name: getattr(self, name).copy() for name in _OF_EACH}
        for name, values in each.items():
            values[row] = getattr(bar, name)[0]
        return replace(self, **each)

    @cached_property
    def strain(self) -> Array:
        """Green-Lagrange strain of the bar ``[n, t]``."""
        return 0.5 * (self.stretch**2 - 1.0)

    @cached_property
    def fibre_strain(self) -> Array:
        """Green-Lagrange strain of the fibres ``[n, t]``."""
        return 0.5 * (self.fibre_stretch**2 - 1.0)


@dataclass(frozen=True, eq=False)
class Branch:
    """A Maxwell branch: spring and dashpot in series, strained by ``driver``.

    ``driver`` is the elastic stress of a constituent, or the Green-Lagrange strain of the bar. ``viscosity`` ``[n, 1]``
    is strength times time: s where a stress drives, MPa s where the strain does. ``time_s`` ``[n, 1]``; at 0 s the
    branch is a bare dashpot.
    """

    driver: Literal["matrix", "fibre", "strain"]
    viscosity: Array
    time_s: Array


@dataclass(frozen=True, eq=False)
class GivingWay:
    """How displacement lost outside the gauge length, s, follows the force F: ds <- kept ds + compliance dF.

    ``compliance`` (mm/N) and ``kept`` (1 where what is lost stays lost, else 0), each ``[n, t]``.
    """

    compliance: Array
    kept: Array


Hook = Callable[[Bars, Values], Array]
Law = Callable[[Array], Array]
"""Second Piola-Kirchhoff stress of the fibres ``[n, t]`` (MPa) at their stretch ``[n, t]``."""


@dataclass(frozen=True, eq=False)
class Effect:
    """One effect: what it is, its parameters, and what it changes in either simulator.

    ``null`` gives those parameters whose values alone make the model the baseline exactly. ``shared`` names parameters
    that belong to the machine, one value for a whole cohort; the others belong to each specimen. ``seen_by`` are
    :data:`PHASES`; ``confounded_with`` says why for each slug or parameter name. ``febio`` holds partials by
    :data:`PLACES`; where it is empty, ``no_febio`` says why. ``loaded_at_rest`` means that there may be force at zero
    displacement, so the solver must wait for its relaxation first; ``unrelaxed``, that this force comes with the first
    step instead, and relaxes during the test; ``asks_rigid``, that its functions use ``rigid_N``. ``around``:
    it acts between machine and specimen, on displacement and force alone, so it works around any simulator.
    ``other_forms`` are effects with the same slug, each with its ``form``.
    """

    slug: str
    title: str
    description: str
    equation: str
    reference: str
    parameters: tuple[Parameter, ...]
    null: Mapping[str, float]
    seen_by: tuple[str, ...]
    confounded_with: Mapping[str, str]
    shared: tuple[str, ...] = ()
    febio: Mapping[str, str] = field(default_factory=dict)
    no_febio: str = ""
    loaded_at_rest: bool = False
    unrelaxed: bool = False
    asks_rigid: bool = False
    around: bool = False
    form: str = ""
    other_forms: tuple["Effect", ...] = ()
    material: Callable[[Bars, Values], Mapping[str, Array]] | None = None
    displacement: Hook | None = None
    giving_way: Callable[[Bars, Values], tuple[GivingWay, ...]] | None = None
    fibre_stretch: Hook | None = None
    fibre_law: Callable[[Law, Values], Law] | None = None
    matrix_stress: Hook | None = None
    fibre_stress: Hook | None = None
    branches: Callable[[Bars, Values], tuple[Branch, ...]] | None = None
    slowing: Hook | None = None
    reading: Hook | None = None

    def __post_init__(self) -> None:
        """Raises :class:`ValueError` when the fields of the effect contradict each other."""
        for what, said, possible in (
            ("null", self.null, self.names),
            ("shared", self.shared, self.names),
            ("seen_by", self.seen_by, PHASES),
            ("febio", self.febio, PLACES),
        ):
            if unknown := set(said) - set(possible):
                raise ValueError(f"effect {self.slug}: {what} has {sorted(unknown)}; possible are {list(possible)}")
        if not self.null or bool(self.febio) == bool(self.no_febio):
            raise ValueError(f"effect {self.slug}: needs null values, and either febio or no_febio")
        inside = (
            self.fibre_stretch,
            self.fibre_law,
            self.matrix_stress,
            self.fibre_stress,
            self.branches,
            self.slowing,
        )
        if self.around and any(inside):
            raise ValueError(f"effect {self.slug}: around a specimen it cannot change what is inside")
        if any(form.slug != self.slug or not form.form for form in self.other_forms):
            raise ValueError(f"effect {self.slug}: other forms of an effect have its slug, and a form of their own")

    @property
    def name(self) -> str:
        """Its name in a study: the slug and, for other forms, the form."""
        return f"{self.slug}/{self.form}" if self.form else self.slug

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(parameter.name for parameter in self.parameters)

    @property
    def typical(self) -> Array:
        """Typical values ``[k]``, in the order of the parameters."""
        return np.array([parameter.reference for parameter in self.parameters])

    @property
    def null_values(self) -> Array:
        """Values ``[k]`` at which the model is the baseline; those that do not matter then are typical."""
        return np.array([self.null.get(parameter.name, parameter.reference) for parameter in self.parameters])


def in_order(effects: tuple[Effect, ...]) -> tuple[Effect, ...]:
    """The effects in the order in which they act. Raises :class:`ValueError` when one is there twice."""
    slugs = [effect.slug for effect in effects]
    if len(set(slugs)) < len(slugs):
        raise ValueError(f"an effect is there twice: {slugs}")
    return tuple(sorted(effects, key=lambda effect: effect.slug))


def model_with(model: Model, effects: tuple[Effect, ...]) -> Model:
    """The model with the effects' parameters after its own, in the order given."""
    added = tuple(parameter for effect in effects for parameter in effect.parameters)
    return Model((*model.parameters, *added), model.beta, model.lambda_0, model.law)


def model_without(model: Model, effects: tuple[Effect, ...]) -> Model:
    """The model without the parameters of ``effects``."""
    added = {parameter.name for effect in effects for parameter in effect.parameters}
    own = tuple(parameter for parameter in model.parameters if parameter.name not in added)
    return Model(own, model.beta, model.lambda_0, model.law)
