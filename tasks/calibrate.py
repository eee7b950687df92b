"""Calibration of each specimen: the parameters that bring the model closest to its measured curves.

Stores: rows of every evaluation, like all tasks. Leaves ``calibrate.json`` and ``calibrate.csv`` (a line for each
specimen, as in table 2 of Pekedis 2025). Fits are least squares from several starts, see :mod:`tasks.least_squares`.
"""

import csv
import io
from collections.abc import Generator
from dataclasses import dataclass
from typing import Any

import numpy as np

from runner.cluster import Local
from tasks.evaluate import SpecimenEvaluation, kept_points
from tasks.least_squares import Fit, Seen, Weighing, least_squares
from tasks.model import Specimen
from tasks.noise import noise_of
from tasks.problems import BadInput
from tasks.simulate import Array
from tasks.workspace import Workspace, digest, read_result, write_json, write_text

ON_BOUND = 1e-3
DETERMINED = 0.25  # of a parameter's range; a uniform distribution over it has a standard deviation of 0.29
CONFOUNDED = 0.95


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
    found = {}
    for number, evaluation in enumerate(evaluations):
        fits = _fits(workspace, evaluation, number)
        if not fits:
            raise BadInput(
                workspace.out, f"{evaluation.specimen.name}: the model fails at every start", "see `sinew status`"
            )
        found[evaluation.specimen.name] = _told(workspace, evaluation, fits)
    result = {
        "names": list(workspace.model.names),
        "units": [parameter.unit for parameter in workspace.model.parameters],
        "free": [parameter.name for parameter in workspace.model.free],
        "starts": settings.starts,
        "evaluations": settings.evaluations,
        "specimens": found,
        "inputs": inputs,
    }
    write_text(workspace.out / "calibrate.csv", _as_csv(result))
    write_json(workspace.out / "calibrate.json", result)
    return result


def _fits(workspace: Workspace, evaluation: SpecimenEvaluation, number: int) -> list[Fit]:
    """Fits from all starts, best first. All starts of a specimen advance together."""
    settings = workspace.study.calibrate
    size = len(workspace.model.free)
    rng = np.random.default_rng([workspace.seed, 4, number])
    starts = np.concatenate([np.full((1, size), 0.5), rng.random((settings.starts - 1, size))])
    weighing = weighing_of(evaluation)
    budget = settings.evaluations // settings.starts
    fits = together(workspace, evaluation, [least_squares(start, weighing, budget) for start in starts])
    return sorted((fit for fit in fits if fit is not None), key=lambda fit: float(fit.objective.sum()))


