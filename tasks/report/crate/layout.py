"""Where study, cohort and results lie in a crate, and the study file with paths that fit there.

They keep their places relative to each other, where they lie in folders beside each other: results name the cohort by
its path from their own folder, and a repetition inside the crate must come to the same bytes.
"""

import json
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

import yaml

from sinew.runner.errors import BadInput
from sinew.tasks.cluster.spec import cluster_request
from sinew.tasks.report.crate.source import Source
from sinew.tasks.study.settings_file import as_yaml, from_yaml
from sinew.tasks.study.study import SlurmSettings

OWN = ("README.md", "METHODS.md", "ro-crate-metadata.json", "sha256sums.txt", "environment", "tables", "profile.yaml")
NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_+.-]{0,99}")
DEEPEST = 3  # folders between a crate and what lies in it


@dataclass(frozen=True)
class Layout:
    """Paths in the crate. ``kept``: they are as they were, relative to each other."""

    study: PurePosixPath
    cohort: PurePosixPath | None
    results: PurePosixPath
    kept: bool

    @property
    def again(self) -> PurePosixPath:
        """Where a repetition writes its results: beside the first ones, so that paths from there are the same."""
        return self.results.with_name(f"{self.results.name}-again")


def layout_of(source: Source) -> Layout:
    """The layout as it is, else one of the crate's own for what lies far apart or has odd names."""
    cohort = source.cohort_folder
    places = [source.study.path.resolve(), source.found.folder.resolve(), *([cohort.resolve()] if cohort else [])]
    base = Path(os.path.commonpath([place.parent for place in places]))
    study, results, *data = [PurePosixPath(place.relative_to(base)) for place in places]
    for one in (study, results, *data):
        if len(one.parts) > DEEPEST or one.parts[0] in OWN or not all(map(NAME.fullmatch, one.parts)):
            own = PurePosixPath("cohort") if cohort else None
            return Layout(PurePosixPath("study.yaml"), own, PurePosixPath("results"), kept=False)
    return Layout(study, data[0] if data else None, results, kept=True)


def changed_fields(source: Source, layout: Layout) -> dict[str, Any]:
    """What the study file in the crate has to say otherwise: its cohort, what options replaced, and no address.

    Raises :class:`BadInput` for a template with an absolute path.
    """
    study, run, changed = source.study, source.run, dict[str, Any]()
    written = from_yaml(study.text)
    if layout.cohort is not None:
        cohort = os.path.relpath(layout.cohort, layout.study.parent)
        if study.cohort is None or os.path.normpath(study.cohort) != cohort:
            changed["cohort"] = cohort
    if run["seed"] != written.get("seed", type(study).model_fields["seed"].default):
        changed["seed"] = run["seed"]
    if run["simulator"] != study.simulator.name:
        changed["simulator"] = run["simulator"]
    if isinstance(study.cluster, SlurmSettings) or cluster_request(study) is not None:
        changed["cluster"] = "local"
    name = study.simulator.own_template
    if name is not None and (Path(name).is_absolute() or ".." in Path(name).parts):
        raise BadInput(f"{study.path}: simulator", f"the template {name[:80]}", "a path below the study's folder")
    return changed


def with_fields(text: str, fields: Mapping[str, Any]) -> str:
    """A study file with other values of some fields of its top level; comments and all else stay.

    ``text`` is YAML that was read as a study before.
    """
    wanted = {**from_yaml(text), **fields}
    for name, value in fields.items():
        text = _with_field(text, name, json.dumps(value))
    if from_yaml(text) != wanted:  # a form of YAML that is not thought of above
        return as_yaml(wanted)
    return text


def _with_field(text: str, name: str, value: str) -> str:
    root = yaml.compose(text, Loader=yaml.SafeLoader)
    assert isinstance(root, yaml.MappingNode), "it was read as a study before"
    for key, old in root.value:
        if key.value == name:
            start, end = old.start_mark.index, old.end_mark.index
            line = "\n" if text[start:end].endswith("\n") else ""
            return f"{text[:start]}{'' if text[start - 1 : start].isspace() else ' '}{value}{line}{text[end:]}"
    start = root.start_mark.index
    if root.flow_style:
        return f"{text[: start + 1]}{name}: {value}, {text[start + 1 :]}"
    return f"{text[:start]}{name}: {value}\n{' ' * root.start_mark.column}{text[start:]}"
