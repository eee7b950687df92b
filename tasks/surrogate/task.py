"""Emulators of a study: run the model, train, and run it again where that tells most, until errors are as asked.

Rows are those of the study's store, as any task has them. The store keeps ``surrogate/SPECIMEN``: which rows they are,
and left-out errors along time.
"""

import logging
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import xarray as xr
from scipy.stats import qmc
from threadpoolctl import threadpool_limits

from sinew.runner.errors import BadInput
from sinew.runner.store.table import Table
from sinew.tasks.fitting.emulator import SDS, Courses, Emulator, Fit, LeftOut, rms, trained, widening
from sinew.tasks.fitting.failing import Failing, failing
from sinew.tasks.fitting.growth import next_runs
from sinew.tasks.model import Specimen
from sinew.tasks.simulate import Array
from sinew.tasks.simulate.evaluation import SpecimenEvaluation
from sinew.tasks.simulate.growing import TURN
from sinew.tasks.simulate.inputs import PLAIN
from sinew.tasks.simulate.plain_design import shares
from sinew.tasks.study import streams
from sinew.tasks.study.cached import cached, commit, key
from sinew.tasks.study.workspace import Workspace
from sinew.tasks.surrogate.reading import apart, courses_of, group, kept_of, times_of
from sinew.tasks.surrogate.result import OfComponent, OfCourse, OfSpecimen, SurrogateResult
from sinew.tasks.surrogate.settings import Settings, fewest, sizes

log = logging.getLogger("sinew")
POOL = 10  # the power of two of points among which the next runs are chosen
FAILED = 0.5  # of all runs: where more failed, there is next to nothing to learn from


@dataclass(frozen=True, eq=False)
class Looked:
    """What is known after a batch of runs.

    ``share`` ``[n, d]`` and ``rows`` ``[n]`` in the table of all runs, ``ok`` ``[n]``; of the runs that did not fail,
    the ``values`` ``[k, t]`` of each course. ``fresh``: by course, the error of the emulator before at this batch, and
    the part of its points inside their intervals. ``region``: where runs fail.
    """

    share: Array
    rows: Array
    ok: Array
    values: list[Array]
    courses: Courses
    spreads: list[float]
    fits: list[Fit]
    left_out: LeftOut
    factors: list[float]
    fresh: list[tuple[float, float]]
    region: Failing

    @cached_property
    def emulator(self) -> Emulator:
        """What was trained."""
        return Emulator(self.share[self.ok], self.courses, self.fits)

    @cached_property
    def off(self) -> list[Array]:
        """How far each course ``[k, t]`` of left-out runs is from what was said of it."""
        return [part - mean for part, mean in zip(self.values, split(self.left_out.mean, self.values), strict=True)]

    @property
    def errors(self) -> list[float]:
        """The left-out error of each course, in parts of its spread."""
        return [rms(off) / size if size else 0.0 for off, size in zip(self.off, self.spreads, strict=True)]


def run(workspace: Workspace, settings: Settings) -> SurrogateResult:
    """The emulator of each specimen."""
    specimens = workspace.specimens(settings.specimens, "surrogate.specimens")
    if not workspace.retry_failed and (known := _finished(workspace, settings, specimens)) is not None:
        return known
    found, arrays, tables = {}, {}, {}
    for specimen in specimens:
        with threadpool_limits(1):  # sums in one order, on whatever machine
            evaluation, table, looked, errors, last = _grown(workspace, settings, specimen)
        found[specimen.name] = _told(evaluation, table, looked, errors, last)
        arrays[group(specimen.name)] = _arrays(evaluation, table, last)
        tables[specimen.name] = table, last.rows
    free = workspace.model.free
    result = SurrogateResult(
        names=[one.name for one in free],
        bounds=[[one.minimum, one.maximum] for one in free],
        asked=settings.error,
        growth=settings.growth,
        specimens=found,
        inputs=_inputs(workspace, settings, tables),
    )
    commit(workspace, result, arrays)
    return result


