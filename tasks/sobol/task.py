"""Sobol indices of a study: plan and evaluate a Saltelli design, analyse it, commit.

The indices are of the objectives (or outputs) in total, by protocol and by specimen, and along time of the force and of
a template's other outputs. The store keeps ``sobol`` (indices and convergence) and ``sobol_time/SPECIMEN``.
"""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr

from sinew.runner.errors import BadInput
from sinew.runner.evaluation.ensemble import failures
from sinew.runner.store.table import Table
from sinew.tasks.model import Specimen
from sinew.tasks.simulate import Array
from sinew.tasks.simulate.evaluation import SpecimenEvaluation
from sinew.tasks.simulate.growing import sizes_up_to
from sinew.tasks.simulate.plain_design import plain_design
from sinew.tasks.simulate.saltelli import Design, block_of, saltelli, scrambles_of
from sinew.tasks.simulate.studied_quantity import objectives_by_output, quantity
from sinew.tasks.sobol.by_chaos import LIMIT, ByChaos, Trained
from sinew.tasks.sobol.estimate import Estimator, estimator
from sinew.tasks.sobol.method import Intervals, column
from sinew.tasks.sobol.result import (
    KEYS,
    Analysis,
    Failures,
    Indices,
    OfOutput,
    OfProtocol,
    OfSpecimen,
    SobolResult,
    Surrogate,
)
from sinew.tasks.sobol.rows import sobol_rows
from sinew.tasks.sobol.settings import Settings
from sinew.tasks.sobol.work import base_of
from sinew.tasks.study.cached import cached, commit, key
from sinew.tasks.study.files import digest
from sinew.tasks.study.workspace import Workspace

log = logging.getLogger("sinew")
BYTES_AT_A_TIME = 2**26  # of curves, when indices along time are computed


@dataclass(frozen=True, eq=False)
class Evaluated:
    """A specimen's evaluations: its table in the store and the row ``at`` ``[n]`` of each row of the design."""

    evaluation: SpecimenEvaluation
    table: Table
    at: Array

    @property
    def specimen(self) -> Specimen:
        return self.evaluation.specimen


def run(workspace: Workspace, settings: Settings, *, extend: bool = False) -> SobolResult:
    """Sobol indices of the study; ``extend`` doubles the base samples of the last result."""
    if settings.method == "surrogate":
        return _by_surrogate(workspace, settings)
    previous = _extended(workspace) if extend else None
    base = base_of(settings, settings.count(workspace.model)) if previous is None else 2 * previous.base_samples
    if not extend and settings.points is not None:
        _say_size(workspace, settings, base)
    scrambles = scrambles_of(base, settings.scrambles) if previous is None else previous.scrambles
    design = saltelli(workspace.model, base, settings.second_order, workspace.seed, scrambles, settings.inputs)
    drawn = digest(design.rows)
    specimens = workspace.specimens(settings.specimens, "sobol.specimens")
    log.info("sobol", extra={"rows": len(design.rows), "base_samples": base, "specimens": len(specimens)})
    planned = [Evaluated(one, *workspace.plan(one, design.rows)) for one in map(workspace.evaluation, specimens)]
    features = design.features()
    design = replace(design, rows=design.rows[:0])  # they are in the store now; a large design need not stay in memory
    for one in planned:
        workspace.evaluate(one.evaluation, one.table, one.at, f"sobol {one.specimen.name}")
    inputs, known = _known(workspace, settings, drawn, planned)
    if known is not None:
        return known
    intervals = Intervals(settings.resamples, settings.confidence, workspace.seed)
    return _analysed(workspace, settings, estimator(design, features, _ran(planned), intervals), planned, inputs)


