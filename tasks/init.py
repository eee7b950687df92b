"""A study of a person's own files: curves in the layout of docs/data.md, and a study file that says what each field is.

Structure is guessed and told, units are read or asked for (:mod:`tasks.guess`). Nothing is written before every file is
understood.
"""

import json
import math
import os
import re
import shlex
import unicodedata
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import jinja2
import numpy as np
from jinja2.sandbox import SandboxedEnvironment

from tasks.bench_exports import LONGEST
from tasks.cohort import write_cohort
from tasks.export_tables import MM
from tasks.guess import LENGTH, LIKELY, POSITION, STRAIN, STRESS, STRETCH, Guess, Hints, UnitUnknown, guess, with_hints
from tasks.measurements import GEOMETRY, NAME, Cohort, read_cohort, refuse_duplicates
from tasks.model import TENDON, Curve, Protocol, Specimen
from tasks.problems import BadInput, one_line, shown
from tasks.resources import resource
from tasks.study import read_study
from tasks.task import TASKS
from tasks.workspace import check_folder, write_text

UNSURE = "unsure: a number may be a specimen's or a trial's; rename to SPECIMEN_PROTOCOL if it is wrong"
TABLES = {".csv", ".txt", ".tsv", ".dat", ".asc"}
MOST_FILES, DEEPEST = 10_000, 4
SIZES = ("length", "width", "thickness")
WORDS = {
    "length": ("length", "länge", "laenge", "messlänge", "longueur"),
    "width": ("width", "breite", "largeur"),
    "thickness": ("thickness", "dicke", "épaisseur", "epaisseur"),
    "diameter": ("diameter", "durchmesser", "diamètre", "diametre"),
}
LONGEST_SIZE = 200  # characters of a line that tells a size
_UNIT = "|".join(re.escape(unit) for unit in sorted(MM, key=len, reverse=True))
#: 'Specimen properties : Length 14.33 mm', 'Gauge length (mm) 10,13', 'width_mm: 8.3', with single spaces.
_SIZE = re.compile(
    r"(?:.*: ?)?(?:(?:gauge|gage|specimen|sample|initial)[ _])*"
    rf"(?P<what>{'|'.join(word for words in WORDS.values() for word in words)})"
    rf"(?:[ _/]* ?[(\[]?(?P<unit>{_UNIT})[)\]]?)? ?[:=]? ?"
    rf"(?P<value>[0-9]+(?:[.,][0-9]+)?)(?: ?[(\[]?(?P<behind>{_UNIT})[)\]]?)?",
    re.IGNORECASE,
)
#: Words of file names that name a protocol, so that what is left names the specimen.
PROTOCOLS = (
    "one_step", "two_step", "onestep", "twostep", "step", "steps", "stress_relaxation", "relaxation", "relax",
    "creep", "hold", "cyclic", "cycles", "cycle", "cyc", "precondition", "preconditioning", "ramp", "pull", "failure",
    "fail", "rupture", "tension", "tensile", "quasistatic", "dynamic", "sinus", "sine", "fast", "slow", "loading",
    "test",
)  # fmt: skip

#: Asks a person for one answer (question, choices or none); not given where nobody can answer.
Ask = Callable[[str, Sequence[str]], str]


@dataclass(frozen=True)
class Sizes:
    """Gauge length, width and thickness (mm) of all specimens; None: each file's own, or to be filled in."""

    length_mm: float | None = None
    width_mm: float | None = None
    thickness_mm: float | None = None

    def __post_init__(self) -> None:
        """Raises :class:`BadInput` for a size that is impossible."""
        for name in GEOMETRY:
            value = getattr(self, name)
            if value is not None and not 0 < value < LONGEST:
                raise BadInput(f"--{name.replace('_', '-')}", f"{value:g}", f"above 0 and below {LONGEST:g} mm")


@dataclass(frozen=True)
class Made:
    """What was made: lines that say what was guessed and how sure that is, and what is still to be filled in."""

    study: Path
    told: tuple[str, ...]
    missing: tuple[Path, ...] = ()


@dataclass(frozen=True, eq=False)
class _Test:
    """A file that is understood, and which specimen and protocol it is."""

    path: Path
    guess: Guess
    specimen: str
    protocol: str
    named: str  # how sure that is


