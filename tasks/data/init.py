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
from sinew.tasks.data.answers import Answers, with_answers, write_answers
from sinew.tasks.data.certainty import Columns, refuse_doubts, refuse_unsure_names
from sinew.tasks.data.cohort import Cohort, read_cohort, refuse_duplicates, visible, write_cohort
from sinew.tasks.data.curves import Bar, begins_elsewhere, curve_of
from sinew.tasks.data.first_ranges import first_ranges
from sinew.tasks.data.further import refuse_unknown
from sinew.tasks.data.hints import Hints
from sinew.tasks.data.layout import NoTable
from sinew.tasks.data.names import FileName, names_of, of_test
from sinew.tasks.data.new_study import (
    LeftOut,
    NewSpecimen,
    ReadFile,
    describe,
    describe_left_out,
    describe_unused,
    leave_open,
    write_study,
)
from sinew.tasks.data.oddities import contradictions, odd_tests
from sinew.tasks.data.quantities import LENGTH, STRAIN, STRESS, STRETCH
from sinew.tasks.data.questions import NEITHER, Doubt, NoColumn, Unclear
from sinew.tasks.data.recording import Recording
from sinew.tasks.data.recordings import read_recordings
from sinew.tasks.data.remarks import remarks
from sinew.tasks.data.sheets import SUFFIXES
from sinew.tasks.data.sizes import SIZES
from sinew.tasks.data.specimen_sizes import Ask, Known, Sizes, ask_for_sizes, known_sizes, with_first_length
from sinew.tasks.data.tables import read_source
from sinew.tasks.data.taken import TITLES, look_at, rows_of, usable
from sinew.tasks.data.told import as_told
from sinew.tasks.drawing.blocks import plural
from sinew.tasks.model import Specimen
from sinew.tasks.study.workspace import check_folder

TABLES = {".csv", ".txt", ".tsv", ".dat", ".asc", ".tra", ".lvm", *SUFFIXES}
MOST_FILES, DEEPEST = 10_000, 4
ANSWERS, OVERVIEW = "answers.yaml", "tests.png"


@dataclass(frozen=True)
class NewStudy:
    """A study file that was written, what was guessed for it line by line, the files to be filled in, the specimens."""

    study: Path
    lines: tuple[str, ...]
    to_fill_in: tuple[Path, ...] = ()
    specimens: tuple[Specimen, ...] = ()


def init(
    files: Sequence[Path],
    out: Path,
    *,
    hints: Hints | None = None,
    sizes: Sizes | None = None,
    ask: Ask | None = None,
    answers: Answers | None = None,
    certain: bool = False,
    show: Callable[[Sequence[str], Sequence[Sequence[str]]], None] | None = None,
) -> NewStudy:
    """Write ``out/study.yaml`` and, unless ``files`` is a cohort already, ``out/cohort``. Raises :class:`BadInput`.

    ``ask`` is asked for units, signs and sizes that no file tells, and for which ``answers`` have none. Without it, an
    unknown unit or a doubtful sign is refused, and an unknown size is left to be filled in. What was told is kept in
    ``out/answers.yaml``.
    ``certain``: refuse what is only likely, and sizes that nobody tells. ``show`` gets the titles and the rows of a
    table of what each file is taken for, before anything is asked.
    """
    check_folder(out)
    answers = answers or Answers()
    for taken in (out / "study.yaml", out / "cohort", out / ANSWERS, out / OVERVIEW):
        if os.path.lexists(taken):
            raise BadInput(taken, "is there already", "a new folder for --out")
    if len(files) == 1 and (cohort := _ready_cohort(files[0])) is not None:
        return _study_of_cohort(cohort, out)
    found = find_tables(files)
    hints, sizes = with_answers(hints or Hints(), answers.hints), sizes or Sizes()
    looked = {} if show is None else look_at((*found.named, *found.in_folders), hints, sizes)
    if show is not None:
        show(TITLES, rows_of(looked, hints))
    columns = Columns.of(answers.confirmed, answers.instead)
    read = read_all(found, hints, ask, answered=answers.answered, columns=columns, known=usable(looked))
    names = names_of([one.path for one in read.recordings])
    if certain:
        refuse_unsure_names(names)
    if certain or ask is None:
        refuse_doubts(read.recordings)
    if certain:
        columns.refuse_likely(read.recordings)
    new = specimens_of(read.recordings, names, sizes, ask, answers.sizes, certain=certain)
    refuse_duplicates([one.specimen for one in new], {one.specimen.name: one.tests[0].path for one in new})
    whole = [one.specimen for one in new if not one.missing]
    others = [one.specimen for one in new if one.missing]
    ranges = first_ranges(whole, others)
    out.mkdir(parents=True, exist_ok=True)
    write_cohort(out / "cohort", [one.specimen for one in new])
    to_fill_in = []
    for one in new:
        if one.missing:
            path = out / "cohort" / one.specimen.name / "specimen.json"
            leave_open(path, one.missing)
            to_fill_in.append(path)
    study = write_study(out, "cohort", [one.specimen for one in new], ranges)
    sizes_told = {one.specimen.name: one.told for one in new}
    write_answers(out / ANSWERS, Answers(hints, sizes_told, read.answered, *columns.told))
    told = (*describe(new), *describe_unused(answers.sizes, new), *contradictions(new), *odd_tests(whole))
    lines = (*told, *ranges.lines, *describe_left_out(read.left_out))
    return NewStudy(study, lines, tuple(to_fill_in), tuple(one.specimen for one in new))


