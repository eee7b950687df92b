"""What a FEBio model holds: numbers that can vary, displacements that can follow a measured one, and its sets."""

import math
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from xml.etree.ElementTree import Element as MeshElement

import defusedxml.ElementTree

from sinew.runner.errors import BadInput, shown
from sinew.tasks.simulate.febio.model_file.source import Element, Source

SECTIONS = ("Globals", "Initial", "Boundary", "Rigid", "Loads", "Contact", "Constraints", "Discrete")
STEPS = ("Step", "step")
PARTS = ("material", "solid", "elastic")  # elements of a material that are materials themselves
NUMBER = r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?"  # one way to read each text: matching takes linear time
_NUMBERS = re.compile(rf"\s*{NUMBER}\s*(?:,\s*{NUMBER}\s*)*")
_AXES = ("x", "y", "z")
_LONGEST = 1000  # bytes of a list of numbers that can vary: a tensor of fourth order has 21
MOST_CHARACTERS, MOST_NUMBERS = 2**25, 200_000  # of the paths of all numbers, and of the numbers


@dataclass(frozen=True)
class Number:
    """A number of the model: its path, such as ``tendon.E``, its value and where it stands (bytes of the text)."""

    path: str
    value: float
    start: int
    end: int


@dataclass(frozen=True)
class Moved:
    """A prescribed displacement: of a set of nodes, or of the rigid body of a material (``rigid``).

    ``factor``, of the load controller ``controller``, stands in the element ``value``; ``axis``: x, y or z.
    """

    name: str
    target: str
    rigid: bool
    axis: str
    factor: float
    controller: int
    value: Element


@dataclass(frozen=True)
class Material:
    """A material, or a part of one: its path, such as ``tendon.solid[2].elastic``, and FEBio's type of it.

    ``elementary``: it has no other material inside.
    """

    path: str
    law: str
    elementary: bool


@dataclass(frozen=True)
class Sets:
    """Names that an output can be of. A surface stands for its nodes."""

    nodes: tuple[str, ...]
    elements: tuple[str, ...]
    surfaces: tuple[str, ...]
    rigid: tuple[str, ...]


@dataclass(frozen=True)
class Contents:
    """What a model holds. ``materials`` and ``others``: numbers in materials, and in loads and other sections.

    ``texts``: parts of materials that are no numbers (maps, formulas, options), which cannot vary. ``laws``: the
    materials themselves, but those of rigid bodies.
    """

    materials: tuple[Number, ...]
    others: tuple[Number, ...]
    texts: tuple[str, ...]
    moved: tuple[Moved, ...]
    sets: Sets
    laws: tuple[Material, ...] = ()

    @property
    def numbers(self) -> Mapping[str, Number]:
        """All numbers by path."""
        return {one.path: one for one in (*self.others, *self.materials)}


def contents_of(source: Source) -> Contents:
    """What a model holds. Raises :class:`BadInput` for a model without materials."""
    section = source.section("Material")
    materials = list(section.all("material")) if section is not None else []
    if not materials:
        raise BadInput(source.path, "has no material", "a FEBio model with a Material section")
    numbers: list[Number] = []
    texts: list[str] = []
    leaves = (leaf for name, material in _named(materials, "material") for leaf in _leaves(name, material))
    for path, element in _few(source, leaves):
        found = list(_numbers(source, path, element))
        numbers += found
        if not found and element.text:
            texts.append(f"{path} ({element.text[:40]})")
    leaves = (
        leaf
        for prefix, parent in _parents(source)
        for part in parent.all(*SECTIONS)
        for name, one in _named(part.children, "")
        for leaf in _leaves(f"{prefix}{part.tag}.{name}", one)
    )
    others = [number for path, leaf in _few(source, leaves) for number in _numbers(source, path, leaf)]
    laws = tuple(law for name, material in _named(materials, "material") for law in _laws(name, material))
    return Contents(tuple(numbers), tuple(others), tuple(texts), tuple(_moved(source)), _sets(source, materials), laws)


# ---- materials


def _laws(path: str, element: Element) -> Iterator[Material]:
    """The material of an element and those inside it."""
    law = element.attributes.get("type", "")
    if not law or law == "rigid body":
        return
    inside = [one for step, child in _steps(element) if child.tag in PARTS for one in _laws(f"{path}.{step}", child)]
    yield Material(path, law, not inside)
    yield from inside


def fibre_and_matrix(laws: tuple[Material, ...]) -> dict[str, Material]:
    """The materials that are the fibre and the matrix, as far as that is certain.

    The only fibre material is the fibre, and the only other elementary one the matrix. A single one is both.
    """
    elementary = [one for one in laws if one.elementary]
    if len(elementary) == 1:
        return {"fibre": elementary[0], "matrix": elementary[0]}
    fibres = [one for one in elementary if "fiber" in one.law]
    others = [one for one in elementary if "fiber" not in one.law]
    found = {"fibre": fibres, "matrix": others}
    return {name: each[0] for name, each in found.items() if len(each) == 1 and len(fibres) == 1}


# ---- numbers


def _named(elements: list[Element], kind: str) -> Iterator[tuple[str, Element]]:
    """Elements, each with a name of its own: its name, else its tag and number."""
    names = [one.name or f"{kind or one.tag}{one.attributes.get('id', '')}" for one in elements]
    yield from zip(numbered(names), elements, strict=True)