def _by_surrogate(workspace: Workspace, settings: Settings) -> SobolResult:
    """Indices of polynomials, trained with more and more rows until their intervals are as narrow as asked."""
    if not workspace.retry_failed and (known := _finished(workspace, settings)) is not None:
        return known
    specimens = workspace.specimens(settings.specimens, "sobol.specimens")
    evaluations = [workspace.evaluation(one) for one in specimens]
    intervals = Intervals(settings.resamples, settings.confidence, workspace.seed)
    studied, _ = quantity(evaluations[0], settings.output)
    looked: list[int] = []
    fits: dict[tuple[bytes, bytes], Trained] = {}
    places: list[Array] = [np.empty(0, dtype=int) for _ in evaluations]
    for size in sizes_up_to(settings.runs):
        design, share = plain_design(workspace.model, size, workspace.seed, settings.scrambles, settings.inputs)
        new = [workspace.plan(one, design.rows[len(places[0]) :]) for one in evaluations]
        places = [np.concatenate([before, at]) for before, (_, at) in zip(places, new, strict=True)]
        planned = [Evaluated(*each) for each in zip(evaluations, (table for table, _ in new), places, strict=True)]
        for one in planned:
            workspace.evaluate(one.evaluation, one.table, one.at, f"sobol {one.specimen.name}")
        looked.append(size)
        ok = _ran(planned)
        if (~ok).mean() > LIMIT:
            raise BadInput(
                f"{workspace.study.path}: sobol.method", f"{(~ok).sum()} of {size} rows failed",
                f"at most {100 * LIMIT:g} % for a surrogate: narrower ranges, or method: saltelli",
            )  # fmt: skip
        estimate = ByChaos(design, share, ok, intervals, settings.second_order, tuple(looked), fits=fits)
        outcomes = objectives_by_output(specimens, [one.table.read(studied, one.at) for one in planned])
        found = {name: estimate.analysis(values) for name, values in outcomes.items()}
        widest = max(_widest(each) for each in found.values())
        words = f"{size} runs, intervals at most ± {widest:.3f}"
        workspace.note("sobol", "surrogate", words, value=widest, runs=size)
        workspace.say(f"sobol: {words} ({settings.error:g} asked)")
        if widest <= settings.error:
            break
    inputs, _ = _known(workspace, settings, digest(design.rows), planned)
    left = {name: estimate.unexplained(values) for name, values in outcomes.items()}
    surrogate = Surrogate(settings.error, widest <= settings.error, left)
    return _analysed(workspace, settings, estimate, planned, inputs, surrogate)


def _widest(found: Analysis) -> float:
    """The largest half-width of an interval; 0 where nothing varies."""
    every = [half.ravel() for half in (found.S1_conf, found.ST_conf, found.S2_conf) if half is not None]
    return float(np.nanmax(np.concatenate(every), initial=0.0))


def _finished(workspace: Workspace, settings: Settings) -> SobolResult | None:
    """The last result, if it is of the same study and all that it was made of is there."""
    try:
        last = sobol_rows(workspace)
    except BadInput:
        return None
    planned = [
        Evaluated(workspace.evaluation(one), *each) for one, each in zip(last.specimens, last.evaluated, strict=True)
    ]
    return _known(workspace, settings, digest(last.design.rows), planned)[1]


def _ran(planned: Sequence[Evaluated]) -> Array:
    """Rows ``[n]`` of the design that no specimen failed."""
    return np.asarray((np.stack([one.table.status[one.at] for one in planned]) == 0).all(axis=0))


def _known(
    workspace: Workspace, settings: Settings, drawn: str, planned: Sequence[Evaluated]
) -> tuple[str, SobolResult | None]:
    """The key of a result, and the result itself if it is there; ``drawn``: digest of the design's rows."""
    bounds = [[parameter.minimum, parameter.maximum] for parameter in workspace.model.free]
    statuses = [one.table.status[one.at] for one in planned]
    tables = [[one.specimen.name, one.table.key] for one in planned]
    inputs = key(SobolResult, settings.model_dump(), workspace.seed, drawn, bounds, tables, *statuses)
    return inputs, cached(workspace, SobolResult, inputs, ["sobol", *map(_course_name, planned)])