def init(
    files: Sequence[Path], out: Path, *, hints: Hints | None = None, sizes: Sizes | None = None, ask: Ask | None = None
) -> Made:
    """Write ``out/study.yaml`` and, unless ``files`` is a cohort already, ``out/cohort``. Raises :class:`BadInput`.

    ``ask`` is asked for units and sizes that no file tells. Without it, an unknown unit is refused, and an unknown size
    becomes a place to fill in.
    """
    check_folder(out)
    for taken in (out / "study.yaml", out / "cohort"):
        if os.path.lexists(taken):
            raise BadInput(taken, "is there already", "a new folder for --out")
    if len(files) == 1 and (cohort := _ready_cohort(files[0])) is not None:
        return _of_cohort(cohort, out)
    paths = list(_tables(files))
    tests = _understood(paths, hints or Hints(), ask)
    sizes = _asked_sizes(tests, sizes or Sizes(), ask)
    specimens = _specimens(tests, sizes)
    refuse_duplicates([one.specimen for one in specimens], {one.specimen.name: one.tests[0].path for one in specimens})
    out.mkdir(parents=True, exist_ok=True)
    write_cohort(out / "cohort", [one.specimen for one in specimens])
    missing = []
    for one in specimens:
        if one.missing:
            path = out / "cohort" / one.specimen.name / "specimen.json"
            _leave_open(path, one.missing)
            missing.append(path)
    study = _write_study(out, "cohort", [one.specimen for one in specimens])
    return Made(study, tuple(_told(tests, specimens)), tuple(missing))


# ---- a cohort that is there already


def _ready_cohort(folder: Path) -> Cohort | None:
    """The cohort in a folder; None where the folder has another layout."""
    if not folder.is_dir():
        return None
    described = any(_walk(folder, lambda path: path.name == "specimen.json"))
    return read_cohort(folder) if described else None


def _of_cohort(cohort: Cohort, out: Path) -> Made:
    if out.resolve().is_relative_to(cohort.folder.resolve()):
        raise BadInput(f"--out {out}", f"lies inside the cohort {cohort.folder}", "a folder beside it")
    out.mkdir(parents=True, exist_ok=True)
    study = _write_study(out, os.path.relpath(cohort.folder.resolve(), out.resolve()), cohort.specimens)
    curves = sum(len(one.curves) for one in cohort.specimens)
    return Made(
        study, (f"{cohort.folder}: a cohort of {len(cohort.specimens)} specimens, {curves} curves, used as it is",)
    )


# ---- which files


def _walk(folder: Path, wanted: Callable[[Path], bool], depth: int = DEEPEST) -> Iterator[Path]:
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


def _tables(files: Sequence[Path]) -> Iterator[Path]:
    """The files, and those with tables in folders, each once."""
    if not files:
        raise BadInput("init", "no files", "exported tests (CSV), or folders of them")
    seen: set[Path] = set()
    for path in files:
        if not path.exists():
            raise BadInput(path, "is not there", "exported tests (CSV), or a folder of them")
        found = (
            list(_walk(path, lambda one: one.suffix.lower() in TABLES and one.is_file())) if path.is_dir() else [path]
        )
        if not found:
            raise BadInput(path, "holds no table", f"files ending in {', '.join(sorted(TABLES))}")
        for one in found:
            if len(seen) >= MOST_FILES:
                raise BadInput(path, f"more than {MOST_FILES:,} files", "the files of one study")
            if os.path.realpath(one) not in {os.path.realpath(other) for other in seen}:
                seen.add(one)
                yield one


def _understood(paths: Sequence[Path], hints: Hints, ask: Ask | None) -> list[_Test]:
    """Every file, with what a person said of units that none of them tells."""
    guesses: list[Guess] = []
    for path in paths:
        while True:
            try:
                guesses.append(guess(path, hints))
                break
            except UnitUnknown as unknown:
                if ask is None:
                    raise
                unit = ask(
                    f"{unknown.what} in {path.name}: which unit? (for all files that do not say)", unknown.choices
                )
                hints = with_hints(hints, unknown.option, unit)
    named = _named(paths)
    return [_Test(path, one, *named[path]) for path, one in zip(paths, guesses, strict=True)]


