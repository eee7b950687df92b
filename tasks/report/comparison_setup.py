"""What was set otherwise in the last runs of two result folders."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from sinew.runner.errors import BadInput, one_line
from sinew.tasks.drawing.blocks import Block, Section, Table, Words, number, plural
from sinew.tasks.report.folder import ResultFolder
from sinew.tasks.study.settings_file import fields_in

Names = tuple[str, str]
SET = {
    "study_file": "study file",
    "study_hash": "hash of the study",
    "template_hash": "hash of the template",
    "version": "version",
    "code": "hash of the code",
    "seed": "seed",
    "simulator": "simulator",
    "machine": "machine",
    "python": "python",
    "out": "out",
}
CELL = 200  # characters of a value
LISTED = 100  # settings of the two studies
UNSET = "–"


def setup(first: ResultFolder, second: ResultFolder, names: Names) -> Section:
    """What the last runs were given: program, study, specimens, and the settings that differ between the studies."""
    last = [one.runs[-1] if one.runs else {} for one in (first, second)]
    rows = []
    for key, what in SET.items():
        values = [_cell(run.get(key, UNSET)) for run in last]
        rows.append([what, *values, "" if values[0] == values[1] else "differs"])
    specimens = [set(one.measured) for one in (first, second)]
    both = specimens[0] & specimens[1]
    other = [name for name in sorted(both) if _data(first, name) != _data(second, name)]
    quantities = [", ".join(_quantities(one)) or UNSET for one in (first, second)]
    rows.append(["compared", *quantities, "" if quantities[0] == quantities[1] else "differs"])
    counts = [str(len(each)) for each in specimens]
    rows.append(["specimens", *counts, "" if specimens[0] == specimens[1] else "differs"])
    words = f"{plural(len(both), 'specimen')} in both"
    words += f"; other curves or sizes under the same name: {', '.join(other)}" if other else ""
    blocks: list[Block] = [
        Table("The last run of each", ["", *names, ""], rows, words=(1, 2, 3)),
        *_settings(last[0], last[1], names),
        Words(words),
    ]
    differs = [row[0] for row in rows if row[3]]
    found = f"differ in {', '.join(differs)}" if differs else "the same settings"
    return Section("setup", "Setup", "What was set otherwise?", blocks, found=found)


def other_ranges(ranges: Sequence[Mapping[str, Sequence[float]]], names: Names) -> Iterator[Block]:
    """A warning and a table where a parameter has another range in each of two results."""
    first, second = ranges
    rows = [[name, *(f"{number(low, 4)} to {number(high, 4)}" for low, high in (first[name], second[name]))]
            for name in first if name in second and tuple(first[name]) != tuple(second[name])]  # fmt: skip
    if rows:
        some = f"{plural(len(rows), 'parameter')} had another range in each study"
        yield Words(f"{some}: that alone makes results differ.", "warning")
        yield Table("Other ranges", ["parameter", *names], rows, words=(1, 2))


def _settings(first: Mapping[str, Any], second: Mapping[str, Any], names: Names) -> Iterator[Block]:
    """The settings of two studies that are not the same, by their fields; what a study leaves open has a dash."""
    try:
        one, other = (fields_in(str(run.get("study_text", "")), Path("study"), "study") for run in (first, second))
    except BadInput as error:
        yield Words(f"The studies cannot be compared: {one_line(str(error))}", "note")
        return
    fields = [field for field in dict.fromkeys((*one, *other)) if one.get(field, UNSET) != other.get(field, UNSET)]
    rows = [[_cell(field), *(_cell(each.get(field, UNSET)) for each in (one, other))] for field in fields[:LISTED]]
    if rows:
        more = f", the first {LISTED} of {len(fields):,}" if len(fields) > LISTED else ""
        yield Table(f"Settings that differ{more}", ["", *names], rows, words=(1, 2))


def _cell(value: object) -> str:
    return one_line(str(value))[:CELL]


def _quantities(found: ResultFolder) -> list[str]:
    """What is compared in a folder, by the stored evaluations."""
    others = {name for every in found.measured.values() for curve in every.values() for name in curve.others}
    return [*(["force"] if found.forces else []), *sorted(others)]


def _data(found: ResultFolder, specimen: str) -> Any:
    """What identifies a specimen's sizes and curves."""
    tables = found.tables.get(specimen)
    return tables[0].identity["specimen"] if tables else None
