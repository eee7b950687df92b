"""A user's own FEBio model as an input template: any mesh, materials, parameters and outputs of its log file."""

import hashlib
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sinew.runner.errors import BadInput
from sinew.tasks.model import Model, Protocol, Specimen
from sinew.tasks.model.effect import Effect
from sinew.tasks.simulate import Array, Capabilities
from sinew.tasks.simulate.febio.field_output import FieldOutput
from sinew.tasks.simulate.febio.output import Logged
from sinew.tasks.simulate.febio.renderer import Allowance, WrongTemplate, render
from sinew.tasks.simulate.febio.variables import history, size
from sinew.tasks.simulate.row_by_row import Failed


@dataclass(frozen=True)
class OwnTemplate:
    """A template by the texts of its ``files``, and its outputs, which sinew adds to the log file section.

    ``fields`` are outputs that are computed from the plot file instead.
    ``force`` names the output that is compared with measured forces. ``settle_s``: how long the solver waits at the
    first displacement of a protocol that starts displaced.
    """

    files: Mapping[str, str]
    main: str
    outputs: tuple[Logged, ...]
    force: str | None = None
    settle_s: float = 0.0
    fields: tuple[FieldOutput, ...] = ()

    name = "template"
    loaded_at_rest = False
    logs_itself = False

    @property
    def capabilities(self) -> Capabilities:
        outputs = (*self.outputs, *self.fields)
        return Capabilities(effects="none" if self.force is None else "solver", outputs=outputs, force=self.force)

    @property
    def logs(self) -> tuple[tuple[str, Logged], ...]:
        return tuple((f"sinew-{number}.txt", output) for number, output in enumerate(self.outputs))

    def identity(self, ramp_s: float, hold_growth: float, still_mm: float) -> dict[str, Any]:
        digests = {name: hashlib.blake2b(text.encode(), digest_size=16) for name, text in self.files.items()}
        fields = {"fields": [asdict(output) for output in self.fields]} if self.fields else {}
        return fields | {
            "files": {name: digest.hexdigest() for name, digest in digests.items()},
            "main": self.main,
            "outputs": [asdict(output) for output in self.outputs],
            "force": self.force,
            "time_steps": [ramp_s, hold_growth, still_mm, self.settle_s],
        }

    def settling(self, model: Model, values: Array) -> float:
        """How long the solver waits (s) at the first displacement, after moving there from rest."""
        return self.settle_s

    def variables(
        self, model: Model, specimen: Specimen, protocol: Protocol, values: Array, times: Array, displacements: Array
    ) -> dict[str, Any]:
        """The variables of the template: parameters by name, the history, and the specimen's size if it has one."""
        parameters = dict(zip(model.names, values.tolist(), strict=True))
        return parameters | size(specimen) | history(protocol.name, times, displacements)

    def can_have(self, effects: tuple[Effect, ...]) -> bool:
        return not effects

    def with_effects(self, effects: tuple[Effect, ...]) -> "OwnTemplate":
        """Raises :class:`BadInput` for any effects, which are those of sinew's own tissue."""
        if effects:
            raise BadInput("model.effects", "with a template", "it in the template: it is a part of sinew's own tissue")
        return self


def check_template(
    study: Path,
    template: OwnTemplate,
    model: Model,
    *,
    sized: bool,
    moved: bool,
    allowance: Allowance | None = None,
) -> None:
    """Render the template at the middle of all ranges and at both ends of each, and check that every parameter matters.

    ``sized``: the specimen's size is known. ``moved``: the displacement history must be used. Raises :class:`BadInput`.
    """
    times = np.array([0.0, 1.0, 2.0])
    protocol = Protocol("check", times, 0.1 * times)
    specimen = Specimen("check", *((10.0, 8.0, 4.0) if sized else (np.nan,) * 3))
    middle = template.variables(model, specimen, protocol, model.reference, times, 0.1 * times)
    renders = [middle]
    renders += [middle | {p.name: value} for p in model.free for value in (p.minimum, p.maximum)]
    outputs = [asdict(output) for output in template.outputs]
    try:
        rendered = render(
            template.files, template.main, renders, outputs, known=list(middle), texts=False, allowance=allowance
        )
    except WrongTemplate as wrong:
        where, problem, expected = wrong.parts
        raise BadInput(f"{study}: {where}", problem, expected) from None
    except Failed as failed:
        raise BadInput(f"{study}: {template.main}", failed.words, "a template that can be rendered") from None
    for name in model.names:
        if name not in rendered["used"]:
            where = f"{study}: model.parameters.{name}"
            raise BadInput(where, f"not used in {template.main}", f"{{{{ {name} }}}} where it acts")
    for number, parameter in enumerate(model.free):
        if all(rendered["same"][1 + 2 * number : 3 + 2 * number]):
            where = f"{study}: model.parameters.{parameter.name}"
            problem = f"{template.main} renders to the same input at both ends of its range"
            raise BadInput(where, problem, f"{{{{ {parameter.name} }}}} printed")
    if moved and not {"displacement_points", "displacement_mm"} & set(rendered["used"]):
        problem = f"{template.main} does not follow the measured displacement"
        raise BadInput(f"{study}: simulator.file", problem, "{{ displacement_points }} in its load curve")
