"""Files of tests to specimens, as ``sinew import`` makes them: each file is a specimen, or all are one."""

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from sinew.runner.errors import BadInput, shown
from sinew.tasks.data.cohort import NAME, refuse_duplicates
from sinew.tasks.data.curves import MOST_STRETCH, Bar, begins_elsewhere, curve_of, first_length_in_words
from sinew.tasks.data.further import refuse_unknown
from sinew.tasks.data.hints import Hints
from sinew.tasks.data.quantities import LENGTH, STRAIN, STRESS, STRETCH, TIME
from sinew.tasks.data.recording import Recording
from sinew.tasks.data.recordings import read_recordings
from sinew.tasks.data.remarks import remarks
from sinew.tasks.data.sizes import (
    OFF,
    POSSIBLE_MM,
    SAME,
    area_told,
    area_told_otherwise,
    check_size,
    contradiction_of_areas,
    contradiction_without_unit,
    is_zero,
    square_side,
)
from sinew.tasks.data.told import as_told
from sinew.tasks.data.units import factor, listed
from sinew.tasks.model import Specimen

NORMALISED_MM = 1.0  # the length of a bar whose displacements are strains
_HOLD = re.compile(r"\bhold")  # "holding", but no "threshold"


@dataclass(frozen=True)
class Reading:
    """What files do not tell of themselves.

    ``stress``: the load is a stress of this unit. ``time``: the unit of times without one. ``hints``: further units,
    and columns. ``reference``: stretch at zero displacement. ``length_mm`` (at that stretch) and ``area_mm2`` replace
    the sizes in the lines above a table. ``tare``: the force counts from its first value.
    """

    stress: str | None = None
    time: str | None = None
    reference: float | None = None
    length_mm: float | None = None
    area_mm2: float | None = None
    tare: bool = False
    hints: Hints = field(default_factory=Hints)

    def __post_init__(self) -> None:
        """Raises :class:`BadInput` for the first number or unit that is impossible, or contradicts another."""
        if self.reference is not None and not 0 < self.reference < MOST_STRETCH:
            raise BadInput("--reference", f"{self.reference:g}", f"above 0 and below {MOST_STRETCH:g}")
        for option, name, value in (("--length-mm", "length", self.length_mm), ("--area-mm2", "area", self.area_mm2)):
            if value is not None:
                check_size(option, name, value)
        for option, short, known, long, long_option in (
            ("--time", self.time, TIME.units, self.hints.time_unit, "--time-unit"),
            ("--stress", self.stress, STRESS.units, self.hints.force_unit, "--force-unit"),
        ):
            if short is not None and factor(known, short) is None:
                raise BadInput(option, shown(short), f"one of {', '.join(listed(known))}")
            if short is not None and long not in (None, short):
                raise BadInput(option, f"{short}, but {long_option} says {shown(long)}", "one and the same unit")
        if self.tare and self.hints.zero_force == "none":
            raise BadInput("--tare", "given together with --zero-force none", "one of them")

    @property
    def all_hints(self) -> Hints:
        """``hints`` with the units of time and stress, and whether the force counts from its first value."""
        time_unit, force_unit = self.time or self.hints.time_unit, self.stress or self.hints.force_unit
        zero_force = "first" if self.tare else self.hints.zero_force
        return replace(self.hints, time_unit=time_unit, force_unit=force_unit, zero_force=zero_force)


@dataclass(frozen=True)
class Imported:
    """Specimens; by ``SPECIMEN/PROTOCOL`` the columns with the spread of a mean, which are left out, and remarks."""

    specimens: tuple[Specimen, ...]
    spreads: Mapping[str, tuple[str, ...]]
    remarks: Mapping[str, tuple[str, ...]]


def read_export(
    path: str | Path, *, protocol: str | None = None, name: str | None = None, reading: Reading | None = None
) -> Specimen:
    """The test in a file as a specimen with one curve.

    The lines above the table must give ``Length`` and either ``Diameter`` (a round bar becomes a square one of equal
    area) or ``Width`` and ``Thickness``, unless ``reading`` does. Without such lines, a stretch or strain is that of a
    bar of 1 mm, and a stress that of a bar of 1 mm2. The protocol is called ``relaxation`` if the lines above the table
    mention a hold, else ``test``. Raises :class:`BadInput` naming the file and row, and for a file with several tests.
    """
    path, reading = Path(path), reading or Reading()
    recordings = _read(path, reading)
    if len(recordings) > 1:
        raise BadInput(path, f"{len(recordings)} tests", "one test, or read_exports for all of them")
    return _specimen(recordings[0], protocol, name, reading)


