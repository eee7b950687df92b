"""Exported tests to curves: Instron-style exports of a machine, and tables of length ratio and stress."""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tasks.export_tables import MM, RATIO, STRESS, Array, Table, read_table
from tasks.measurements import NAME, refuse_duplicates
from tasks.model import Curve, Protocol, Specimen
from tasks.problems import BadInput, shown

LONGEST, WIDEST = 1e4, 1e8  # mm, mm2
FARTHEST = 10.0  # a length ratio beyond it is in percent, or a length


@dataclass(frozen=True)
class Reading:
    """What exports do not say of themselves.

    ``stress``: the load is a stress of this unit (Pa, kPa, MPa); ``time``: unit of the time where none is given;
    ``reference``: length ratio at zero displacement; ``length_mm`` at that ratio and ``area_mm2``, in place of those of
    a header block. Without a block, a length ratio is that of a bar of 1 mm, a stress that of one of 1 mm2. ``tare``:
    subtract the first force.
    """

    stress: str | None = None
    time: str | None = None
    reference: float | None = None
    length_mm: float | None = None
    area_mm2: float | None = None
    tare: bool = False

    def __post_init__(self) -> None:
        """Raises :class:`BadInput` for the first number that is impossible."""
        for option, value, most, unit in (
            ("--reference", self.reference, FARTHEST, ""),
            ("--length-mm", self.length_mm, LONGEST, " mm"),
            ("--area-mm2", self.area_mm2, WIDEST, " mm2"),
        ):
            if value is not None and not 0 < value < most:
                raise BadInput(option, f"{value:g}", f"above 0 and below {most:g}{unit}")


@dataclass(frozen=True)
class Imported:
    """Specimens, and by ``SPECIMEN/PROTOCOL`` the columns that hold the spread of a mean, which are left out."""

    specimens: tuple[Specimen, ...]
    spreads: Mapping[str, tuple[str, ...]]


def read_export(
    path: Path, *, protocol: str | None = None, name: str | None = None, reading: Reading | None = None
) -> Specimen:
    """One exported test as a specimen with one curve.

    The header block must give ``Length`` and either ``Diameter`` (a round bar becomes a square one of equal area) or
    ``Width`` and ``Thickness``, unless :class:`Reading` does. The protocol is called ``relaxation`` when the block
    speaks of a hold, else ``test``. Time starts at 0. Raises :class:`BadInput` naming the file and row.
    """
    return _read(path, protocol, name, reading or Reading())[0]


def read_exports(
    paths: Sequence[Path],
    *,
    protocol: str | None = None,
    specimen: str | None = None,
    reading: Reading | None = None,
) -> Imported:
    """Several exports, each a specimen named after its file; or all of them protocols of one ``specimen``.

    Protocols of one specimen are named after their files. Raises :class:`BadInput` for two of one name.
    """
    for option, given in (("--protocol", protocol), ("--specimen", specimen)):
        if given is not None and not NAME.fullmatch(given):
            raise BadInput(option, shown(given), "letters, digits, '_', '-', '+' and '.'")
    if specimen is not None and protocol is not None and len(paths) > 1:
        raise BadInput("--protocol", f"one name for {len(paths)} files of one specimen", "names of files as protocols")
    reading = reading or Reading()
    if specimen is not None:
        found = [_read(path, protocol or _plain(path), specimen, reading) for path in paths]
    else:
        found = [_read(path, protocol, None, reading) for path in paths]
    spreads = {f"{one.name}/{one.curves[0].name}": names for one, names in found if names}
    specimens = [one for one, _ in found]
    if specimen is not None:
        return Imported((_joined(paths, specimens),), spreads)
    for path, one in zip(paths, specimens, strict=True):
        if not NAME.fullmatch(one.name):
            raise BadInput(path, "a name that cannot be used for a specimen", "a letter or digit in front")
    refuse_duplicates(specimens, {one.name: path for path, one in zip(paths, specimens, strict=True)})
    return Imported(tuple(specimens), spreads)


def _plain(path: Path) -> str:
    return re.sub(r"[^A-Za-z0-9_.+-]+", "_", path.stem)


