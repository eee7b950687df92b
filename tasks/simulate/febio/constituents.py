"""Fibre and matrix in a FEBio model of the user's own: where they stand, and effects of the library around them.

A study names the material that is the fibre, the matrix, or both. An effect wraps that material, or adds terms to its
Prony series, in the rendered input: no template has to be changed. Materials with an uncoupled volume take FEBio's
uncoupled kinds of the same wrappers.
"""

import re
from collections import Counter
from collections.abc import Iterator, Mapping
from copy import deepcopy
from dataclasses import dataclass
from functools import lru_cache
from typing import Any
from xml.etree.ElementTree import Element, SubElement, fromstring, tostring

import defusedxml.ElementTree

from sinew.tasks.model.effect import Effect, in_order
from sinew.tasks.simulate.febio.units import MILLIMETRES, UNITS, stress_MPa
from sinew.tasks.simulate.row_by_row import Failed

VERSION = 1  # of the inputs that are made here
NAMES = ("fibre", "matrix")
TERMS = 6  # of a Prony series in FEBio, at most
SQUARE = 2.0  # the exponent of the fibres' toe where no effect changes it
MEMORY = ("viscoelastic", "uncoupled viscoelastic")
UNCOUPLED_KINDS = {
    "viscoelastic": "uncoupled viscoelastic",
    "elastic damage": "uncoupled elastic damage",
    "prestrain elastic": "uncoupled prestrain elastic",
}
#: Uncoupled materials of FEBio 4 whose names do not say so.
UNCOUPLED = {
    *("2D trans iso Mooney-Rivlin", "Arruda-Boyce", "EFD Mooney-Rivlin", "EFD Veronda-Westmann", "Fung orthotropic"),
    *(
        "Gent",
        "HGO-coronary",
        "Holzapfel-Gasser-Ogden",
        "Mooney-Rivlin",
        "Mooney-Rivlin AD",
        "Ogden",
        "Veronda-Westmann",
    ),
    *("Mooney-Rivlin von Mises Fibers", "TC nonlinear orthotropic", "Yeoh", "incomp neo-Hookean", "muscle material"),
    *("tendon material", "trans iso MR-Estrada", "trans iso Mooney-Rivlin", "trans iso Veronda-Westmann"),
}
SAME_IN_ONE = {"fluid-flow": "relaxation-mode"}  # one law, where fibre and matrix are one material


@dataclass(frozen=True)
class Constituent:
    """A material that an effect can be put around.

    ``path``: where it stands, such as ``tendon.solid[2].elastic``. ``law``: FEBio's type of it. ``free_terms``: of the
    Prony series around it, all of them where there is none. ``exponent``: of its toe, the number in ``<beta>`` if it
    has one that does not vary. ``modulus``: whether it has a Young's modulus ``<E>``. ``directed``: whether it has
    fibres along ``<fiber>``. ``stress_MPa``: the model's unit of stress.
    """

    path: str
    law: str
    uncoupled: bool
    free_terms: int
    exponent: float | None
    modulus: bool
    directed: bool
    stress_MPa: float


class NoMaterial(Exception):
    """There is no material at a path; holds those that there are."""


class NoUnits(Exception):
    """The model's system of units is not known; holds its name."""


# ---- where they stand


def located(texts: list[str], path: str) -> Constituent:
    """The material at ``path`` of an input, which was rendered with several parameter sets.

    Raises :class:`NoMaterial` and :class:`NoUnits`.
    """
    places = []
    for text in texts:
        root = _root(text)
        every = dict(_materials(root))
        if (system := root.findtext("Module/units", "").strip() or MILLIMETRES) not in UNITS:
            raise NoUnits(system)
        if path not in every:
            raise NoMaterial(*sorted(every))
        inner, place = _elastic(path, every[path])
        places.append(place)
    first = places[0]
    exponents = {_number(place.element.findtext("beta")) for place in places}
    return Constituent(
        inner,
        first.element.get("type", ""),
        first.uncoupled,
        TERMS if first.series is None else len(_free_terms(first.series)),
        exponents.pop() if len(exponents) == 1 else None,
        all(_number(place.element.findtext("E")) is not None for place in places),
        first.element.find("fiber") is not None,
        stress_MPa(system),
    )


