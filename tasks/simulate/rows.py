"""Run given parameter rows along each measured curve, and write the forces as CSV. Leaves ``simulate.json``."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from sinew.runner.cluster.local import Local
from sinew.runner.errors import BadInput
from sinew.runner.files import new_file
from sinew.runner.store.schema import STATUSES
from sinew.tasks.data.numeric_csv import read_header, read_numbers
from sinew.tasks.data.text import check_text
from sinew.tasks.model import FORCE, Curve, Model, Specimen
from sinew.tasks.simulate import Array
from sinew.tasks.simulate.evaluation import SpecimenEvaluation
from sinew.tasks.study.files import write_json
from sinew.tasks.study.workspace import Workspace

MAX_PARAMETER_BYTES = 256 * 2**20
#: Names in a result folder that are not those of sites.
RESERVED = {
    "adopted", "attempts", "calibrate", "discover", "fields", "figures", "infer", "jobs", "journal", "lock", "solver",
    "store.zarr",
}  # fmt: skip


def read_parameters(path: Path, model: Model) -> Array:
    """Parameter sets ``[n, d]`` from a CSV with one column for each named parameter; the rest stay at their reference.

    Raises :class:`BadInput` for unknown or repeated columns and for values that the model cannot have.
    """
    if path.suffix == ".csv":
        check_text(path, MAX_PARAMETER_BYTES)
    columns = read_header(path) if path.is_file() and path.suffix == ".csv" else None
    for name in columns or ():
        if name not in model.names:
            raise BadInput(f"{path}: row 1, {name}", "unknown parameter", f"some of {', '.join(model.names)}")
        if columns is not None and columns.count(name) > 1:
            raise BadInput(f"{path}: row 1, {name}", "given twice", "each parameter once")
    if columns is None and path.is_file():
        raise BadInput(path, "not a CSV file", "PARAMETERS.csv with one column for each parameter name")
    values = read_numbers(path, columns, max_bytes=MAX_PARAMETER_BYTES)
    assert columns is not None
    for column, name in enumerate(columns):
        parameter = model.parameters[model.names.index(name)]
        for row, value in enumerate(values[:, column]):
            if not parameter.possible(value):
                raise BadInput(f"{path}: row {row + 2}, {name}", f"{value:g}", parameter.limits)
    return model.full(tuple(columns), values)


def simulate_rows(workspace: Workspace, parameters: Array) -> dict[str, Any]:
    """Write ``OUT/SPECIMEN.PROTOCOL.csv`` with ``time_s,displacement_mm,row_0,row_1,...`` (N, 17 digits).

    A row that failed has empty cells; ``simulate.json`` says why. The curves are in the store too, at every measured
    point. Each of a template's outputs has a file, too: ``OUT/SPECIMEN.PROTOCOL.OUTPUT.csv``. Returns what
    ``simulate.json`` holds.
    """
    failed: list[dict[str, Any]] = []
    files: list[str] = []
    evaluations = [
        (one, SpecimenEvaluation(workspace.model, one, workspace.simulator, "all"))
        for one in workspace.cohort.specimens
    ]
    _refuse_names(workspace, evaluations)
    here = isinstance(workspace.cluster, Local) and workspace.simulator.capabilities.batch_multiple > 1
    for specimen, evaluation in evaluations:
        table, rows = workspace.plan(evaluation, parameters)
        workspace.evaluate(evaluation, table, rows, f"simulate {specimen.name}", here=here)
        messages = table.read("message", rows)
        for number in np.flatnonzero(table.status[rows]):
            status = STATUSES[table.status[rows[number]]]
            entry = {"specimen": specimen.name, "row": int(number), "status": status, "message": str(messages[number])}
            failed.append(entry)
        for curve in specimen.curves:
            for field, name in evaluation.courses(curve.name).items():
                files.append(_file_of(specimen, curve, name))
                _write_curves(workspace.out / files[-1], curve, table.read(field, rows))
    result = {
        "rows": len(parameters),
        "failed": len({entry["row"] for entry in failed}),
        "failures": failed,
        "files": files,
        "simulator": workspace.simulator.identity(),
    }
    write_json(workspace.out / "simulate.json", result)
    return result


def _file_of(specimen: Specimen, curve: Curve, output: str) -> str:
    ending = "" if output == FORCE else f".{output}"
    return f"{specimen.name}.{curve.name}{ending}.csv"


def _refuse_names(workspace: Workspace, evaluations: Sequence[tuple[Specimen, SpecimenEvaluation]]) -> None:
    """Refuse specimens whose files would overwrite each other, or lie among those of the results."""
    taken: dict[str, str] = {}
    where = workspace.cohort.folder
    for specimen, evaluation in evaluations:
        if (site := specimen.site) is not None:
            folder = workspace.out / site
            if site.casefold() in RESERVED or (folder.exists() and not folder.is_dir()):
                raise BadInput(where / site, "a name that result folders use", "another name of the site")
        for curve in specimen.curves:
            for output in evaluation.courses(curve.name).values():
                name, ours = _file_of(specimen, curve, output), f"{specimen.name}, {curve.name}, {output}"
                other = taken.setdefault(name.casefold(), ours)
                if other != ours:
                    problem = f"{ours} and {other} would both be written to {name}"
                    raise BadInput(where, problem, "other names of specimens and protocols, without dots")


def _write_curves(path: Path, curve: Curve, courses: Array) -> None:
    columns = {"time_s": curve.protocol.time_s, "displacement_mm": curve.protocol.displacement_mm}
    columns |= {f"row_{row}": course for row, course in enumerate(courses)}
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f".{path.name}.partial")
    with new_file(partial) as file:
        pd.DataFrame(columns).to_csv(file, index=False, float_format="%.17g")
    partial.replace(path)
