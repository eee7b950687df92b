"""The measured curves of a cohort as its page draws them, kept in the result folder whatever was evaluated.

They are the group ``measured`` of ``store.zarr``: all curves one after the other along ``point``, with the number of
points of each in ``row_size`` (a contiguous ragged array of the CF conventions).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import xarray as xr

from sinew.runner.errors import StoreError, one_line
from sinew.runner.store.damage import result_errors
from sinew.runner.store.layout import Damaged
from sinew.runner.store.store import Store
from sinew.tasks.data.cohort import Cohort
from sinew.tasks.data.sources import MOST as MOST_LETTERS
from sinew.tasks.drawing.thinning import drawn_points
from sinew.tasks.model import Curve, Protocol
from sinew.tasks.simulate import Array
from sinew.tasks.study.files import digest

GROUP = "measured"
POINTS = 500  # of a curve, at the most: more than a plot of a page's width can show
MOST = 2 * POINTS  # that are taken from a folder
SOURCE = "source"  # of each curve, where any is known
COLUMNS = {"time": "s", "displacement": "mm", "force": "N"}


@dataclass(frozen=True, eq=False)
class MeasuredQuantity:
    """What was measured beside the force along a protocol: ``values`` ``[q]`` in ``unit`` at the times ``time_s``."""

    unit: str
    time_s: Array
    values: Array


@dataclass(frozen=True, eq=False)
class MeasuredCurve:
    """A curve at points that represent it, each array ``[p]``; ``total`` points were measured or stored.

    ``force_N`` is NaN where nothing was measured, but the specimen was pulled. ``others``: what is compared besides.
    ``source``: where it comes from, for people.
    """

    time_s: Array
    displacement_mm: Array
    force_N: Array
    total: int
    others: Mapping[str, MeasuredQuantity] = field(default_factory=dict)
    source: str = ""


def represented(protocol: str, time: Array, moved: Array, force: Array) -> MeasuredCurve:
    """A curve ``[t]`` at the points that are drawn."""
    keep = drawn_points(Protocol(protocol, time, moved), force, count=POINTS)
    return MeasuredCurve(time[keep], moved[keep], force[keep], time.size)


def keep_curves(store: Store, cohort: Cohort) -> None:
    """Write the cohort's curves into the store, unless they are there, whole. Raises ``StoreError``."""
    curves = [(specimen.name, curve) for specimen in cohort.specimens for curve in specimen.curves]
    parts = [[name, curve.name, curve.digest, *filter(None, [curve.source])] for name, curve in curves]
    content = digest(POINTS, parts)
    if curves and _content(store) != content:
        store.write_result(GROUP, _ragged(curves).assign_attrs(content=content))


def _ragged(curves: Sequence[tuple[str, Curve]]) -> xr.Dataset:
    """The curves of specimens by name, each at the points that are drawn, one after the other."""
    drawn = [
        represented(curve.name, curve.protocol.time_s, curve.protocol.displacement_mm, curve.force_N)
        for _, curve in curves
    ]
    columns = zip(*((one.time_s, one.displacement_mm, one.force_N) for one in drawn), strict=True)
    about = {
        "specimen": ("curve", np.array([name for name, _ in curves], dtype=object)),
        "protocol": ("curve", np.array([curve.name for _, curve in curves], dtype=object)),
        "row_size": ("curve", np.array([one.time_s.size for one in drawn]), {"sample_dimension": "point"}),
        "total": ("curve", np.array([one.total for one in drawn]), {"long_name": "points that were measured"}),
    }
    sources = [curve.source for _, curve in curves]
    about |= {SOURCE: ("curve", np.array(sources, dtype=object))} if any(sources) else {}
    points = {
        name: ("point", np.concatenate(column), {"units": unit})
        for (name, unit), column in zip(COLUMNS.items(), columns, strict=True)
    }
    return xr.Dataset(about | points)


def _content(store: Store) -> Any:
    """The hash of the measured curves of which points are kept; None where there are none, or damaged ones."""
    try:
        return store.read_result(GROUP).attrs.get("content")
    except StoreError:
        return None


def kept_curves(store: Store) -> dict[str, dict[str, MeasuredCurve]]:
    """The curves that :func:`keep_curves` wrote, by specimen and protocol; none in a folder of an older version.

    Raises ``StoreError`` for a group that is damaged.
    """
    if not (store.path / GROUP).is_dir():
        return {}
    with result_errors(store.path / GROUP):
        return _cut(store.read_result(GROUP))


def _cut(kept: xr.Dataset) -> dict[str, dict[str, MeasuredCurve]]:
    wanted = {"specimen": "curve", "protocol": "curve", "row_size": "curve", "total": "curve"} | dict.fromkeys(
        COLUMNS, "point"
    )
    wanted |= {SOURCE: "curve"} if SOURCE in kept else {}
    if any(name not in kept or kept[name].dims != (dim,) for name, dim in wanted.items()):
        raise Damaged("its arrays are not those of curves")
    sizes, totals = kept["row_size"].to_numpy(), kept["total"].to_numpy()
    time, moved, force = (kept[name].to_numpy() for name in COLUMNS)
    kinds = [each.dtype.kind for each in (sizes, totals, time, moved, force)]
    if kinds != [*"iifff"] or (sizes < 1).any() or (sizes > MOST).any() or int(sizes.sum()) != time.size:
        raise Damaged("its curves have other lengths")
    if (totals < sizes).any():
        raise Damaged("fewer points were measured than are kept")
    ends = np.cumsum(sizes)
    found: dict[str, dict[str, MeasuredCurve]] = {}
    labels: Mapping[str, list[str]] = {
        name: [str(one) for one in kept[name].to_numpy()] for name in ("specimen", "protocol")
    }
    told = kept[SOURCE].to_numpy() if SOURCE in kept else [""] * sizes.size
    sources = [one_line(str(one))[:MOST_LETTERS] for one in told]
    for i, (specimen, protocol) in enumerate(zip(labels["specimen"], labels["protocol"], strict=True)):
        part = slice(int(ends[i] - sizes[i]), int(ends[i]))
        columns = (time[part], moved[part], force[part])
        found.setdefault(specimen, {})[protocol] = MeasuredCurve(*columns, int(totals[i]), source=sources[i])
    return found