def _grown(
    workspace: Workspace, settings: Settings, specimen: Specimen
) -> tuple[SpecimenEvaluation, Table, list[int], list[float], Looked]:
    """Runs of a specimen, more and more of them; and what is known after the last."""
    evaluation, model = workspace.evaluation(specimen), workspace.model
    names = tuple(one.name for one in model.free)
    share, rows = np.empty((0, len(names))), np.empty(0, dtype=int)
    before: Looked | None = None
    looked: list[int] = []
    errors: list[float] = []
    for size in sizes(settings, len(names)):
        new = _next(workspace, settings, before, size, specimen.name)
        table, at = workspace.plan(evaluation, model.full(names, PLAIN.values(model.free, new)))
        workspace.evaluate(evaluation, table, at, f"surrogate {specimen.name}")
        share, rows = np.concatenate([share, new]), np.concatenate([rows, at])
        before = _looked(workspace, evaluation, table, share, rows, before)
        looked.append(size)
        errors.append(max(before.errors, default=0.0))
        words = f"{specimen.name}: {size} runs, errors of at most {100 * errors[-1]:.2g} % of the spread"
        workspace.note("surrogate", specimen.name, words, value=errors[-1], runs=size)
        workspace.say(f"surrogate: {words} ({100 * settings.error:g} % asked)")
        if errors[-1] <= settings.error:
            break
    assert before is not None, "there is at least one batch"
    return evaluation, table, looked, errors, before


def _next(workspace: Workspace, settings: Settings, before: Looked | None, size: int, specimen: str) -> Array:
    """Where the model is run next, ``[n, d]``: so that there are ``size`` runs in all."""
    known = 0 if before is None else len(before.share)
    free = len(workspace.model.free)
    if before is None or settings.growth == "even" or not before.fits:
        return shares(free, size, workspace.seed, TURN)[known:]
    rng = streams.generator(workspace.seed, f"surrogate pool {specimen}", size)
    pool = qmc.Sobol(free, scramble=True, seed=rng).random_base2(POOL)
    alive = 1.0 - before.region.probability(pool)
    return np.asarray(pool[next_runs(before.emulator, pool, alive, size - known)])


def _looked(
    workspace: Workspace,
    evaluation: SpecimenEvaluation,
    table: Table,
    share: Array,
    rows: Array,
    before: Looked | None,
) -> Looked:
    """Train with all runs so far. Raises :class:`BadInput` where too many of the first ones failed."""
    ok, values = courses_of(table, list(_courses(evaluation)), rows)
    least = fewest(share.shape[1])
    if before is None and ((~ok).mean() > FAILED or ok.sum() < least):
        raise BadInput(
            workspace.out, f"{(~ok).sum()} of the first {ok.size} runs of {evaluation.specimen.name} failed",
            f"a model that can be evaluated in most of its ranges (`sinew status` tells why), {least} times at least",
        )  # fmt: skip
    courses, spreads = apart(values)
    fits, left_out = trained(share[ok], courses, () if before is None else before.fits)
    parts = zip(values, split(left_out.mean, values), split(left_out.sd, values), strict=True)
    factors = [widening(value, LeftOut(mean, sd), share.shape[1]) for value, mean, sd in parts]
    fresh = [] if before is None else _fresh(before, share, ok, values)
    region = failing(share, ~ok)
    return Looked(share, rows, ok, values, courses, spreads, fits, left_out, factors, fresh, region)


