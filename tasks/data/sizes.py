"""Sizes of a specimen that the lines above a table tell: gauge length, width, thickness, diameter and cross-section."""

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

from sinew.runner.errors import BadInput
from sinew.tasks.data import units, words
from sinew.tasks.data.heads import Row, joined, told_units
from sinew.tasks.data.text import is_number, tells_mark
from sinew.tasks.data.titles import name_and_unit

SIZES = ("length", "width", "thickness")
SAME = 1e-3  # two statements of a size that differ by less agree: 10 mm and 10.0005 mm
ROUNDED = 0.01  # so do two in one file, which may round one of them
OFF = 0.05  # how much a cross-section that is told twice may differ
SHORTEST_MM, LONGEST_MM = 1e-6, 1e4  # of any size: a nanometre, and ten metres
LEAST_MM2, LARGEST_MM2 = SHORTEST_MM**2, LONGEST_MM**2
POSSIBLE_MM = f"at least {SHORTEST_MM:g} and below {LONGEST_MM:g} mm"
SMALLEST_MM, SMALLEST_MM2 = 0.1, 0.01  # of a size without unit: a smaller one may as well be in m or cm
LEAST = {**dict.fromkeys((*SIZES, "diameter"), SHORTEST_MM), "area": LEAST_MM2}
LARGEST = {**dict.fromkeys((*SIZES, "diameter"), LONGEST_MM), "area": LARGEST_MM2}
FAR = 500  # rows from either end of those above a table, in which sizes are looked for
_WIDEST = 200  # cells of a row that tells a size
_LONGEST_LINE = 200  # characters of a line that tells a size
_LONGEST_LABEL = 60  # of a column of sizes, with its unit
_WORDS = {name: words.SIZES[name] for name in ("length", "width", "thickness", "diameter")}
#: What may stand beside the word for a size; with any other word, a line tells something else ("parallel length").
_BESIDE = re.compile(
    r"\b(?:gauge|gage|specimen|sample|initial|original|probe[n]?|standard travel|course standard|éprouvette|eprouvette|"
    r"de|la|l|sw|real|actual|measured|mean|average|образца|рабочая|начальная|исходная|расч[её]тная)\b|[-:,_.'()]|^(?:proben|anfangs)"
)
_SYMBOLS = re.compile(r"\b(?:l0|a0|b0|d0|s0)\b")
_UNIT = "|".join(re.escape(unit) for unit in sorted([*units.LENGTH, "μm"], key=len, reverse=True))
#: What may stand in front of a colon: with any other word, a line tells the size of something else.
_BEFORE = (
    r"(?:specimen|sample|test ?piece|test|properties|property|geometry|dimensions?|sizes?|parameters?|inputs?|general|"
    r"initial|original|proben?|abmessung(?:en)?|éprouvette|właściwości|próbki|name|nr|no|\d+)"
)
_OF_SPECIMEN = rf"(?:(?:{_BEFORE}[ _]+)*{_BEFORE} ?: ?)?"
_ALLOWED = re.compile(rf"(?:{_BEFORE}[ _]+)*{_BEFORE} ?", re.IGNORECASE)
_LABEL = (
    rf"{_OF_SPECIMEN}(?:(?:gauge|gage|specimen|sample|initial)[ _])*"
    rf"(?P<what>{'|'.join(word for words in _WORDS.values() for word in words)})"
)
#: "Specimen properties : Length 14.33 mm", "Gauge length (mm) 10,13", "width_mm: 8.3", with single spaces.
_SIZE = re.compile(
    rf"{_LABEL}(?:[ _/]* ?[(\[]?(?P<unit>{_UNIT})[)\]]?)? ?[:=]? ?"
    rf"(?P<value>[0-9]+(?:[.,][0-9]+)?(?:e[-+]?[0-9]+)?)(?: ?[(\[]?(?P<behind>{_UNIT})[)\]]?)?",
    re.IGNORECASE,
)
#: The length by which Bluehill makes strains of the displacement: "Strain : Tensile strain (Extension) gauge length".
_OF_STRAIN = re.compile(
    r"strain : (?:tensile|compressive) strain \((?:extension|displacement)\) gauge length(?!\w)", re.IGNORECASE
)
_HEIGHTS = "|".join(words.HEIGHT)
_HEIGHT_WORD = re.compile(_HEIGHTS, re.IGNORECASE)
#: "Höhe [mm]: 98,6", "Specimen height,4,mm", with single spaces.
_HEIGHT = re.compile(
    rf"{_OF_SPECIMEN}(?:(?:specimen|sample|initial)[ _])*(?:{_HEIGHTS})"
    rf"(?:[ _/]* ?[(\[]?(?P<unit>{_UNIT})[)\]]?)? ?[:=]? ?"
    rf"(?P<value>[0-9]+(?:[.,][0-9]+)?)(?: ?[(\[]?(?P<behind>{_UNIT})[)\]]?)?",
    re.IGNORECASE,
)
_AREAS = "|".join(map(re.escape, units.AREA))
#: "Cross-sectional area: 0.3 cm²", "Area (mm2) 12", which need a unit.
_AREA = re.compile(
    rf"{_OF_SPECIMEN}(?:(?:specimen|sample|initial)[ _])*(?:{'|'.join(map(re.escape, words.SIZES['area']))})"
    rf"(?: ?[(\[](?P<unit>{_AREAS})[)\]])? ?[:=]? ?"
    rf"(?P<value>[0-9]+(?:[.,][0-9]+)?(?:e[-+]?[0-9]+)?)(?: ?[(\[]?(?P<behind>{_AREAS})[)\]]?)?",
    re.IGNORECASE,
)
_SHAPE = re.compile(r"[\w ]+ \(([\w, ]+)\)")
_CELL = re.compile(rf"{_LABEL} ?:?", re.IGNORECASE)
_OTHER_UNIT = re.compile(r"[(\[][^)\]]*[)\]]")  # a label with its unit is read by the pattern above


