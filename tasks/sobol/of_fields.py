"""Sobol indices of fields: of every node and element of a mesh, where a study keeps the fields of its runs.

Of a vector it is the magnitude that has indices, of a symmetric tensor the equivalent of von Mises, at two moments: the
largest displacement of a protocol, and its end. The store keeps ``sobol_fields/SPECIMEN_PROTOCOL``.
"""

import re
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, cast

import numpy as np
import xarray as xr

from sinew.tasks.model import Curve
from sinew.tasks.simulate import Array
from sinew.tasks.simulate.febio.faces import outer_faces
from sinew.tasks.simulate.febio.field_output import SIZES
from sinew.tasks.simulate.febio.keeping import Index
from sinew.tasks.simulate.febio.kept import key_of, settings_of
from sinew.tasks.simulate.febio.plot_file import PlotFile, Variable
from sinew.tasks.simulate.febio.simulator import FEBio
from sinew.tasks.simulate.febio.vtk import by_cell, has_place
from sinew.tasks.sobol.by_chaos import ByChaos
from sinew.tasks.sobol.estimate import Estimator
from sinew.tasks.sobol.evaluated import Evaluated
from sinew.tasks.sobol.result import KEYS

BYTES_AT_A_TIME = 2**26  # of the places that are analysed together
ROUNDING = 1e-5  # of the largest value of a field: plot files hold seven digits
MOST = 2**31  # numbers of all runs: of larger fields there are no indices
MOST_INDICES = 2**25  # of all parameters, moments and places together


def stored_as(table: str, protocol: str) -> str:
    """What the store calls the indices of the fields along a protocol, of a specimen whose rows are in ``table``."""
    return f"sobol_fields/{table}_{protocol}"


def kept(one: Evaluated) -> bool:
    """Whether the runs of a specimen's rows keep their fields."""
    simulator = one.evaluation.simulator
    return isinstance(simulator, FEBio) and simulator.kept is not None


def missing(one: Evaluated, curve: Curve, ok: Array) -> bool:
    """Whether there are kept fields along a protocol, of which there could be indices."""
    return kept(one) and bool(ok.any()) and _Plots.of_kept(one, curve).of(int(np.argmax(ok))) is not None


def of_fields(estimate: Estimator | ByChaos, one: Evaluated, curve: Curve) -> xr.Dataset | str:
    """The indices of all fields along a protocol, or why there are none."""
    plots = _Plots.of_kept(one, curve)
    first = plots.of(int(np.argmax(estimate.ok)))
    if first is None:
        return "the fields of its rows were not kept"
    shapes = {name: scalars.shape for name, scalars in _scalars(first, curve).items()}
    width = sum(int(np.prod(shape)) for shape in shapes.values())
    if not width:
        return "none of its variables is a number, a vector or a stress of nodes or elements"
    if estimate.ok.size * width > MOST:
        return f"{estimate.ok.size:,} rows with {width:,} numbers each are too many"
    if width * len(estimate.design.names) * len(KEYS) > MOST_INDICES:
        return f"indices of {len(estimate.design.names)} parameters at {width:,} places are too many"
    with tempfile.TemporaryFile() as file:
        shape = (estimate.ok.size, width)
        values = np.memmap(file, np.float32, "w+", shape=shape)
        for row in np.flatnonzero(estimate.ok):
            if (plot := plots.of(int(row))) is None:
                return f"the fields of row {one.at[row]} are gone, or were not kept"
            scalars = _scalars(plot, curve)
            if {name: scalar.shape for name, scalar in scalars.items()} != shapes:
                return f"row {one.at[row]} has other variables, another mesh or other moments than the first"
            values[row] = np.concatenate([scalar.ravel() for scalar in scalars.values()])
        blocks = np.repeat(np.arange(len(shapes) * len(moments(first, curve))), _places_of(shapes))
        found = _analysed(estimate, one, values, blocks)
    dataset = _dataset(estimate.design.names, found, first, curve)
    return dataset.assign_attrs(specimen=one.specimen.name, run=plots.key(int(np.argmax(estimate.ok))))


class _Plots:
    """The kept runs of a specimen's rows along a protocol."""

    def __init__(self, index: Index, one: Evaluated, curve: Curve) -> None:
        evaluation = one.evaluation
        identities = evaluation.model.identity(), one.specimen.size(), evaluation.simulator.identity()
        self.index, self.one, self.settings = index, one, settings_of(*identities, curve.protocol.digest)

    @classmethod
    def of_kept(cls, one: Evaluated, curve: Curve) -> "_Plots":
        """Those in the folder of a simulator that keeps them."""
        folder = cast(FEBio, one.evaluation.simulator).kept
        assert folder is not None, "kept() was asked"
        index = Index(folder)
        index.look()
        return cls(index, one, curve)

    def key(self, row: int) -> str:
        """The key of the run of a row of the design."""
        values = self.one.table.parameters(self.one.at[row : row + 1])[0]
        return key_of(self.settings, tuple(self.one.table.names), values)

    def of(self, row: int) -> PlotFile | None:
        """The fields of a row of the design; of several runs, those of which most was asked."""
        run = next(self.index.runs(self.key(row)), None)
        return None if run is None else run.plot