@dataclass(frozen=True)
class _Place:
    """A material in an input, and the materials that it is a part of, the outermost first."""

    element: Element
    around: tuple[Element, ...]

    @property
    def series(self) -> Element | None:
        """The viscoelastic material whose elastic part this is."""
        outer = self.around[-1] if self.around else None
        return outer if outer is not None and outer.get("type") in MEMORY else None

    @property
    def uncoupled(self) -> bool:
        return any(
            "uncoupled" in (law := one.get("type", "")) or law in UNCOUPLED for one in (*self.around, self.element)
        )


def _free_terms(series: Element) -> list[int]:
    """Numbers of the terms that a Prony series does not have."""
    has = {child.tag for child in series}
    return [number for number in range(1, TERMS + 1) if not {f"g{number}", f"t{number}"} & has]


def _root(text: str) -> Element:
    root: Element = defusedxml.ElementTree.fromstring(text.encode(), forbid_dtd=True)
    return root


def _materials(root: Element) -> Iterator[tuple[str, _Place]]:
    """Everything with a type in the section of materials, with its path."""
    section = root.find("Material")
    materials = [] if section is None else section.findall("material")
    names = [one.get("name") or f"material{one.get('id', '')}" for one in materials]
    count, seen = Counter(names), Counter[str]()
    for name, one in zip(names, materials, strict=True):
        seen[name] += 1
        yield from _inside(name if count[name] == 1 else f"{name}[{seen[name]}]", _Place(one, ()))


def _inside(path: str, place: _Place) -> Iterator[tuple[str, _Place]]:
    if place.element.get("type") is None:
        return
    yield path, place
    tags, seen = Counter(child.tag for child in place.element), Counter[str]()
    for child in place.element:
        seen[child.tag] += 1
        step = child.tag if tags[child.tag] == 1 else f"{child.tag}[{seen[child.tag]}]"
        yield from _inside(f"{path}.{step}", _Place(child, (*place.around, place.element)))


def _elastic(path: str, place: _Place) -> tuple[str, _Place]:
    """The elastic part of a material that relaxes, and its path; any other material itself."""
    inner = place.element.find("elastic")
    if place.element.get("type") not in MEMORY or inner is None:
        return path, place
    return _elastic(f"{path}.elastic", _Place(inner, (*place.around, place.element)))


def _number(text: str | None) -> float | None:
    try:
        return None if text is None else float(text)
    except ValueError:
        return None


# ---- which effects they can have


def why_not(effect: Effect, found: Mapping[str, Constituent], settles: bool) -> str | None:
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
        name = "fibre" if place == "beta" else place.partition("_")[0]
        if name not in found:
            return f"simulator.{name} does not say which material is the {name}"
        if problem := _problem(place, partial, found[name]):
            return f"{found[name].path} ({found[name].law}) {problem}"
    if "parameters.E_m" in "".join(effect.febio.values()) and not found["matrix"].modulus:
        return f"{found['matrix'].path} ({found['matrix'].law}) has no modulus E"
    return None


def _problem(place: str, partial: str, one: Constituent) -> str | None:
    if place == "beta":
        return None if one.exponent == SQUARE else f"has no exponent beta that stays {SQUARE:g}"
    if place.endswith("memory"):
        return None if one.free_terms else f"has {TERMS} relaxation times already, FEBio's most"
    kind = _kind_of(partial)
    if one.uncoupled and kind not in UNCOUPLED_KINDS:
        return f"is uncoupled, and FEBio's {kind} is not"
    if kind == "prestrain elastic" and not one.directed:
        return "has no fibres along a direction"
    return None


def _kind_of(partial: str) -> str:
    found = re.match(r'<elastic type="([^"]+)">', partial)
    assert found is not None, "a partial of the library"
    return found[1]


# ---- inputs with effects