@dataclass(frozen=True)
class Size:
    """A size as a file tells it. ``text`` is what is written.

    ``mm``: the size in mm, a cross-section in mm2; None where its number or unit makes no sense. ``has_unit``: False
    where there is a number but no unit; ``mm`` takes it for millimetres then, unless it is so small that it may be in
    metres. ``column``: it follows from a column of current lengths, whose title ``text`` is.
    """

    mm: float | None
    has_unit: bool
    text: str
    column: bool = False


def read_sizes(header: Sequence[Row], own: int = 0, decimal: str = "") -> Mapping[str, Size]:
    """The sizes in the rows above a table: ``length``, ``width``, ``thickness``, ``diameter``, ``area`` (mm2).

    ``decimal``: the decimal mark of the table, if it is known. Where the other one may mark thousands, as in
    ``20,000 um``, there is no number.

    A size stands in a row of its own, or in a table of results: a row of labels, one of units, one of numbers. If
    several rows tell one size, the first of them with number and unit counts, else the first with a number; where they
    contradict each other, none does. The height of a round specimen is its length, and so is
    one beside a width and a thickness that make the area. Rows from ``own`` on go before those
    above them. Of many thousand rows, the first and the last are looked at.
    """
    found = _read_sizes(header, own, decimal)
    if not {"length", "width"} & found.keys() and "diameter" in found and found["diameter"].mm is not None:
        height = _height(narrow(header[:FAR]), decimal)
        found |= {} if height is None else {"length": height}
    if "length" not in found and _is_cross_section(found) and (height := _height_beside(header, decimal)) is not None:
        found |= {"length": height}
    return found


def _is_cross_section(found: Mapping[str, Size]) -> bool:
    """Whether width and thickness make the area, so that a height beside them is no side of it."""
    width, thickness, area = (found[name].mm if name in found else None for name in ("width", "thickness", "area"))
    if width is None or thickness is None or area is None:
        return False
    return abs(width * thickness - area) <= ROUNDED * area


def _height_beside(header: Sequence[Row], decimal: str) -> Size | None:
    """The height in a table of results; None where there is none, or several."""
    header = narrow(header[-FAR:])
    found = [
        size_in("length", cell, unit.strip("()[] "), decimal)
        for labels, below, numbers in zip(header, header[1:], header[2:], strict=False)
        for label, unit, cell in zip(labels, told_units(below) or (), numbers, strict=False)
        if label.casefold() in words.HEIGHT
    ]
    return found[0] if len(found) == 1 and found[0].mm is not None and found[0].has_unit else None


