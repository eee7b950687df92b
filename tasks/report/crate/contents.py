"""The files that go into a crate: study, template, measured curves, results. A closed list: nothing else goes out."""

import os
import re
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path, PurePosixPath

from sinew.runner.errors import BadInput, shown
from sinew.runner.files import read_input
from sinew.tasks.data.cohort import check_inside, visible
from sinew.tasks.discover.result import ADOPTED, COPY, TEMPLATE, WITH_EFFECTS, WITH_LAWS, DiscoverResult
from sinew.tasks.drawing.formats import without_formulas
from sinew.tasks.registry import TASKS
from sinew.tasks.report.crate.layout import Layout, changed_fields, with_fields
from sinew.tasks.report.crate.pack import MAX_BYTES, Item
from sinew.tasks.report.crate.source import Source
from sinew.tasks.report.status import PAGE
from sinew.tasks.study.files import as_bytes, read_json
from sinew.tasks.study.own_template import template_texts
from sinew.tasks.study.study import read_study

PLAIN = re.compile(r"[A-Za-z0-9_+. -]{1,255}")  # names that every archive, list of hashes and system can hold
LARGE = ("store.zarr", "journal", "log.jsonl")  # what a crate holds only if it is asked for: all rows, and the log
MACHINERY = ("attempts", "jobs", "lock", "progress.json")  # records of processes, in no crate
FILES = ("ranges.json", COPY, PAGE)
ENDINGS = (".json", ".jsonl", ".csv", ".png", ".pdf", ".svg", ".nc", ".db", ".yaml", ".feb", ".txt", ".safetensors")
WORDS = {
    ".json": "result", ".csv": "table", ".png": "figure", ".pdf": "figure", ".html": "page with all results",
    ".nc": "posterior sample (netCDF)", ".db": "history of an inference (SQLite)",
    ".yaml": "study with the named effect",
}  # fmt: skip


def study_items(source: Source, layout: Layout) -> Iterator[Item]:
    """The study file, with paths of the crate, and the template with all that it includes."""
    text = with_fields(source.study.text, changed_fields(source, layout))
    yield Item(str(layout.study), text.encode(), "study file")
    place = layout.study.parent / PurePosixPath(source.study.simulator.own_template or "").parent
    for each, content in template_texts(source.study).items():
        _check_name(source.study.path.parent, place / each)
        yield Item(str(place / each), content.encode(), "FEBio template")


def cohort_items(source: Source, layout: Layout) -> Iterator[Item]:
    """Measured curves and sizes of all specimens. Raises :class:`sinew.runner.errors.BadInput`."""
    folder = source.cohort_folder
    if folder is None or layout.cohort is None:
        return
    for specimen in source.cohort.specimens:
        for path in visible(folder / specimen.name):
            if path.suffix.lower() == ".csv" or path.name == "specimen.json":
                check_inside(path, folder)
                content = read_input(path, MAX_BYTES, "a file of the cohort")
                words = "size of a specimen" if path.name == "specimen.json" else "measured curve"
                yield Item(str(layout.cohort / specimen.name / path.name), content, f"{words}, {specimen.name}")


def result_items(source: Source, layout: Layout, *, store: bool) -> Iterator[Item]:
    """Results, figures and the page; with ``store`` all rows and the log too, so that it is a result folder again."""
    template = template_files(source.found.folder)
    for relative in result_files(source.found.folder):
        if not kept(relative, template, store=store):
            continue
        _check_name(source.found.folder, relative)
        path: bytes | Path = source.found.folder / relative
        if relative.name == COPY:
            _check_copy(source.found.folder / relative)
        if relative in map(PurePosixPath, (WITH_EFFECTS, WITH_LAWS)) and layout.cohort is not None:
            cohort = os.path.relpath(layout.cohort, layout.results / relative.parent)
            written = read_study(source.found.folder / relative)  # refuses what is no study
            path = with_fields(written.path.read_text("utf-8"), {"cohort": cohort}).encode()
        yield Item(str(layout.results / relative), path, _words(relative))