def weighing_of(evaluation: SpecimenEvaluation) -> Weighing:
    """How many measured points each kept point of each curve stands for."""
    counts, shares = [], []
    for curve in evaluation.specimen.curves:
        keep = kept_points(curve.protocol, evaluation.points_per_curve)
        edges = np.concatenate([[0], (keep[1:] + keep[:-1] + 1) // 2, [curve.force_N.size]])
        counts.append(curve.force_N.size)
        shares.append(np.diff(edges).astype(float))
    return Weighing(tuple(counts), tuple(shares))


@dataclass
class _Running:
    """A fit under way and the points that it waits for."""

    steps: Generator[Array, Seen, Fit | None]
    asked: Array


def together(
    workspace: Workspace, evaluation: SpecimenEvaluation, fits: list[Generator[Array, Seen, Fit | None]]
) -> list[Fit | None]:
    """Drive fits of one specimen to their ends: what they ask for is evaluated in common rounds, through the store."""
    ended: dict[int, Fit | None] = {}
    running = {number: _Running(steps, next(steps)) for number, steps in enumerate(fits)}
    while running:
        points = np.concatenate([fit.asked for fit in running.values()])
        seen = _seen(workspace, evaluation, points)
        first = 0
        for number, fit in list(running.items()):
            rows = slice(first, first + len(fit.asked))
            first += len(fit.asked)
            try:
                fit.asked = fit.steps.send(Seen(seen.objective[rows], tuple(force[rows] for force in seen.forces)))
            except StopIteration as end:
                ended[number] = end.value
                del running[number]
    return [ended[number] for number in sorted(ended)]


def _seen(workspace: Workspace, evaluation: SpecimenEvaluation, points: Array) -> Seen:
    table, rows = workspace.plan(evaluation, from_unit(workspace, points))
    here = isinstance(workspace.cluster, Local) and workspace.simulator.batch_multiple > 1
    workspace.evaluate(evaluation, table, rows, f"calibrate {evaluation.specimen.name}", here=here, brief=True)
    names = [curve.name for curve in evaluation.specimen.curves]
    return Seen(table.read("objective", rows), tuple(table.read(f"force_{name}", rows) for name in names))


def from_unit(workspace: Workspace, points: Array) -> Array:
    """Parameter sets ``[n, all]`` from points ``[n, free]`` of the unit cube."""
    free = workspace.model.free
    low, high = (np.array([getattr(parameter, side) for parameter in free]) for side in ("minimum", "maximum"))
    return workspace.model.full(tuple(parameter.name for parameter in free), low + (high - low) * points)


def _told(workspace: Workspace, evaluation: SpecimenEvaluation, fits: list[Fit]) -> dict[str, Any]:
    best = fits[0]
    free = [parameter.name for parameter in workspace.model.free]
    values = from_unit(workspace, best.at[np.newaxis])[0]
    noise = [noise_of(curve) for curve in evaluation.specimen.curves]
    sd, correlation = uncertainty(best, weighing_of(evaluation), [each.inflation for each in noise])
    floor = float(sum(each.sd_N for each in noise))
    pairs = [
        {"parameters": [free[i], free[j]], "correlation": correlation[i, j]}
        for i in range(len(free))
        for j in range(i)
        if sd[i] < DETERMINED and sd[j] < DETERMINED and abs(correlation[i, j]) > CONFOUNDED
    ]
    specimen = evaluation.specimen
    return {
        "parameters": dict(zip(workspace.model.names, values, strict=True)),
        "rmse_N": dict(zip([curve.name for curve in specimen.curves], best.objective, strict=True)),
        "total_N": float(best.objective.sum()),
        "noise_N": floor,
        "above_noise": float(best.objective.sum()) / floor - 1.0 if floor > 0 else None,
        "on_bound": [n for n, at in zip(free, best.at, strict=True) if min(at, 1 - at) < ON_BOUND],
        "sd_of_range": dict(zip(free, sd, strict=True)),
        "determined": [name for name, value in zip(free, sd, strict=True) if value < DETERMINED],
        "confounded": pairs,
        "converged": best.converged,
        "starts": [{"total_N": float(fit.objective.sum()), "converged": fit.converged} for fit in fits],
        "traces": [[list(point) for point in fit.trace] for fit in fits],
    }


def uncertainty(fit: Fit, weighing: Weighing, inflation: list[float]) -> tuple[Array, Array]:
    """Standard deviations ``[d]``, as parts of each range, and correlations ``[d, d]`` from the curvature at the fit.

    A curve's residuals are taken for noise of the size of their RMSE, of which ``inflation`` points weigh as much as
    one (correlation in time; not a number: taken for 1), and each parameter as uniform over its range before the data
    were seen (precision 12). Where the model itself is wrong, the residuals are no noise and all of this is too bold.
    """
    precision = 12.0 * np.eye(fit.at.size)
    for jacobian, share, rmse, factor in zip(fit.jacobians, weighing.shares, fit.objective, inflation, strict=True):
        variance = max(rmse, 1e-12) ** 2 * (factor if np.isfinite(factor) else 1.0)
        precision += (jacobian * share) @ jacobian.T / variance
    covariance = np.linalg.inv(precision)
    sd = np.sqrt(np.diag(covariance))
    return sd, covariance / np.outer(sd, sd)


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