# ---- a cohort that is there already


def _ready_cohort(folder: Path) -> Cohort | None:
    """The cohort in a folder; None where the folder has another layout."""
    if not folder.is_dir() or not any(_walk(folder, lambda path: path.name == "specimen.json")):
        return None
    return read_cohort(folder)


def _study_of_cohort(cohort: Cohort, out: Path) -> NewStudy:
    if out.resolve().is_relative_to(cohort.folder.resolve()):
        raise BadInput(f"--out {out}", f"lies inside the cohort {cohort.folder}", "a folder beside it")
    ranges = first_ranges(cohort.specimens)
    out.mkdir(parents=True, exist_ok=True)
    study = write_study(out, os.path.relpath(cohort.folder.resolve(), out.resolve()), cohort.specimens, ranges)
    curves = sum(len(one.curves) for one in cohort.specimens)
    specimens = plural(len(cohort.specimens), "specimen")
    line = f"{cohort.folder}: a cohort of {specimens}, {plural(curves, 'curve')}, used as it is"
    return NewStudy(study, (line, *ranges.lines), specimens=tuple(cohort.specimens))


# ---- which files


@dataclass(frozen=True)
class Files:
    """Files with tables: those that a person ``named``, and those found in folders. ``left_out``: others, and why."""

    named: tuple[Path, ...]
    in_folders: tuple[Path, ...]
    left_out: tuple[LeftOut, ...] = ()


def find_tables(files: Sequence[Path]) -> Files:
    """The files, and those with tables in folders, each once. Raises :class:`BadInput` where there is none."""
    if not files:
        raise BadInput("init", "no files", "exported tests (CSV), or folders of them")
    named: list[Path] = []
    in_folders: list[Path] = []
    left_out: list[LeftOut] = []
    seen: set[str] = set()
    for path in sorted(files, key=Path.is_dir):  # a file that is also in a folder was named
        if not path.exists():
            raise BadInput(path, "is not there", "exported tests (CSV), or a folder of them")
        inside, root = list[Path](), path.resolve()
        for one in _walk(path, Path.is_file) if path.is_dir() else ():
            if one.is_symlink() and not one.resolve().is_relative_to(root):
                left_out.append((one, "a link that leaves the folder; name it itself, if it is meant"))
            else:
                inside.append(one)
        found = [one for one in inside if one.suffix.lower() in TABLES] if path.is_dir() else [path]
        if not found and any(one.is_relative_to(path) and one.is_symlink() for one, _ in left_out):
            raise BadInput(
                path, "holds no table but links that leave it", "tables inside, or what they lead to, by name"
            )
        if not found:
            problem = "holds no file with the ending of a table"
            raise BadInput(path, problem, f"{', '.join(sorted(TABLES))}; or text files of another ending, by name")
        others = [one for one in inside if one.suffix.lower() not in TABLES and one not in files]
        left_out += [(one, f"{one.suffix or 'no ending'} is no ending of a table") for one in others]
        for one in found:
            if len(seen) >= MOST_FILES:
                raise BadInput(path, f"more than {MOST_FILES:,} files", "the files of one study")
            if (real := os.path.realpath(one)) not in seen:
                seen.add(real)
                (in_folders if path.is_dir() else named).append(one)
    return Files(tuple(named), tuple(in_folders), tuple(left_out))


