"""Effects of the library inside a FEBio model of the user's own: which it can have, and its input with them.

An effect wraps the material that is the fibre or the matrix, or adds terms to its Prony series, in the rendered input:
no template has to be changed. Materials whose volume is uncoupled take FEBio's uncoupled kinds of the same wrappers. A
wrapper that FEBio takes and ignores is found by running it, see :mod:`sinew.tasks.discover.fit.acting`.
"""

import re
from collections import Counter
from collections.abc import Mapping
from copy import deepcopy
from functools import lru_cache
from typing import Any
from xml.etree.ElementTree import Element, SubElement, fromstring

import numpy as np

from sinew.tasks.model.effect import Effect, in_order
from sinew.tasks.simulate.febio.constituents import (
    MEMORY,
    TERMS,
    Constituent,
    Place,
    direction_of,
    free_terms_of,
    number_in,
    places_at,
)
from sinew.tasks.simulate.febio.input_text import as_text, parsed
from sinew.tasks.simulate.row_by_row import Failed

VERSION = 1  # of the inputs that are made here
SQUARE = 2.0  # the exponent of the fibres' toe where no effect changes it
UNCOUPLED_KINDS = {
    "viscoelastic": "uncoupled viscoelastic",
    "elastic damage": "uncoupled elastic damage",
    "prestrain elastic": "uncoupled prestrain elastic",
}
VOLUME = ("k", "pressure_model")  # of uncoupled materials: FEBio takes them from the outermost, and no others
SAME_IN_ONE = {"fluid-flow": "relaxation-mode"}  # one law, where fibre and matrix are one material


# ---- which effects they can have


def why_not(effect: Effect, found: Mapping[str, Constituent], *, settles: bool) -> str | None:
    """Why a model with these constituents, by name, cannot have an effect inside; None where it can.

    ``settles``: the solver waits until what is loaded at rest has relaxed.
    """
    if not effect.febio or "thickness_mm" in effect.febio:
        return effect.no_febio or "it acts around the specimen"
    if effect.loaded_at_rest and not settles:
        return "simulator.settle_s does not say how long it takes to relax at rest"
    one = len({constituent.path for constituent in found.values()}) < len(found)
    if one and effect.slug in SAME_IN_ONE:
        return f"in a single material it is {SAME_IN_ONE[effect.slug]}"
    for place, partial in effect.febio.items():
        name = constituent_of(place)
        if name not in found:
            return f"simulator.{name} does not say which material is the {name}"
        if problem := _problem(place, partial, found[name]):
            return f"{found[name].path} ({found[name].law}) {problem}"
    return None


def constituent_of(place: str) -> str:
    """The constituent that a partial at ``place`` acts on."""
    return "fibre" if place == "beta" else place.partition("_")[0]


def _problem(place: str, partial: str, one: Constituent) -> str | None:
    if place == "beta":
        return None if one.exponent == SQUARE else f"has no exponent beta that stays {SQUARE:g}"
    memory = place.endswith("memory")
    if memory and not one.free_terms:
        return f"has {TERMS} relaxation times already, FEBio's most"
    if "parameters.E_m" in partial and not one.modulus:
        return "has no modulus E"
    if one.mapped and not (memory and one.in_series):
        return "has directions for each element (ElementData), which FEBio does not find behind another material"
    kind = "" if memory else _kind_of(partial)
    if one.uncoupled and not memory and kind not in UNCOUPLED_KINDS:
        return f"is uncoupled, and FEBio's {kind} is not"
    if kind == "prestrain elastic" and not one.directed:
        return "has no fibres along a direction"
    return None


def used(effects: tuple[Effect, ...]) -> set[str]:
    """The constituents that effects act on."""
    return {constituent_of(place) for effect in effects for place in effect.febio}


def fit_together(effects: tuple[Effect, ...], found: Mapping[str, Constituent]) -> bool:
    """Whether one input can have all of these effects, each of which it can have."""
    partials = [partial for effect in effects for partial in effect.febio.items()]
    every = [(found[constituent_of(place)], place, partial) for place, partial in partials]
    terms = Counter(one.path for one, place, _ in every if place.endswith("memory"))
    wrappers = [(one, _kind_of(partial)) for one, place, partial in every if place.endswith("elastic")]
    wrapped = Counter(one.path for one, _ in wrappers)
    # FEBio looks for fibres that are not straight right behind the material that stretches them
    curved = [one.path for one, kind in wrappers if kind == "prestrain elastic" and not one.straight]
    return all(terms[one.path] <= one.free_terms for one, _, _ in every) and all(wrapped[path] < 2 for path in curved)


def _kind_of(partial: str) -> str:
    found = re.match(r'<elastic type="([^"]+)">', partial)
    assert found is not None, "a partial of the library"
    return found[1]


# ---- inputs with effects


