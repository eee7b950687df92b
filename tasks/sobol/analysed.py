"""From finished rows of a Sobol study to its committed result."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import xarray as xr

from sinew.runner.errors import BadInput
from sinew.runner.evaluation.ensemble import failures
from sinew.tasks.model import Curve
from sinew.tasks.simulate import Array
from sinew.tasks.simulate.saltelli import Design
from sinew.tasks.simulate.studied_quantity import objectives_by_output, quantity
from sinew.tasks.sobol.by_chaos import ByChaos
from sinew.tasks.sobol.estimate import Estimator
from sinew.tasks.sobol.evaluated import Evaluated
from sinew.tasks.sobol.method import column
from sinew.tasks.sobol.of_fields import kept, missing, of_fields, stored_as
from sinew.tasks.sobol.result import (
    KEYS,
    SHAPLEY,
    Failures,
    Indices,
    OfOutput,
    OfProtocol,
    OfSpecimen,
    SobolResult,
    Surrogate,
)
from sinew.tasks.sobol.settings import Settings
from sinew.tasks.study.cached import cached, commit, key
from sinew.tasks.study.workspace import Workspace

BYTES_AT_A_TIME = 2**26  # of curves, when indices along time are computed


def ran(planned: Sequence[Evaluated]) -> Array:
    """Rows ``[n]`` of the design that no specimen failed."""
    return np.asarray((np.stack([one.table.status[one.at] for one in planned]) == 0).all(axis=0))


def known(
    workspace: Workspace,
    settings: Settings,
    drawn: str,
    planned: Sequence[Evaluated],
    versions: Sequence[tuple[str, int]] = (),
) -> tuple[str, SobolResult | None]:
    """The key of a result, and the result itself if it is there; ``drawn``: digest of the design's rows.

    ``versions``: of each cheaper version its name, and how many rows it has for each of the model's.
    """
    bounds = [[parameter.minimum, parameter.maximum] for parameter in workspace.model.free]
    every = [*planned, *(other for one in planned for other in one.cheaper)]
    statuses = [one.table.status[one.at] for one in every]
    tables = [[one.specimen.name, one.table.key] for one in every]
    more = [list(versions)] if versions else []
    inputs = key(SobolResult, settings.model_dump(), workspace.seed, drawn, bounds, tables, *statuses, *more)
    last = SobolResult.read(workspace.out)
    if last is None or _lacks_fields(last, planned):
        return inputs, None
    fields = [stored_as(*each) for each in last.field_courses().values()]
    return inputs, cached(workspace, SobolResult, inputs, ["sobol", *map(_course_name, planned), *fields])


def _lacks_fields(last: SobolResult, planned: Sequence[Evaluated]) -> bool:
    """Whether there are kept fields of which the result has no indices."""
    ok, has = ran(planned), last.fields or {}
    return any(
        missing(one, curve, ok)
        for one in planned
        for curve in one.curves
        if curve.name not in has.get(one.specimen.name, [])
    )


def analysed(
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
    objectives = [one.read(studied) for one in planned]
    outcomes = objectives_by_output(specimens, objectives)
    found = {name: estimate.analysis(values) for name, values in outcomes.items()}
    total = found.pop("total")
    outputs, by_output = _of_outputs(workspace, estimate, planned)
    result = SobolResult(
        names=list(design.names),
        bounds=[[parameter.minimum, parameter.maximum] for parameter in workspace.model.free],
        seed=workspace.seed,
        **{name: getattr(total, name) for name in (*KEYS, *SHAPLEY, "S2", "S2_conf")},
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
        correlations=settings.correlations or None,
        surrogate=surrogate,
        failures=_failures(estimate, planned, outcomes["total"]),
        convergence=estimate.convergence(outcomes["total"]),
        tables={one.specimen.name: one.table.name for one in planned},
        inputs=inputs,
    )  # fmt: skip

    def along_time(one: Evaluated) -> None:
        workspace.store.write_result(_course_name(one), _along_time(estimate, one).assign_attrs(inputs=inputs))

    workspace.each("sobol along time", "analyses", along_time, {one.specimen.name: one for one in planned})
    result = replace(result, fields=_of_fields(workspace, estimate, planned, inputs) or None)
    commit(workspace, result, {"sobol": _arrays(design, result, {"total": total, **found, **by_output})})
    return result


def _of_fields(
    workspace: Workspace, estimate: Estimator | ByChaos, planned: Sequence[Evaluated], inputs: str
) -> dict[str, list[str]]:
    """Write indices of kept fields; returns the protocols along which there are some, by specimen."""
    found: dict[str, list[str]] = {}

    def write(each: tuple[Evaluated, Curve]) -> None:
        one, curve = each
        indices = of_fields(estimate, one, curve)
        if isinstance(indices, str):
            workspace.say(f"{one.specimen.name}, {curve.name}: no indices of fields: {indices}")
            return
        workspace.store.write_result(stored_as(one.table.name, curve.name), indices.assign_attrs(inputs=inputs))
        found.setdefault(one.specimen.name, []).append(curve.name)

    every = {f"{one.specimen.name} {curve.name}": (one, curve) for one in planned if kept(one) for curve in one.curves}
    workspace.each("sobol of fields", "protocols", write, every)
    return found


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
        summaries = [one.read(f"summary_{output.name}") for one in planned]
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
            **{
                name: (("output", "parameter"), np.stack([getattr(part, name) for part in parts]))
                for name in result.keys
            },
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
                columns = one.read(field, slice(start, start + per_pass))
                parts.append(estimate.of(columns))
            of = curve.name if field == f"force_{curve.name}" else f"{course}_{curve.name}"
            for name in parts[0]:
                both = np.concatenate([part[name] for part in parts], axis=1)
                variables[f"{name}_{of}"] = (("parameter", dim), both)
        for name in (dim, f"displacement_{curve.name}", f"measured_{curve.name}"):
            if name in dataset:
                coordinates[name] = (dim, dataset[name].to_numpy(), {"units": dataset[name].attrs["units"]})
    return xr.Dataset(variables, coordinates, {"specimen": one.specimen.name})