def _walk(folder: Path, wanted: Callable[[Path], bool], depth: int = DEEPEST) -> Iterator[Path]:
    """Files in a folder and below; hidden ones and links to folders are passed over."""
    for child in visible(folder):
        if child.is_dir() and not child.is_symlink() and depth > 0:
            yield from _walk(child, wanted, depth - 1)
        elif wanted(child):
            yield child


@dataclass(frozen=True)
class Read:
    """Tests of all files, and files that are left out (in folders, without a table of a test).

    ``answered``: what holds for files that ask for it.
    """

    recordings: Sequence[Recording]
    left_out: Sequence[LeftOut]
    answered: Hints


@dataclass
class _Person:
    """Who answers a question once for all files that ask it. ``answered``: so far; ``ask``: None if nobody is there."""

    ask: Ask | None
    answered: Hints

    def answer(self, where: Path, what: Unclear | Doubt) -> str | None:
        """The answer to a question on a file; None if nobody can give it."""
        known = self.answered.of(what.option)
        if known in what.choices:
            return str(known)
        if self.ask is None:
            return None
        answer = self.ask(what.question_on(where.name), what.choices)
        self.answered = self.answered.answered(what.option, answer)
        return answer


def read_all(
    files: Files,
    hints: Hints,
    ask: Ask | None = None,
    *,
    answered: Hints | None = None,
    columns: Columns | None = None,
    known: Mapping[Path, Sequence[Recording]] | None = None,
) -> Read:
    """Every file. What one does not tell is asked for once, and holds for all files that do not tell it.

    ``hints`` hold for all files, ``answered`` for those that ask. ``columns``: which likely ones are right; if
    omitted, nobody is asked about them. ``known``: tests of files that were read already.
    """
    recordings: list[Recording] = []
    left_out = list(files.left_out)
    person = _Person(ask, answered or Hints())
    for path in (*files.named, *files.in_folders):
        try:
            found, told = ((known or {}).get(path), hints)
            if found is None:
                found, told = _read(path, hints, person)
            while columns and (other := next((each for one in found if (each := columns.other(one, ask))), None)):
                tests = len(found)
                found, told = _read(path, told.answered(*other), person)
                if len(found) != tests:
                    problem = f"{other[0]} {shown(other[1])} cannot be of each of its {tests} tests beside each other"
                    raise BadInput(path, problem, "a file for each test")
        except (NoTable, NoColumn) as none:
            if path in files.named or (isinstance(none, NoColumn) and not none.alone):
                raise
            left_out.append((path, none.problem))
            continue
        recordings += [_settled(one, told, person) for one in found]
    if not recordings:
        path, problem = left_out[-1]
        expected = "at least one file with a test; `sinew import --dry-run` says what each file lacks"
        raise BadInput(path, problem, expected)
    refuse_unknown(hints.further, [one.further.values for one in recordings], recordings[0].left_out)
    return Read(recordings, left_out, person.answered)


def _read(path: Path, hints: Hints, person: _Person) -> tuple[Sequence[Recording], Hints]:
    """The tests in a file, and the hints with the answers that it needs."""
    source = read_source(path)
    while True:
        try:
            return read_recordings(source, hints), hints
        except Unclear as unclear:
            answer = person.answer(path, unclear)
            if answer is None or hints.of(unclear.option) == answer:  # it was told, and does not help
                raise unclear.unanswered() from None
            hints = hints.answered(unclear.option, answer)
        except NoColumn as none:
            answer = None if none.alone or none.question is None else person.answer(path, none.question)
            if none.question is None or answer in (None, NEITHER, hints.of(none.question.option)):
                raise
            hints = hints.answered(none.question.option, str(answer))


