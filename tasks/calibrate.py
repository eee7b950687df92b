"""Calibration of each specimen: the parameters that bring the model closest to its measured curves.

Stores: rows of every evaluation, like all tasks; ``calibrate/SPECIMEN``, the points of the Bayesian search. Leaves
``calibrate.json``, ``calibrate.csv`` (a line for each specimen, as in table 2 of Pekedis 2025) and
``calibrate_sites.csv`` (mean and standard deviation by site). All specimens share the cluster: while one's next point
is being thought of, it evaluates the others'.
"""

import csv
import io
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from runner.ensemble import Desk, Talk
from tasks.bayesian import Search, informative
from tasks.correlations import correlations, sites_table
from tasks.evaluate import SpecimenEvaluation
from tasks.fits import (
    Found,
    Place,
    best_apart,
    from_unit,
    jacobians_at,
    polished,
    residuals_of,
    search,
    to_unit,
    uncertainty,
    weighing_of,
)
from tasks.ledger import Ledger
from tasks.model import Specimen, file_name
from tasks.noise import Noise, noise_of
from tasks.problems import BadInput
from tasks.simulate import Array
from tasks.study import CalibrateSettings
from tasks.workspace import Workspace, digest, read_result, write_json, write_text

ON_BOUND = 1e-3
DETERMINED = 0.25  # of a parameter's range; a uniform distribution over it has a standard deviation of 0.29
CONFOUNDED = 0.95
FOLLOWED = 0.8  # a fit that leaves less than this part of the noise shows that its estimate was wrong


def calibrate(workspace: Workspace) -> dict[str, Any]:
    """Best parameters of every specimen, RMSE by protocol, and what the curves say of each parameter.

    Returns ``calibrate.json``. Raises :class:`BadInput` when a specimen cannot be evaluated at any start.
    """
    settings = workspace.study.calibrate
    specimens = workspace.specimens(settings.specimens, "calibrate.specimens")
    evaluations = [workspace.evaluation(specimen) for specimen in specimens]
    inputs = digest(settings.model_dump(), workspace.seed, [evaluation.table().key for evaluation in evaluations],
                    [[p.name, p.minimum, p.maximum, p.reference] for p in workspace.model.parameters])  # fmt: skip
    previous = read_result(workspace.out / "calibrate.json")
    if previous is not None and previous.get("inputs") == inputs:
        return previous
    talks = []
    for number, evaluation in enumerate(evaluations):
        table, _ = workspace.plan(evaluation, np.empty((0, len(workspace.model.names))))
        folder = workspace.out / "calibrate"
        name = file_name(evaluation.specimen.name)
        known = Ledger(folder / f"{name}.known.jsonl", inputs)
        if not len(known):
            known.append(np.array([len(table)]))
        seeds = _seeds(workspace, evaluation, table, int(known.kept[0][0]), settings.bayesian.seeds)
        ledger = Ledger(folder / f"{name}.proposals.jsonl", digest(inputs, seeds.points, seeds.totals))
        seed = (workspace.seed, 4, number)
        work = _methods(workspace, evaluation, settings, seeds, seed, ledger)
        talks.append(Talk([(table, evaluation)], _most(settings, len(workspace.model.free)), work))
    done = workspace.converse(talks, "calibrate")
    found = {}
    for evaluation, fitted in zip(evaluations, done, strict=True):
        if fitted is None:
            raise BadInput(
                workspace.out, f"{evaluation.specimen.name}: the model fails at every start", "see `sinew status`"
            )
        found[evaluation.specimen.name] = _told(workspace, evaluation, fitted)
        _keep_points(workspace, evaluation, fitted)
    result = {
        "names": list(workspace.model.names),
        "units": [parameter.unit for parameter in workspace.model.parameters],
        "meanings": [parameter.description for parameter in workspace.model.parameters],
        "free": [parameter.name for parameter in workspace.model.free],
        "bounds": [[parameter.minimum, parameter.maximum] for parameter in workspace.model.free],
        "methods": list(settings.methods),
        "evaluations": settings.evaluations,
        "bayesian_evaluations": settings.bayesian.evaluations,
        "specimens": found,
        "inputs": inputs,
    }
    result["correlations"] = correlations(found, workspace.model.free)
    write_text(workspace.out / "calibrate.csv", _as_csv(result))
    write_text(workspace.out / "calibrate_sites.csv", sites_table(found, workspace.model.free))
    write_json(workspace.out / "calibrate.json", result)
    return result


