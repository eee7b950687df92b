"""What a person says of a FEBio model: which numbers vary, what is moved, and what is measured."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches

from sinew.runner.errors import BadInput, shown
from sinew.tasks.simulate.febio.model_file.contents import Contents, Material, Moved, Number, fibre_and_matrix
from sinew.tasks.simulate.febio.settings import IDENTIFIER, OF_THE_STORE
from sinew.tasks.simulate.febio.variables import TAKEN

COMPARED = 10_000  # names that are compared with an unknown one
REDUCTIONS = ("sum", "mean", "max", "min")
POISSON = re.compile(r"(.*\.)?(v|nu|v12|v23|v31)")
_MEASURE = re.compile(r"(?P<name>[^=@]+)=(?P<item>[^@]+)@(?P<set>.+?)(?::(?P<reduce>sum|mean|max|min))?")
_OF_NODES = re.compile(r"[uvaR]?[xyz]|[uvaR]?[xyz]\s*-.*")


@dataclass(frozen=True)
class Varied:
    """A number that varies from ``minimum`` to ``maximum``, under ``name``."""

    name: str
    number: Number
    minimum: float
    maximum: float


@dataclass(frozen=True)
class Measured:
    """An output: FEBio's ``item`` of ``data`` for a set, made one number by ``reduce``. ``surface``: of its nodes."""

    name: str
    data: str
    item: str
    set: str
    reduce: str
    scale: float = 1.0
    unit: str = "1"
    surface: bool = False


def varied(where: str, contents: Contents, chosen: Sequence[str]) -> tuple[Varied, ...]:
    """Numbers by their paths, each with its range if one is given: ``tendon.E=5:50``. Raises :class:`BadInput`."""
    numbers, found = contents.numbers, list[Varied]()
    for text in chosen:
        path, _, bounds = text.partition("=") if text not in numbers else (text, "", "")
        number = numbers.get(path)
        if number is None:
            problem = f"no number {shown(path)}"
            raise BadInput(f"{where}--vary", problem, _some(path, sorted(numbers)))
        if any(one.number == number for one in found):
            raise BadInput(f"{where}--vary", f"{shown(path)} is given twice", "each number once")
        low, high = _range(where, path, bounds) if bounds else _first_range(where, number)
        if not low <= number.value <= high:
            problem = f"{shown(path)} is {number.value:g}, outside of {low:g} to {high:g}"
            raise BadInput(f"{where}--vary", problem, "a range with the model's own value in it")
        found.append(Varied(_name(path, [one.name for one in found]), number, low, high))
    return tuple(found)


def _range(where: str, path: str, text: str) -> tuple[float, float]:
    low, _, high = text.partition(":")
    try:
        bounds = float(low), float(high)
    except ValueError:
        bounds = 0.0, 0.0
    if not _is_range(*bounds):
        raise BadInput(f"{where}--vary", f"{shown(f'{path}={text}')} holds no range", f"{path}=MIN:MAX")
    return bounds


def _is_range(low: float, high: float) -> bool:
    """Whether numbers can be the ends of a range, with room to compute its width."""
    return -1e300 < low < high < 1e300


def _first_range(where: str, number: Number) -> tuple[float, float]:
    """From half of the value to twice the value; for Poisson's ratios, 0.1 to both sides, from 0 to 0.499."""
    value = number.value
    if POISSON.fullmatch(number.path) and 0 < value < 0.499:
        return max(0.0, round(value - 0.1, 6)), min(0.499, round(value + 0.1, 6))
    low, high = sorted((value / 2, value * 2))
    if not _is_range(low, high):
        raise BadInput(f"{where}--vary", f"{shown(number.path)} is {value:g}", f"its range: {number.path}=MIN:MAX")
    return low, high


def _name(path: str, taken: Sequence[str]) -> str:
    name = re.sub(r"[^A-Za-z0-9]+", "_", path).strip("_")[:56]
    name = name if name[:1].isalpha() else f"p_{name}"
    unique, number = name, 1
    while unique in taken or unique in TAKEN:
        number += 1
        unique = f"{name}_{number}"
    return unique


