"""The tendon bar as an input template: the built-in one, or a user's with the same variables.

The template receives the model's parameters and constants, the specimen and the protocol; it logs the reactions at the
grip by itself, at must points only. It is half of the specimen's width, so force = 2 x summed reactions.
"""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from sinew.runner.errors import BadInput
from sinew.tasks.model import Model, Protocol, Specimen
from sinew.tasks.model.effect import Effect
from sinew.tasks.simulate import Array, Capabilities
from sinew.tasks.simulate.febio.effects import fit_together, template_with
from sinew.tasks.simulate.febio.files import checked_path, read_text
from sinew.tasks.simulate.febio.output import Logged
from sinew.tasks.simulate.febio.renderer import WrongTemplate, render
from sinew.tasks.simulate.febio.variables import history, size
from sinew.tasks.simulate.row_by_row import Failed
from sinew.tasks.study.resources import resource

REACTIONS = "reaction.txt"
DEFAULT_TEMPLATE = "tendon.feb.j2"
RELAXED = 40.0  # times the longest relaxation time: full relaxation
FORCE = Logged("force", "N", item="Rz", reduce="sum", scale=2.0)


@dataclass(frozen=True)
class TendonTemplate:
    """The ``text`` of a tendon's template, called ``main`` in messages.

    ``loaded_at_rest``: the bar bears force at zero displacement, whose relaxation is waited for.
    """

    text: str
    loaded_at_rest: bool = False
    main: str = DEFAULT_TEMPLATE

    name = "febio"
    capabilities = Capabilities(effects="solver")
    logs = ((REACTIONS, FORCE),)
    fields = ()
    logs_itself = True

    @property
    def files(self) -> Mapping[str, str]:
        return {self.main: self.text}

    def identity(self, ramp_s: float, hold_growth: float, still_mm: float) -> dict[str, Any]:
        digest = hashlib.blake2b(self.text.encode(), digest_size=16).hexdigest()
        steps = {"ramp_s": ramp_s, "hold_growth": hold_growth, "still_mm": still_mm}
        return {"template": digest, "time_steps": steps} | ({"loaded_at_rest": True} if self.loaded_at_rest else {})

    def settling(self, model: Model, values: Array) -> float:
        """How long the solver waits (s) at the first displacement, after moving there from rest."""
        return RELAXED * max(value for name, value in zip(model.names, values, strict=True) if name.startswith("tau"))

    def variables(
        self, model: Model, specimen: Specimen, protocol: Protocol, values: Array, times: Array, displacements: Array
    ) -> dict[str, Any]:
        """The variables that the comment at the top of the built-in template lists."""
        return {
            "parameters": dict(zip(model.names, values.tolist(), strict=True)),
            "constants": {"beta": model.beta, "lambda_0": model.lambda_0},
            **size(specimen),
            **history(protocol.name, times, displacements),
        }

    def completed(self, text: str, variables: Mapping[str, Any]) -> str:
        """The input as it is: effects are in the template's own text."""
        return text

    def can_have(self, effects: tuple[Effect, ...]) -> bool:
        return fit_together(effects)

    def why_not(self, effect: Effect) -> str | None:
        """Why its input cannot have an effect; None where it can."""
        return None if effect.febio else "not in FEBio"

    def with_effects(self, effects: tuple[Effect, ...]) -> "TendonTemplate":
        """The template with the partials of ``effects``. Raises :class:`BadInput`."""
        at_rest = self.loaded_at_rest or any(effect.loaded_at_rest for effect in effects)
        return replace(self, text=template_with(self.text, effects), loaded_at_rest=at_rest)


def read_template(folder: Path, name: str | None, model: Model | None = None) -> TendonTemplate:
    """The built-in template, or the file ``name`` inside ``folder``, which is rendered once to check it.

    It is rendered with the parameters of ``model``, by default the baseline's. Raises :class:`BadInput` when the file
    is not there, lies outside the folder, cannot be rendered, or is no FEBio input.
    """
    if name is None:
        return TendonTemplate(resource(f"templates/{DEFAULT_TEMPLATE}").read_text("utf-8"))
    path = checked_path(folder / name, folder, "simulator.template", "the study's folder")
    template = TendonTemplate(read_text(path, "utf-8"), main=path.name)
    model = model or Model()
    times = np.array([0.0, 1.0, 2.0])
    protocol = Protocol("check", times, 0.1 * times)
    specimen = Specimen("check", 10.0, 8.0, 4.0)
    variables = template.variables(model, specimen, protocol, model.reference, times, 0.1 * times)
    try:
        render(template.files, template.main, [variables], None, texts=False)
    except WrongTemplate as wrong:
        where, problem, expected = wrong.parts
        raise BadInput(path.parent / where, problem, expected) from None
    except Failed as failed:
        raise BadInput(path, failed.words, "a template that can be rendered") from None
    return template
