"""The ``model`` section of a study file: its parameters and their ranges, and the model that it describes."""

from dataclasses import replace
from typing import Annotated

from pydantic import Field

from sinew.runner.errors import shown
from sinew.tasks.model import TENDON, Model, Parameter
from sinew.tasks.model.effect import Effect
from sinew.tasks.model.effects import effect_named, named
from sinew.tasks.model.law import MAX_LAWS, is_law
from sinew.tasks.model.parameters import LARGEST_LAMBDA_0, own_parameter
from sinew.tasks.simulate.febio.settings import IDENTIFIER
from sinew.tasks.simulate.febio.variables import TAKEN
from sinew.tasks.simulate.settings import Law
from sinew.tasks.study.fields import Unit
from sinew.tasks.study.settings_file import FieldError, Section


class ParameterSettings(Section):
    """Bounds of a parameter, or one ``fixed`` value; ``unit`` guards against a slip of units."""

    min: Annotated[float, Field(allow_inf_nan=False)] | None = None
    max: Annotated[float, Field(allow_inf_nan=False)] | None = None
    reference: Annotated[float, Field(allow_inf_nan=False)] | None = None
    fixed: Annotated[float, Field(allow_inf_nan=False)] | None = None
    unit: Unit | None = None

    def apply(self, parameter: Parameter) -> Parameter:
        """The parameter with these settings. Raises ``ValueError`` with the field that is wrong."""
        if self.unit is not None and self.unit != parameter.unit:
            raise FieldError("unit", shown(self.unit), f"{parameter.unit!r}, the unit of {parameter.name}")
        if self.fixed is not None:
            if self.min is not None or self.max is not None or self.reference is not None:
                raise FieldError("fixed", "given beside min, max or reference", "either fixed, or min and max")
            low = high = reference = self.fixed
        else:
            low = parameter.minimum if self.min is None else self.min
            high = parameter.maximum if self.max is None else self.max
            if low >= high:
                raise FieldError("max", f"{high:g} is not above min {low:g}", "min below max (or use fixed)")
            middle = parameter.reference if low <= parameter.reference <= high else (low + high) / 2
            reference = middle if self.reference is None else self.reference
            if not low <= reference <= high:
                raise FieldError("reference", f"{reference:g}", f"a value from {low:g} to {high:g}")
        for field, value in (("fixed" if self.fixed is not None else "min", low), ("max", high)):
            # a range may touch the edge of what is possible, its inside is what is studied
            if not parameter.possible(value) and (low == high or value < parameter.floor or value >= parameter.ceiling):
                raise FieldError(field, f"{value:g}", parameter.limits)
        return replace(parameter, minimum=low, maximum=high, reference=reference)

    def own(self, name: str) -> Parameter:
        """A parameter of a template, which has no published range. Raises :class:`FieldError`."""
        low, high = (self.min, self.max) if self.fixed is None else (self.fixed, self.fixed)
        if low is None or high is None:
            field = "min" if low is None else "max"
            raise FieldError(field, "missing", "min and max (or fixed), as nothing is known of this parameter")
        return self.apply(own_parameter(name, self.unit or "1", low, high))


class ModelSettings(Section):
    """The tissue model: what the study says differs from the published ranges, and ``effects`` it has besides."""

    parameters: dict[str, ParameterSettings] = Field(default_factory=dict)
    beta: Annotated[float, Field(ge=2, le=10, allow_inf_nan=False)] = 2.0
    lambda_0: Annotated[float, Field(gt=1, le=LARGEST_LAMBDA_0, allow_inf_nan=False)] = 1.01
    effects: list[str] = Field(default_factory=list)


def model_of(settings: ModelSettings, law: Law) -> Model:
    """The model with the study's bounds: the tissue, or the parameters of a user's template.

    Raises :class:`FieldError`.
    """
    return _template_model(settings) if law == "template" else _tissue_model(settings)


def effects_of(settings: ModelSettings) -> tuple[Effect, ...]:
    """The effects that the model has besides the baseline, in the study's order. Raises :class:`FieldError`."""
    for name in settings.effects:
        if is_law(name):
            try:
                effect_named(name)
            except ValueError as error:
                raise FieldError("model.effects", shown(name), f"a law of docs/laws.md ({error})") from None
        elif name not in named():
            expected = f"one of {', '.join(named())}, or a law of docs/laws.md"
            raise FieldError("model.effects", f"no effect {shown(name)}", expected)
    laws = [name for name in settings.effects if is_law(name)]
    if len(laws) > MAX_LAWS:
        raise FieldError("model.effects", f"{len(laws)} laws", f"at most {MAX_LAWS}")
    chosen = tuple(effect_named(name) for name in settings.effects)
    slugs = [effect.slug for effect in chosen]
    for i, slug in enumerate(slugs):
        if slug in slugs[:i]:
            raise FieldError("model.effects", f"{slug} is a duplicate", "each effect once")
    return chosen


def _tissue_model(settings: ModelSettings) -> Model:
    added = [parameter for effect in effects_of(settings) for parameter in effect.parameters]
    known = {parameter.name: parameter for parameter in (*TENDON, *added)}
    for name in settings.parameters:
        if name not in known:
            raise FieldError(f"model.parameters.{name}", "unknown parameter", f"one of {', '.join(known)}")
    parameters = tuple(_applied(settings, parameter) for parameter in known.values())
    model = Model(parameters, settings.beta, settings.lambda_0)
    if not model.free:
        raise FieldError("model.parameters", "every parameter is fixed", "at least one with min and max")
    return model


def _applied(settings: ModelSettings, parameter: Parameter) -> Parameter:
    """A known parameter with the study's settings of it. Raises :class:`FieldError`."""
    try:
        return settings.parameters.get(parameter.name, ParameterSettings()).apply(parameter)
    except FieldError as error:
        raise FieldError(f"model.parameters.{parameter.name}.{error.field}", error.problem, error.expected) from None


def _template_model(settings: ModelSettings) -> Model:
    for field in ("beta", "lambda_0"):
        if field in settings.model_fields_set:
            expected = "it in the template: it is a part of sinew's own tissue"
            raise FieldError(f"model.{field}", "with a template", expected)
    effects = effects_of(settings)
    for effect in effects:
        if not (effect.around or effect.febio):
            possible = ", ".join(name for name, one in named().items() if one.around or one.febio)
            expected = f"effects that act around any model or that FEBio has: {possible}"
            raise FieldError("model.effects", f"{shown(effect.name)} with a template", expected)
    of_effects = {parameter.name: parameter for effect in effects for parameter in effect.parameters}
    parameters = []
    for name, one in settings.parameters.items():
        if name in of_effects:
            continue
        if not IDENTIFIER.fullmatch(name) or name in TAKEN:
            problem = "is taken by the template language" if name in TAKEN else "cannot be a name"
            expected = "another name: letters, digits and '_', beginning with a letter"
            raise FieldError(f"model.parameters.{name}", problem, expected)
        try:
            parameters.append(one.own(name))
        except FieldError as error:
            raise FieldError(f"model.parameters.{name}.{error.field}", error.problem, error.expected) from None
    added = tuple(_applied(settings, parameter) for parameter in of_effects.values())
    model = Model((*parameters, *added), law="template")
    if not model.free:
        raise FieldError("model.parameters", "no parameter with min and max", "at least one")
    return model
