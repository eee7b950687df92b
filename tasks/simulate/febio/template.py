"""A user's own FEBio model as an input template: any mesh, materials, parameters and outputs of its log file."""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from sinew.runner.errors import BadInput
from sinew.tasks.model import Model, Protocol, Specimen
from sinew.tasks.model.effect import Effect
from sinew.tasks.simulate import Array, Capabilities
from sinew.tasks.simulate.febio import effects_inside
from sinew.tasks.simulate.febio.constituents import Constituent, NotFound, located
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
    first displacement of a protocol that starts displaced. ``constituents``: where the fibre and the matrix stand, as
    far as the study says it; ``effects`` are around them.
    """

    files: Mapping[str, str]
    main: str
    outputs: tuple[Logged, ...]
    force: str | None = None
    settle_s: float = 0.0
    fields: tuple[FieldOutput, ...] = ()
    constituents: Mapping[str, Constituent] = field(default_factory=dict)
    effects: tuple[Effect, ...] = ()

    name = "template"
    logs_itself = False

    @property
    def loaded_at_rest(self) -> bool:
        return any(effect.loaded_at_rest for effect in self.effects)

    @property
    def capabilities(self) -> Capabilities:
        outputs = (*self.outputs, *self.fields)
        where = tuple((name, one.path) for name, one in self.constituents.items())
        return Capabilities(
            effects="none" if self.force is None else "solver",
            outputs=outputs,
            force=self.force,
            constituents=where,
        )

    @property
    def logs(self) -> tuple[tuple[str, Logged], ...]:
        return tuple((f"sinew-{number}.txt", output) for number, output in enumerate(self.outputs))

    def identity(self, ramp_s: float, hold_growth: float, still_mm: float) -> dict[str, Any]:
        digests = {name: hashlib.blake2b(text.encode(), digest_size=16) for name, text in self.files.items()}
        fields = {"fields": [asdict(output) for output in self.fields]} if self.fields else {}
        return (
            fields
            | self._inside()
            | {
                "files": {name: digest.hexdigest() for name, digest in digests.items()},
                "main": self.main,
                "outputs": [asdict(output) for output in self.outputs],
                "force": self.force,
                "time_steps": [ramp_s, hold_growth, still_mm, self.settle_s],
            }
        )

    def _inside(self) -> dict[str, Any]:
        """What the identity says of effects: nothing where there are none."""
        if not self.effects:
            return {}
        used = effects_inside.used(self.effects)
        at = {name: one.path for name, one in self.constituents.items() if name in used}
        names = [effect.name for effect in self.effects]
        return {"inside": {"version": effects_inside.VERSION, "at": at, "effects": names}}

    def settling(self, model: Model, values: Array) -> float:
        """How long the solver waits (s) at the first displacement, after moving there from rest."""
        return self.settle_s

    def variables(
        self, model: Model, specimen: Specimen, protocol: Protocol, values: Array, times: Array, displacements: Array
    ) -> dict[str, Any]:
        """The variables of the template: parameters by name, the history, and the specimen's size if it has one."""
        parameters = dict(zip(model.names, values.tolist(), strict=True))
        return parameters | size(specimen) | history(protocol.name, times, displacements)

    def completed(self, text: str, variables: Mapping[str, Any]) -> str:
        """A rendered input with the effects. Raises :class:`Failed`."""
        return effects_inside.with_effects(text, self.constituents, self.effects, variables) if self.effects else text

    def why_not(self, effect: Effect) -> str | None:
        """Why its input cannot have an effect; None where it can."""
        return effects_inside.why_not(effect, self.constituents, settles=self.settle_s > 0)

    def can_have(self, effects: tuple[Effect, ...]) -> bool:
        each = all(self.why_not(effect) is None for effect in effects)
        return each and effects_inside.fit_together(effects, self.constituents)

    def with_effects(self, effects: tuple[Effect, ...]) -> "OwnTemplate":
        """The template with ``effects`` around its constituents. Raises :class:`BadInput`."""
        for effect in effects:
            if (why := self.why_not(effect)) is not None:
                raise BadInput("model.effects", f"{effect.name}: {why}", "effects that the template can have")
        return replace(self, effects=effects)


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
    middle = _at_the_middle(template, model, sized=sized)
    renders = [middle]
    renders += [middle | {p.name: value} for p in model.free for value in (p.minimum, p.maximum)]
    rendered = _rendered(study, template, renders, allowance, known=list(middle), texts=False)
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


def with_constituents(
    study: Path,
    template: OwnTemplate,
    model: Model,
    paths: Mapping[str, str],
    *,
    sized: bool,
    allowance: Allowance | None = None,
) -> OwnTemplate:
    """The template, in which effects can be around the materials at ``paths``, by the name of the constituent.

    They are looked up in its input at the middle and at both ends of all ranges. Raises :class:`BadInput`.
    """
    if not paths:
        return template
    middle = _at_the_middle(template, model, sized=sized)
    ends = [{one.name: getattr(one, end) for one in model.free} for end in ("minimum", "maximum")]
    renders = [middle, *(middle | values for values in ends)]
    texts = _rendered(study, template, renders, allowance, texts=True)["texts"]
    found = {}
    for name, path in paths.items():
        try:
            found[name] = located(texts, path)
        except NotFound as error:
            problem, expected = error.args
            raise BadInput(f"{study}: simulator.{name}", f"{problem} in {template.main}", expected[:300]) from None
    return replace(template, constituents=found)


def _at_the_middle(template: OwnTemplate, model: Model, *, sized: bool) -> dict[str, Any]:
    """Variables of the template at the middle of all ranges, of a short test."""
    times = np.array([0.0, 1.0, 2.0])
    protocol = Protocol("check", times, 0.1 * times)
    specimen = Specimen("check", *((10.0, 8.0, 4.0) if sized else (np.nan,) * 3))
    return template.variables(model, specimen, protocol, model.reference, times, 0.1 * times)


def _rendered(
    study: Path,
    template: OwnTemplate,
    renders: Sequence[Mapping[str, Any]],
    allowance: Allowance | None,
    *,
    texts: bool,
    known: Sequence[str] | None = None,
) -> dict[str, Any]:
    """As :func:`sinew.tasks.simulate.febio.renderer.render`, with its outputs. Raises :class:`BadInput`."""
    outputs = [asdict(output) for output in template.outputs]
    try:
        return render(template.files, template.main, renders, outputs, known=known, texts=texts, allowance=allowance)
    except WrongTemplate as wrong:
        where, problem, expected = wrong.parts
        raise BadInput(f"{study}: {where}", problem, expected) from None
    except Failed as failed:
        raise BadInput(f"{study}: {template.main}", failed.words, "a template that can be rendered") from None