# ---- which specimen, which protocol


def _safe(words: str) -> str:
    """A part of a file's name as a name that a cohort may have; empty when nothing is left."""
    plain = unicodedata.normalize("NFKD", words).encode("ascii", "ignore").decode()
    return re.sub(r"[^A-Za-z0-9_+.-]+", "_", plain).strip("_.-+ ")[:80]


def _protocol_in(stem: str) -> tuple[str, str] | None:
    """The rest of a file's name and the protocol that it ends, or begins, with."""
    words = [word for word in re.split(r"[\s_.-]+", stem) if word]
    for count in range(min(3, len(words)), 0, -1):
        for own, rest in ((words[-count:], words[:-count]), (words[:count], words[count:])):
            name = "_".join(own).lower()
            bare = re.sub(r"_?\d+$", "", name)
            if name in PROTOCOLS or bare in PROTOCOLS:
                return "_".join(rest), name
    return None


def _named(paths: Sequence[Path]) -> dict[Path, tuple[str, str, str]]:
    """Specimen (with its site in front), protocol, and how sure that is, by file."""
    stems = {path: _safe(path.stem) for path in paths}
    for path, stem in stems.items():
        if not NAME.fullmatch(stem):
            raise BadInput(path, "a name of which no specimen can be named", "a letter or digit in the name")
    absolute = {path: path.absolute() for path in paths}
    root = Path(os.path.commonpath([path.parent for path in absolute.values()]))
    found: dict[Path, tuple[str, str, str]] = {}
    for path, stem in stems.items():
        folders = [name for name in map(_safe, absolute[path].parent.relative_to(root).parts) if name]
        ending = _protocol_in(stem)
        if ending is not None and ending[0]:
            specimen, protocol, how = ending[0], ending[1], LIKELY
        elif ending is not None:  # the folder is the specimen
            specimen = folders.pop() if folders else _safe(absolute[path].parent.name) or "specimen"
            protocol, how = ending[1], UNSURE if re.search(r"\d$", ending[1]) else LIKELY
        else:
            specimen, protocol, how = stem, "test", LIKELY
        found[path] = ("/".join([*folders[-1:], specimen]), protocol, how)
    if not any(_protocol_in(stem) for stem in stems.values()):
        found |= _grid(stems, found)
    places: dict[tuple[str, str], Path] = {}
    for path, (specimen, protocol, _) in found.items():
        other = places.setdefault((specimen.casefold(), protocol.casefold()), path)
        if other != path:
            problem = f"specimen {specimen}, protocol {protocol}, as {other}"
            raise BadInput(path, problem, "names such as SPECIMEN_PROTOCOL.csv, each pair once")
    return found


def _grid(stems: Mapping[Path, str], found: Mapping[Path, tuple[str, str, str]]) -> dict[Path, tuple[str, str, str]]:
    """Names like A_p1, A_p2, B_p1, B_p2: what all specimens share is the protocol. Empty where they are no grid."""
    parts = {path: stem.rpartition("_") for path, stem in stems.items()}
    specimens = {part[0] for part in parts.values()}
    protocols = {part[2] for part in parts.values()}
    usable = all(NAME.fullmatch(name) for name in (*specimens, *protocols))
    if not usable or len(specimens) < 2 or len(protocols) < 2 or len(parts) != len(specimens) * len(protocols):
        return {}
    pairs = {(found[path][0].rpartition("/")[0], part[0], part[2]) for path, part in parts.items()}
    if len(pairs) != len(parts):
        return {}
    return {
        path: ("/".join(filter(None, [found[path][0].rpartition("/")[0], part[0]])), part[2], LIKELY)
        for path, part in parts.items()
    }


# ---- sizes


def _asked_sizes(tests: Sequence[_Test], sizes: Sizes, ask: Ask | None) -> Sizes:
    if ask is None:
        return sizes
    answers = {}
    for name in SIZES:
        if getattr(sizes, f"{name}_mm") is None and any(_in_header(test, name) is None for test in tests):
            said = ask(f"{name} of the specimens in mm? (empty: fill it in later)", ())
            try:
                answers[f"{name}_mm"] = float(said.replace(",", ".")) if said.strip() else None
            except ValueError:
                raise BadInput(f"--{name}-mm", shown(said), "a number of millimetres") from None
    return Sizes(**({f"{name}_mm": getattr(sizes, f"{name}_mm") for name in SIZES} | answers))