def _extended(workspace: Workspace) -> SobolResult:
    """The result that is extended; its sequences are kept.

    Raises :class:`BadInput` for a design that this program does not draw.
    """
    previous = SobolResult.read(workspace.out)
    assert previous is not None, "checked before the store was opened"
    if not previous.has_design:
        problem = f"{previous.base_samples:,} base samples of {previous.scrambles:,} scrambles"
        raise BadInput(SobolResult.path(workspace.out), problem, "what `sinew sobol` writes; run it again")
    return previous


def _say_size(workspace: Workspace, settings: Settings, base: int) -> None:
    count = settings.count(workspace.model)
    rows = base * block_of(count, settings.second_order)
    workspace.say(
        f"sobol: {settings.points:,} points asked; the next power of two is {base:,} base samples, "
        f"{rows:,} rows for {count} {'groups' if settings.groups else 'parameters'}"
    )


def _analysed(
    workspace: Workspace,
    settings: Settings,
    estimate: Estimator | ByChaos,
    planned: Sequence[Evaluated],
    inputs: str,
    surrogate: Surrogate | None = None,
) -> SobolResult:
    """Analyse finished rows and commit the result."""
    design, ok, whole = estimate.design, estimate.ok, estimate.whole
    failed = int((~ok).sum())
    if whole.sum() < 2:
        raise BadInput(
            workspace.out, f"{failed} of {ok.size} rows failed and no two base samples are whole",
            "a model that can be evaluated within its bounds (see `sinew status`)",
        )  # fmt: skip
    specimens = tuple(one.specimen for one in planned)
    studied, words = quantity(planned[0].evaluation, settings.output)
    objectives = [one.table.read(studied, one.at) for one in planned]
    outcomes = objectives_by_output(specimens, objectives)
    found = {name: estimate.analysis(values) for name, values in outcomes.items()}
    total = found.pop("total")
    outputs, by_output = _of_outputs(workspace, estimate, planned)
    result = SobolResult(
        names=list(design.names),
        bounds=[[parameter.minimum, parameter.maximum] for parameter in workspace.model.free],
        seed=workspace.seed,
        **{name: getattr(total, name) for name in (*KEYS, "S2", "S2_conf")},
        rows=ok.size,
        failed=failed,
        base_samples=design.base_samples,
        scrambles=design.scrambles,
        base_samples_used=int(whole.sum()),
        points_asked=settings.points,
        confidence=settings.confidence,
        objective=words + (", mean of the specimens" if len(specimens) > 1 else ""),
        field=studied,
        evaluations=ok.size * len(specimens),
        protocols={name: OfProtocol(**vars(each), rows=ok.size, failed=failed, base_samples=design.base_samples)
                   for name, each in found.items()},
        specimens=_of_specimens(estimate, planned, objectives),
        outputs=outputs or None,
        groups={title: list(members) for title, members in settings.groups.items()} or None,
        distributions={name: vars(one) for name, one in settings.inputs.distributions.items()} or None,
        surrogate=surrogate,
        failures=_failures(estimate, planned, outcomes["total"]),
        convergence=estimate.convergence(outcomes["total"]),
        tables={one.specimen.name: one.table.name for one in planned},
        inputs=inputs,
    )  # fmt: skip

    def along_time(one: Evaluated) -> None:
        workspace.store.write_result(_course_name(one), _along_time(estimate, one).assign_attrs(inputs=inputs))

    workspace.each("sobol along time", "analyses", along_time, {one.specimen.name: one for one in planned})
    commit(workspace, result, {"sobol": _arrays(design, result, {"total": total, **found, **by_output})})
    return result


def _course_name(one: Evaluated) -> str:
    """What the store calls a specimen's indices along time."""
    return f"sobol_time/{one.table.name}"