def _settled(recording: Recording, hints: Hints, person: _Person) -> Recording:
    """The recording counted as ``hints`` and the answers to its doubts say."""
    while True:
        found = as_told(recording, hints)
        answer = person.answer(recording.path, found.doubts[0]) if found.doubts else None
        if answer is None:
            return found
        hints = hints.answered(found.doubts[0].option, answer)


# ---- specimens


def specimens_of(
    recordings: Sequence[Recording],
    names: Mapping[Path, FileName],
    sizes: Sizes,
    ask: Ask | None = None,
    answers: Mapping[str, Mapping[str, float]] | None = None,
    *,
    certain: bool = False,
) -> list[NewSpecimen]:
    """Recordings grouped by specimen, with their sizes; ``answers``: earlier ones (mm). Raises :class:`BadInput`.

    ``certain``: refuse a size that is only likely, and one that nobody tells.
    """
    grouped: dict[str, list[ReadFile]] = {}
    for recording in recordings:
        name = of_test(names[recording.path], recording.test)
        ours = grouped.setdefault(name.specimen, [])
        if any(one.name.protocol == name.protocol for one in ours):
            problem = f"two tests of specimen {name.specimen} are called {shown(name.protocol)}"
            raise BadInput(recording.path, problem, "other names of files, or of the tests in one file")
        ours.append(ReadFile(recording, name))
    tests = dict(sorted(grouped.items()))
    known = {}
    for specimen, each in tests.items():
        of = [one.recording for one in each]
        found = known_sizes(specimen, of, sizes, (answers or {}).get(specimen, {}))
        known[specimen] = with_first_length(found, of, ask, certain=certain)
    if ask is not None:
        known = ask_for_sizes(known, ask)
    new = [_specimen(name, each, known[name]) for name, each in tests.items()]
    if certain:
        refuse_unknown_sizes(new)
    return new


def _specimen(name: str, tests: Sequence[ReadFile], known: Known) -> NewSpecimen:
    notes = [*known.notes, *known.proposals]
    for test in tests:
        _check_sizes(test.recording, known.mm)
        found = (*remarks(test.recording), *begins_elsewhere(test.recording, known.mm["length"]))
        notes += [f"{test.path.name}: {remark}" for remark in found]
    length, width, thickness = (known.mm[size] for size in SIZES)
    bar = Bar(length or math.inf, width or 1.0, thickness or 1.0)
    curves = tuple(curve_of(test.recording, bar, test.name.protocol) for test in tests)
    specimen = Specimen(name, length or 1.0, width or 1.0, thickness or 1.0, curves)
    missing = tuple(size for size in SIZES if known.mm[size] is None)
    return NewSpecimen(specimen, tuple(tests), missing, tuple(notes), known.told)


def refuse_unknown_sizes(specimens: Sequence[NewSpecimen]) -> None:
    """Raises :class:`BadInput` for the first specimen with sizes that nobody tells, and names all of them."""
    for one in specimens:
        if one.missing:
            problem = f"does not give the {' and the '.join(one.missing)} of {one.specimen.name}"
            raise BadInput(one.tests[0].path, problem, ", ".join(f"--{size}-mm" for size in one.missing))


def _check_sizes(recording: Recording, known: Mapping[str, float | None]) -> None:
    """Refuse a recording that needs a size that nobody knows."""
    motion, load = recording.motion.quantity, recording.load.quantity
    if motion in (STRAIN, STRETCH, LENGTH) and known["length"] is None:
        problem = f"{motion.name} makes a displacement with the gauge length only"
        raise BadInput(recording.path, problem, "--length-mm (1 for normalised data)")
    if load is STRESS and (known["width"] is None or known["thickness"] is None):
        expected = "--width-mm and --thickness-mm (1 and 1 for normalised data: newtons are MPa then)"
        raise BadInput(recording.path, "a stress makes a force with the cross-section only", expected)
