"""The outputs that a study asks for, in a rendered input."""

import re
from typing import Any
from xml.etree.ElementTree import Element, SubElement

from .wrong import Wrong


def add_outputs(main: str, root: Element, outputs: list[dict[str, Any]]) -> None:
    """Add the study's outputs to the log file section, each with a file of its own."""
    log = part_of(part_of(root, "Output"), "logfile")
    for number, output in enumerate(outputs):
        chosen = _ids(main, root, output)
        if output["reduce"] == "single" and len(chosen) != 1:
            problem = f"set {output['set']} has {len(chosen)} items" if output["set"] else f"{len(chosen)} ids"
            raise Wrong(f"simulator.outputs.{output['name']}", problem, "one, or reduce: sum, mean, max or min")
        attributes = {"data": output["item"], "name": output["name"], "file": f"sinew-{number}.txt", "delim": ","}
        SubElement(log, output["data"], attributes).text = ",".join(map(str, chosen))


def part_of(element: Element, tag: str) -> Element:
    """The first element ``tag`` inside ``element``, which gets one if there is none."""
    found = element.find(tag)
    return SubElement(element, tag) if found is None else found


def _ids(main: str, root: Element, output: dict[str, Any]) -> list[int]:
    """The nodes, elements or rigid bodies of an output. Raises :class:`Wrong` for those that do not exist."""
    kind, asked, of = output["data"], output["set"], f"simulator.outputs.{output['name']}"
    if kind == "rigid_body_data":
        bodies = {e.get("name"): _number(main, e) for e in root.iter("material") if e.get("type") == "rigid body"}
        there, sets, what = set(bodies.values()), {name: [number] for name, number in bodies.items()}, "rigid body"
    else:
        each, outer, named = ("node", "Nodes", "NodeSet") if kind == "node_data" else ("elem", "Elements", "ElementSet")
        parts = [(part, [_number(main, e) for e in part.iter(each)]) for part in root.iter(outer)]
        there = {number for _, numbers in parts for number in numbers}
        sets = {part.get("name"): numbers for part, numbers in parts}
        what = "node" if kind == "node_data" else "element"
        if asked is not None:
            sets |= {e.get("name"): _listed(main, e) for e in root.iter(named)}
    if asked is not None and asked not in sets:
        known = ", ".join(sorted(name for name in sets if name)) or "none is there"
        raise Wrong(of, f"no set {asked!r} of {what}s in {main}", f"one of {known}"[:300])
    chosen = output["ids"] if asked is None else sets[asked]
    for number in chosen:
        if number not in there:
            expected = f"{what}s from {min(there)} to {max(there)}" if there else f"a model with {what}s"
            raise Wrong(of, f"{what} {number} is not in {main}", expected)
    if not chosen:
        raise Wrong(of, f"set {asked!r} is empty", f"at least one {what}")
    return chosen


def _number(main: str, element: Element) -> int:
    text = element.get("id", "")
    if not text.strip().isdecimal():
        raise Wrong(main, f"<{element.tag} id={text!r}>", "a whole number as id")
    return int(text)


def _listed(main: str, element: Element) -> list[int]:
    """The ids of a set: ``1,2,3``, or an element with an id for each."""
    if len(element):
        return [_number(main, child) for child in element]
    found = []
    for part in re.split(r"[\s,]+", element.text or ""):
        if part and not part.isdecimal():
            raise Wrong(main, f"<{element.tag} name={element.get('name')!r}> has {part[:20]!r}", "numbers and commas")
        found += [int(part)] if part else []
    return found
