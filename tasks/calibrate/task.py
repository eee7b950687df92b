"""Calibration of each specimen: the parameters that bring the model closest to its measured curves.

Stores: rows of every evaluation, like all tasks; ``calibrate/SPECIMEN``, the points of the Bayesian search. Leaves
``calibrate.json``, ``calibrate.csv`` (a line for each specimen, as in table 2 of Pekedis 2025) and
``calibrate_sites.csv`` (mean and standard deviation by site). All specimens share the cluster: while the next point of
one is computed, the others are evaluated.
"""

import csv
import io
from collections.abc import Callable, Mapping

import numpy as np
import xarray as xr

from sinew.runner.errors import BadInput
from sinew.runner.evaluation.adaptive import AdaptiveRun, Session
from sinew.runner.store.table import Table
from sinew.tasks.calibrate.correlations import correlations, sites_table
from sinew.tasks.calibrate.method import Fits, calibrated, most_evaluations, specimen_fit
from sinew.tasks.calibrate.result import SEARCHES, CalibrateResult, search_group
from sinew.tasks.calibrate.settings import Settings
from sinew.tasks.fitting.bayesian import Search, informative
from sinew.tasks.fitting.fits import FitSession, residuals_of
from sinew.tasks.model import FORCE, Specimen, file_name
from sinew.tasks.model.parameters import from_unit, to_unit
from sinew.tasks.simulate import Array
from sinew.tasks.simulate.evaluation import SpecimenEvaluation
from sinew.tasks.study import streams
from sinew.tasks.study.cached import cached, commit, key
from sinew.tasks.study.checkpoint import Checkpoint, in_unit_cube, is_count
from sinew.tasks.study.files import digest, write_text
from sinew.tasks.study.same_data import data_of
from sinew.tasks.study.streams import Stream
from sinew.tasks.study.workspace import Workspace

TABLES = ("calibrate.csv", "calibrate_sites.csv")


def run(workspace: Workspace, settings: Settings) -> CalibrateResult:
    """Best parameters of every specimen, RMSE by protocol, and what the curves say of each parameter.

    Raises :class:`BadInput` when a specimen cannot be evaluated at any start.
    """
    specimens = workspace.specimens(settings.specimens, "calibrate.specimens")
    evaluations = [workspace.evaluation(specimen) for specimen in specimens]
    of_fits = key(
        CalibrateResult,
        settings.model_dump(),
        workspace.seed,
        [evaluation.table().key for evaluation in evaluations],
        [[p.name, p.minimum, p.maximum, p.reference] for p in workspace.model.parameters],
    )
    data = data_of(workspace, specimens)
    inputs = digest(of_fits, data, [[one.name, one.donor] for one in specimens])  # fits do not depend on donors
    arrays = [search_group(one.name) for one in specimens] if SEARCHES & set(settings.methods) else []
    if (known := cached(workspace, CalibrateResult, inputs, arrays, TABLES)) is not None:
        return known
    runs = [_adaptive_run(workspace, settings, of_fits, *numbered) for numbered in enumerate(evaluations)]
    found: dict[str, Fits] = {}
    for evaluation, fits in zip(evaluations, workspace.run_adaptive(runs, "calibrate"), strict=True):
        name = evaluation.specimen.name
        if fits is None:
            raise BadInput(workspace.out, f"{name}: the model fails at every start", "see `sinew status`")
        found[name] = fits
    model = workspace.model
    fitted = {one.specimen.name: specimen_fit(model, one, found[one.specimen.name], settings) for one in evaluations}
    result = CalibrateResult(
        names=list(model.names),
        units=[parameter.unit for parameter in model.parameters],
        meanings=[parameter.description for parameter in model.parameters],
        free=[parameter.name for parameter in model.free],
        bounds=[(parameter.minimum, parameter.maximum) for parameter in model.free],
        methods=list(settings.methods),
        evaluations=settings.evaluations,
        bayesian_evaluations=settings.bayesian.evaluations,
        specimens=fitted,
        inputs=inputs,
        correlations=correlations(fitted, model.free),
        data=data,
    )
    write_text(workspace.out / TABLES[0], _as_csv(result))
    write_text(workspace.out / TABLES[1], sites_table(fitted, model.free))
    searches = {search_group(name): fits.search for name, fits in found.items() if fits.search is not None}
    commit(workspace, result, {group: _points(workspace, search) for group, search in searches.items()})
    return result