def numbered(names: Sequence[str]) -> Iterator[str]:
    """The names, each with its number where several are the same: ``solid[1]``, ``solid[2]``."""
    count, seen = Counter(names), Counter[str]()
    for name in names:
        seen[name] += 1
        yield name if count[name] == 1 else f"{name}[{seen[name]}]"


def _leaves(path: str, element: Element) -> Iterator[tuple[str, Element]]:
    """The elements without children inside ``element``, with their paths; an element without children is itself one."""
    if not element.children:
        yield path, element
    for step, child in _steps(element):
        yield from _leaves(f"{path}.{step}", child)


def _steps(element: Element) -> Iterator[tuple[str, Element]]:
    """The children of an element, each with its tag, and its number where several have it."""
    yield from zip(numbered([child.tag for child in element.children]), element.children, strict=True)


def _few(source: Source, leaves: Iterator[tuple[str, Element]]) -> Iterator[tuple[str, Element]]:
    """The same leaves. Raises :class:`BadInput` where the paths of their numbers would fill the memory."""
    left, numbers = MOST_CHARACTERS, MOST_NUMBERS
    for path, element in leaves:
        count = 1 + element.text[:_LONGEST].count(",")
        left, numbers = left - len(path) * count, numbers - count
        if left < 0 or numbers < 0:
            raise BadInput(source.path, "has too many numbers beside its mesh, or names that are too long", "fewer")
        yield path, element


def _numbers(source: Source, path: str, element: Element) -> Iterator[Number]:
    """The number that an element holds, or each number of its list."""
    if element.inside is None:
        return
    begin, end = element.inside
    if end - begin > _LONGEST:
        return
    text = source.text[begin:end].decode()
    if not text.isascii() or not _NUMBERS.fullmatch(text):
        return
    found = list(re.finditer(NUMBER, text))
    for i, match in enumerate(found, 1):
        if math.isfinite(value := float(match[0])):
            place = f"{path}[{i}]" if len(found) > 1 else path
            yield Number(place, value, begin + match.start(), begin + match.end())


def _parents(source: Source) -> Iterator[tuple[str, Element]]:
    """What can hold loads and boundary conditions: the model, and each of its steps."""
    yield "", source.root
    for section in source.root.all("Step"):
        for name, step in _named(list(section.all("step")), "step"):
            yield f"Step.{name}.", step


# ---- displacements


def _moved(source: Source) -> Iterator[Moved]:
    """Displacements of one direction that follow a load controller, in a model without steps."""
    boundary, rigid = source.section("Boundary"), source.section("Rigid")
    for one in boundary.children if boundary is not None else ():
        if (one.tag, one.attributes.get("type")) in (("bc", "prescribed displacement"), ("bc", "prescribe")):
            yield from _one_moved(source, one, one.attributes.get("node_set", ""), rigid=False)
    for one in rigid.children if rigid is not None else ():
        kinds = (("rigid_bc", "rigid_displacement"), ("rigid_constraint", "prescribe"))
        if (one.tag, one.attributes.get("type")) in kinds:
            body = one.find("rb")
            yield from _one_moved(source, one, body.text if body is not None else "", rigid=True)


def _one_moved(source: Source, one: Element, target: str, *, rigid: bool) -> Iterator[Moved]:
    direction = one.find("dof")
    value = one.find("value") or one.find("scale")
    axis = direction.text.removeprefix("R") if direction is not None else ""
    if value is None or axis not in _AXES or not target:
        return
    numbers = list(_numbers(source, one.name, value))
    controller = value.attributes.get("lc", "")
    if len(numbers) == 1 and is_id(controller) and one.name:
        yield Moved(one.name, target, rigid, axis, numbers[0].value, int(controller), value)


# ---- sets


def is_id(text: str) -> bool:
    """Whether a text is the number of a node, an element or a load controller."""
    return text.isdecimal() and len(text) < 12


def _sets(source: Source, materials: list[Element]) -> Sets:
    parts = source.mesh.children if source.mesh is not None else []

    def names(*tags: str) -> tuple[str, ...]:
        return tuple(dict.fromkeys(part.name for part in parts if part.tag in tags and part.name))

    rigid = tuple(one.name for one in materials if one.attributes.get("type") == "rigid body" and one.name)
    return Sets(names("Nodes", "NodeSet"), names("Elements", "ElementSet"), names("Surface"), rigid)


def nodes_of_surface(source: Source, name: str) -> list[int]:
    """The nodes of a surface, each once, in increasing order. Raises :class:`BadInput`."""
    assert source.mesh is not None, "it has a surface"
    surface = next(part for part in source.mesh.all("Surface") if part.name == name)
    facets: MeshElement = defusedxml.ElementTree.fromstring(source.text[surface.start : surface.end], forbid_dtd=True)
    numbers = [part.strip() for facet in facets for part in (facet.text or "").split(",")]
    if not numbers or not all(is_id(number) for number in numbers):
        raise BadInput(source.path, f"the facets of surface {shown(name)} cannot be read", "numbers of nodes")
    return sorted({int(number) for number in numbers})
