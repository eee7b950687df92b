"""``ro-crate-metadata.json``: the description of a crate, by the rules of RO-Crate 1.1 (doi:10.5281/zenodo.7867028)."""

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import PurePosixPath
from typing import Any
from urllib.parse import quote

from sinew.runner.errors import BadInput, shown
from sinew.tasks.drawing.blocks import plural
from sinew.tasks.report.crate import environment
from sinew.tasks.report.crate.layout import Layout
from sinew.tasks.report.crate.pack import Packed
from sinew.tasks.report.crate.source import Source
from sinew.tasks.study.files import as_bytes
from sinew.tasks.study.resources import DISTRIBUTION

METADATA = "ro-crate-metadata.json"
SPECIFICATION = "https://w3id.org/ro/crate/1.1"
MEDIA = {
    ".csv": "text/csv", ".db": "application/vnd.sqlite3", ".html": "text/html", ".json": "application/json",
    ".jsonl": "application/jsonl", ".md": "text/markdown", ".nc": "application/netcdf", ".pdf": "application/pdf",
    ".png": "image/png", ".txt": "text/plain", ".yaml": "application/yaml", ".yml": "application/yaml",
}  # fmt: skip
ORCID = re.compile(r"(?:https://orcid\.org/)?(\d{4}-\d{4}-\d{4}-\d{3}[\dX])")
SPDX = re.compile(r"[A-Za-z0-9][A-Za-z0-9.+-]{0,63}")
ADDRESS = re.compile(r"https?://[!-~]{1,500}")
TIME = re.compile(r"(\d{4}-\d{2}-\d{2}) (\d{2}:\d{2}:\d{2})")  # of a line of the log


@dataclass(frozen=True)
class Person:
    """An author; ``orcid`` is empty where none is given."""

    name: str
    orcid: str = ""


def person_of(text: str) -> Person:
    """``NAME`` or ``NAME <ORCID>``. Raises :class:`BadInput`."""
    name, _, rest = text.partition("<")
    orcid = ORCID.fullmatch(rest.removesuffix(">").strip()) if rest else None
    if not name.strip() or len(text) > 200 or not text.isprintable() or (rest and orcid is None):
        raise BadInput("--author", shown(text), '"NAME" or "NAME <0000-0002-1825-0097>"')
    return Person(name.strip(), f"https://orcid.org/{orcid.group(1)}" if orcid else "")


def licence_of(text: str) -> str:
    """The address of a licence, from itself or from its SPDX name. Raises :class:`BadInput`."""
    if ADDRESS.fullmatch(text):
        return text
    if not SPDX.fullmatch(text):
        raise BadInput("--license", shown(text), "an SPDX name such as CC-BY-4.0, or an address")
    return f"https://spdx.org/licenses/{text}"


def metadata(
    source: Source, layout: Layout, files: Sequence[Packed], *, licence: str | None, authors: Sequence[Person]
) -> bytes:
    """The description of ``files``, in their order."""
    people = [_person(one, i) for i, one in enumerate(authors, start=1)]
    graph: list[dict[str, Any]] = [
        {
            "@id": METADATA,
            "@type": "CreativeWork",
            "conformsTo": {"@id": SPECIFICATION},
            "about": {"@id": "./"},
        },
        {
            "@id": "./",
            "@type": "Dataset",
            "name": source.study.name,
            "description": _description(source),
            "datePublished": _time(source).partition("T")[0],
            **({"license": {"@id": licence}} if licence else {}),
            **({"author": [{"@id": one["@id"]} for one in people]} if people else {}),
            "hasPart": [{"@id": _id(one)} for one in files],
            "mentions": [{"@id": "#run"}],
        },
        *(_file(one) for one in files),
        *_run(source, layout, files, people),
        *people,
    ]
    if licence:
        graph.append({"@id": licence, "@type": "CreativeWork", "name": licence.rpartition("/")[2] or licence})
    context = [f"{SPECIFICATION}/context", {"sha256": "http://schema.org/sha256"}]
    return as_bytes(json.dumps({"@context": context, "@graph": graph}, indent=1, ensure_ascii=False) + "\n")


def _description(source: Source) -> str:
    tasks = ", ".join(source.found.results)
    specimens = len(source.cohort.specimens)
    return f"A study made with sinew: curves of {plural(specimens, 'specimen')}, model and results ({tasks})."


def _id(one: Packed) -> str:
    return quote(one.item.name)


def _file(one: Packed) -> dict[str, Any]:
    media = MEDIA.get(PurePosixPath(one.item.name).suffix)
    return {
        "@id": _id(one),
        "@type": "File",
        "name": one.item.name,
        "description": one.item.words,
        **({"encodingFormat": media} if media else {}),
        "contentSize": str(one.bytes),
        "sha256": one.sha256,
    }


def _run(
    source: Source, layout: Layout, files: Sequence[Packed], people: Sequence[Mapping[str, Any]]
) -> list[dict[str, Any]]:
    """The computation: what it used, what came out, and by which programs."""
    program, version = DISTRIBUTION, environment.version_of(source.run, "version", "")
    solver, its_version = environment.solver(source)
    used, made = [], []
    for one in files:
        path = PurePosixPath(one.item.name)
        if path == layout.study or (layout.cohort is not None and path.is_relative_to(layout.cohort)):
            used.append({"@id": _id(one)})
        elif path.is_relative_to(layout.results) or path.parts[0] == "tables":
            made.append({"@id": _id(one)})
    return [
        {
            "@id": "#run",
            "@type": "CreateAction",
            "name": f"Computation of {source.study.name}",
            "instrument": [{"@id": "#sinew"}, {"@id": "#solver"}],
            "object": used,
            "result": made,
            "endTime": _time(source),
            **({"agent": [{"@id": one["@id"]} for one in people]} if people else {}),
        },
        {"@id": "#sinew", "@type": "SoftwareApplication", "name": program, "softwareVersion": version},
        {"@id": "#solver", "@type": "SoftwareApplication", "name": solver, "softwareVersion": its_version},
    ]


def _person(one: Person, number: int) -> dict[str, Any]:
    return {"@id": one.orcid or f"#author-{number}", "@type": "Person", "name": one.name}


def _time(source: Source) -> str:
    """When the last task finished, by the log: a crate made again from the same results has the same bytes."""
    for event in reversed(source.found.events):
        found = TIME.match(str(event.get("asctime", "")))
        if event["message"] == "task finished" and found:
            return f"{found.group(1)}T{found.group(2)}"
    return "1970-01-01T00:00:00"
