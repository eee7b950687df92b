"""FEBio inputs with effects: an input template is edited into another, which needs nothing else to be rendered.

The result is a template like any other: it can be saved beside a study and read by a person, and its text is part of
every evaluation's identity. Without effects the text stays as it is.
"""

import re
from textwrap import dedent, indent

from sinew.runner.errors import BadInput
from sinew.tasks.model.effect import Effect, in_order

_LAWS = {"fibre": "fiber-exp-pow-linear", "matrix": "isotropic elastic"}
_CONSTANTS = {"beta": "constants.beta", "thickness_mm": "specimen.thickness_mm"}
_INNER = re.compile(r"^( *)\[\[ elastic \]\]$", re.MULTILINE)


def template_with(template: str, effects: tuple[Effect, ...]) -> str:
    """The input template with the partials of ``effects``; their parameters are among its ``parameters``.

    Raises :class:`BadInput` for an effect without a partial, for two that need the same constant or Prony term, and
    for a template in which the place of a partial is not found.
    """
    _check(effects)
    # wrappers that change the fibres' stretch go outside, so that the laws inside get the changed stretch
    chosen = sorted(in_order(effects), key=lambda effect: effect.fibre_stretch is not None)
    for constituent, law in _LAWS.items():
        wrappers = [effect.febio[place] for effect in chosen if (place := f"{constituent}_elastic") in effect.febio]
        memory = [effect.febio[place] for effect in chosen if (place := f"{constituent}_memory") in effect.febio]
        if wrappers or memory:
            template = _edited(template, law, wrappers, memory)
    for place, constant in _CONSTANTS.items():
        for expression in (effect.febio[place] for effect in chosen if place in effect.febio):
            edited = re.sub(rf"(?<![\w.]){re.escape(constant)}\b", f"({expression})", _body(template))
            if edited == _body(template):
                raise BadInput("simulator.template", f"has no {constant}", "a template that uses it")
            template = template.replace(_body(template), edited)
    return template


def fit_together(effects: tuple[Effect, ...]) -> bool:
    """Whether one input can have all of these effects, each of which has a partial."""
    try:
        _check(effects)
    except BadInput:
        return False
    return True


def _check(effects: tuple[Effect, ...]) -> None:
    taken: dict[str, str] = {}
    for effect in effects:
        if not effect.febio:
            raise BadInput(f"effect {effect.slug}", f"not in FEBio: {effect.no_febio}", "simulator: uniaxial")
        for place, partial in effect.febio.items():
            terms = re.findall(r"<(\w+)>", partial) if place.endswith("memory") else [""] * (place in _CONSTANTS)
            for slot in (f"{place} {term}".strip() for term in terms):
                if slot in taken:
                    raise BadInput(f"effects {taken[slot]} and {effect.slug}", f"both need {slot}", "one of them")
                taken[slot] = effect.slug


def _edited(template: str, law: str, wrappers: list[str], memory: list[str]) -> str:
    """The template with one constituent's elastic material wrapped, the first innermost, and Prony terms before it."""
    opening = re.compile(rf'^( *)<elastic type="{law}">$', re.MULTILINE)
    openings = len(opening.findall(template))  # counted first: to look for the end of each takes time squared
    found = None
    if openings == 1:
        found = re.search(rf"{opening.pattern}.*?^\1</elastic>$", template, re.MULTILINE | re.DOTALL)
    if found is None:
        raise BadInput(
            "simulator.template", f"has {openings} <elastic> of type {law}", "exactly one, on lines of its own"
        )
    begin, end = found.span()
    text = dedent(found[0])
    for wrapper in wrappers:
        inner = text
        text = _INNER.sub(lambda slot, inner=inner: indent(inner, slot[1]), wrapper)  # type: ignore[misc]
    return template[:begin] + indent("\n".join([*memory, text]), found[1]) + template[end:]


def _body(template: str) -> str:
    """The template behind the comment that says what a template can use."""
    return template.rpartition("-#}")[2]
