"""A study of a person's own files, as ``sinew init`` makes it: a cohort in the layout of docs/data.md and a study file.

Columns and names are guessed and listed, units are read or asked for. Nothing is written before every file is
understood.
"""

import math
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from sinew.runner.errors import BadInput, shown
from sinew.tasks.data.cohort import GEOMETRY, Cohort, read_cohort, refuse_duplicates, write_cohort
from sinew.tasks.data.columns import LENGTH, LIKELY, STRAIN, STRESS, STRETCH, Hints, UnknownUnit
from sinew.tasks.data.names import FileName, names_of
from sinew.tasks.data.new_study import NewSpecimen, ReadFile, describe, leave_open, write_study
from sinew.tasks.data.recordings import Bar, Recording, curve_of, read_recording, remarks
from sinew.tasks.data.sheets import SUFFIXES
from sinew.tasks.data.sizes import LONGEST_MM, SIZES, square_side
from sinew.tasks.model import Specimen
from sinew.tasks.study.workspace import check_folder

TABLES = {".csv", ".txt", ".tsv", ".dat", ".asc", ".tra", *SUFFIXES}
MOST_FILES, DEEPEST = 10_000, 4

#: Asks a person for one answer (question, choices or none). Not given where nobody can answer.
Ask = Callable[[str, Sequence[str]], str]


@dataclass(frozen=True)
class Sizes:
    """Gauge length, width and thickness (mm) of all specimens. None: each file's own, or to be filled in."""

    length_mm: float | None = None
    width_mm: float | None = None
    thickness_mm: float | None = None

    def __post_init__(self) -> None:
        """Raises :class:`BadInput` for a size that is impossible."""
        for name in GEOMETRY:
            value = getattr(self, name)
            if value is not None and not 0 < value < LONGEST_MM:
                raise BadInput(f"--{name.replace('_', '-')}", f"{value:g}", f"above 0 and below {LONGEST_MM:g} mm")


@dataclass(frozen=True)
class NewStudy:
    """A study file that was written, what was guessed for it line by line, and the files to be filled in."""

    study: Path
    lines: tuple[str, ...]
    to_fill_in: tuple[Path, ...] = ()


def init(
    files: Sequence[Path], out: Path, *, hints: Hints | None = None, sizes: Sizes | None = None, ask: Ask | None = None
) -> NewStudy:
    """Write ``out/study.yaml`` and, unless ``files`` is a cohort already, ``out/cohort``. Raises :class:`BadInput`.

    ``ask`` is asked for units and sizes that no file tells. Without it, an unknown unit is refused, and an unknown size
    is left to be filled in.
    """
    check_folder(out)
    for taken in (out / "study.yaml", out / "cohort"):
        if os.path.lexists(taken):
            raise BadInput(taken, "is there already", "a new folder for --out")
    if len(files) == 1 and (cohort := _ready_cohort(files[0])) is not None:
        return _study_of_cohort(cohort, out)
    paths = list(find_tables(files))
    recordings = read_all(paths, hints or Hints(), ask)
    sizes = _ask_for_sizes(recordings, sizes or Sizes(), ask)
    new = specimens_of(recordings, names_of(paths), sizes)
    refuse_duplicates([one.specimen for one in new], {one.specimen.name: one.tests[0].path for one in new})
    out.mkdir(parents=True, exist_ok=True)
    write_cohort(out / "cohort", [one.specimen for one in new])
    to_fill_in = []
    for one in new:
        if one.missing:
            path = out / "cohort" / one.specimen.name / "specimen.json"
            leave_open(path, one.missing)
            to_fill_in.append(path)
    study = write_study(out, "cohort", [one.specimen for one in new])
    return NewStudy(study, tuple(describe(new)), tuple(to_fill_in))


# ---- a cohort that is there already


def _ready_cohort(folder: Path) -> Cohort | None:
    """The cohort in a folder; None where the folder has another layout."""
    if not folder.is_dir() or not any(_walk(folder, lambda path: path.name == "specimen.json")):
        return None
    return read_cohort(folder)


def _study_of_cohort(cohort: Cohort, out: Path) -> NewStudy:
    if out.resolve().is_relative_to(cohort.folder.resolve()):
        raise BadInput(f"--out {out}", f"lies inside the cohort {cohort.folder}", "a folder beside it")
    out.mkdir(parents=True, exist_ok=True)
    study = write_study(out, os.path.relpath(cohort.folder.resolve(), out.resolve()), cohort.specimens)
    curves = sum(len(one.curves) for one in cohort.specimens)
    line = f"{cohort.folder}: a cohort of {len(cohort.specimens)} specimens, {curves} curves, used as it is"
    return NewStudy(study, (line,))


# ---- which files


def find_tables(files: Sequence[Path]) -> Iterator[Path]:
    """The files, and those with tables in folders, each once. Raises :class:`BadInput` where there is none."""
    if not files:
        raise BadInput("init", "no files", "exported tests (CSV), or folders of them")
    seen: set[str] = set()
    for path in files:
        if not path.exists():
            raise BadInput(path, "is not there", "exported tests (CSV), or a folder of them")
        found = list(_walk(path, _is_table)) if path.is_dir() else [path]
        if not found:
            raise BadInput(path, "holds no table", f"files ending in {', '.join(sorted(TABLES))}")
        for one in found:
            if len(seen) >= MOST_FILES:
                raise BadInput(path, f"more than {MOST_FILES:,} files", "the files of one study")
            if (real := os.path.realpath(one)) not in seen:
                seen.add(real)
                yield one