@dataclass(frozen=True)
class _Fitted:
    methods: dict[str, Found]
    seen: Search | None
    jacobians: tuple[Array, ...]

    @property
    def best(self) -> str:
        return min(self.methods, key=lambda name: self.methods[name].total)


def _most(settings: CalibrateSettings, size: int) -> int:
    """Evaluations that a specimen takes at the most."""
    both = {"bayesian", "hybrid"} & set(settings.methods)
    rows = settings.bayesian.evaluations if both else 0
    rows += max(0, settings.evaluations - settings.bayesian.evaluations) if "hybrid" in settings.methods else 0
    rows += settings.evaluations if "least_squares" in settings.methods else 0
    return rows + size + 1


def _methods(
    workspace: Workspace,
    evaluation: SpecimenEvaluation,
    settings: CalibrateSettings,
    seeds: Search,
    seed: tuple[int, ...],
    ledger: Ledger,
) -> Callable[[Desk], _Fitted | None]:
    def work(desk: Desk) -> _Fitted | None:
        place = Place(desk, workspace.model, evaluation, _best_so_far(workspace, evaluation.specimen))
        found: dict[str, Found | None] = {}
        seen = None
        if {"bayesian", "hybrid"} & set(settings.methods):
            bo = settings.bayesian
            budget = min(bo.evaluations, settings.evaluations)
            seen, found["bayesian"] = search(
                place, budget=budget, initial=bo.initial, pending=bo.pending, seeds=seeds, seed=seed, ledger=ledger
            )
        if "hybrid" in settings.methods and seen is not None:
            left = settings.evaluations - len(seen.totals)
            found["hybrid"] = polished(place, best_apart(seen), left, settings.starts, before=found["bayesian"])
        if "least_squares" in settings.methods:
            rng = np.random.default_rng((*seed, 1))
            starts = [np.full(place.size, 0.5), *rng.random((settings.starts - 1, place.size))]
            found["least_squares"] = polished(place, starts, settings.evaluations, settings.starts)
        methods: dict[str, Found] = {n: one for n, one in found.items() if one is not None and n in settings.methods}
        if not methods:
            return None
        best = min(methods.values(), key=lambda one: one.total)
        return _Fitted(methods, seen, jacobians_at(place, best.at))

    return work


def _best_so_far(workspace: Workspace, specimen: Specimen) -> Callable[[float], None]:
    """Tells those who look on of the best total (N) that a specimen has come to."""
    heard, best = 0, np.inf

    def hear(total: float) -> None:
        nonlocal heard, best
        heard, best = heard + 1, min(best, total) if np.isfinite(total) else best
        words = f"best {best:.4g} N after {heard:,}" if np.isfinite(best) else f"all of {heard:,} failed"
        value = best if np.isfinite(best) else None
        workspace.note("calibrate", specimen.name, words, value=value, unit="N", evaluations=heard)

    return hear


def _seeds(workspace: Workspace, evaluation: SpecimenEvaluation, table: Any, known: int, count: int) -> Search:
    """Of the first ``known`` rows of a table: the best half of ``count``, and others spread evenly over the rest."""
    size = len(workspace.model.free)
    rows = np.flatnonzero(table.status[:known] == 0)
    if rows.size == 0 or count == 0:
        return Search(np.empty((0, size)), np.empty(0), np.empty((0, 0, 0)))
    totals = table.read("objective", rows).sum(axis=1)
    chosen = informative(totals, count)
    points = to_unit(workspace.model, table.parameters(rows[chosen]))
    inside = ((points >= 0.0) & (points <= 1.0)).all(axis=1)
    forces = tuple(table.read(f"force_{curve.name}", rows[chosen]) for curve in evaluation.specimen.curves)
    return Search(points[inside], totals[chosen][inside], residuals_of(evaluation, forces)[inside])


