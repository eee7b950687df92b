"""Fibre and matrix in a FEBio model of the user's own: where these materials stand, and what they are.

A name is the way to a material in the rendered input, such as ``tendon.solid[2].elastic``.
"""

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from xml.etree.ElementTree import Element

import numpy as np

from sinew.tasks.simulate.febio.input_text import parsed
from sinew.tasks.simulate.febio.model_file.contents import NUMBER, PARTS, numbered
from sinew.tasks.simulate.febio.units import MILLIMETRES, UNITS, stress_MPa

NAMES = ("fibre", "matrix")
TERMS = 6  # of a Prony series in FEBio, at most
MEMORY = ("viscoelastic", "uncoupled viscoelastic")
MOST_LISTED, LONGEST = 20, 60  # materials of a message, and the letters of each
#: Uncoupled materials of FEBio 4 whose names do not say so.
UNCOUPLED = {
    *("2D trans iso Mooney-Rivlin", "2D trans iso Veronda-Westmann", "Arruda-Boyce", "EFD Mooney-Rivlin"),
    *("EFD Veronda-Westmann", "Fung orthotropic", "Gent", "HGO-coronary", "Holzapfel-Gasser-Ogden", "Mooney-Rivlin"),
    *("Mooney-Rivlin AD", "Mooney-Rivlin von Mises Fibers", "Ogden", "TC nonlinear orthotropic", "Veronda-Westmann"),
    *("Yeoh", "damage Mooney-Rivlin", "damage trans iso Mooney-Rivlin", "incomp neo-Hookean", "muscle material"),
    *("tendon material", "trans iso MR-Estrada", "trans iso Mooney-Rivlin", "trans iso Veronda-Westmann"),
}
_STEP = re.compile(rf"({'|'.join(PARTS)})(?:\[(\d{{1,4}})\])?")


@dataclass(frozen=True)
class Constituent:
    """A material that an effect can be put around.

    ``path``: where it stands, such as ``tendon.solid[2].elastic``. ``law``: FEBio's type of it. ``free_terms``: of the
    Prony series around it, all of them where there is none (``in_series`` tells). ``exponent``: of its toe, the number
    in ``<beta>`` if that does not vary. ``modulus``: whether it has a Young's modulus ``<E>``. ``directed``: whether
    it has fibres along ``<fiber>``; ``straight``: along one direction of the whole model. ``mapped``: directions are
    given element by element, by the way to the material. ``stress_MPa``: the model's unit of stress.
    """

    path: str
    law: str
    uncoupled: bool
    free_terms: int
    in_series: bool
    exponent: float | None
    modulus: bool
    directed: bool
    straight: bool
    mapped: bool
    stress_MPa: float


class NotFound(Exception):
    """There is no such material, or the model's units are not known: the problem, and what was expected."""


# ---- where they stand


def located(texts: list[str], path: str) -> Constituent:
    """The material at ``path`` of an input, which was rendered with several parameter sets.

    Of a material that relaxes, its elastic part. Raises :class:`NotFound`.
    """
    places = []
    for text in texts:
        root = parsed(text)
        if (system := root.findtext("Module/units", "").strip() or MILLIMETRES) not in UNITS:
            raise NotFound(f"units {system[:LONGEST]!r} are not known", f"one of {', '.join(UNITS)}")
        found = list(places_at(root, path))
        if len(found) != 1:
            problem = f"{'no material' if not found else 'several materials'} {path[:LONGEST]!r}"
            raise NotFound(problem, f"one of {', '.join(_listed(root))}")
        inner, place = _elastic(path, found[0])
        places.append(place)
    first = places[0]
    exponents = {number_in(place.element.find("beta")) for place in places}
    directions = {direction_of(place) for place in places}
    return Constituent(
        inner,
        first.element.get("type", ""),
        first.uncoupled,
        TERMS if first.series is None else len(free_terms_of(first.series)),
        first.series is not None,
        exponents.pop() if len(exponents) == 1 else None,
        all((number_in(place.element.find("E")) or 0.0) > 0.0 for place in places),
        first.element.find("fiber") is not None,
        directions != {None} and len(directions) == 1,
        any(part.get("type", "").rpartition(".")[2] in ("fiber", "mat_axis") for part in root.iter("ElementData")),
        stress_MPa(system),
    )