def _is_table(path: Path) -> bool:
    return path.suffix.lower() in TABLES and path.is_file()


def _walk(folder: Path, wanted: Callable[[Path], bool], depth: int = DEEPEST) -> Iterator[Path]:
    """Files in a folder and below; hidden ones and links to folders are passed over."""
    try:
        children = sorted(folder.iterdir())
    except OSError as error:
        raise BadInput(folder, f"cannot be read ({error.strerror})", "a readable folder") from None
    for child in children:
        if child.name.startswith("."):
            continue
        if child.is_dir() and not child.is_symlink() and depth > 0:
            yield from _walk(child, wanted, depth - 1)
        elif wanted(child):
            yield child


def read_all(paths: Sequence[Path], hints: Hints, ask: Ask | None = None) -> list[Recording]:
    """Every file. A unit that one does not tell is asked for once, and holds for all files that do not tell it."""
    recordings: list[Recording] = []
    for path in paths:
        while True:
            try:
                recordings.append(read_recording(path, hints))
                break
            except UnknownUnit as unknown:
                if ask is None:
                    raise
                question = f"{unknown.quantity} in {path.name}: which unit? (for all files that do not say)"
                hints = hints.answered(unknown.option, ask(question, unknown.choices))
    return recordings


# ---- sizes


def _ask_for_sizes(recordings: Sequence[Recording], sizes: Sizes, ask: Ask | None) -> Sizes:
    if ask is None:
        return sizes
    known = {name: getattr(sizes, name) for name in GEOMETRY}
    for name in SIZES:
        if known[f"{name}_mm"] is None and any(size_of(recording, name) is None for recording in recordings):
            answer = ask(f"{name} of the specimens in mm? (empty: fill it in later)", ())
            try:
                known[f"{name}_mm"] = float(answer.replace(",", ".")) if answer.strip() else None
            except ValueError:
                raise BadInput(f"--{name}-mm", shown(answer), "a number of millimetres") from None
    return Sizes(**known)


def size_of(recording: Recording, name: str) -> float | None:
    """A size (mm) that the file tells with its unit. A diameter is that of a bar with a square of equal area."""
    diameter = recording.sizes.get("diameter")
    if name != "length" and diameter is not None and diameter.mm is not None and diameter.has_unit:
        return square_side(diameter.mm)
    size = recording.sizes.get(name)
    return size.mm if size is not None and size.has_unit else None


# ---- specimens


def specimens_of(recordings: Sequence[Recording], names: Mapping[Path, FileName], sizes: Sizes) -> list[NewSpecimen]:
    """Recordings grouped by specimen. ``sizes`` go before those of files. Raises :class:`BadInput`."""
    grouped: dict[str, list[ReadFile]] = {}
    for recording in recordings:
        name = names[recording.path]
        grouped.setdefault(name.specimen, []).append(ReadFile(recording, name))
    return [_specimen(name, tests, sizes) for name, tests in sorted(grouped.items())]


def _specimen(name: str, tests: Sequence[ReadFile], sizes: Sizes) -> NewSpecimen:
    known = {size: _common_size(name, tests, size, getattr(sizes, f"{size}_mm")) for size in SIZES}
    notes: list[str] = []
    if known["length"] is None and all(test.recording.motion.quantity is LENGTH for test in tests):
        known["length"] = float(tests[0].recording.numbers[0, 1])
        notes.append(f"gauge length {known['length']:g} mm, {LIKELY}: the length in the first row")
    for test in tests:
        _check_sizes(test.recording, known)
        notes += [f"{test.path.name}: {remark}" for remark in remarks(test.recording)]
    length, width, thickness = known["length"] or math.inf, known["width"] or 1.0, known["thickness"] or 1.0
    bar = Bar(length, width, thickness)
    curves = tuple(curve_of(test.recording, bar, test.name.protocol) for test in tests)
    specimen = Specimen(name, known["length"] or 1.0, width, thickness, curves)
    return NewSpecimen(specimen, tuple(tests), tuple(size for size in SIZES if known[size] is None), tuple(notes))


def _common_size(name: str, tests: Sequence[ReadFile], size: str, given: float | None) -> float | None:
    """A size of a specimen: the one ``given``, or that of its files. Raises :class:`BadInput` if these disagree."""
    values: dict[float, Path] = {}
    for test in tests:
        if (value := size_of(test.recording, size)) is not None:
            values.setdefault(value, test.path)
    if given is None and len(values) > 1:
        (first, one), (second, other), *_ = values.items()
        problem = f"a {size} of {second:g} mm, but {first:g} mm in {one}, of the same specimen {name}"
        raise BadInput(other, problem, f"files of one specimen, or --{size}-mm")
    return given or next(iter(values), None)


def _check_sizes(recording: Recording, known: Mapping[str, float | None]) -> None:
    """Refuse a recording that needs a size that nobody knows."""
    motion, load = recording.motion.quantity, recording.load.quantity
    if motion in (STRAIN, STRETCH, LENGTH) and known["length"] is None:
        problem = f"{motion.name} makes a displacement with the gauge length only"
        raise BadInput(recording.path, problem, "--length-mm (1 for normalised data)")
    if load is STRESS and (known["width"] is None or known["thickness"] is None):
        expected = "--width-mm and --thickness-mm (1 and 1 for normalised data: newtons are MPa then)"
        raise BadInput(recording.path, "a stress makes a force with the cross-section only", expected)