def _told(workspace: Workspace, evaluation: SpecimenEvaluation, fitted: _Fitted) -> dict[str, Any]:
    best = fitted.methods[fitted.best]
    free = [parameter.name for parameter in workspace.model.free]
    values = from_unit(workspace.model, best.at[np.newaxis])[0]
    noise = [noise_of(curve, evaluation.specimen.curves) for curve in evaluation.specimen.curves]
    inflation = [each.inflation for each in noise]
    sd, correlation = uncertainty(fitted.jacobians, best.objective, weighing_of(evaluation), inflation)
    floor = _floor(noise, best.total)
    pairs = [
        {"parameters": [free[i], free[j]], "correlation": correlation[i, j]}
        for i in range(len(free))
        for j in range(i)
        if sd[i] < DETERMINED and sd[j] < DETERMINED and abs(correlation[i, j]) > CONFOUNDED
    ]
    specimen = evaluation.specimen
    settings = workspace.study.calibrate
    equal = sorted({settings.bayesian.evaluations, settings.evaluations})
    return {
        "site": specimen.site,
        "donor": specimen.donor,
        "parameters": dict(zip(workspace.model.names, values, strict=True)),
        "rmse_N": dict(zip([curve.name for curve in specimen.curves], best.objective, strict=True)),
        "total_N": best.total,
        "noise_N": floor,
        "above_noise": _above(best.total, floor),
        "method": fitted.best,
        "on_bound": [n for n, at in zip(free, best.at, strict=True) if min(at, 1 - at) < ON_BOUND],
        "sd_of_range": dict(zip(free, sd, strict=True)),
        "determined": [name for name, value in zip(free, sd, strict=True) if value < DETERMINED],
        "confounded": pairs,
        "methods": {
            name: {
                "total_N": one.total,
                "above_noise": _above(one.total, floor),
                "evaluations": one.trace[-1][0],
                "converged": one.converged,
                "starts": one.starts,
                "above_noise_after": {str(count): _above(one.total_after(count), floor) for count in equal},
                "trace": [list(point) for point in one.trace],
            }
            for name, one in fitted.methods.items()
        },
    }


def often_on_bound(result: dict[str, Any]) -> str:
    """A sentence on the parameters that ended on a bound in half of the specimens or more, empty where none did.

    Where the curves do not determine a parameter, it says nothing that it ended there.
    """
    specimens = result["specimens"].values()
    counts = Counter(name for told in specimens for name in told["on_bound"] if name in told["determined"])
    names = [name for name in result["free"] if 2 * counts[name] >= len(specimens)]
    if not names:
        return ""
    return (
        f"On an end of their range in half of the specimens or more: {', '.join(names)}. Widen it (model.parameters "
        "in the study file) where it is a guess; where it is certain, the model lacks something."
    )


def _floor(noise: Sequence[Noise], total: float) -> float | None:
    """The objective (N) that noise alone would leave; None where the curves do not tell their noise."""
    floor = float(sum(each.sd_N for each in noise))
    return floor if total >= FOLLOWED * floor else None  # what a model follows is no noise; not so where it is NaN


def _above(total: float | None, floor: float | None) -> float | None:
    """How far above the noise of the curves, as a part of it."""
    return total / floor - 1.0 if total is not None and floor else None


def _keep_points(workspace: Workspace, evaluation: SpecimenEvaluation, fitted: _Fitted) -> None:
    if fitted.seen is not None:
        dataset = xr.Dataset(
            {
                "parameters": (("evaluation", "parameter"), from_unit(workspace.model, fitted.seen.points)),
                "total": ("evaluation", fitted.seen.totals, {"units": "N"}),
            },
            coords={"parameter": list(workspace.model.names)},
        )
        workspace.store.write_result(f"calibrate/{file_name(evaluation.specimen.name)}", dataset)


def _as_csv(result: dict[str, Any]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["specimen", *result["names"], "rmse_N"])
    for name, told in result["specimens"].items():
        values = [f"{told['parameters'][parameter]:.6g}" for parameter in result["names"]]
        writer.writerow([name, *values, f"{told['total_N']:.6g}"])
    return text.getvalue()


def fitted_curves(workspace: Workspace, specimen: Specimen, parameters: dict[str, float]) -> dict[str, Array]:
    """Forces ``[t]`` (N) along every measured point of each curve, for the figures. NaN if this one row fails."""
    row = np.array([[parameters[name] for name in workspace.model.names]])
    evaluation = SpecimenEvaluation(workspace.model, specimen, workspace.simulator, "all")
    table, rows = workspace.plan(evaluation, row)
    workspace.evaluate(evaluation, table, rows, f"curves of {specimen.name}", here=True, brief=True)
    return {curve.name: table.read(f"force_{curve.name}", rows)[0] for curve in specimen.curves}