def _check_name(folder: Path, relative: PurePosixPath) -> None:
    """Raises :class:`BadInput` for a file whose name an archive or a list of hashes could not hold."""
    if not all(PLAIN.fullmatch(part) for part in relative.parts):
        expected = "letters, digits, spaces and _ + . - ; remove it or give it another name"
        raise BadInput(folder, f"holds a file called {shown(str(relative))}", expected)


def _check_copy(path: Path) -> None:
    """Raises :class:`BadInput` for a copy of a verdict that says something else than the verdict beside it."""
    original = DiscoverResult.path(path.parent)
    if not original.is_file() or read_json(path) != read_json(original):
        raise BadInput(path, f"not a copy of {original.name}", "`sinew run --tasks discover` to write both, or neither")


def table_items(source: Source) -> Iterator[Item]:
    """The numbers of each result as CSV."""
    for task, result in source.found.results.items():
        table = TASKS[task].module("show").table(result)
        text = without_formulas(table).to_csv(lineterminator="\n", float_format="%.10g")
        yield Item(f"tables/{task}.csv", as_bytes(text), f"numbers of {task} as a table")


def template_files(folder: Path) -> frozenset[PurePosixPath]:
    """The files in a result folder of the template beside the study with the named effects."""
    if not (folder / TEMPLATE).is_dir() or not (folder / WITH_EFFECTS).is_file():
        return frozenset()
    return frozenset(PurePosixPath(TEMPLATE) / each for each in template_texts(read_study(folder / WITH_EFFECTS)))


def kept(relative: PurePosixPath, template: Collection[PurePosixPath] = (), *, store: bool) -> bool:
    """Whether a file of a result folder goes into a crate; ``template``: files that are there for being read."""
    first, *rest = relative.parts
    if first == ADOPTED and rest:
        return kept(PurePosixPath(*rest), store=store)
    if any(part.startswith(".") for part in relative.parts):
        return False
    if first in LARGE:
        return store and _of_store(first, rest)
    if relative in template:
        return True
    if relative.suffix not in ENDINGS:
        return first in FILES and not rest
    if not rest:
        return first in FILES or first.partition(".")[0].partition("_")[0] in TASKS
    return first in (*TASKS, "figures") and (store or relative.suffix != ".jsonl")  # those are checkpoints


def _of_store(first: str, rest: Sequence[str]) -> bool:
    """Whether a name below one of ``LARGE`` is that of a file which sinew writes there."""
    if first == "log.jsonl":
        return not rest
    if first == "journal":
        return len(rest) == 2 and (rest[1] == "planned" or rest[1].endswith(".safetensors"))
    *_, name = rest or ("",)
    chunk = rest[rest.index("c") + 1 :] if "c" in rest else ["no chunk"]
    return name == "zarr.json" or all(map(str.isdecimal, chunk))


def strangers(folder: Path) -> list[str]:
    """Files in a result folder that no task wrote; they stay where they are."""
    template = template_files(folder)
    left = [one for one in result_files(folder) if not kept(one, template, store=True)]
    return [str(one) for one in left if not one.name.startswith(".")]


def result_files(folder: Path) -> list[PurePosixPath]:
    """All files of a result folder but the records of processes, sorted; links are not followed."""
    found = []
    for where, folders, names in os.walk(folder):
        inside = PurePosixPath(Path(where).relative_to(folder))
        if inside in (PurePosixPath(), PurePosixPath(ADOPTED)):
            folders[:] = [each for each in folders if each not in MACHINERY]
            names = [each for each in names if each not in MACHINERY]
        found += [inside / name for name in names]
    return sorted(found)


def _words(relative: PurePosixPath) -> str:
    if relative.parts[0] in LARGE:
        return "log of all runs" if relative.name == "log.jsonl" else "stored evaluations"
    what = WORDS.get(relative.suffix, "result")
    task = relative.parts[0].partition(".")[0].partition("_")[0]
    return f"{what}, {task}" if task in TASKS else what
