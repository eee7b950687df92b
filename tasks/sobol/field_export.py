"""Sobol indices of fields as files for ParaView."""

from pathlib import Path

import numpy as np
import xarray as xr

from sinew.runner.errors import BadInput
from sinew.runner.store.store import open_store
from sinew.tasks.simulate import Array
from sinew.tasks.simulate.febio.field_export import FOLDER
from sinew.tasks.simulate.febio.keeping import Index
from sinew.tasks.simulate.febio.plot_file import PlotFile, Variable
from sinew.tasks.simulate.febio.plot_mesh import Mesh
from sinew.tasks.simulate.febio.vtk import write_vtk
from sinew.tasks.sobol.field_figures import parameters_of, variables_of
from sinew.tasks.sobol.of_fields import stored_as
from sinew.tasks.sobol.result import KEYS, SobolResult
from sinew.tasks.study.result import believed


def export_indices(folder: Path, to: Path) -> list[Path]:
    """Write the indices of all fields of a result folder into the folder ``to``: a .pvd file for each protocol.

    Each has a state for each moment. Raises :class:`BadInput` where there are none, and
    :class:`sinew.runner.errors.StoreError`.
    """
    result = SobolResult.read(folder)
    courses = {} if result is None else result.field_courses()
    if not courses:
        expected = "a finished `sinew sobol` of a study with keep: fields"
        raise BadInput(SobolResult.path(folder), "no indices of fields", expected)
    store, paths = open_store(folder), []
    for table, protocol in courses.values():
        with believed(SobolResult.path(folder)):
            plot = _as_plot(folder, store.read_result(stored_as(table, protocol)))
        paths.append(to / f"sobol_{table}_{protocol}.pvd")
        write_vtk(paths[-1], plot)
    return paths


def _as_plot(folder: Path, dataset: xr.Dataset) -> PlotFile:
    """The indices as variables on the mesh of one of the runs."""
    index = Index(folder / FOLDER)
    index.look()
    run = next(index.runs(str(dataset.attrs.get("run"))), None)
    if run is None:
        raise BadInput(folder / FOLDER, "the run whose mesh is needed is gone", "the files of all kept runs")
    mesh, variables = run.plot.mesh, dict[str, Variable]()
    for name in variables_of(dataset):
        about = dataset[f"{name}.ST"].attrs
        for key in KEYS:
            for j, parameter in enumerate(parameters_of(dataset)):
                title = f"{key} {parameter}: {about['variable']}"
                values = dataset[f"{name}.{key}"].to_numpy()[:, j, :, np.newaxis].astype(np.float32)
                variables[title] = _variable(title, str(about["where"]), values, mesh)
    return PlotFile(dataset["time_s"].to_numpy().astype(np.float64), mesh, variables)


def _variable(title: str, where: str, values: Array, mesh: Mesh) -> Variable:
    """A number ``[moment, place, 1]`` for each node or element. Raises :class:`BadInput` for another number of them."""
    counts = [len(region.ids) for region in mesh.domains]
    expected = len(mesh.nodes) if where == "node" else sum(counts)
    if values.shape[1] != expected:
        raise BadInput(title, f"{values.shape[1]:,} places", f"{expected:,}, as in the mesh")
    if where == "node":
        return Variable(title, "node", "node", "float", "1", values, ((0, expected),))
    return Variable(title, "domain", "item", "float", "1", values, tuple(enumerate(counts)))
