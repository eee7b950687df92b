"""Figures of Sobol indices of fields: on the outer faces of the mesh, of the parameters that decide most."""

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib import pyplot as plt
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from sinew.tasks.drawing.figures import STYLE, symbol
from sinew.tasks.simulate import Array

SHOWN = 3  # parameters
MOST_FACES = 50_000  # of a mesh that is drawn
OF = {"magnitude": "magnitude of the ", "von_mises": "von Mises equivalent of the "}


def variables_of(dataset: xr.Dataset) -> list[str]:
    """The fields that have indices, as the store calls them."""
    return [str(name).removesuffix(".ST") for name in dataset.data_vars if str(name).endswith(".ST")]


def parameters_of(dataset: xr.Dataset) -> list[str]:
    """The names of the parameters."""
    return [str(name) for name in dataset["parameter"].to_numpy()]


def on_the_mesh(dataset: xr.Dataset, variable: str) -> Figure | None:
    """Total order indices of a field at each moment (rows), of the parameters that decide most (columns).

    None for a mesh without faces, or with too many of them.
    """
    if "faces" not in dataset or dataset.sizes["face"] > MOST_FACES:
        return None
    faces = dataset["faces"].to_numpy()
    indices = dataset[f"{variable}.ST"]
    chosen = _strongest(indices)
    moments = dataset.sizes["moment"]
    nodes = dataset["nodes"].to_numpy()
    corners = [nodes[face[face >= 0]] for face in faces]
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots(
            moments, len(chosen), figsize=(2.4 * len(chosen) + 0.9, 2.5 * moments + 0.5),
            squeeze=False, subplot_kw={"projection": "3d"},
        )  # fmt: skip
        for moment, row in enumerate(axes):
            for axis, j in zip(row, chosen, strict=True):
                values = _of_faces(dataset, indices.to_numpy()[moment, j], indices.attrs["where"])
                shown = Poly3DCollection(corners, cmap="viridis", edgecolors=(0, 0, 0, 0.2), linewidths=0.1)
                shown.set_array(values)
                shown.set_clim(0.0, 1.0)
                axis.add_collection3d(shown)
                low, high = _box(nodes)
                axis.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
                axis.set_box_aspect(np.maximum(high - low, 1e-3 * (high - low).max()), zoom=1.2)
                axis.set_axis_off()
                name = parameters_of(dataset)[j]
                axis.set_title(f"{symbol(name)}, {_moment(dataset, moment)}", fontsize=8)
        of = f"{OF.get(indices.attrs['of'], '')}{indices.attrs['variable']}"
        figure.colorbar(shown, ax=list(axes[:, -1]), shrink=0.7, label=f"total order index of the {of}")
        figure.supxlabel(
            f"specimen {dataset.attrs['specimen']}, {dataset.attrs['protocol']}", fontsize=8, x=0.99, ha="right"
        )
    return figure


def _box(nodes: Array) -> tuple[Array, Array]:
    """The corners ``[3]`` of a box around nodes ``[n, 3]``, which is nowhere without depth."""
    low, high = nodes.min(axis=0), nodes.max(axis=0)
    pad = np.where(high > low, 0.0, 0.5e-3 * max(float((high - low).max()), 1e-12))
    return low - pad, high + pad


def _strongest(indices: xr.DataArray) -> Array:
    """The numbers of the parameters with the largest mean index."""
    strength = np.nan_to_num(indices.to_numpy()).mean(axis=(0, 2))
    return np.asarray(np.argsort(-strength, kind="stable")[:SHOWN])


def _moment(dataset: xr.Dataset, number: int) -> str:
    return f"{float(dataset['time_s'].to_numpy()[number]):.4g} s"


def _of_faces(dataset: xr.Dataset, values: Array, where: str) -> Array:
    """An index for each face ``[f]``: that of its element, or the mean of its nodes."""
    if where != "node":
        return np.asarray(values[dataset["face_element"].to_numpy()])
    faces = dataset["faces"].to_numpy()
    known = np.where(faces >= 0, values[faces], np.nan)
    count = np.isfinite(known).sum(axis=1)  # a node that is held has no index
    return np.asarray(np.where(count > 0, np.nansum(known, axis=1) / np.maximum(count, 1), np.nan))


def field_table(dataset: xr.Dataset, variable: str) -> pd.DataFrame:
    """What is drawn: by moment, parameter and place (a node, or an element, by its position in the mesh)."""
    chosen = _strongest(dataset[f"{variable}.ST"])
    parts = {key: dataset[f"{variable}.{key}"].to_numpy()[:, chosen] for key in ("ST", "ST_conf")}
    moments, parameters, places = parts["ST"].shape
    at, names = dataset["time_s"].to_numpy(), parameters_of(dataset)
    return pd.DataFrame(
        {
            "time_s": np.repeat(at, parameters * places),
            "parameter": np.tile(np.repeat([names[j] for j in chosen], places), moments),
            "place": np.tile(np.arange(places), moments * parameters),
            **{key: values.ravel() for key, values in parts.items()},
        }
    )
