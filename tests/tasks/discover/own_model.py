"""A model of a user's own that is solved in this process: a stiffening bar of three parameters which relaxes."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sinew.tasks.model import Curve, Model, Protocol, Specimen
from sinew.tasks.model.effect import Effect, model_with
from sinew.tasks.model.parameters import own_parameter
from sinew.tasks.simulate import Capabilities, Output, Simulated
from sinew.tasks.simulate.around import Around, Near

OWN = Model(
    (
        own_parameter("E", "MPa", 5.0, 50.0, 20.0),
        own_parameter("nu_m", "1", 0.1, 1.0, 0.5),  # what relaxes; called like a parameter of the tissue
        own_parameter("tau", "s", 1.0, 30.0, 8.0),
    ),
    law="template",
)
TRUTH = np.array([18.0, 0.6, 9.0])
STIFFENS = 25.0  # per unit of strain
BAR = Specimen("bone/1", 20.0, 4.0, 2.0)
RELAX = Protocol("relax", np.linspace(0.0, 40.0, 401), 1.2 * np.minimum(np.linspace(0.0, 10.0, 401), 1.0))
PULLS = Protocol("pulls", np.linspace(0.0, 24.0, 241), 0.6 * (1.0 - np.abs(np.linspace(0.0, 24.0, 241) % 8 / 4 - 1.0)))
GROWS = Protocol("grows", PULLS.time_s, PULLS.displacement_mm * (0.5 + PULLS.time_s / 24.0))


@dataclass(frozen=True)
class OwnBar:
    """The model as a simulator, which effects of the machine can be around; it counts its ``runs``.

    ``inside``: effects inside it, of which only the softening by the largest strain does anything. ``points``: how many
    points along it a camera follows (``dic_1_mm``, ...), evenly spread.
    """

    runs: list[int] = field(default_factory=lambda: [0])
    inside: tuple[Effect, ...] = ()
    points: int = 0

    name = "template"

    @property
    def capabilities(self) -> Capabilities:
        force = (Output("force", "N"),) if self.points else ()
        return Capabilities(effects="solver", outputs=force + tuple(Output(name, "mm") for name in self.followed))

    @property
    def followed(self) -> tuple[str, ...]:
        """What the points are called."""
        return tuple(f"dic_{number}_mm" for number in range(1, self.points + 1))

    def identity(self) -> dict[str, Any]:
        return {"name": "own bar"}

    def can_have(self, effects: tuple[Effect, ...]) -> bool:
        return all(effect.around for effect in effects)

    def why_not(self, effect: Effect) -> str | None:
        return None if effect.around else "it is a bar"

    def with_effects(self, effects: tuple[Effect, ...], near: Near | None = None) -> Any:
        return Around(self, effects, near) if effects else self

    def simulate(
        self, model: Model, specimen: Specimen, protocol: Protocol, parameters: np.ndarray, *, stresses: bool = False
    ) -> Simulated:
        self.runs[0] += len(parameters)
        stiff, part, tau = parameters.T[:3, :, np.newaxis]
        strain = protocol.displacement_mm / specimen.length_mm
        elastic = specimen.area_mm2 * stiff * np.expm1(STIFFENS * strain) / STIFFENS
        if self.inside and self.inside[0].name == "softening":
            loss, shape, scale = parameters.T[3:6, :, np.newaxis]
            largest = np.maximum.accumulate(np.maximum(strain + 0.5 * strain**2, 0.0))
            elastic = elastic * (1.0 + loss * np.expm1(-((largest / scale) ** shape)))
        changes, steps, over = np.diff(elastic, axis=1), np.diff(protocol.time_s), np.zeros_like(elastic)
        kept = np.exp(-steps / tau)
        gained = changes * (1.0 - kept) * tau / steps
        for i in range(steps.size):
            over[:, i + 1] = over[:, i] * kept[:, i] + gained[:, i]
        count = len(parameters)
        parts = {name: (k + 1) / self.points * protocol.displacement_mm for k, name in enumerate(self.followed)}
        outputs = {name: np.tile(course, (count, 1)) for name, course in parts.items()}
        return Simulated(elastic + part * over, np.zeros(count, np.int8), ("",) * count, outputs=outputs)


def pulled(
    effects: tuple[Effect, ...] = (),
    values: tuple[float, ...] = (),
    sd_N: float = 0.05,
    *,
    points: int = 0,
    sd_mm: float = 0.002,
    wrong_N: float = 0.0,
) -> Specimen:
    """A specimen of this model with one effect inside it, or pulled by a machine with ``effects``; white noise.

    ``points`` that a camera follows are seen in every fifth row, with white noise of ``sd_mm``. ``wrong_N``: of a
    smooth error of the force that no effect describes.
    """
    bar = OwnBar(inside=tuple(effect for effect in effects if not effect.around), points=points)
    around = tuple(effect for effect in effects if effect.around)
    model, rng, curves = model_with(OWN, effects), np.random.default_rng(5), []
    row = np.concatenate([TRUTH, values])[np.newaxis]
    for protocol in (RELAX, PULLS, GROWS) if bar.inside else (RELAX, PULLS):
        done = bar.with_effects(around).simulate(model, BAR, protocol, row)
        wrong = wrong_N * np.sin(150.0 * protocol.displacement_mm / BAR.length_mm)
        force = done.force_N[0] + wrong + rng.normal(0.0, sd_N, protocol.time_s.size)
        seen = np.where(np.arange(force.size) % 5, np.nan, 1.0)
        others = {name: seen * (done.outputs[name][0] + rng.normal(0.0, sd_mm, force.size)) for name in bar.followed}
        curves.append(Curve(protocol, force, others))
    return Specimen(BAR.name, BAR.length_mm, BAR.width_mm, BAR.thickness_mm, tuple(curves))