def _read_sizes(header: Sequence[Row], own: int, decimal: str) -> dict[str, Size]:
    """The same without the height of a round specimen."""
    if own:
        shared, mine = _read_sizes(header[:own], 0, decimal), _read_sizes(header[own:], 0, decimal)
        both = {**shared, **mine}
        if contradiction_of_areas(both) and not contradiction_of_areas(shared):
            both = {name: size for name, size in both.items() if name in mine or name == "length"}
        return both
    if len(header) > 2 * FAR:
        header = [*header[:FAR], *header[-FAR:]]
    header = narrow(header)
    told: dict[str, list[Size]] = {}
    for row in header:
        if read := _read(row, decimal) or _in_cells(row, decimal):
            told.setdefault(read[0], []).append(read[1])
    for name, size in _of_geometry(header, decimal):
        told.setdefault(name, []).append(size)
    for labels, *below in zip(header, header[1:], (*header[2:], ()), (*header[3:], (), ()), strict=False):
        for name, size in _in_columns(labels, below, decimal):
            told.setdefault(name, []).append(size)
    return {name: _one_of(sizes) for name, sizes in told.items()}


def _height(header: Sequence[Row], decimal: str) -> Size | None:
    """The height that one row tells, with its unit; None where no row does, or several."""
    named = [row for row in header if any(_HEIGHT_WORD.search(cell) for cell in row)]
    found = _HEIGHT.fullmatch(joined(named[0][:3])) if len(named) == 1 else None
    if found is None or sum(bool(_HEIGHT_WORD.search(cell)) for cell in named[0]) > 1:
        return None
    unit = found["unit"] or found["behind"] or ""
    size = size_in("length", found["value"], unit, decimal)
    return size if size.mm is not None and size.has_unit else None


def _one_of(sizes: Sequence[Size]) -> Size:
    """The one of several statements of a size that counts; one without a number where they contradict each other."""
    first = min(sizes, key=lambda size: (size.mm is None, not size.has_unit))  # min keeps the first of equals
    if first.mm is None:
        return first
    for size in sizes:
        if size.mm and size.has_unit == first.has_unit and abs(size.mm - first.mm) > ROUNDED * first.mm:
            return Size(None, first.has_unit, f"{first.text} and {size.text}")
    return first


def contradiction_of_areas(sizes: Mapping[str, Size]) -> str:
    """What contradicts each other in the cross-sections that a file tells with their units; nothing where all agree.

    Width and thickness may be those of a rectangle or of an ellipse.
    """
    mm = {name: size.mm for name, size in sizes.items() if size.mm is not None and size.has_unit}
    told: dict[str, tuple[float, ...]] = {}
    rounded = 0.0
    if "area" in mm:
        told[f"a cross-section of {mm['area']:.6g} mm2"] = (mm["area"],)
        rounded = _rounding(sizes["area"])
    if "diameter" in mm:
        told[f"a diameter of {mm['diameter']:.6g} mm"] = (square_side(mm["diameter"]) ** 2,)
    if "width" in mm and "thickness" in mm:
        both = mm["width"] * mm["thickness"]
        told[f"{mm['width']:.6g} x {mm['thickness']:.6g} mm"] = (both, both * math.pi / 4)
    for (one, areas), (other, others) in combinations(told.items(), 2):
        if not any(abs(a - b) <= OFF * b + rounded for a in areas for b in others):
            return f"{one}, but {other} is {others[0]:.6g} mm2"
    return ""


def contradiction_without_unit(sizes: Mapping[str, Size]) -> str:
    """Where a cross-section with its unit is another one than sizes without a unit make in millimetres."""
    area, others = sizes.get("area"), [sizes[name] for name in ("diameter", "width", "thickness") if name in sizes]
    if area is None or area.mm is None or not area.has_unit or all(size.has_unit for size in others):
        return ""
    both = area_told_otherwise(sizes)
    ellipse = math.pi / 4 if "diameter" not in sizes else 1.0
    if both is None or any(abs(part * both - area.mm) <= OFF * area.mm + _rounding(area) for part in (1.0, ellipse)):
        return ""
    return f"a cross-section of {area.mm:.6g} mm2, but sizes without a unit that make {both:.6g} mm2"


