"""Sizes of the specimens of a new study: what a person gives, what files tell, and what must be asked for."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType

from sinew.runner.errors import BadInput, shown
from sinew.tasks.data.columns import LIKELY
from sinew.tasks.data.curves import first_length_in_words
from sinew.tasks.data.quantities import LENGTH
from sinew.tasks.data.recording import Recording
from sinew.tasks.data.sizes import (
    OFF,
    SAME,
    SIZES,
    check_size,
    contradiction_of_areas,
    is_possible,
    round_in_words,
    square_side,
)
from sinew.tasks.data.sizes_in_names import sizes_in_name

FOR_ALL = "all"  # behind an answer: it holds for all specimens that are left

#: Asks a person for one answer (question, choices or none). Not given where nobody can answer.
Ask = Callable[[str, Sequence[str]], str]


@dataclass(frozen=True)
class Sizes:
    """Gauge length, width and thickness (mm) of all specimens. None: each file's own, or to be filled in.

    ``override``: they count where files tell other ones; else a contradiction is refused. ``square_by``: the option by
    which a person gave width and thickness, those of a square of equal area; empty where they were given as such.
    """

    length_mm: float | None = None
    width_mm: float | None = None
    thickness_mm: float | None = None
    override: bool = False
    square_by: str = ""

    def __post_init__(self) -> None:
        """Raises :class:`BadInput` for a size that is impossible."""
        for name in SIZES:
            if (value := getattr(self, f"{name}_mm")) is not None:
                check_size(f"--{name}-mm", name, value)

    @classmethod
    def of(
        cls,
        length_mm: float | None,
        width_mm: float | None,
        thickness_mm: float | None,
        diameter_mm: float | None,
        area_mm2: float | None = None,
        *,
        override: bool,
    ) -> "Sizes":
        """Sizes as a person gives them. By a diameter or a cross-section, they are those of a square of equal area."""
        of_square = {"--diameter-mm": diameter_mm, "--area-mm2": area_mm2}
        given = [(option, size) for option, size in of_square.items() if size is not None]
        if not given:
            return cls(length_mm, width_mm, thickness_mm, override)
        option, size = given[0]
        if len(given) > 1 or width_mm is not None or thickness_mm is not None:
            raise BadInput(option, "given beside a width, a thickness or another size", "one of them")
        round_one = diameter_mm is not None
        check_size(option, "diameter" if round_one else "area", size)
        side = square_side(size) if round_one else round(math.sqrt(size), 9)
        return cls(length_mm, side, side, override, f"{option} {size:g} (a square of equal area)")

    def option(self, size: str) -> str:
        """The option by which a person gave a size."""
        return self.square_by if self.square_by and size != "length" else f"--{size}-mm"


@dataclass(frozen=True)
class Known:
    """Sizes (mm) of one specimen by name, None for those that nobody tells, and notes for a person.

    ``told``: those that a person has told, ``proposed``: those that names of files may tell, which are not taken.
    """

    mm: Mapping[str, float | None]
    notes: tuple[str, ...] = ()
    told: Mapping[str, float] = field(default_factory=dict)
    proposed: Mapping[str, float] = field(default_factory=dict)

    def answered(self, answers: Mapping[str, float | None]) -> "Known":
        """The same with answers to what nobody tells."""
        new = {size: mm for size, mm in answers.items() if mm is not None and self.mm.get(size) is None}
        return replace(self, mm={**self.mm, **new}, told={**self.told, **new})

    @property
    def proposals(self) -> tuple[str, ...]:
        """A note on each size that nobody tells, but perhaps the name of a file."""
        return tuple(
            f"{size} may be {mm:g} mm by the name of the file; it is not taken"
            for size, mm in self.proposed.items()
            if size in SIZES and self.mm.get(size) is None
        )


def size_of(recording: Recording, name: str) -> float | None:
    """A size (mm) that the file gives with its unit. A diameter is that of a bar with a square of equal area."""
    diameter = recording.sizes.get("diameter")
    if name != "length" and diameter is not None and diameter.mm is not None and diameter.has_unit:
        return square_side(diameter.mm)
    size = recording.sizes.get(name)
    return size.mm if size is not None and size.has_unit else None


def known_sizes(
    specimen: str, recordings: Sequence[Recording], given: Sizes, answers: Mapping[str, float] = MappingProxyType({})
) -> Known:
    """Sizes of a specimen: those ``given``, else earlier ``answers`` (mm), else those of its files.

    Raises :class:`BadInput` where files disagree with each other or, without ``given.override``, with what is told.
    """
    mm: dict[str, float | None] = {}
    notes: list[str] = []
    only_given: dict[str, float] = {}
    for size in SIZES:
        told: dict[float, Path] = {}
        for recording in recordings:
            if (value := size_of(recording, size)) is not None:
                told.setdefault(value, recording.path)
        by_option = getattr(given, f"{size}_mm")
        asked = by_option or answers.get(size)
        mm[size] = asked or next(iter(told), None)
        if asked is not None:
            source = given.option(size) if by_option else "an earlier answer"
            contradictions = _contradictions(size, asked, told, source, given.override)
            if contradictions or not told:
                only_given[size] = asked
            if not (told or by_option):
                notes.append(f"{size} {asked:g} mm, as answered before")
            notes += contradictions
        elif told and max(told) - min(told) > SAME * max(told):
            (first, one), (second, other) = ((value, told[value]) for value in (min(told), max(told)))
            problem = f"a {size} of {second:g} mm, but {first:g} mm in {one}, of the same specimen {specimen}"
            raise BadInput(other, problem, f"files of one specimen, or --{size}-mm with --override")
    notes += _square_of_area(mm, recordings)
    _refuse_contradictions(recordings, given, answers)
    notes += _other_areas(mm, recordings, given, only_given)
    notes += list(filter(None, (round_in_words(one.sizes, mm["width"]) for one in recordings)))[:1]
    notes += dict.fromkeys(note for one in recordings for note in _without_unit(one))
    proposed = {size: value for one in reversed(recordings) for size, value in sizes_in_name(one.path.stem).items()}
    return Known(mm, tuple(notes), only_given, proposed)


def _square_of_area(mm: dict[str, float | None], recordings: Sequence[Recording]) -> list[str]:
    """Set width and thickness by a cross-section, where nobody tells either, with a unit or without; a note on it.

    Files with different cross-sections leave them open.
    """
    told = {name for one in recordings for name in one.sizes}
    if mm["width"] is not None or mm["thickness"] is not None or told & {"width", "thickness", "diameter"}:
        return []
    areas = [size.mm for one in recordings if (size := one.sizes.get("area")) is not None and size.has_unit and size.mm]
    if not areas or max(areas) - min(areas) > SAME * max(areas):
        return []
    mm["width"] = mm["thickness"] = round(math.sqrt(areas[0]), 9)
    return [f"cross-section {areas[0]:g} mm2: width and thickness are those of a square"]


def _refuse_contradictions(recordings: Sequence[Recording], given: Sizes, answers: Mapping[str, float]) -> None:
    """Raises :class:`BadInput` for a file that contradicts itself, unless a person tells width and thickness."""
    if (given.width_mm or answers.get("width")) and (given.thickness_mm or answers.get("thickness")):
        return
    for recording in recordings:
        if differs := contradiction_of_areas(recording.sizes):
            remedy = "sizes that agree, or --width-mm and --thickness-mm with --override"
            raise BadInput(recording.path, f"gives {differs}", remedy)


def _other_areas(
    mm: Mapping[str, float | None], recordings: Sequence[Recording], given: Sizes, told: Mapping[str, float]
) -> list[str]:
    """A note for each file with another cross-section than width x thickness.

    Raises :class:`BadInput` where a person told one of them, without ``given.override``.
    """
    width, thickness = mm["width"], mm["thickness"]
    found = []
    for recording in recordings:
        area = recording.sizes.get("area")
        if width is None or thickness is None or area is None or area.mm is None or not area.has_unit:
            continue
        both = width * thickness
        if abs(area.mm - both) <= OFF * both:
            continue
        ellipse = both * math.pi / 4
        if abs(area.mm - ellipse) <= OFF * ellipse:
            told_so = (
                f"{recording.path.name} gives {area.mm:.6g} mm2, as of an ellipse {width:.6g} x {thickness:.6g} mm"
            )
            found.append(f"{told_so}; the cross-section of the bar is {both:.6g} mm2")
            continue
        differs = f"a cross-section of {area.mm:.6g} mm2, but {width:.6g} x {thickness:.6g} mm is {both:.6g} mm2"
        if {"width", "thickness"} & set(told) and not given.override:
            raise BadInput(recording.path, differs, "sizes that agree, or --override to use those given all the same")
        found.append(f"{recording.path.name} gives {differs}")
    return found


def _without_unit(recording: Recording) -> Iterator[str]:
    """A note on each size that a file gives without a unit, or in a way that cannot be read: it is not used."""
    for name, size in recording.sizes.items():
        if not size.has_unit and size.text:
            told = f"{recording.path.name} gives a {name} of {shown(size.text)} without a unit, so it is not used"
            option = f"--{name}-mm {size.mm:g}" if size.mm is not None and name != "area" else ""
            yield f"{told}; if it is in mm, give {option}" if option else told
        elif size.mm is None and size.text:
            yield f"{recording.path.name} gives a {name} of {shown(size.text)}, which is not used"


def with_first_length(
    known: Known, recordings: Sequence[Recording], ask: Ask | None = None, *, certain: bool = False
) -> Known:
    """The sizes with the length in the first row for a gauge length, where the tests hold lengths and nobody tells it.

    ``ask`` is asked whether that is right. ``certain``: raises :class:`BadInput` in place of that.
    """
    if known.mm["length"] is not None or any(recording.motion.quantity is not LENGTH for recording in recordings):
        return known
    first = float(recordings[0].numbers[0, 1])
    if certain:
        problem = f"does not give the gauge length; {first:g} mm, the length in the first row, is {LIKELY}, not certain"
        raise BadInput(recordings[0].path, problem, "--length-mm")
    if ask is not None:
        question = f"{recordings[0].path.name}: {first:g} mm, the length in the first row: is it the gauge length?"
        return known.answered({"length": first}) if ask(question, ("yes", "no")) == "yes" else known
    return replace(known, mm={**known.mm, "length": first}, notes=(*known.notes, first_length_in_words(recordings[0])))


def _contradictions(size: str, asked: float, told: Mapping[float, Path], source: str, override: bool) -> list[str]:
    """A note for each file that tells another size than the one that was ``asked`` for."""
    found = []
    for value, path in told.items():
        if abs(value - asked) <= SAME * value:
            continue
        if not override:
            problem = f"a {size} of {value:g} mm, but {source} says {asked:g}"
            raise BadInput(
                path, problem, f"a {size} for each file that has none (--answers), or --override to use it all the same"
            )
        found.append(f"{size} {asked:g} mm by {source}; {path.name} gives {value:g} mm")
    return found


def ask_for_sizes(known: Mapping[str, Known], ask: Ask) -> dict[str, Known]:
    """Ask for each size that nobody tells, specimen by specimen; what is told is never asked for.

    An empty answer leaves a size to be filled in. An answer that ends in "all" holds for all specimens that are left.
    A width that begins with "d" is a diameter, which tells the thickness too.
    """
    found = {specimen: dict(one.mm) for specimen, one in known.items()}
    left = {size: [specimen for specimen, mm in found.items() if mm[size] is None] for size in SIZES}
    for specimen in found:
        for size in SIZES:
            if specimen not in left[size]:
                continue
            can_be_round = size == "width" and specimen in left["thickness"]
            proposed = known[specimen].proposed.get(size)
            answer = _answer(size, left[size], proposed, ask, can_be_round=can_be_round)
            those = list(left[size]) if answer.for_all else [specimen]
            told = (size, "thickness") if answer.is_diameter else (size,)
            those = [one for one in those if all(one in left[each] for each in told)]
            for each in told:
                for one in those:
                    found[one][each] = answer.mm
                left[each] = [one for one in left[each] if one not in those]
    return {specimen: known[specimen].answered(mm) for specimen, mm in found.items()}


@dataclass(frozen=True)
class _Answer:
    """A size in mm, or None; whether it holds for all specimens that are left; of a round one, the side of a square."""

    mm: float | None
    for_all: bool
    is_diameter: bool = False


def _answer(size: str, left: Sequence[str], proposed: float | None, ask: Ask, *, can_be_round: bool) -> _Answer:
    """The answer for the first of the specimens that are ``left``. Asks until it can be read."""
    more = f"; '{FOR_ALL}' behind it: for all {len(left)} that are left" if len(left) > 1 else ""
    perhaps = "" if proposed is None else f"; the name of the file may say {proposed:g}"
    round_one = "; 'd 8': round, with a diameter of 8" if can_be_round else ""
    question = f"{size} of {left[0]} in mm? (empty: fill it in later{round_one}{more}{perhaps})"
    wrong = ""
    while True:
        answer = ask(wrong + question, ()).strip()
        number, for_all = answer.removesuffix(FOR_ALL).strip(), answer.endswith(FOR_ALL)
        if not number:
            return _Answer(None, for_all)
        is_diameter = can_be_round and number[0] in "dD"
        try:
            value = float(number[1 if is_diameter else 0 :].replace(",", "."))
        except ValueError:
            value = 0.0
        if is_possible(value):
            return _Answer(square_side(value) if is_diameter else value, for_all, is_diameter)
        wrong = f"{shown(answer)} is no number of millimetres. "
