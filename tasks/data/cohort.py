"""The layout of a cohort: ``COHORT/[SITE/]SPECIMEN/PROTOCOL.csv`` beside a ``specimen.json``; read and written.

Only text is read. Pickled files are refused, and so are links that leave the cohort. Whatever is wrong with a number is
reported with its file and row.
"""

import json
import math
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from sinew.runner.errors import BadInput, shown
from sinew.runner.files import new_file, read_input
from sinew.tasks.data.numeric_csv import read_header, read_numbers
from sinew.tasks.data.sizes import POSSIBLE_MM, is_possible
from sinew.tasks.data.sources import KEY, sources_of
from sinew.tasks.data.text import BINARY, HUGE, MAX_TEXT_BYTES, check_text
from sinew.tasks.model import Curve, Protocol, Specimen, file_name
from sinew.tasks.model.specimen import FORCE

COLUMNS = ("time_s", "displacement_mm", "force_N")
MOST_FURTHER = 1000  # columns behind these
GEOMETRY = ("length_mm", "width_mm", "thickness_mm")
NOTES = ("donor", "note", "source", "diameter_mm", KEY)
MAX_JSON_BYTES = 2**20
MAX_POINTS, MAX_NUMBERS, MAX_CURVES = 2_000_000, 100_000_000, 10_000  # of a curve; and of a cohort
NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_+.-]{0,99}")


@dataclass(frozen=True, eq=False)
class Cohort:
    """The specimens of a folder, in order of their names."""

    folder: Path
    specimens: tuple[Specimen, ...]

    def choose(self, names: Sequence[str], where: str) -> tuple[Specimen, ...]:
        """Specimens by name. Raises :class:`BadInput` at ``where`` for a name that is not there."""
        known = {specimen.name: specimen for specimen in self.specimens}
        for name in names:
            if name not in known:
                raise BadInput(where, f"no specimen {shown(name)} in {self.folder}", f"one of {_listed(known)}")
        return tuple(known[name] for name in names)


def read_cohort(folder: str | Path) -> Cohort:
    """Read every specimen of a cohort. Raises :class:`BadInput` for the first thing that is wrong."""
    folder = Path(folder)
    if folder.suffix.lower() in BINARY:
        raise BadInput(folder, "pickled and binary data are never read", "a folder of CSV files")
    if not os.path.isdir(folder):  # unlike Path.is_dir, it takes names of any length
        problem = "is a file" if os.path.exists(folder) else "is not there"
        raise BadInput(folder, problem, "a cohort folder with SPECIMEN/PROTOCOL.csv and SPECIMEN/specimen.json")
    root = folder.resolve()
    room = _Room(folder)
    specimens: list[Specimen] = []
    for entry in _entries(folder, root):
        if entry.is_dir():
            if _is_specimen(entry):
                specimens.append(_read_specimen(entry, root, entry.name, room))
            else:
                _check_name(entry)
                site = [child for child in _entries(entry, root) if child.is_dir()]
                if not site:
                    raise BadInput(entry, "holds no CSV file and no specimen", "PROTOCOL.csv files and specimen.json")
                specimens += [_read_specimen(child, root, f"{entry.name}/{child.name}", room) for child in site]
    if not specimens:
        raise BadInput(folder, "holds no specimen", "folders SPECIMEN with PROTOCOL.csv files and specimen.json")
    refuse_duplicates(specimens, {s.name: folder / s.name for s in specimens})
    return Cohort(folder, tuple(specimens))


@dataclass
class _Room:
    """How many numbers and curves a cohort may still have: links may make one file many curves."""

    folder: Path
    numbers: int = MAX_NUMBERS
    curves: int = MAX_CURVES

    def take(self, curve: Curve) -> Curve:
        """The curve, if there is room for it. Raises :class:`BadInput`."""
        self.numbers -= curve.force_N.size * (len(COLUMNS) + len(curve.others))
        self.curves -= 1
        if self.numbers < 0 or self.curves < 0:
            most = f"{MAX_NUMBERS:,} numbers" if self.numbers < 0 else f"{MAX_CURVES:,} curves"
            raise BadInput(self.folder, f"more than {most}", "fewer or thinner curves in a cohort")
        return curve