def is_zero(size: Size) -> bool:
    """Whether a size is told as 0, as by a template that was not filled in."""
    return size.mm is None and re.match(r"0+(?:[.,]0*)?(?![\d.,])", size.text) is not None


def area_told(sizes: Mapping[str, Size]) -> float | None:
    """The cross-section (mm2) that a file tells, in whichever way; None without one."""
    mm = {name: size.mm for name, size in sizes.items() if size.mm is not None}
    if "diameter" in mm:
        return square_side(mm["diameter"]) ** 2
    if "width" in mm and "thickness" in mm:
        return mm["width"] * mm["thickness"]
    return mm.get("area")


def area_told_otherwise(sizes: Mapping[str, Size]) -> float | None:
    """The cross-section (mm2) that other sizes of a file make than the one that it gives as such."""
    return area_told({name: size for name, size in sizes.items() if name != "area"})


def _rounding(size: Size) -> float:
    """How far a size as it is written may be from what was rounded (mm or mm2): half of its last digit."""
    number = re.match(r"[0-9]+(?:[.,]([0-9]+))?", size.text)
    if number is None or not size.mm or not float(number[0].replace(",", ".")):
        return 0.0
    return 0.5 * 10.0 ** -len(number[1] or "") * size.mm / float(number[0].replace(",", "."))


def narrow(header: Sequence[Row]) -> list[Row]:
    """The rows, without those that are too wide to tell a size."""
    return [row if len(row) <= _WIDEST else () for row in header]


def named_in(cell: str) -> str | None:
    """The size that a single cell names, with its number or without one; None for another one."""
    found = _read((cell,))
    return meant(cell) if found is None else found[0]


def _in_cells(row: Row, decimal: str) -> tuple[str, Size] | None:
    """A size from the cells label, number, unit."""
    if len(row) < 2 or (name := meant(row[0])) is None or _OTHER_UNIT.search(row[0]):
        return None
    size = size_in(name, row[1], row[2] if len(row) > 2 else "", decimal)
    return None if size.mm is None and not row[1][:1].isdigit() else (name, size)


def _in_columns(labels: Row, below: Sequence[Row], decimal: str) -> Iterator[tuple[str, Size]]:
    """Sizes from a table of results, unless a second specimen has other ones."""
    columns, height = columns_of_sizes(labels, below[0])
    numbers, next_row = below[height - 1 : height + 1]
    for place, (name, unit) in columns.items():
        cell, other = (row[place] if place < len(row) else "" for row in (numbers, next_row))
        if cell and (other == cell or not other[:1].isdigit()):
            yield name, size_in(name, cell, unit, decimal)


def columns_of_sizes(labels: Row, below: Row) -> tuple[dict[int, tuple[str, str]], int]:
    """The size and unit of each column that ``labels`` of a table of results name, and how many rows these take.

    Units stand below the labels, ``Width`` above ``mm``, or within them: ``Width (mm)``.
    """
    if told := told_units(below):
        named = ((place, meant(label), unit) for place, (label, unit) in enumerate(zip(labels, told, strict=False)))
        return {place: (name, unit.strip("()[] ")) for place, name, unit in named if name is not None}, 2
    above = [label if cell[:1].isdigit() else "" for label, cell in zip(labels, below, strict=False)]
    short = {place: label for place, label in enumerate(above) if label[:1].isalpha() and len(label) < _LONGEST_LABEL}
    parts = {place: name_and_unit(label) for place, label in short.items()}
    within = {place: (meant(name), unit) for place, (name, unit) in parts.items() if units.is_unit(unit)}
    return {place: (name, unit) for place, (name, unit) in within.items() if name is not None}, 1


def _of_geometry(header: Sequence[Row], decimal: str) -> Iterator[tuple[str, Size]]:
    """The sizes of TA Instruments, whose names stand in a row and the numbers in another one.

    ``Geometry, Rectangular (Length, Width, Thickness)`` and ``Size, 10.3, 5.51, 0.03, mm``.
    """
    rows = {row[0].casefold(): row[1:] for row in header if len(row) > 1}
    shape = _SHAPE.fullmatch(rows.get("geometry", ("",))[0])
    cells = rows.get("size", ())
    names = [meant(name.strip()) for name in shape[1].split(",")] if shape is not None else []
    if names and None not in names and len(names) < len(cells):
        for name, cell in zip(filter(None, names), cells, strict=False):
            yield name, size_in(name, cell, cells[len(names)], decimal)