def with_effects(
    text: str, found: Mapping[str, Constituent], effects: tuple[Effect, ...], parameters: Mapping[str, float]
) -> str:
    """The input ``text`` with ``effects`` around its constituents, at the effects' ``parameters``.

    Raises :class:`Failed` where these parameters make another input than the template's reference.
    """
    root = _root(text)
    places = dict(_materials(root))
    missing = [one.path for one in found.values() if one.path not in places]
    if missing:
        raise Failed("bad_input", f"there is no material {missing[0]} with these parameters")
    at = {name: places[one.path] for name, one in found.items()}
    unit = next(iter(found.values())).stress_MPa
    values = {one.name: parameters[one.name] / _in_MPa(one.unit, unit) for each in effects for one in each.parameters}
    if "matrix" in at and (modulus := _number(at["matrix"].element.findtext("E"))) is not None:
        values["E_m"] = modulus
    # wrappers that change the fibres' stretch go outside, so that the laws inside get the changed stretch
    chosen = sorted(in_order(effects), key=lambda effect: effect.fibre_stretch is not None)
    partials = [(place, partial) for effect in chosen for place, partial in effect.febio.items()]
    for place, partial in partials:
        if place == "beta":
            _set_exponent(at["fibre"].element, _rendered(f"{{{{ {partial} | full }}}}", values))
    for place, partial in partials:
        if place.endswith("_elastic"):
            _wrap(at[place.removesuffix("_elastic")], _element(_rendered(partial, values)))
    for place, partial in partials:  # around the wrappers, if there is no series yet
        if place.endswith("_memory"):
            _remember(at[place.removesuffix("_memory")], _element(f"<terms>{_rendered(partial, values)}</terms>"))
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + tostring(root, encoding="unicode") + "\n"


def _in_MPa(unit: str, stress_MPa: float) -> float:
    """What one of the model's own units is in ``unit``, which may have a stress in it."""
    stresses = {"MPa": stress_MPa, "MPa s": stress_MPa, "MPa^0.5": stress_MPa**0.5}
    assert unit in stresses or "MPa" not in unit, "a unit of an effect that has a partial"
    return stresses.get(unit, 1.0)


def _set_exponent(element: Element, text: str) -> None:
    exponent = element.find("beta")
    assert exponent is not None, "checked when the study was read"
    exponent.text = text


def _wrap(place: _Place, wrapper: Element) -> None:
    """Put ``wrapper`` around a material, which stands where the wrapper says ``<inner/>``."""
    outer = place.element
    inner = Element("elastic", {"type": outer.get("type", "")})
    inner.text, inner[:] = outer.text, list(outer)
    kind = wrapper.get("type", "")
    outer[:] = [inner if child.tag == "inner" else child for child in wrapper]
    outer.set("type", UNCOUPLED_KINDS[kind] if place.uncoupled else kind)
    if outer.tag == "material" and (density := inner.find("density")) is not None:
        outer.append(deepcopy(density))  # of the whole, for a body force


def _remember(place: _Place, terms: Element) -> None:
    """Add terms to the Prony series around a material, or put one around it."""
    if place.series is None and place.element.get("type") not in MEMORY:
        _wrap(place, _element('<elastic type="viscoelastic"><inner/></elastic>'))
    series = place.series if place.series is not None else place.element
    free = _free_terms(series)
    if not free:
        raise Failed("bad_input", f"the effects need more than {TERMS} relaxation times, FEBio's most")
    for number, term in enumerate(terms):
        SubElement(series, f"{term.tag[0]}{free[number // 2]}").text = term.text


def _element(text: str) -> Element:
    return fromstring(text.replace("[[ elastic ]]", "<inner/>"))  # noqa: S314 - a partial of the library, with numbers


def _rendered(partial: str, parameters: Mapping[str, float]) -> str:
    return str(_template(partial).render(parameters=dict(parameters)))


@lru_cache(64)
def _template(partial: str) -> Any:
    from sinew.tasks.simulate.febio.rendering import environment  # Jinja2 is slow to import

    return environment({"partial": partial}).get_template("partial")