def read_curve(path: Path, root: Path, *, length_mm: float = math.inf) -> Curve:
    """Read ``PROTOCOL.csv``: times increase, displacements stay above ``-length_mm``, all numbers are finite.

    Columns behind those of the force may have empty cells.
    """
    check_inside(path, root)
    further = _further_columns(path)
    table = read_numbers(path, COLUMNS, further=further)
    time_s, displacement, force = table[:, : len(COLUMNS)].T
    if not 3 <= len(table) <= MAX_POINTS:
        few = "at least 3" if len(table) < 3 else f"at most {MAX_POINTS:,}; every second or tenth row will do"
        raise BadInput(path, f"{len(table):,} rows of numbers", few)
    huge = np.flatnonzero((np.abs(table) >= HUGE).any(axis=1))
    if huge.size:
        raise BadInput(f"{path}: row {huge[0] + 2}", "a number beyond 1e100", "seconds, millimetres and newtons")
    back = np.flatnonzero(np.diff(time_s) <= 0)
    if back.size:
        i = int(back[0])
        what = "stands still" if time_s[i + 1] == time_s[i] else "runs backwards"
        raise BadInput(
            f"{path}: row {i + 3}, time_s",
            f"time {what} ({time_s[i]:g} s, then {time_s[i + 1]:g} s)",
            "increasing times",
        )
    crushed = np.flatnonzero(displacement <= -length_mm)
    if crushed.size:
        i = int(crushed[0])
        raise BadInput(
            f"{path}: row {i + 2}, displacement_mm",
            f"{displacement[i]:g} mm leaves nothing of a gauge length of {length_mm:g} mm",
            "displacements above minus the gauge length, in mm",
        )
    others = {name: table[:, len(COLUMNS) + number].copy() for number, name in enumerate(further)}
    return Curve(Protocol(path.stem, time_s.copy(), displacement.copy()), force.copy(), others)


def _further_columns(path: Path) -> tuple[str, ...]:
    """Names of the columns behind that of the force; none where the header is another, which is refused later."""
    check_text(path, MAX_TEXT_BYTES)
    header = read_header(path)
    further = tuple(header[len(COLUMNS) :])
    if tuple(header[: len(COLUMNS)]) != COLUMNS:
        return ()
    if len(further) > MOST_FURTHER:
        raise BadInput(f"{path}: row 1", f"{len(further)} columns behind force_N", f"at most {MOST_FURTHER}")
    for name in further:
        if not NAME.fullmatch(name) or name == FORCE:
            expected = "another name of letters, digits, '_' and '.', such as lateral_strain"
            raise BadInput(f"{path}: row 1", f"a column called {shown(name)}", expected)
        if header.count(name) > 1:
            raise BadInput(f"{path}: row 1, {name}", "given twice", "each column once")
    return further


def check_inside(path: Path, root: Path) -> None:
    """Refuse files that are links out of ``root`` and whatever is no regular file."""
    try:
        resolved = path.resolve()
    except (RuntimeError, OSError):
        raise BadInput(path, "a link to itself", "a file") from None
    if not resolved.is_relative_to(root.resolve()):
        raise BadInput(path, f"a link that leaves {root}", "files inside the folder")
    if path.is_symlink() and not resolved.exists():
        raise BadInput(path, "a link to nothing", "a file")
    if resolved.exists() and not (resolved.is_file() or resolved.is_dir()):
        raise BadInput(path, "neither a file nor a folder", "a regular file")


def read_json(path: Path, root: Path) -> dict[str, Any]:
    """A JSON object of a cohort."""
    check_inside(path, root)
    check_text(path, MAX_JSON_BYTES)

    def unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        seen = set[str]()
        for name, _ in pairs:
            if name in seen:
                raise BadInput(f"{path}: {shown(name)[1:-1]}", "given twice", "each key once")
            seen.add(name)
        return dict(pairs)

    try:
        text = read_input(path, MAX_JSON_BYTES, "a JSON object").decode("utf-8-sig")
        content = json.loads(text, object_pairs_hook=unique)
    except (ValueError, RecursionError) as error:
        line = f": line {error.lineno}" if isinstance(error, json.JSONDecodeError) else ""
        raise BadInput(f"{path}{line}", "not valid JSON", 'an object such as {"length_mm": 10.0, ...}') from None
    if not isinstance(content, dict):
        raise BadInput(path, f"holds {shown(content)}", 'an object such as {"length_mm": 10.0, ...}')
    return content


def _read_specimen(folder: Path, root: Path, name: str, room: _Room) -> Specimen:
    _check_name(folder)
    entries = list(_entries(folder, root))
    curves = [entry for entry in entries if entry.suffix.lower() == ".csv"]
    if not curves:
        raise BadInput(folder, "holds no CSV file", "one PROTOCOL.csv for each protocol")
    described = folder / "specimen.json"
    if described not in entries:
        raise BadInput(described, "is not there", f"a JSON object with {', '.join(GEOMETRY)}")
    content = read_json(described, root)
    for key in content:
        if key not in (*GEOMETRY, *NOTES):
            raise BadInput(f"{described}: {key}", "unknown key", f"one of {', '.join((*GEOMETRY, *NOTES))}")
    length, width, thickness = (_size(described, content, key) for key in GEOMETRY)
    for path in curves:
        _check_name(path)
    donor, sources = content.get("donor"), sources_of(described, content)
    read = [room.take(read_curve(path, root, length_mm=length)) for path in curves]
    return Specimen(
        name,
        length,
        width,
        thickness,
        curves=tuple(replace(curve, source=sources.get(curve.name, "")) for curve in read),
        donor=None if donor is None else str(donor),
    )