def _fresh(before: Looked, share: Array, ok: Array, values: list[Array]) -> list[tuple[float, float]]:
    """What an emulator said of runs that it had not seen: the error in parts of the spread, and the part inside."""
    new = np.flatnonzero(ok)[before.ok.sum() :]
    if not new.size:
        return []
    means, sds = before.emulator.predict(share[new])
    found = []
    for value, mean, sd, size, factor in zip(
        values, split(means, values), split(sds, values), before.spreads, before.factors, strict=True
    ):
        off = value[-new.size :] - mean
        inside = np.abs(off) <= SDS * factor * sd + 1e-12 * size
        if size or not off.any():
            found.append((rms(off) / size if size else 0.0, float(inside.mean())))
        else:  # it did not vary before: there is no spread to compare with
            found.append((np.nan, np.nan))
    return found


def split(together: Array, values: list[Array]) -> list[Array]:
    """Courses ``[n, t]`` one by one, of all of them side by side."""
    return np.split(together, np.cumsum([one.shape[1] for one in values])[:-1], axis=1)


def _courses(evaluation: SpecimenEvaluation) -> dict[str, tuple[str, str, str]]:
    """The fields of the store that hold courses: of each its output, protocol and unit."""
    units = {output.name: output.unit for output in evaluation.simulator.capabilities.outputs} | {"force": "N"}
    return {
        field: (output, curve.name, units[output])
        for curve in evaluation.specimen.curves
        for field, output in evaluation.courses(curve.name).items()
    }


def _told(
    evaluation: SpecimenEvaluation,
    table: Table,
    looked: list[int],
    errors: list[float],
    last: Looked,
) -> OfSpecimen:
    fresh = last.fresh or [(np.nan, np.nan)] * len(last.values)
    numbers = zip(last.spreads, last.errors, last.factors, fresh, strict=True)
    courses = {
        field: OfCourse(*about, size, error, factor, *seen)
        for (field, about), (size, error, factor, seen) in zip(_courses(evaluation).items(), numbers, strict=True)
    }
    return OfSpecimen(
        table=table.key,
        runs=last.ok.size,
        failed=int((~last.ok).sum()),
        sizes=looked,
        errors=np.array(errors),
        courses=courses,
        components=[OfComponent(one.kind, one.degree, np.array(one.theta), one.error) for one in last.fits],
        caught=last.region.caught,
        mistaken=last.region.mistaken,
    )


def _arrays(evaluation: SpecimenEvaluation, table: Table, last: Looked) -> xr.Dataset:
    """Rows of the table, and the left-out error (rms over runs) of each course along time."""
    variables: dict[str, object] = {"row": ("run", last.rows)}
    coordinates = {}
    for (field, (_, protocol, unit)), off in zip(_courses(evaluation).items(), last.off, strict=True):
        dim = f"time_{protocol}"
        coordinates[dim] = (dim, times_of(table, protocol), {"units": "s"})
        variables[f"error_{field}"] = (dim, np.sqrt(np.mean(off**2, axis=0)), {"units": unit})
    free = evaluation.model.free
    about = {"names": [one.name for one in free], "bounds": [[one.minimum, one.maximum] for one in free]}
    return xr.Dataset(variables, coordinates, {"specimen": evaluation.specimen.name, **about})


def _inputs(workspace: Workspace, settings: Settings, tables: Mapping[str, tuple[Table, Array]]) -> str:
    """The key of a result."""
    bounds = [[one.name, one.minimum, one.maximum] for one in workspace.model.free]
    used = [part for table, rows in tables.values() for part in (table.key, rows, table.status[rows])]
    return key(SurrogateResult, settings.model_dump(), workspace.seed, bounds, *used)


def _finished(workspace: Workspace, settings: Settings, specimens: tuple[Specimen, ...]) -> SurrogateResult | None:
    """The last result, if it is of the same study and all that it was made of is there."""
    tables = {}
    for specimen in specimens:
        table = workspace.store.table(workspace.evaluation(specimen).table())
        kept = kept_of(workspace.store, specimen.name)
        if kept is None or (rows := kept["row"].to_numpy()).max() >= len(table):
            return None
        tables[specimen.name] = table, rows
    return cached(workspace, SurrogateResult, _inputs(workspace, settings, tables), map(group, tables))
