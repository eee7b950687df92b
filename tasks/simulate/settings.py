"""The settings of a simulator in a study: their base class, and those of the embedded simulator."""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Literal

from sinew.runner.errors import BadInput
from sinew.tasks.model import Model
from sinew.tasks.model.effect import Effect
from sinew.tasks.simulate import Simulator
from sinew.tasks.study.settings_file import Section

Law = Literal["tendon", "template"]
"""The parameters that a study varies: those of sinew's own tissue, or those of the study's own template."""


class SolverMissing(BadInput):
    """The solver is not on this machine."""


@dataclass(frozen=True)
class Purpose:
    """What a simulator is built for.

    ``study`` is the study's file, beside which templates lie, ``text`` what it held when it was read. ``sized``: the
    specimens have a size. ``scratch`` is the folder of solver runs, ``kept`` that of runs that are kept. ``solver`` is
    the program that the user names, in place of the study's. ``compared``: the outputs that are compared with
    measurements besides the force.
    """

    study: Path
    text: str
    model: Model
    effects: tuple[Effect, ...]
    sized: bool
    scratch: Path
    solver: str | None = None
    compared: tuple[str, ...] = ()
    kept: Path | None = None


class SimulatorSettings(Section):
    """The settings of a kind of simulator. Subclasses have a literal ``name`` and are listed in the registry."""

    law: ClassVar[Law] = "tendon"
    template_field: ClassVar[str | None] = None  # that names a template beside the study
    name: str

    @property
    def own_template(self) -> str | None:
        """The template that a study brings, as the study names it; None without one."""
        return None if self.template_field is None else getattr(self, self.template_field)

    @property
    def further_templates(self) -> tuple[str, ...]:
        """Templates of cheaper versions of the model, in the same folder as the study's own."""
        return ()

    @property
    def cheaper(self) -> tuple[str, ...]:
        """What stands in for the model where a study can use it, the cheapest first."""
        return ()

    @property
    def coarse_rows(self) -> int:
        """How many runs of the coarse version are made for each of the model itself."""
        return 0

    @property
    def like_embedded(self) -> bool:
        """Whether the embedded simulator gives nearly the same forces."""
        return False

    @property
    def output_names(self) -> tuple[str, ...]:
        """Names of the quantities that are stored besides the force of sinew's own tissue."""
        return ()

    @property
    def comparable(self) -> dict[str, str]:
        """Units of the outputs that can be compared with measurements besides the force, by name; 1: no unit."""
        return {}

    @property
    def constituents(self) -> dict[str, str]:
        """Where the fibre and the matrix stand in a model of the user's own, as far as the study says it."""
        return {}

    @property
    def gives_force(self) -> bool:
        """Whether there is a force to compare with a measured one."""
        return True

    def refuse_around(self, where: str) -> None:
        """Raise :class:`BadInput`, of ``where``, if no effects can act around a model of the user's own."""

    def build(self, purpose: Purpose) -> Simulator:
        """The simulator. Raises :class:`BadInput`, and :class:`SolverMissing` once all else has been checked."""
        raise NotImplementedError


class UniaxialSettings(SimulatorSettings):
    """The embedded simulator."""

    name: Literal["uniaxial"] = "uniaxial"

    @property
    def like_embedded(self) -> bool:
        return True

    @property
    def comparable(self) -> dict[str, str]:
        from sinew.tasks.simulate.lateral import OUTPUTS

        return {name: output.unit for name, output in OUTPUTS.items()}

    def build(self, purpose: Purpose) -> Simulator:
        from sinew.tasks.simulate.effects import UniaxialWith
        from sinew.tasks.simulate.uniaxial import Uniaxial

        effects = tuple(effect.name for effect in purpose.effects)
        return UniaxialWith(effects, compared=purpose.compared) if effects else Uniaxial(compared=purpose.compared)
