"""What ``sinew init`` writes and says: the study file, sizes to be filled in, and what was guessed for each file."""

import json
import shlex
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import jinja2
from jinja2.sandbox import SandboxedEnvironment

from sinew.runner.errors import brief, one_line
from sinew.tasks.data.first_ranges import FirstRanges
from sinew.tasks.data.names import FileName, plain_name
from sinew.tasks.data.rates import rate_words
from sinew.tasks.data.recording import Recording
from sinew.tasks.data.sizes import SIZES
from sinew.tasks.drawing.blocks import listed, number
from sinew.tasks.model import Curve, Specimen
from sinew.tasks.registry import TASKS
from sinew.tasks.study.files import write_text
from sinew.tasks.study.resources import resource
from sinew.tasks.study.study import read_study

LeftOut = tuple[Path, str]  # a file, and why it is not used
IMPLAUSIBLE_STRAIN = 500.0  # %
CYCLES = ("cyc", "zyk", "cicl")  # how names of cyclic protocols begin
LISTED = 20  # files that are left out and named


@dataclass(frozen=True, eq=False)
class ReadFile:
    """A file that is understood, and the specimen and protocol that it belongs to."""

    recording: Recording
    name: FileName

    @property
    def path(self) -> Path:
        return self.recording.path


@dataclass(frozen=True, eq=False)
class NewSpecimen:
    """A specimen, the tests of its curves in the same order, the sizes that are missing, and notes for a person.

    ``told``: sizes (mm) by name that a person has told.
    """

    specimen: Specimen
    tests: tuple[ReadFile, ...]
    missing: tuple[str, ...]
    notes: tuple[str, ...]
    told: Mapping[str, float] = field(default_factory=dict)


def write_study(out: Path, cohort: str, specimens: Sequence[Specimen], ranges: FirstRanges) -> Path:
    """Write ``out/study.yaml`` with every field explained. ``cohort`` is the path of the cohort, seen from there."""
    study = out / "study.yaml"
    several = len({one.site for one in specimens if one.site}) > 1
    tasks = [name for name, task in TASKS.items() if not task.optional and (several or name != "compare")]
    cyclic = sorted({curve.name for one in specimens for curve in one.curves if curve.name.startswith(CYCLES)})
    names = {"cohort": json.dumps(cohort), "tasks": tasks, "cyclic": list(map(json.dumps, cyclic)), "ranges": ranges}
    write_rendered(study, "study.yaml.j2", names)
    return study


def write_rendered(study: Path, template: str, values: Mapping[str, Any]) -> None:
    """Write a study file from one of sinew's templates; ``name`` and ``command``, its path in a shell, are set here."""
    name = plain_name(study.parent.resolve().name).replace("+", "-")[:64] or "study"
    text = environment().from_string(resource(f"templates/{template}").read_text("utf-8"))
    write_text(study, text.render(values, name=name, command=one_line(shlex.quote(str(study)))))
    read_study(study)  # a study file that cannot be read must not be left behind unnoticed


def environment() -> SandboxedEnvironment:
    """What renders study files. Its filter ``json`` escapes all that YAML takes for the end of a line."""
    made = SandboxedEnvironment(
        undefined=jinja2.StrictUndefined, autoescape=False, trim_blocks=True, keep_trailing_newline=True
    )
    made.filters["json"] = json.dumps
    return made


def leave_open(path: Path, missing: Sequence[str]) -> None:
    """Replace sizes in a ``specimen.json`` by null. A run refuses the file until they are filled in."""
    content = json.loads(path.read_text("utf-8"))
    content |= {f"{size}_mm": None for size in missing}
    content["note"] = f"fill in {', '.join(f'{size}_mm' for size in missing)} (a number, mm) and delete this note"
    write_text(path, json.dumps(content, indent=1) + "\n")


def describe(specimens: Sequence[NewSpecimen]) -> Iterator[str]:
    """What was guessed, file by file, and how sure that is."""
    for new in specimens:
        specimen = new.specimen
        sizes = " x ".join("?" if s in new.missing else f"{getattr(specimen, f'{s}_mm'):.4g}" for s in SIZES)
        yield one_line(f"specimen {specimen.name}: {sizes} mm (length x width x thickness)")
        for test, curve in zip(new.tests, specimen.curves, strict=True):
            what = ", ".join(f"{column.in_words} ({column.how})" for column in test.recording.columns)
            yield one_line(f"  {test.path}: protocol {curve.name} ({test.name.how}); {what}")
            yield f"    {_ranges(curve, None if 'length' in new.missing else specimen.length_mm)}"
            length = test.recording.sizes.get("length")
            if length is not None and length.column and length.mm == specimen.length_mm:
                yield one_line(f"    gauge length: '{length.text}' less the displacement")
            if test.recording.further.words:
                yield one_line(f"    kept beside the force: {', '.join(test.recording.further.words)}")
            if test.recording.left_out:
                yield brief(f"    left out: {', '.join(test.recording.left_out[:20])}")
        yield from (one_line(f"    {note}") for note in new.notes)
    tests = Counter(test.path for new in specimens for test in new.tests if test.recording.test)
    yield from _several_tests({path: count for path, count in tests.items() if count > 1})


def _several_tests(counts: Mapping[Path, int]) -> Iterator[str]:
    """What the tests of files with several of them are taken for, and what to do if all in a file are of one specimen.

    ``counts``: the number of tests in each of these files.
    """
    if not counts:
        return
    total, path = sum(counts.values()), next(iter(counts))
    files, each = (str(path), "") if len(counts) == 1 else (f"{path} and {len(counts) - 1} more", " in a file")
    yield one_line(
        f"{files}: {'its' if not each else 'their'} {total} tests are taken for those of {total} specimens; if all"
        f"{each} are of one specimen, make a cohort first, with the same options: "
        f"sinew import {shlex.quote(str(path))} --specimen NAME --out COHORT"
    )


def describe_unused(answered: Iterable[str], new: Sequence[NewSpecimen]) -> Iterator[str]:
    """Specimens that earlier answers know and no file is of: a file that was renamed loses its sizes."""
    unused = sorted(set(answered) - {one.specimen.name for one in new})
    if unused:
        names = listed(unused, LISTED)
        yield one_line(f"answers that were not used: sizes of {names}; no test is of a specimen of that name")


def describe_left_out(files: Sequence[LeftOut]) -> Iterator[str]:
    """The files that are not used, each with the reason."""
    for path, reason in files[:LISTED]:
        yield one_line(f"left out: {path} ({reason})")
    if len(files) > LISTED:
        yield f"left out: {len(files) - LISTED:,} more"


def _ranges(curve: Curve, length_mm: float | None) -> str:
    time_s, displacement = curve.protocol.time_s, curve.protocol.displacement_mm
    strain = ""
    if length_mm is not None:
        low, high = 100 * displacement.min() / length_mm, 100 * displacement.max() / length_mm
        doubt = "; few tissues bear that: check the gauge length" if high > IMPLAUSIBLE_STRAIN else ""
        strain = f" (strain {f'{number(low)} ' if low < 0 else ''}to {number(high)} %{doubt})"
    reach = f"displacement {displacement.min():.4g} to {displacement.max():.4g} mm{strain}"
    force = f"force {curve.force_N.min():.4g} to {curve.force_N.max():.4g} N"
    rate = rate_words(curve.protocol, length_mm)
    loaded = f", loaded at {rate}" if rate else ""
    return f"{time_s.size:,} points, {time_s[-1]:,.4g} s, {reach}, {force}{loaded}"