def read_exports(
    paths: str | Path | Sequence[str | Path],
    *,
    protocol: str | None = None,
    specimen: str | None = None,
    reading: Reading | None = None,
) -> Imported:
    """One or several files, each a specimen named after its file; or all of them protocols of one ``specimen``.

    Protocols of one specimen are named after their files. If a file holds several tests, each has its own name behind
    that of the file. Raises :class:`BadInput` for two of one name.
    """
    files = [Path(paths)] if isinstance(paths, str | Path) else list(map(Path, paths))
    if not files:
        raise BadInput("paths", "no files", "exports of testing machines")
    for option, given in (("--protocol", protocol), ("--specimen", specimen)):
        if given is not None and not NAME.fullmatch(given):
            raise BadInput(option, shown(given), "letters, digits, '_', '-', '+' and '.'")
    if specimen is not None and protocol is not None and len(files) > 1:
        raise BadInput("--protocol", f"one name for {len(files)} files of one specimen", "names of files as protocols")
    reading = reading or Reading()
    recordings = [recording for path in files for recording in _read(path, reading)]
    refuse_unknown(reading.hints.further, [one.further.values for one in recordings], recordings[0].left_out)
    parts: list[Specimen] = []
    spreads: dict[str, tuple[str, ...]] = {}
    noticed: dict[str, tuple[str, ...]] = {}
    for recording in recordings:
        own = _plain(recording)
        part = (
            _specimen(recording, protocol, own, reading)
            if specimen is None
            else _specimen(recording, protocol or own, specimen, reading)
        )
        parts.append(part)
        where = f"{part.name}/{part.curves[0].name}"
        spreads |= {where: recording.spreads} if recording.spreads else {}
        found = [*remarks(recording), *length_taken(recording, reading), *_replaced(recording, reading)]
        found += [*_ellipse(recording, reading), *begins_elsewhere(recording, part.length_mm)]
        noticed |= {where: tuple(found)} if found else {}
    sources = [recording.path for recording in recordings]
    if specimen is not None:
        return Imported((_joined(sources, parts),), spreads, noticed)
    for path, one in zip(sources, parts, strict=True):
        if not NAME.fullmatch(one.name):
            raise BadInput(path, "a name that cannot be used for a specimen", "a letter or digit in front")
    refuse_duplicates(parts, {one.name: path for path, one in zip(sources, parts, strict=True)})
    return Imported(tuple(parts), spreads, noticed)


def _plain(recording: Recording) -> str:
    """The name of a file, and of its test if it holds several, as a name that a cohort may have."""
    name = f"{recording.path.stem}_{recording.test}" if recording.test else recording.path.stem
    plain = re.sub(r"[^A-Za-z0-9_.+-]+", "_", name)
    return plain.lstrip("_.+-") or ("specimen" if any(map(str.isalnum, name)) else plain)  # a name in other letters


def _read(path: Path, reading: Reading) -> list[Recording]:
    hints = reading.all_hints
    return [as_told(_without_zeros(one), hints) for one in read_recordings(path, hints, first_of_alike=True)]


def _without_zeros(recording: Recording) -> Recording:
    """The recording without sizes of 0, which a template left open, where it can do without them."""
    told = {name: size for name, size in recording.sizes.items() if not is_zero(size)}
    bare_length = recording.motion.quantity in (STRAIN, STRETCH, LENGTH)
    bare_area = recording.load.quantity is STRESS or area_told(told) is not None
    kept = {
        name: size for name, size in recording.sizes.items() if not (bare_length if name == "length" else bare_area)
    }
    return replace(recording, sizes={**kept, **told})