def _in_header(test: _Test, name: str) -> float | None:
    """A size (mm) that a line above a file's table tells with its unit; the side of a square for a diameter."""
    for line in test.guess.header:
        found = _SIZE.fullmatch(line) if len(line) < LONGEST_SIZE else None
        unit = found and (found["unit"] or found["behind"])
        if not found or not unit:
            continue
        value = float(found["value"].replace(",", ".")) * MM[unit.lower()]
        if found["what"].lower() in WORDS[name] and 0 < value < LONGEST:
            return value
        if found["what"].lower() in WORDS["diameter"] and name != "length" and 0 < value < LONGEST:
            return round(value * math.sqrt(math.pi) / 2, 9)
    return None


@dataclass(frozen=True, eq=False)
class _Found:
    specimen: Specimen
    tests: tuple[_Test, ...]
    missing: tuple[str, ...]
    notes: list[str] = field(default_factory=list)


def _specimens(tests: Sequence[_Test], sizes: Sizes) -> list[_Found]:
    grouped: dict[str, list[_Test]] = {}
    for test in tests:
        grouped.setdefault(test.specimen, []).append(test)
    return [_specimen(name, members, sizes) for name, members in sorted(grouped.items())]


def _specimen(name: str, tests: Sequence[_Test], given: Sizes) -> _Found:
    known = {}
    for size in SIZES:
        values: dict[float, Path] = {}
        for test in tests:
            if (value := _in_header(test, size)) is not None:
                values.setdefault(value, test.path)
        if len(values) > 1 and getattr(given, f"{size}_mm") is None:
            (first, one), (second, other), *_ = values.items()
            problem = f"a {size} of {second:g} mm, but {first:g} mm in {one}, of the same specimen {name}"
            raise BadInput(other, problem, f"files of one specimen, or --{size}-mm")
        known[size] = getattr(given, f"{size}_mm") or next(iter(values), None)
    notes: list[str] = []
    if known["length"] is None and all(test.guess.columns[1].kind is LENGTH for test in tests):
        known["length"] = float(tests[0].guess.numbers[0, 1])
        notes.append(f"gauge length {known['length']:g} mm, {LIKELY}: the length in the first row")
    for test in tests:
        _check_known(test, known)
    bar = {size: value if value is not None else 1.0 for size, value in known.items()}
    curves = tuple(_curve(test, bar | {"length": known["length"] or math.inf}, notes) for test in tests)
    specimen = Specimen(name, bar["length"], bar["width"], bar["thickness"], curves)
    return _Found(specimen, tuple(tests), tuple(s for s, value in known.items() if value is None), notes)


def _check_known(test: _Test, known: Mapping[str, float | None]) -> None:
    """Refuse what needs a size that nobody knows."""
    motion, load = test.guess.columns[1].kind, test.guess.columns[2].kind
    if motion in (STRAIN, STRETCH, LENGTH) and known["length"] is None:
        expected = "--length-mm (1 for normalised data)"
        raise BadInput(test.path, f"{motion.what} makes a displacement with the gauge length only", expected)
    if load is STRESS and (known["width"] is None or known["thickness"] is None):
        expected = "--width-mm and --thickness-mm (1 and 1 for normalised data: newtons are MPa then)"
        raise BadInput(test.path, "a stress makes a force with the cross-section only", expected)