def _read(path: Path, protocol: str | None, name: str | None, reading: Reading) -> tuple[Specimen, tuple[str, ...]]:
    """A specimen with one curve, and the names of columns that hold a spread."""
    table = read_table(path, time=reading.time, stress=reading.stress)
    length, width, thickness = _bar(path, table, reading)
    time_s, motion, load = table.numbers.T
    back = np.flatnonzero(np.diff(time_s) <= 0)
    if back.size:
        row = table.first + int(back[0]) + 1
        raise BadInput(
            f"{path}: row {row}, time", f"{time_s[back[0] + 1]:g} s after {time_s[back[0]]:g} s", "increasing times"
        )
    displacement = _displacement(path, table, reading, motion, length)
    force = load * width * thickness if table.load is STRESS else load
    held = any("hold" in key for key in table.block)
    history = Protocol(protocol or ("relaxation" if held else "test"), time_s - time_s[0], displacement)
    curve = Curve(history, force - force[0] if reading.tare else force)
    return Specimen(name or _plain(path), length, width, thickness, (curve,)), table.spreads


def _displacement(path: Path, table: Table, reading: Reading, motion: Array, length: float) -> Array:
    """Displacement ``[t]`` (mm) from the reference."""
    if table.motion is not RATIO:
        if reading.reference is not None:
            raise BadInput(path, "holds displacements, which --reference does not apply to", "a ratio such as L/L0")
        if (motion <= -length).any():
            problem, expected = (
                "an extension that shortens the gauge to nothing",
                "extensions in the unit that it names",
            )
            raise BadInput(path, problem, expected)
        return motion
    displacement: Array = length * (motion / (reading.reference or 1.0) - 1.0)
    wrong = np.flatnonzero((displacement <= -length) | (motion > FARTHEST))
    if wrong.size:
        where = f"{path}: row {table.first + int(wrong[0])}, {RATIO.name}"
        raise BadInput(where, f"{motion[wrong[0]]:g}", f"a length over the reference length, at most {FARTHEST:g}")
    return displacement


def _bar(path: Path, table: Table, reading: Reading) -> tuple[float, float, float]:
    """Length, width and thickness (mm)."""

    def size(key: str, option: str) -> float:
        if key not in table.block:
            expected = f"a length with its unit, or {option}"
            raise BadInput(f"{path}: {key.capitalize()}", "missing in the header block", expected)
        cells = table.block[key]
        try:
            value = float(cells[0].replace(",", ".")) * MM[cells[1].lower() if len(cells) > 1 else "mm"]
        except (ValueError, KeyError, IndexError):
            raise BadInput(
                f"{path}: {key.capitalize()}", shown(" ".join(cells)), "a number and a unit such as mm"
            ) from None
        if not 0 < value < LONGEST:
            raise BadInput(f"{path}: {key.capitalize()}", f"{value:g} mm", "above 0 and below 10000 mm")
        return value

    unit_length = table.motion is RATIO and "length" not in table.block
    length = reading.length_mm or (1.0 if unit_length else size("length", "--length-mm"))
    unit_area = table.load is STRESS and not {"diameter", "width", "thickness"} & table.block.keys()
    if reading.area_mm2 is not None or unit_area:
        side = round(math.sqrt(reading.area_mm2 or 1.0), 9)
    elif "diameter" in table.block:
        side = round(size("diameter", "--area-mm2") * math.sqrt(math.pi) / 2, 9)
    else:
        return length, size("width", "--area-mm2"), size("thickness", "--area-mm2")
    return length, side, side


def _joined(paths: Sequence[Path], parts: Sequence[Specimen]) -> Specimen:
    """One specimen with the curves of all ``parts``. Raises :class:`BadInput` where they cannot be of one."""
    first = parts[0]
    names: dict[str, Path] = {}
    digests: dict[str, Path] = {}
    for path, part in zip(paths, parts, strict=True):
        (curve,) = part.curves
        if not NAME.fullmatch(curve.name) or curve.name == "total":
            problem = f"its name cannot be used for a protocol: {shown(curve.name)}"
            raise BadInput(path, problem, "a letter or digit in front, and not 'total'")
        for known, key in ((names, curve.name.casefold()), (digests, curve.digest)):
            if key in known:
                what = f"protocol {curve.name}, as {known[key]}" if known is names else f"the numbers of {known[key]}"
                raise BadInput(path, f"has {what}", "each protocol of a specimen once")
            known[key] = path
        if (part.length_mm, part.area_mm2) != (first.length_mm, first.area_mm2):
            sizes = [f"{one.length_mm:g} mm, {one.area_mm2:g} mm2" for one in (part, first)]
            raise BadInput(path, f"a bar of {sizes[0]}, but {sizes[1]} in {paths[0]}", "files of one specimen")
    return Specimen(
        first.name, first.length_mm, first.width_mm, first.thickness_mm, tuple(part.curves[0] for part in parts)
    )