def _specimen(recording: Recording, protocol: str | None, name: str | None, reading: Reading) -> Specimen:
    bar = _bar(recording, reading)
    labels = [row[0].rpartition(":")[2].lower() for row in recording.header if row]
    usual = "relaxation" if any(map(_HOLD.search, labels)) else "test"
    curve = curve_of(recording, bar, protocol or usual, reference=reading.reference)
    return Specimen(name or _plain(recording), bar.length_mm, bar.width_mm, bar.thickness_mm, (curve,))


def _bar(recording: Recording, reading: Reading) -> Bar:
    length = reading.length_mm or _length(recording)
    sizes = recording.sizes
    if reading.area_mm2 is not None:
        side = round(math.sqrt(reading.area_mm2), 9)
    elif differs := contradiction_of_areas(sizes):
        raise BadInput(recording.path, f"gives {differs}", "sizes that agree, or --area-mm2")
    elif differs := contradiction_without_unit(sizes):
        raise BadInput(recording.path, f"gives {differs}", "sizes with their units, or --area-mm2")
    elif recording.load.quantity is STRESS and not _tells_area(recording):
        side = 1.0
    elif "diameter" in sizes:
        side = square_side(_size(recording, "diameter", "--area-mm2"))
    elif "area" in sizes and not {"width", "thickness"} <= sizes.keys():
        side = round(math.sqrt(_size(recording, "area", "--area-mm2")), 9)
    else:
        return Bar(length, _size(recording, "width", "--area-mm2"), _size(recording, "thickness", "--area-mm2"))
    return Bar(length, side, side)


def _ellipse(recording: Recording, reading: Reading) -> Iterator[str]:
    """A remark where the cross-section that a file gives is that of an ellipse, and the bar's is width x thickness."""
    area, both = recording.sizes.get("area"), area_told_otherwise(recording.sizes)
    if reading.area_mm2 is None and area is not None and area.mm and both and abs(both - area.mm) > OFF * both:
        yield f"the file gives a cross-section of {area.mm:.6g} mm2, that of the bar is {both:.6g} mm2; --area-mm2"


def length_taken(recording: Recording, reading: Reading) -> Iterator[str]:
    """A remark where nothing tells the gauge length: the one in the first row serves as such, or 1 mm."""
    if reading.length_mm is not None or "length" in recording.sizes:
        return
    if recording.motion.quantity is LENGTH:
        yield first_length_in_words(recording)
    elif recording.motion.quantity in (STRETCH, STRAIN):
        yield f"no gauge length: taken as {NORMALISED_MM:g} mm, so that displacements are strains; --length-mm"


def _replaced(recording: Recording, reading: Reading) -> Iterator[str]:
    """A remark for each size of the file that an option replaces with another one."""
    if reading.length_mm is not None and "length" in recording.sizes:
        told = recording.sizes["length"].mm
        if told is not None and abs(told - reading.length_mm) > SAME * told:
            yield f"length {reading.length_mm:g} mm by --length-mm; the file gives {told:g} mm"
    if reading.area_mm2 is not None and (differs := contradiction_of_areas(recording.sizes)):
        yield f"cross-section {reading.area_mm2:g} mm2 by --area-mm2; the file gives {differs}"
    elif reading.area_mm2 is not None:
        area = area_told(recording.sizes)
        if area is not None and abs(area - reading.area_mm2) > SAME * area:
            yield f"cross-section {reading.area_mm2:g} mm2 by --area-mm2; the file gives {area:.4g} mm2"


def _tells_area(recording: Recording) -> bool:
    known = recording.sizes.keys()
    return "diameter" in known or "area" in known or {"width", "thickness"} <= known


def _length(recording: Recording) -> float:
    if "length" not in recording.sizes and recording.motion.quantity in (STRETCH, STRAIN):
        return NORMALISED_MM
    if "length" not in recording.sizes and recording.motion.quantity is LENGTH:
        return float(recording.numbers[0, 1])
    return _size(recording, "length", "--length-mm")


def _size(recording: Recording, name: str, option: str) -> float:
    where = f"{recording.path}: {name.capitalize()}"
    size = recording.sizes.get(name)
    if size is None:
        raise BadInput(where, "missing in the lines above the table", f"a length with its unit, or {option}")
    if size.mm is None:
        expected = f"a number {POSSIBLE_MM} and a unit such as mm, or {option}"
        raise BadInput(where, shown(size.text), expected)
    return size.mm


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