def moved(where: str, contents: Contents, name: str | None) -> Moved | None:
    """A prescribed displacement by its name. Raises :class:`BadInput`."""
    if name is None:
        return None
    found = [one for one in contents.moved if one.name == name]
    if not found:
        names = [one.name for one in contents.moved]
        raise BadInput(f"{where}--move", f"no prescribed displacement {shown(name)}", _some(name, names))
    if len(found) > 1:
        raise BadInput(f"{where}--move", f"{shown(name)} is the name of {len(found)}", "a model with a name for each")
    return found[0]


def constituents(where: str, contents: Contents, chosen: Mapping[str, str | None]) -> dict[str, Material]:
    """The fibre and the matrix by the paths of their materials, else as far as the model tells.

    Raises :class:`BadInput`.
    """
    if not any(chosen.values()):
        return fibre_and_matrix(contents.laws)
    by_path = {one.path: one for one in contents.laws}
    found = {}
    for name, path in chosen.items():
        if path is not None and path not in by_path:
            raise BadInput(f"{where}--{name}", f"no material {shown(path)}", _some(path, list(by_path)))
        if path is not None:
            found[name] = by_path[path]
    return found


def force_of(where: str, contents: Contents, moved: Moved, scale: float) -> Measured:
    """The force of the displacement that is moved: its reaction. Raises :class:`BadInput`."""
    if moved.rigid:
        return Measured("force", "rigid_body_data", f"F{moved.axis}", moved.target, "single", scale, "N")
    target = moved.target.removeprefix("@surface:")
    surface = target != moved.target
    if target not in (contents.sets.surfaces if surface else contents.sets.nodes):
        problem = f"the nodes that {shown(moved.name)} moves ({shown(moved.target)}) have no node set or surface"
        raise BadInput(f"{where}--move", problem, "a displacement of a named node set or surface")
    return Measured("force", "node_data", f"R{moved.axis}", target, "sum", scale, "N", surface)


def measured(where: str, contents: Contents, chosen: Sequence[str]) -> tuple[Measured, ...]:
    """Outputs by ``NAME=ITEM@SET`` or ``NAME=ITEM@SET:max``. Raises :class:`BadInput`."""
    found: list[Measured] = []
    for text in chosen:
        parts = _MEASURE.fullmatch(text)
        if parts is None:
            expected = "NAME=ITEM@SET, such as narrowing=ux@edge or stress=sz@gauge:max"
            raise BadInput(f"{where}--measure", f"{shown(text)} cannot be read", expected)
        name, item, target = parts["name"], parts["item"], parts["set"]
        if not IDENTIFIER.fullmatch(name) or name in OF_THE_STORE or name in [*(one.name for one in found), "force"]:
            problem = f"{shown(name)} cannot be the name of an output"
            raise BadInput(f"{where}--measure", problem, "another name: letters, digits and '_'")
        found.append(_output(where, contents, name, item, target, parts["reduce"]))
    return tuple(found)


def _output(where: str, contents: Contents, name: str, item: str, target: str, reduce: str | None) -> Measured:
    sets = contents.sets
    of_nodes = target in sets.nodes or target in sets.surfaces
    if target in sets.rigid and not (of_nodes or target in sets.elements):
        return Measured(name, "rigid_body_data", item, target, "single")
    if of_nodes and (target not in sets.elements or _OF_NODES.fullmatch(item)):
        surface = target not in sets.nodes
        return Measured(
            name, "node_data", item, target, reduce or ("sum" if item[0] == "R" else "mean"), 1, "1", surface
        )
    if target in sets.elements:
        return Measured(name, "element_data", item, target, reduce or "mean")
    known = [*sets.nodes, *sets.surfaces, *sets.elements, *sets.rigid]
    raise BadInput(f"{where}--measure", f"no set, surface or rigid body {shown(target)}", _some(target, known))


def _some(near: str, names: Sequence[str]) -> str:
    """The names nearest to one, for a message."""
    close = get_close_matches(near, list(names)[:COMPARED], 5, 0.4) or list(names)[:5]
    more = f", ... ({len(names)} in all)" if len(names) > len(close) else ""
    return f"one of {', '.join(close)}{more}" if names else "none: the model has none"