def with_effects(
    text: str, found: Mapping[str, Constituent], effects: tuple[Effect, ...], parameters: Mapping[str, float]
) -> str:
    """The input ``text`` with ``effects`` around its constituents, at the effects' ``parameters``.

    Raises :class:`Failed` where these parameters make another input than those that it was looked at with.
    """
    root = parsed(text)
    at: dict[str, Place] = {}
    for name in sorted(used(effects)):
        one = found[name]
        places = list(places_at(root, one.path))
        if len(places) != 1:
            raise Failed("bad_input", f"there is no material {one.path} with these parameters")
        at[name] = places[0]
    unit = next(iter(found.values())).stress_MPa
    values = {one.name: parameters[one.name] / _in_MPa(one.unit, unit) for each in effects for one in each.parameters}
    # wrappers that change the fibres' stretch go outside, so that the laws inside get the changed stretch
    chosen = sorted(in_order(effects), key=lambda effect: effect.fibre_stretch is not None)
    partials = [(at[constituent_of(place)], place, each.febio[place]) for each in chosen for place in each.febio]
    if any("parameters.E_m" in partial for _, _, partial in partials):
        values["E_m"] = _modulus(at["matrix"].element)
    for place, where, partial in partials:
        if where == "beta":
            _set_exponent(place.element, _rendered(f"{{{{ {partial} | full }}}}", values))
    for place, where, partial in partials:
        if where.endswith("elastic"):
            _wrap(place, _element(_rendered(partial, values)))
    for place, where, partial in partials:  # around the wrappers, if there is no series yet
        if where.endswith("memory"):
            _remember(place, _element(f"<terms>{_rendered(partial, values)}</terms>"))
    return as_text(root)


def _in_MPa(unit: str, stress_MPa: float) -> float:
    """What one of the model's own units is in ``unit``, which may have a stress in it."""
    stresses = {"MPa": stress_MPa, "MPa s": stress_MPa, "MPa^0.5": stress_MPa**0.5}
    assert unit in stresses or "MPa" not in unit, "a unit of an effect that has a partial"
    return stresses.get(unit, 1.0)


def _modulus(element: Element) -> float:
    modulus = number_in(element.find("E"))
    if modulus is None or modulus <= 0.0:
        raise Failed("bad_input", "the matrix has no modulus E above 0 with these parameters")
    return modulus


def _set_exponent(element: Element, text: str) -> None:
    exponent = element.find("beta")
    if exponent is None or number_in(exponent) != SQUARE:
        raise Failed("bad_input", f"the fibre has no exponent beta of {SQUARE:g} with these parameters")
    exponent.text = text


def _wrap(place: Place, wrapper: Element) -> None:
    """Put ``wrapper`` around a material, which stands where the wrapper says ``<inner/>``."""
    outer, uncoupled, along = place.element, place.uncoupled, _direction_inside(place)
    inner = Element("elastic", {"type": outer.get("type", "")})
    inner.text, inner[:] = outer.text, list(outer)
    kind = wrapper.get("type", "")
    outer[:] = [inner if child.tag == "inner" else child for child in wrapper]
    outer.set("type", UNCOUPLED_KINDS[kind] if uncoupled else kind)
    if outer.tag == "material" and (density := inner.find("density")) is not None:
        outer.append(deepcopy(density))  # of the whole, for a body force
    for child in [child for child in inner if uncoupled and child.tag in VOLUME]:
        inner.remove(child)
        outer.append(child)
    for stretched in outer.findall("prestrain"):
        _turn(stretched, along)


def _direction_inside(place: Place) -> tuple[float, ...] | None:
    """The direction of the straight fibres of a material, also where effects wrapped it before."""
    around, element = place.around, place.element
    while element.find("fiber") is None and (inner := element.find("elastic")) is not None:
        around, element = (*around, element), inner
    return direction_of(Place(element, around))


def _turn(stretched: Element, along: tuple[float, ...] | None) -> None:
    """Turn a stretch along z, as the library has it, to the straight fibres of this model; FEBio finds others."""
    gradient = stretched.find("F0")
    assert gradient is not None, "a partial of the library"
    assert gradient.text is not None
    stretch = float(gradient.text.split(",")[-1])
    if along is not None:
        turned = np.eye(3) + (stretch - 1.0) * np.outer(along, along)
        gradient.text = ",".join(repr(value) for value in turned.ravel().tolist())
        return
    stretched.clear()
    stretched.set("type", "in-situ stretch")
    SubElement(stretched, "stretch").text = repr(stretch)
    SubElement(stretched, "isochoric").text = "0"


def _remember(place: Place, terms: Element) -> None:
    """Add terms to the Prony series around a material, or put one around it."""
    if place.series is None and place.element.get("type") not in MEMORY:
        _wrap(place, _element('<elastic type="viscoelastic"><inner/></elastic>'))
    series = place.series if place.series is not None else place.element
    free = free_terms_of(series)
    if 2 * len(free) < len(terms):
        raise Failed("bad_input", f"the effects need more than {TERMS} relaxation times, FEBio's most")
    for number, term in enumerate(terms):
        SubElement(series, f"{term.tag[0]}{free[number // 2]}").text = term.text


def _element(text: str) -> Element:
    return fromstring(text.replace("[[ elastic ]]", "<inner/>"))  # noqa: S314 - a partial of the library, with numbers


def _rendered(partial: str, parameters: Mapping[str, float]) -> str:
    return str(_template(partial).render(parameters=dict(parameters)))


@lru_cache(64)
def _template(partial: str) -> Any:
    from sinew.tasks.simulate.febio.rendering.sandbox import environment  # Jinja2 is slow to import

    return environment({"partial": partial}).get_template("partial")