def _curve(test: _Test, bar: Mapping[str, float], notes: list[str]) -> Curve:
    time_s, motion, load = test.guess.numbers.T
    kind = test.guess.columns[1].kind
    back = np.flatnonzero(np.diff(time_s) <= 0)
    if back.size:
        row = test.guess.first + int(back[0]) + 1
        problem = f"{time_s[back[0] + 1]:g} s after {time_s[back[0]]:g} s"
        raise BadInput(f"{test.path}: row {row}, time", problem, "increasing times")
    length = bar["length"]
    if kind is STRAIN:
        displacement = motion * length
    elif kind is STRETCH:
        displacement = (motion - 1.0) * length
    elif kind is LENGTH:
        displacement = motion - length
    elif kind is POSITION:
        displacement = motion - motion[0]
        notes.append(f"{test.path.name}: positions, {LIKELY} to count from the first one")
    else:
        displacement = motion
    crushed = np.flatnonzero(displacement <= -length)
    if crushed.size:
        row = test.guess.first + int(crushed[0])
        problem = f"{displacement[crushed[0]]:g} mm shortens a gauge of {length:g} mm to nothing"
        raise BadInput(f"{test.path}: row {row}, {kind.what}", problem, "another gauge length, unit or column")
    force = load * bar["width"] * bar["thickness"] if test.guess.columns[2].kind is STRESS else load
    if np.median(force) < 0 and abs(force.min()) > 5 * abs(force.max()):
        notes.append(f"{test.path.name}: forces are below 0; tension is positive here, so look at the machine's sign")
    return Curve(Protocol(test.protocol, time_s - time_s[0], displacement.copy()), force.copy())


# ---- what is written, and told


def _leave_open(path: Path, missing: Sequence[str]) -> None:
    """Make sizes that nobody knows places to fill in, which a run refuses until they are."""
    content = json.loads(path.read_text("utf-8"))
    content |= {f"{size}_mm": None for size in missing}
    content["note"] = f"fill in {', '.join(f'{size}_mm' for size in missing)} (a number, mm) and delete this note"
    write_text(path, json.dumps(content, indent=1) + "\n")


def _write_study(out: Path, cohort: str, specimens: Sequence[Specimen]) -> Path:
    study = out / "study.yaml"
    several = len({one.site for one in specimens if one.site}) > 1
    tasks = [task for task in TASKS if several or task != "compare"]
    cyclic = sorted({c.name for one in specimens for c in one.curves if c.name.startswith("cyc")})
    environment = SandboxedEnvironment(
        undefined=jinja2.StrictUndefined, autoescape=False, trim_blocks=True, keep_trailing_newline=True
    )
    template = environment.from_string(resource("templates/study.yaml.j2").read_text("utf-8"))
    name = _safe(out.resolve().name).replace("+", "-")[:64] or "study"
    values = {"name": name, "cohort": json.dumps(cohort), "tasks": tasks, "cyclic": map(json.dumps, cyclic)}
    command = one_line(shlex.quote(str(study)))
    write_text(study, template.render(**values, study=command, parameters=TENDON))
    read_study(study)  # what was written must be what can be read
    return study


def _told(tests: Sequence[_Test], specimens: Sequence[_Found]) -> Iterator[str]:
    """What was guessed, file by file, and how sure that is."""
    for one in specimens:
        specimen = one.specimen
        sizes = " x ".join("?" if s in one.missing else f"{getattr(specimen, f'{s}_mm'):.4g}" for s in SIZES)
        yield one_line(f"specimen {specimen.name}: {sizes} mm (length x width x thickness)")
        for test, curve in zip(one.tests, specimen.curves, strict=True):
            what = ", ".join(
                f"{column.kind.what} from '{column.title or column.place + 1}' in {column.unit} ({column.how})"
                for column in test.guess.columns
            )
            yield one_line(f"  {test.path}: protocol {curve.name} ({test.named}); {what}")
            time_s, displacement = curve.protocol.time_s, curve.protocol.displacement_mm
            reach = f"displacement {displacement.min():.4g} to {displacement.max():.4g} mm"
            if "length" not in one.missing:
                reach += f" (strain to {100 * displacement.max() / specimen.length_mm:.3g} %)"
            force = f"force {curve.force_N.min():.4g} to {curve.force_N.max():.4g} N"
            yield f"    {time_s.size:,} points, {time_s[-1]:,.4g} s, {reach}, {force}"
            if test.guess.left_out:
                yield one_line(f"    left out: {', '.join(test.guess.left_out[:20])}")
        yield from (one_line(f"    {note}") for note in one.notes)


def summary(made: Made) -> Mapping[str, Any]:
    """What was made, as plain data."""
    return {"study": str(made.study), "told": list(made.told), "fill_in": [str(path) for path in made.missing]}