def meant(label: str) -> str | None:
    """The size that a label names; None for another one."""
    if len(label) >= _LONGEST_LINE:
        return None
    before, _, label = label.rpartition(" : ")
    if before and not _ALLOWED.fullmatch(before):
        return None
    text = re.sub(r"[(\[].*", "", label.replace("_", " ")).casefold().strip(" :")
    text = " ".join(_BESIDE.sub(" ", text).split())
    for one in (text, " ".join(_SYMBOLS.sub(" ", text).split())):
        for name, known in words.SIZES.items():
            if one in known:
                return name
    return None


def size_in(name: str, cell: str, unit: str, decimal: str = "") -> Size:
    """The size of this ``name`` that a cell tells, in this unit or without one; ``decimal`` as above."""
    text = f"{cell} {unit}".strip()
    number = re.fullmatch(r"[0-9]+(?:[.,][0-9]+)?(?:e[-+]?[0-9]+)?", cell, re.IGNORECASE)
    factor = units.factor(units.AREA if name == "area" else units.LENGTH, unit) if unit else 1.0
    other = "" if not decimal else "," if decimal == "." else "."
    if number is None or factor is None or (other and tells_mark(cell, other) is False):
        return Size(None, bool(unit), text)
    value = float(cell.replace(",", ".")) * factor
    smallest = LEAST[name] if unit else SMALLEST_MM2 if name == "area" else SMALLEST_MM
    there = smallest <= value if unit else smallest < value
    return Size(value if there and value < LARGEST[name] else None, bool(unit), text)


def check_size(option: str, name: str, value: float) -> None:
    """Raises :class:`BadInput` where a person gives a size (mm, a cross-section in mm2) that is impossible."""
    if not LEAST[name] <= value < LARGEST[name]:
        unit = "mm2" if name == "area" else "mm"
        raise BadInput(option, f"{value:g}", f"at least {LEAST[name]:g} and below {LARGEST[name]:g} {unit}")


def is_possible(mm: float) -> bool:
    """Whether a size (mm) can be that of a specimen."""
    return SHORTEST_MM <= mm < LONGEST_MM


def square_side(diameter_mm: float) -> float:
    """The side (mm) of a square with the area of a circle."""
    return round(diameter_mm * math.sqrt(math.pi) / 2, 9)


def round_in_words(sizes: Mapping[str, Size], width_mm: float | None) -> str:
    """What is said where a diameter of a file became this width, or nothing."""
    diameter = sizes.get("diameter")
    if diameter is None or diameter.mm is None or not diameter.has_unit or width_mm != square_side(diameter.mm):
        return ""
    return f"round, diameter {diameter.mm:g} mm: counted as a square of equal area"


def _read(row: Row, decimal: str = "") -> tuple[str, Size] | None:
    line, start = joined(row), joined(row[:3])
    if len(start) >= _LONGEST_LINE:
        return None
    if found := _OF_STRAIN.match(joined(row[:1])):
        row = (f"length{joined(row[:1])[found.end() :]}", *row[1:])
        line, start = joined(row), joined(row[:3])
    for text in (line, start) if len(line) < _LONGEST_LINE else (start,):
        if found := _SIZE.fullmatch(text):
            name = _name(found["what"])
            unit = found["unit"] or found["behind"] or ""
            if text is not line and any(is_number(cell, mark) for cell in row[3:4] for mark in ".,"):
                return name, Size(None, bool(unit), joined(row[:6]))  # two numbers of one size
            return name, size_in(name, found["value"], unit, decimal)
        if (found := _AREA.fullmatch(text)) and (unit := found["unit"] or found["behind"]):
            one = found["behind"] in (None, unit)
            return "area", size_in("area", found["value"], unit, decimal) if one else Size(None, True, text)
    if found := _CELL.fullmatch(joined(row[:1])):
        return _name(found["what"]), Size(None, False, joined(row[1:3]))
    return None


def _name(word: str) -> str:
    return next(name for name, words in _WORDS.items() if word.lower() in words)