def _of_outputs(
    workspace: Workspace, estimate: Estimator | ByChaos, planned: Sequence[Evaluated]
) -> tuple[dict[str, OfOutput], dict[str, Indices]]:
    """Indices of each of a template's outputs, and the same by the name that the store gives them."""
    outputs: dict[str, OfOutput] = {}
    named: dict[str, Indices] = {}
    specimens = tuple(one.specimen for one in planned)
    can = workspace.simulator.capabilities
    for output in can.outputs:
        summaries = [one.table.read(f"summary_{output.name}", one.at) for one in planned]
        each = {
            name: column(estimate.of(values[:, np.newaxis]), 0)
            for name, values in objectives_by_output(specimens, summaries).items()
        }
        named |= {f"{output.name} {name}": found for name, found in each.items()}
        total = vars(each.pop("total"))
        is_force = output.name == can.force
        outputs[output.name] = OfOutput(output.summary, output.unit, is_force, **total, protocols=each)
    return outputs, named


def _of_specimens(
    estimate: Estimator | ByChaos, planned: Sequence[Evaluated], objectives: Sequence[Array]
) -> dict[str, OfSpecimen]:
    specimens = {}
    for one, values in zip(planned, objectives, strict=True):
        columns = np.column_stack([values.sum(axis=1), values])
        found = estimate.of(columns)
        specimens[one.specimen.name] = OfSpecimen(
            **vars(column(found, 0)),
            failed=failures(one.table, one.at),
            protocols={curve.name: column(found, 1 + i) for i, curve in enumerate(one.specimen.curves)},
        )
    return specimens


def _failures(estimate: Estimator | ByChaos, planned: Sequence[Evaluated], total: Array) -> Failures:
    return Failures(
        rule=estimate.rule,
        rows=int((~estimate.ok).sum()),
        base_samples_left_out=estimate.design.base_samples - int(estimate.whole.sum()),
        by_status={one.specimen.name: failures(one.table, one.at) for one in planned},
        **estimate.if_failed_had(total),
    )


def _arrays(design: Design, result: SobolResult, analyses: Mapping[str, Indices]) -> xr.Dataset:
    """Indices of all outputs ``[output, parameter]`` and the convergence, for the store."""
    parts, settled = list(analyses.values()), result.convergence
    return xr.Dataset(
        {
            **{name: (("output", "parameter"), np.stack([getattr(part, name) for part in parts])) for name in KEYS},
            **{f"convergence_{name}": (("base_samples", "parameter"), getattr(settled, name)) for name in KEYS},
        },
        {
            "parameter": np.array(design.names, dtype=str),
            "output": list(analyses),
            "base_samples": settled.base_samples,
        },
        {
            "rows": design.base_samples * design.block,
            "method": "polynomial chaos" if design.plain else "Saltelli 2010 by SALib",
            "failed_rows": result.failures.rule,
        },
    )


def _along_time(estimate: Estimator | ByChaos, one: Evaluated) -> xr.Dataset:
    """Indices of the force, and of other outputs, at each kept point, a few points at a time: memory stays flat."""
    variables = {}
    coordinates: dict[str, object] = {"parameter": np.array(estimate.design.names, dtype=str)}
    dataset = one.table.dataset()
    per_pass = max(1, BYTES_AT_A_TIME // (8 * max(1, one.at.size)))
    for curve in one.specimen.curves:
        dim = f"time_{curve.name}"
        points = dataset.sizes[dim]
        for field, course in one.evaluation.courses(curve.name).items():
            parts = []
            for start in range(0, points, per_pass):
                columns = one.table.read(field, one.at, slice(start, start + per_pass))
                parts.append(estimate.of(columns))
            of = curve.name if field == f"force_{curve.name}" else f"{course}_{curve.name}"
            for name in KEYS:
                both = np.concatenate([part[name] for part in parts], axis=1)
                variables[f"{name}_{of}"] = (("parameter", dim), both)
        for name in (dim, f"displacement_{curve.name}", f"measured_{curve.name}"):
            if name in dataset:
                coordinates[name] = (dim, dataset[name].to_numpy(), {"units": dataset[name].attrs["units"]})
    return xr.Dataset(variables, coordinates, {"specimen": one.specimen.name})
