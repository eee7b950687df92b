"""Outputs that are computed from the fields of a run: a variable of the plot file, at some of its places."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sinew.runner.errors import shown
from sinew.tasks.simulate import Array, Output
from sinew.tasks.simulate.febio.output import Reduce, reduced
from sinew.tasks.simulate.febio.plot_file import Kind, PlotFile, Variable
from sinew.tasks.simulate.febio.plot_mesh import Mesh, Region
from sinew.tasks.simulate.row_by_row import Failed


@dataclass(frozen=True)
class FieldOutput(Output):
    """A ``component`` of the plot variable ``field``, of a named ``set`` or of some ``ids`` (neither: of all places).

    ``component`` is one of the variable's, ``magnitude`` of a vector or ``von_mises`` of a symmetric tensor; a number
    needs none. The values are reduced to one number, which is multiplied by ``scale``. ``at_rest`` is its value at time
    0, as for outputs of the log.
    """

    field: str = ""
    component: str | None = None
    ids: tuple[int, ...] = ()
    set: str | None = None
    reduce: Reduce = "single"
    scale: float = 1.0
    at_rest: float = 0.0


def magnitude(values: Array) -> Array:
    """The length ``[...]`` of vectors ``[..., 3]``."""
    return np.asarray(np.sqrt((values.astype(np.float64) ** 2).sum(axis=-1)))


def von_mises(values: Array) -> Array:
    """The equivalent ``[...]`` of symmetric tensors ``[..., 6]``, in FEBio's order."""
    xx, yy, zz, xy, yz, xz = np.moveaxis(values.astype(np.float64), -1, 0)
    normal = (xx - yy) ** 2 + (yy - zz) ** 2 + (zz - xx) ** 2
    return np.asarray(np.sqrt(normal / 2 + 3 * (xy**2 + yz**2 + xz**2)))


SIZES: dict[str, tuple[Kind, Callable[[Array], Array]]] = {
    "magnitude": ("vec3f", magnitude), "von_mises": ("mat3fs", von_mises),
}  # fmt: skip
"""Numbers that do not depend on the axes, by name: of which kind of variable they are, and how they are computed."""


def field_course(output: FieldOutput, plot: PlotFile) -> tuple[Array, Array]:
    """Times ``[t]`` (s, above 0) and values ``[t]`` of an output.

    Raises :class:`Failed`: ``bad_input`` for a variable, component or set that is not there.
    """
    variable = plot.variables.get(output.field)
    if variable is None:
        there = ", ".join(plot.variables) or "none"
        raise _wrong(output, f"no variable {shown(output.field)} in the plot file, which has {there}")
    if not variable.values.shape[1]:
        raise _wrong(output, f"{variable.name} is there for no part of the mesh")
    items = _items(output, variable, plot.mesh)
    if not items.size:
        raise _wrong(output, "no place is chosen")
    if output.reduce == "single" and items.size != 1:
        raise _wrong(output, f"{items.size:,} places, and no reduce: sum, mean, max or min")
    later = plot.time_s > 0
    values = _component(output, variable, variable.values[later][:, items])
    return plot.time_s[later], reduced(output.name, output.reduce, output.scale, plot.time_s[later], values)


def _wrong(output: FieldOutput, problem: str) -> Failed:
    return Failed("bad_input", f"simulator.outputs.{output.name}: {problem}")


def _component(output: FieldOutput, variable: Variable, values: Array) -> Array:
    """One number for each place, ``[state, item]``, of ``values`` ``[state, item, component]``."""
    name = output.component
    if name is None and len(variable.components) == 1:
        return values[:, :, 0].astype(np.float64)
    if name is not None and name in SIZES and variable.kind == SIZES[name][0]:
        return SIZES[name][1](values)
    if name not in variable.components:
        others = [size for size, (kind, _) in SIZES.items() if kind == variable.kind]
        expected = ", ".join([*variable.components, *others]) or "no component"
        raise _wrong(output, f"component {shown(name)} of {variable.name}, which has {expected}")
    return values[:, :, variable.components.index(name)].astype(np.float64)


def _items(output: FieldOutput, variable: Variable, mesh: Mesh) -> Array:
    """Positions of the chosen places among the items of a variable."""
    if variable.where == "global" or (output.set is None and not output.ids):
        return np.arange(variable.values.shape[1])
    if variable.where == "node":
        return _nodes(output, mesh)
    regions = {"domain": mesh.domains, "surface": mesh.surfaces, "edge": mesh.edges}[variable.where]
    chosen = _chosen_elements(output, mesh) if variable.where == "domain" else None
    found, start = [np.zeros(0, np.intp)], 0
    for number, count in variable.regions:
        region = regions[number]
        if output.set is not None and output.set in _names(region, mesh):
            found.append(np.arange(start, start + count))
        elif chosen is not None and variable.per in ("item", "corner"):
            inside = np.flatnonzero(np.isin(region.ids, chosen))
            each = count // max(1, len(region.ids))
            found.append((start + inside[:, np.newaxis] * each + np.arange(each)).ravel())
        start += count
    items = np.concatenate(found)
    if not items.size or (output.ids and variable.per == "item" and items.size != len(set(output.ids))):
        what = f"set {shown(output.set)}" if output.set is not None else "all of these ids"
        raise _wrong(output, f"{variable.name} is not there for {what} ({variable.where} data)")
    return items


def _names(region: Region, mesh: Mesh) -> tuple[str, ...]:
    """A domain is called by its own name, or by that of its material."""
    return tuple(name for name in (region.name, (mesh.parts or {}).get(region.part, "")) if name)


def _chosen_elements(output: FieldOutput, mesh: Mesh) -> Array | None:
    """The solver's numbers of the elements in a set or of the ids, None for a set that is none of elements."""
    return np.array(output.ids) if output.set is None else (mesh.element_sets or {}).get(output.set)


def _nodes(output: FieldOutput, mesh: Mesh) -> Array:
    """Positions of nodes: those of a node set, or of a surface or domain of this name."""
    if output.set is None:
        order = np.argsort(mesh.node_ids, kind="stable")
        asked = np.array(output.ids)
        at = np.clip(np.searchsorted(mesh.node_ids[order], asked), 0, order.size - 1)
        if (mesh.node_ids[order[at]] != asked).any():
            raise _wrong(output, "some of the nodes are not in the model")
        return np.asarray(order[at])
    named = dict(mesh.node_sets or {})
    if output.set in named:
        return named[output.set]
    regions = (*mesh.surfaces, *mesh.domains)
    for region in regions:
        if region.name == output.set:
            return region.nodes
    known = ", ".join(sorted({*named, *(region.name for region in regions if region.name)})) or "none is there"
    raise _wrong(output, f"no set {shown(output.set)} of nodes; expected one of {known}")