def moments(plot: PlotFile, curve: Curve) -> dict[str, int]:
    """The states of the largest displacement and of the end, by name; one state is not listed twice."""
    time, moved = curve.protocol.time_s, np.abs(curve.protocol.displacement_mm)
    before_end = time[-1] - time[int(np.argmax(moved))]
    largest = int(np.argmin(np.abs(plot.time_s - (plot.time_s[-1] - before_end))))
    end = plot.time_s.size - 1
    return {"largest": largest, "end": end} if largest != end else {"end": end}


def measured(variable: Variable) -> str | None:
    """What of a variable has indices: ``magnitude``, ``von_mises``, or itself (empty); None if nothing has."""
    if variable.kind == "float":
        return ""
    return next((name for name, (kind, _) in SIZES.items() if kind == variable.kind), None)


def _scalars(plot: PlotFile, curve: Curve) -> dict[str, Array]:
    """One number for each moment and place ``[moment, place]`` of the variables of nodes and elements."""
    states = list(moments(plot, curve).values())
    found = {}
    for name, variable in plot.variables.items():
        how = measured(variable)
        if not has_place(variable) or how is None or not variable.values.shape[1]:
            continue
        values = np.stack([_places(plot, variable, state) for state in states])
        found[name] = values[..., 0] if not how else SIZES[how][1](values).astype(np.float32)
    return found


def _places(plot: PlotFile, variable: Variable, state: int) -> Array:
    """A variable ``[place, component]`` at all nodes, or in all elements."""
    if variable.where == "node":
        return np.asarray(variable.values[state])
    domains = plot.mesh.domains
    return by_cell(variable, domains, sum(len(region.corners) for region in domains), state)


def _places_of(shapes: Mapping[str, tuple[int, ...]]) -> list[int]:
    """How many places each variable has at each moment, one after the other."""
    return [places for moment_count, places in shapes.values() for _ in range(moment_count)]


def _analysed(estimate: Estimator | ByChaos, one: Evaluated, values: Array, blocks: Array) -> Mapping[str, Array]:
    """Indices ``[parameter, place]`` by key, some places at a time.

    ``blocks`` ``[place]``: the same number for all places of a variable at a moment. NaN where a place has no values,
    or where they vary by no more than the rounding of the largest of them.
    """
    largest = np.zeros(blocks.max() + 1)
    for places in _slices(values):
        seen = np.abs(values[estimate.ok, places]).max(axis=0)
        np.fmax.at(largest, blocks[places], seen)
    beside = sum(other.at.size for other in one.cheaper)  # cheaper versions keep no fields
    found = {key: np.full((len(estimate.design.names), values.shape[1]), np.nan) for key in KEYS}
    for places in _slices(values):
        part = values[:, places].astype(np.float64)
        ran = part[estimate.ok]
        there = np.asarray(np.isfinite(ran).all(axis=0))
        there[there] = np.ptp(ran[:, there], axis=0) > ROUNDING * largest[blocks[places]][there]
        if there.any():
            outcomes = np.concatenate([part[:, there], np.full((beside, there.sum()), np.nan)])
            indices = estimate.of(outcomes)
            for key, values_of in found.items():
                values_of[:, np.arange(values.shape[1])[places][there]] = indices[key]
    return found


def _slices(values: Array) -> Iterator[slice]:
    each = max(1, BYTES_AT_A_TIME // (8 * max(1, len(values))))
    return (slice(start, start + each) for start in range(0, values.shape[1], each))


def _dataset(names: Sequence[str], found: Mapping[str, Array], plot: PlotFile, curve: Curve) -> xr.Dataset:
    """Indices ``[moment, parameter, place]`` of each variable, and the mesh at rest with its outer faces."""
    states = moments(plot, curve)
    variables: dict[str, Any] = {}
    start = 0
    for name, scalars in _scalars(plot, curve).items():
        variable, plain = plot.variables[name], re.sub(r"[^A-Za-z0-9]", "_", name)[:60]
        plain = plain if f"{plain}.ST" not in variables else f"{plain}_{len(variables)}"
        about = {"variable": name, "where": variable.where, "of": measured(variable) or "value"}
        for key, indices in found.items():
            of_it = indices[:, start : start + scalars.size].reshape(len(indices), *scalars.shape)
            dims = ("moment", "parameter", f"{plain}_places")
            variables[f"{plain}.{key}"] = (dims, of_it.swapaxes(0, 1).astype(np.float32), about)
        start += scalars.size
    faces, cells = outer_faces(plot.mesh)
    variables["nodes"] = (("node", "axis"), plot.mesh.nodes.astype(float))
    if len(faces):  # lines have none
        variables |= {"faces": (("face", "corner"), faces), "face_element": (("face",), cells)}
    coordinates = {
        "parameter": np.array(names, dtype=str),
        "moment": list(states),
        "time_s": ("moment", plot.time_s[list(states.values())]),
    }
    return xr.Dataset(variables, coordinates, {"protocol": curve.name})
