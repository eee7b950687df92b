"""What a FEBio model holds, as lines for a person and as JSON."""

from collections.abc import Iterator, Sequence
from typing import Any

from sinew.runner.errors import one_line
from sinew.tasks.simulate.febio.model_file.contents import Contents, Moved, Number
from sinew.tasks.simulate.febio.model_file.source import Source

MOST_LINES = 200  # of each kind


def lines(source: Source, contents: Contents) -> Iterator[str]:
    """What can vary, what can be moved, and what outputs can be of."""
    module = source.section("Module")
    kind = module.attributes.get("type", "") if module is not None else ""
    yield one_line(f"{source.path}: FEBio {source.version}{f', {kind}' if kind else ''}")
    yield "can vary (--vary NAME or NAME=MIN:MAX):"
    yield from _listed([_number(one) for one in contents.materials])
    yield from _listed([_number(one) for one in contents.others])
    if contents.texts:
        yield "in materials, but no numbers:"
        yield from _listed(contents.texts)
    yield "can be moved by the measured displacement (--move NAME):"
    yield from _listed([_moved(one) for one in contents.moved] or ["nothing"])
    if contents.laws:
        yield "materials (--fibre NAME and --matrix NAME, for effects inside the tissue):"
        yield from _listed([f"{one.path} ({one.law})" for one in contents.laws])
    yield "outputs can be of (--measure NAME=ITEM@SET):"
    sets = contents.sets
    kinds = {"nodes": sets.nodes, "surfaces": sets.surfaces, "elements": sets.elements, "rigid bodies": sets.rigid}
    for kind, names in kinds.items():
        if names:
            yield one_line(f"  {kind}: {', '.join(names)}"[:300])


def _listed(entries: Sequence[str]) -> Iterator[str]:
    yield from (one_line(f"  {entry}"[:200]) for entry in entries[:MOST_LINES])
    if len(entries) > MOST_LINES:
        yield f"  and {len(entries) - MOST_LINES:,} more (--json lists all)"


def _number(number: Number) -> str:
    return f"{number.path} = {number.value!r}"


def _moved(moved: Moved) -> str:
    what = "rigid body" if moved.rigid else "nodes"
    return f"{moved.name} ({what} {moved.target}, along {moved.axis})"


def as_json(source: Source, contents: Contents) -> dict[str, Any]:
    """The same for a program."""
    return {
        "model": str(source.path),
        "format": source.version,
        "materials": {one.path: one.value for one in contents.materials},
        "others": {one.path: one.value for one in contents.others},
        "texts": list(contents.texts),
        "laws": {one.path: one.law for one in contents.laws},
        "moved": [{"name": one.name, "target": one.target, "axis": one.axis} for one in contents.moved],
        "sets": {
            "nodes": list(contents.sets.nodes),
            "surfaces": list(contents.sets.surfaces),
            "elements": list(contents.sets.elements),
            "rigid": list(contents.sets.rigid),
        },
    }