def _size(path: Path, content: dict[str, Any], key: str) -> float:
    if key not in content:
        raise BadInput(f"{path}: {key}", "missing", "a length in mm")
    value = content[key]
    if value is None:
        raise BadInput(f"{path}: {key}", "is not filled in", "a length in mm, such as 10.0")
    if isinstance(value, bool) or not isinstance(value, int | float) or not is_possible(value):
        raise BadInput(f"{path}: {key}", shown(value), f"a length in mm, {POSSIBLE_MM}")
    return float(value)


def _check_name(path: Path) -> None:
    if path.name == "total.csv":
        raise BadInput(path, "the name 'total' is taken by the sum over protocols", "another protocol name")
    if not NAME.fullmatch(path.stem if path.suffix.lower() == ".csv" else path.name):
        raise BadInput(path, "a name that cannot be used", "letters, digits, '_', '-', '+' and '.' in names")


def _is_specimen(folder: Path) -> bool:
    return any(child.suffix.lower() == ".csv" or child.name == "specimen.json" for child in folder.iterdir())


def visible(folder: Path) -> list[Path]:
    """What is in a folder, in order of name, without hidden files. Raises :class:`BadInput` if it cannot be read."""
    try:
        return sorted(child for child in folder.iterdir() if not child.name.startswith("."))
    except OSError as error:
        raise BadInput(folder, f"cannot be read ({error.strerror})", "a readable folder") from None


def _entries(folder: Path, root: Path) -> Iterator[Path]:
    """What is in a folder, in order of name; hidden files are passed over, pickled ones refused."""
    for child in visible(folder):
        if child.suffix.lower() in BINARY:
            raise BadInput(child, "pickled and binary data are never read", "the same numbers as CSV")
        check_inside(child, root)
        if child.is_symlink() and child.is_dir() and root in (child.resolve(), *child.resolve().parents):
            target = child.resolve()
            if target == root or folder.resolve().is_relative_to(target):
                raise BadInput(child, "a link to a folder that contains it", "specimen folders")
        yield child


def write_cohort(folder: str | Path, specimens: Sequence[Specimen], truth: Mapping[str, Any] | None = None) -> None:
    """Write ``FOLDER/SPECIMEN/PROTOCOL.csv`` and ``specimen.json``, and the ``truth`` of a virtual cohort.

    Numbers have 10 significant digits. Raises :class:`BadInput` if a specimen is there already, or a link on the way to
    it, which would lead elsewhere.
    """
    folder = Path(folder)
    for specimen in specimens:
        place = folder / specimen.name
        for parent in place.parents[: len(Path(specimen.name).parts) - 1]:
            if parent.is_symlink():
                raise BadInput(parent, "is a link", "a folder")
        if os.path.lexists(place):
            raise BadInput(folder / specimen.name, "is there already", "a new folder, or specimens that are not in it")
    for specimen in specimens:
        target = folder / specimen.name
        target.mkdir(parents=True)
        content: dict[str, Any] = {key: getattr(specimen, key) for key in GEOMETRY}
        if specimen.donor is not None:
            content["donor"] = specimen.donor
        if sources := {curve.name: curve.source for curve in specimen.curves if curve.source}:
            content[KEY] = sources
        (target / "specimen.json").write_text(json.dumps(content, indent=1) + "\n", "utf-8")
        for curve in specimen.curves:
            columns = (curve.protocol.time_s, curve.protocol.displacement_mm, curve.force_N)
            table = pd.DataFrame({**dict(zip(COLUMNS, columns, strict=True)), **curve.others})
            table.to_csv(target / f"{curve.name}.csv", index=False, float_format="%.10g")
    if truth is not None:
        with new_file(folder / "truth.json") as file:
            file.write(json.dumps(truth, indent=1).encode() + b"\n")


def refuse_duplicates(specimens: Sequence[Specimen], places: Mapping[str, Path]) -> None:
    """Refuse two specimens of one name, or with the same numbers. ``places`` holds where each one comes from."""
    names: dict[str, str] = {}
    files: dict[str, str] = {}
    digests: dict[tuple[str, ...], str] = {}
    for specimen in specimens:
        if names.get(specimen.name.casefold()) == specimen.name:
            raise BadInput(places[specimen.name], f"a duplicate of specimen {specimen.name}", "unique names")
        other = names.setdefault(specimen.name.casefold(), specimen.name)
        if other != specimen.name:
            raise BadInput(places[specimen.name], f"a duplicate of specimen {other} but for upper case", "unique names")
        other = files.setdefault(file_name(specimen.name).casefold(), specimen.name)
        if other != specimen.name:
            problem = f"would be called {file_name(specimen.name)} in results, as {other} is"
            raise BadInput(places[specimen.name], problem, "names that differ in more than / and _")
        digest = tuple(curve.digest for curve in specimen.curves)
        other = digests.setdefault(digest, specimen.name)
        if other != specimen.name:
            raise BadInput(
                places[specimen.name], f"a duplicate of specimen {other}: its curves are the same numbers",
                "each specimen once",
            )  # fmt: skip


def _listed(names: Any) -> str:
    listed = list(names)
    return ", ".join(listed[:8]) + (", ..." if len(listed) > 8 else "")
