"""A study of a person's own FEBio model, as ``sinew init model.feb`` makes it: a template and a study file."""

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from sinew.runner.errors import BadInput, one_line
from sinew.tasks.data.new_study import write_rendered
from sinew.tasks.simulate.febio.model_file.choices import (
    Measured,
    Varied,
    constituents,
    force_of,
    measured,
    moved,
    varied,
)
from sinew.tasks.simulate.febio.model_file.contents import Contents, Moved
from sinew.tasks.simulate.febio.model_file.loading import Loading, loading_of, units
from sinew.tasks.simulate.febio.model_file.source import Source
from sinew.tasks.simulate.febio.model_file.template import AS_SAVED, check_same, name_of_nodes, template_of
from sinew.tasks.study.files import write_text
from sinew.tasks.study.workspace import check_folder

HISTORY = {"displacement_points": "", "step_points": "", "end_s": 1.0, "first_step_s": 1.0}


@dataclass(frozen=True)
class Choices:
    """What a person says of a model: numbers that vary, a displacement that follows the data, and outputs.

    ``fibre`` and ``matrix``: paths of the materials that effects inside the tissue act on.

    ``factor``: how far it goes (mm) for a displacement of 1 mm: -1 where the model pulls in the other direction, 0.5
    where it is half of the specimen.
    """

    vary: Sequence[str] = ()
    move: str | None = None
    factor: float = 1.0
    measure: Sequence[str] = ()
    fibre: str | None = None
    matrix: str | None = None


@dataclass(frozen=True)
class NewModelStudy:
    """A study file that was written, and what it holds line by line."""

    study: Path
    lines: tuple[str, ...]


def init_model(source: Source, contents: Contents, choices: Choices, out: Path) -> NewModelStudy:
    """Write ``out/study.yaml`` and the template beside it. Raises :class:`BadInput` before anything is written."""
    check_folder(out)
    where = f"{source.path}: "
    if not choices.vary:
        raise BadInput(f"{where}--vary", "nothing is said to vary", "at least one number, by a name of the list")
    vary = varied(where, contents, choices.vary)
    part = moved(where, contents, choices.move)
    system, length, force = units(source)
    outputs = measured(where, contents, choices.measure)
    factor = choices.factor * length
    if part is not None:
        outputs = (force_of(where, contents, part, math.copysign(force, factor)), *outputs)
    chosen = {"fibre": choices.fibre, "matrix": choices.matrix}
    if part is None and any(chosen.values()):
        raise BadInput(
            f"{where}--fibre and --matrix", "without --move", "--move, which gives the force that is compared"
        )
    tissue = {} if part is None else constituents(where, contents, chosen)
    if not outputs:
        raise BadInput(f"{where}--measure", "nothing is measured", "--move, which gives the force, or --measure")
    loading = loading_of(source, part, factor)
    files = template_of(source, vary, part, factor, outputs)
    check_same(source, files, HISTORY | {one.name: one.number.value for one in vary} | {"protocol": AS_SAVED})
    for name in ("study.yaml", *files):
        if os.path.lexists(out / name):
            raise BadInput(out / name, "is there already", "a new folder for --out")
    out.mkdir(parents=True, exist_ok=True)
    for name, text in files.items():
        write_text(out / name, text)
    study = out / "study.yaml"
    values = {
        "model": one_line(source.path.name),
        "main": next(iter(files)),
        "vary": vary,
        "part": part,
        "outputs": [(one, name_of_nodes(one.set) if one.surface else one.set) for one in outputs],
        "tissue": tissue,
        "protocol": AS_SAVED,
        "loading": loading,
    }
    write_rendered(study, "model_study.yaml.j2", values)
    lines = _told(vary, part, outputs, loading, system, choices.factor)
    lines += [f"{name}: {one.path} ({one.law}), for effects inside the tissue" for name, one in tissue.items()]
    return NewModelStudy(study, tuple(one_line(line)[:300] for line in lines))


def _told(
    vary: Sequence[Varied],
    part: Moved | None,
    outputs: Sequence[Measured],
    loading: Loading,
    system: str,
    factor: float,
) -> list[str]:
    told = [f"{one.name}: {one.number.path}, {one.minimum:g} to {one.maximum:g} ({one.number.value:g})" for one in vary]
    told += [f"{one.name}: {one.item} of {one.set} ({one.data}, {one.reduce}), in {_unit(one)}" for one in outputs]
    told.append(f"units: {system}; loaded as saved for {loading.time_s[-1]:g} s")
    if part is None:
        told.append("nothing is moved: the loading stays as saved, and measured curves cannot be compared")
    else:
        far = max(loading.displacement_mm, key=abs)
        told.append(f"moved: {part.name}, {factor:g} mm for a displacement of 1 mm, which goes to {far:g} mm as saved")
    return told


def _unit(output: Measured) -> str:
    return output.unit if output.unit != "1" else "the model's unit"