def _adaptive_run(
    workspace: Workspace, settings: Settings, inputs: str, number: int, evaluation: SpecimenEvaluation
) -> AdaptiveRun:
    """The calibration of specimen ``number``, which asks for its evaluations as it goes."""
    table, _ = workspace.plan(evaluation, np.empty((0, len(workspace.model.names))))
    folder, name = workspace.out / "calibrate", file_name(evaluation.specimen.name)
    known = Checkpoint(folder / f"{name}.known.jsonl", inputs, 1, lambda numbers: is_count(numbers, len(table)))
    if not len(known):
        known.append(np.array([len(table)]))
    seeds = _seeds(workspace, evaluation, table, int(known.kept[0][0]), settings.bayesian.seeds)
    size = len(workspace.model.free)  # of a point; beside it are the size + 2 numbers of the kernel that proposed it
    file, what = folder / f"{name}.proposals.jsonl", digest(inputs, seeds.points, seeds.totals)
    checkpoint = Checkpoint(file, what, 2 * size + 2, lambda numbers: in_unit_cube(numbers[:size]))
    seed = streams.key(workspace.seed, Stream.CALIBRATION, number)
    note = _best_so_far(workspace, evaluation)

    def work(session: Session) -> Fits | None:
        return calibrated(FitSession(session, workspace.model, evaluation, note), settings, seeds, seed, checkpoint)

    return AdaptiveRun([(table, evaluation)], most_evaluations(settings, len(workspace.model.free)), work)


def _best_so_far(workspace: Workspace, evaluation: SpecimenEvaluation) -> Callable[[float], None]:
    """A function that shows those who watch the study the best total objective that a specimen has come to."""
    evaluated, best = 0, np.inf
    specimen, unit, behind = evaluation.specimen, evaluation.unit, "" if evaluation.several else " N"

    def note(total: float) -> None:
        nonlocal evaluated, best
        evaluated, best = evaluated + 1, min(best, total) if np.isfinite(total) else best
        words = f"best {best:.4g}{behind} after {evaluated:,}" if np.isfinite(best) else f"all of {evaluated:,} failed"
        value = best if np.isfinite(best) else None
        workspace.note("calibrate", specimen.name, words, value=value, unit=unit, evaluations=evaluated)

    return note


def _seeds(workspace: Workspace, evaluation: SpecimenEvaluation, table: Table, known: int, count: int) -> Search:
    """Of the first ``known`` rows of a table: the best half of ``count``, and others spread evenly over the rest."""
    size = len(workspace.model.free)
    rows = np.flatnonzero(table.status[:known] == 0)
    if rows.size == 0 or count == 0:
        return Search(np.empty((0, size)), np.empty(0), np.empty((0, 0, 0)))
    totals = table.read("objective", rows).sum(axis=1)
    chosen = informative(totals, count)
    points = to_unit(workspace.model, table.parameters(rows[chosen]))
    inside = ((points >= 0.0) & (points <= 1.0)).all(axis=1)
    forces = tuple(table.read(one.field, rows[chosen]) / one.level for one in evaluation.series())
    return Search(points[inside], totals[chosen][inside], residuals_of(evaluation, forces)[inside])


def _points(workspace: Workspace, search: Search) -> xr.Dataset:
    """The points of a Bayesian search and the total objective (N) of each."""
    return xr.Dataset(
        {
            "parameters": (("evaluation", "parameter"), from_unit(workspace.model, search.points)),
            "total": ("evaluation", search.totals, {"units": "N"}),
        },
        coords={"parameter": list(workspace.model.names)},
    )


def _as_csv(result: CalibrateResult) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    first = next(iter(result.specimens.values()))
    writer.writerow(["specimen", *result.names, "rmse_N", *first.sums()])
    for name, fit in result.specimens.items():
        numbers = [*fit.values(result.names), fit.total_N, *fit.sums().values()]
        writer.writerow([name, *(f"{value:.6g}" for value in numbers)])
    return text.getvalue()


def fitted_curves(
    workspace: Workspace, specimen: Specimen, parameters: Mapping[str, float], quantity: str = FORCE
) -> dict[str, Array]:
    """Forces ``[t]`` (N) along every measured point of each curve, for the figures. NaN if this one row fails.

    Or another ``quantity`` that is compared, in its unit.
    """
    row = np.array([[parameters[name] for name in workspace.model.names]])
    evaluation = SpecimenEvaluation(workspace.model, specimen, workspace.simulator, "all")
    table, rows = workspace.plan(evaluation, row)
    workspace.evaluate(evaluation, table, rows, f"curves of {specimen.name}", here=True, brief=True)
    of = [series for series in evaluation.series() if series.output == quantity]
    return {series.protocol: table.read(series.field, rows)[0] for series in of}
