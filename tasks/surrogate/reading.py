"""The emulators of a result folder, made again from its rows: for tasks, notebooks and scripts."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr
from threadpoolctl import threadpool_limits

from sinew.runner.errors import BadInput, StoreError, shown
from sinew.runner.store.store import Store, open_store
from sinew.runner.store.table import Table
from sinew.tasks.fitting.emulator import Courses, Emulator, Fit, rms, taken_apart
from sinew.tasks.fitting.failing import Failing, failing
from sinew.tasks.simulate import Array
from sinew.tasks.study.result import believed
from sinew.tasks.surrogate.result import OfSpecimen, SurrogateResult
from sinew.tasks.surrogate.settings import MOST_RUNS

FLAT = 1e-12  # part of its size by which a course varies at least


@dataclass(frozen=True, eq=False)
class Course:
    """What an emulator says of one course: ``mean`` and ``sd`` ``[m, t]`` (``unit``) at ``time_s`` ``[t]``."""

    time_s: Array
    mean: Array
    sd: Array
    unit: str


@dataclass(frozen=True, eq=False)
class Surrogate:
    """The emulator of a specimen: from values of the free parameters ``names`` to courses of forces and outputs.

    ``lower`` and ``upper`` ``[d]``: the ranges that it was trained in.
    """

    specimen: str
    names: tuple[str, ...]
    lower: Array
    upper: Array
    told: OfSpecimen
    times: Mapping[str, Array]
    emulator: Emulator
    region: Failing

    def courses(self, parameters: Array) -> dict[str, Course]:
        """Courses by the store's fields (``force_PROTOCOL``) at ``parameters`` ``[m, d]``, or ``[d]`` for one set.

        Raises :class:`BadInput` for values outside the ranges.
        """
        with threadpool_limits(1):
            mean, sd = self.emulator.predict(self._share(parameters))
        found, begin = {}, 0
        for field, one in self.told.courses.items():
            place = slice(begin, begin + self.times[field].size)
            found[field] = Course(self.times[field], mean[:, place], one.factor * sd[:, place], one.unit)
            begin = place.stop
        return found

    def failing(self, parameters: Array) -> Array:
        """How probable it is that a run fails, ``[m]``, at ``parameters`` ``[m, d]``."""
        return self.region.probability(self._share(parameters))

    def _share(self, parameters: Array) -> Array:
        try:
            values = np.atleast_2d(np.asarray(parameters, dtype=float))
        except (TypeError, ValueError, OverflowError):
            raise BadInput("parameters", shown(parameters), f"numbers [m, {len(self.names)}]") from None
        if values.ndim != 2 or values.shape[1] != len(self.names):
            raise BadInput("parameters", f"shape {np.shape(parameters)}", f"[m, {len(self.names)}]: a value of each of "
                           f"{', '.join(self.names)}")  # fmt: skip
        outside = ~((values >= self.lower) & (values <= self.upper))
        if outside.any():
            row, column = np.argwhere(outside)[0]
            expected = f"{self.lower[column]:g} to {self.upper[column]:g}, where the emulator was trained"
            raise BadInput(f"parameters: row {row}, {self.names[column]}", f"{values[row, column]:g}", expected)
        return np.asarray((values - self.lower) / (self.upper - self.lower))


def surrogate(folder: str | Path, specimen: str | None = None) -> Surrogate:
    """The emulator of a specimen (left out: the only one) in a result folder.

    Raises :class:`BadInput`, also where the store has changed since, and ``StoreError`` where it cannot be read.
    """
    folder = Path(folder)
    result, path = SurrogateResult.read(folder), SurrogateResult.path(folder)
    if result is None:
        raise BadInput(path, "is not there", "a finished `sinew surrogate` in this folder")
    name = next(iter(result.specimens)) if specimen is None and len(result.specimens) == 1 else specimen
    if not isinstance(name, str) or name not in result.specimens:
        raise BadInput(path, f"specimen {shown(name)}", f"one of {', '.join(result.specimens)}")
    one = result.specimens[name]
    store = open_store(folder)
    with believed(path):
        table = {each.key: each for each in store.tables()}[one.table]
        kept = kept_of(store, name, result.inputs)
        rows = np.empty(0, dtype=int) if kept is None else kept["row"].to_numpy()
        if kept is None or rows.size != one.runs or table.pending(rows).size:
            raise ValueError("the store does not hold its runs any more")
        _check_told(kept, result, one)
        at = [table.names.index(each) for each in result.names]
        lower, upper = np.array(result.bounds, dtype=float).T
        share = (table.parameters(rows)[:, at] - lower) / (upper - lower)
        ok, values = courses_of(table, list(one.courses), rows)
        if (~ok).sum() != one.failed:
            raise ValueError(f"{(~ok).sum()} of its runs failed, not {one.failed}")
        fits = [Fit(each.kind, each.degree, tuple(each.theta), each.error) for each in one.components]  # type: ignore[arg-type]
        with threadpool_limits(1):
            emulator = Emulator(share[ok], apart(values)[0], fits)
            region = failing(share, ~ok)
        times = {field: times_of(table, each.protocol) for field, each in one.courses.items()}
    return Surrogate(name, tuple(result.names), lower, upper, one, times, emulator, region)


def _check_told(kept: xr.Dataset, result: SurrogateResult, one: OfSpecimen) -> None:
    """Raises :class:`ValueError` where a result tells otherwise than what the store keeps of its emulator."""
    if kept.attrs.get("names") != result.names or kept.attrs.get("bounds") != result.bounds:
        raise ValueError("the emulator in the store is of other parameters or ranges")
    if {f"error_{field}" for field in one.courses} != {str(each) for each in kept.data_vars} - {"row"}:
        raise ValueError("the emulator in the store is of other courses")
    for field, course in one.courses.items():
        error = kept[f"error_{field}"]
        if error.dims != (f"time_{course.protocol}",) or error.attrs.get("units") != course.unit:
            raise ValueError(f"the store has another protocol or unit of {field}")
        if not np.isclose(rms(error.to_numpy()), course.error * course.spread, rtol=1e-6, atol=0.0):
            raise ValueError(f"the store has another error of {field}")


def group(specimen: str) -> str:
    """Where the store keeps what an emulator was trained with."""
    return f"surrogate/{specimen}"


def times_of(table: Table, protocol: str) -> Array:
    """The times ``[t]`` (s) of what is kept along a protocol."""
    found = table.coordinate(f"time_{protocol}")
    if found is None:
        raise LookupError(f"no times of {protocol}")
    return np.asarray(found, dtype=float)


def kept_of(store: Store, specimen: str, inputs: str | None = None) -> xr.Dataset | None:
    """What the store keeps of an emulator, with the rows ``row`` ``[n]`` of its table; None where they cannot be.

    ``inputs``: the key of the result that they must be of.
    """
    try:
        dataset = store.read_result(group(specimen))
        rows = dataset["row"].to_numpy()
    except (StoreError, KeyError):
        return None
    right = rows.ndim == 1 and rows.dtype.kind == "i" and 0 < rows.size <= MOST_RUNS and rows.min(initial=0) >= 0
    return dataset if right and inputs in (None, dataset.attrs.get("inputs")) else None


def courses_of(table: Table, fields: Sequence[str], rows: Array) -> tuple[Array, list[Array]]:
    """Which ``rows`` ran ``[n]``, and of those the courses ``[k, t]`` of each field.

    A run with a course that has values which are no numbers counts as failed.
    """
    found = [table.read(field, rows) for field in fields]
    ok = np.asarray(table.status[rows] == 0)
    for values in found:
        ok &= np.isfinite(values).all(axis=1)
    return ok, [values[ok] for values in found]


def spread(values: Array) -> float:
    """The standard deviation over runs of a course ``[n, t]``, root mean square along time; 0 if it does not vary."""
    largest = float(np.abs(values).max())
    if not largest:
        return 0.0
    found = float(np.sqrt(np.mean(np.var(values / largest, axis=0))))
    return largest * found if found > FLAT else 0.0


def apart(values: Sequence[Array]) -> tuple[Courses, list[float]]:
    """All courses ``[n, t]`` of a specimen taken apart together, each in its own spread; and these spreads."""
    spreads = [spread(one) for one in values]
    parts = [one if size else np.broadcast_to(one[:1], one.shape) for one, size in zip(values, spreads, strict=True)]
    scale = [np.full(one.shape[1], size or max(float(np.abs(one).max()), 1.0))
             for one, size in zip(values, spreads, strict=True)]  # fmt: skip
    return taken_apart(np.concatenate(parts, axis=1), np.concatenate(scale)), spreads