@dataclass(frozen=True)
class Place:
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
        every = [one.get("type", "") for one in (*self.around, self.element)]
        return any("uncoupled" in law or law in UNCOUPLED for law in every)


def free_terms_of(series: Element) -> list[int]:
    """Numbers of the terms that a Prony series does not have."""
    has = {child.tag for child in series}
    return [number for number in range(1, TERMS + 1) if not {f"g{number}", f"t{number}"} & has]


def _labelled(root: Element) -> Iterator[tuple[str, Element]]:
    """The materials of an input, each with a name of its own."""
    section = root.find("Material")
    materials = [] if section is None else section.findall("material")
    names = [one.get("name", "").strip() or f"material{one.get('id', '')}" for one in materials]
    yield from zip(numbered(names), materials, strict=True)


def places_at(root: Element, path: str) -> Iterator[Place]:
    """The materials that ``path`` stands for: one, unless names are such that there are more."""
    for label, material in _labelled(root):
        if path == label:
            found = _down(Place(material, ()), [])
        elif path.startswith(f"{label}."):
            found = _down(Place(material, ()), path[len(label) + 1 :].split("."))
        else:
            continue
        if found is not None:
            yield found


def _down(place: Place, steps: list[str]) -> Place | None:
    for step in steps:
        match = _STEP.fullmatch(step)
        inside = place.element.findall(match[1]) if match else []
        number = int(match[2]) if match and match[2] else 1
        if match is None or not 0 < number <= len(inside) or (match[2] is None and len(inside) > 1):
            return None
        place = Place(inside[number - 1], (*place.around, place.element))
    return place if place.element.get("type") else None


def _listed(root: Element) -> list[str]:
    """The first materials of an input, by their paths."""
    found: list[str] = []
    waiting = [(label[:LONGEST], material) for label, material in _labelled(root)]
    while waiting and len(found) < MOST_LISTED:
        path, element = waiting.pop(0)
        found += [path] if element.get("type") else []
        for tag in PARTS:
            inside = element.findall(tag)[:MOST_LISTED]
            ways = [tag] if len(inside) == 1 else [f"{tag}[{i}]" for i in range(1, len(inside) + 1)]
            waiting += [(f"{path}.{way}", one) for way, one in zip(ways, inside, strict=True)]
    return found or ["none, as there is none"]


def _elastic(path: str, place: Place) -> tuple[str, Place]:
    """The elastic part of a material that relaxes, and its path; any other material itself."""
    while place.element.get("type") in MEMORY and (inner := place.element.find("elastic")) is not None:
        path, place = f"{path}.elastic", Place(inner, (*place.around, place.element))
    return path, place


def number_in(element: Element | None) -> float | None:
    """The number in an element, if it is one that stays as it is."""
    if element is None or "lc" in element.attrib or element.get("type", "const") != "const":
        return None
    text = (element.text or "").strip()
    return float(text) if re.fullmatch(NUMBER, text) and math.isfinite(float(text)) else None


def direction_of(place: Place) -> tuple[float, ...] | None:
    """The direction of straight fibres in the axes of the model, of length 1; None where it may vary in space."""
    fiber = place.element.find("fiber")
    turned = any(one.find("mat_axis") is not None for one in (*place.around, place.element))
    if fiber is None or turned or fiber.get("type", "vector") != "vector" or "lc" in fiber.attrib:
        return None
    texts = [part.strip() for part in (fiber.text or "").split(",")]
    if len(texts) != 3 or not all(re.fullmatch(NUMBER, text) for text in texts):
        return None
    along = np.array([float(text) for text in texts])
    size = float(np.linalg.norm(along))
    return tuple((along / size).tolist()) if 0.0 < size < math.inf else None
