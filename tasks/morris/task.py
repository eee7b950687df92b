"""Elementary effects of a study: plan and evaluate Morris' trajectories, analyse them, commit.

The store keeps ``morris``.
"""

from functools import partial

import numpy as np
import xarray as xr

from sinew.runner.errors import BadInput
from sinew.tasks.morris.method import elementary_effects, trajectories
from sinew.tasks.morris.result import KEYS, MorrisResult
from sinew.tasks.morris.settings import Settings
from sinew.tasks.simulate.studied_quantity import objectives_by_output, quantity
from sinew.tasks.study.cached import cached, commit, key
from sinew.tasks.study.workspace import Workspace


def run(workspace: Workspace, settings: Settings) -> MorrisResult:
    """Elementary effects on the total objective, and on each protocol's and specimen's."""
    design = trajectories(workspace.model, settings.trajectories, settings.levels, workspace.seed)
    specimens = workspace.specimens(settings.specimens, "morris.specimens")
    evaluations = [workspace.evaluation(specimen) for specimen in specimens]
    planned = [workspace.plan(evaluation, design.rows) for evaluation in evaluations]
    for evaluation, (table, at) in zip(evaluations, planned, strict=True):
        workspace.evaluate(evaluation, table, at, f"morris {evaluation.specimen.name}")
    statuses = [table.status[at] for table, at in planned]
    tables = [[one.name, table.key] for one, (table, _) in zip(specimens, planned, strict=True)]
    inputs = key(MorrisResult, settings.model_dump(), workspace.seed, design.rows, tables, *statuses)
    if (known := cached(workspace, MorrisResult, inputs, ["morris"])) is not None:
        return known
    ok = np.asarray((np.stack(statuses) == 0).all(axis=0))
    whole = np.asarray(ok.reshape(design.count, design.block).all(axis=1))
    if whole.sum() < 2:
        problem = f"{int((~ok).sum())} of {ok.size} rows failed and no two trajectories are whole"
        expected = "a model that can be evaluated within its bounds (see `sinew status`)"
        raise BadInput(workspace.out, problem, expected)
    effects = partial(
        elementary_effects, design, whole=whole, resamples=settings.resamples, confidence=settings.confidence,
        seed=workspace.seed,
    )  # fmt: skip
    studied, words = quantity(evaluations[0], settings.output)
    units = {f"summary_{output.name}": output.unit for output in workspace.simulator.capabilities.outputs}
    by_specimen = [table.read(studied, at) for table, at in planned]
    outcomes = objectives_by_output(specimens, by_specimen)
    found = {name: effects(values) for name, values in outcomes.items()}
    result = MorrisResult(
        names=list(design.names),
        bounds=[[parameter.minimum, parameter.maximum] for parameter in workspace.model.free],
        **vars(found["total"]),
        rows=ok.size,
        failed=int((~ok).sum()),
        trajectories=design.count,
        trajectories_used=int(whole.sum()),
        levels=design.levels,
        confidence=settings.confidence,
        objective=words + (", mean of the specimens" if len(specimens) > 1 else ""),
        unit=units.get(studied, evaluations[0].unit),
        field=studied,
        protocols={name: each for name, each in found.items() if name != "total"},
        specimens={
            specimen.name: effects(values.sum(axis=1))
            for specimen, values in zip(specimens, by_specimen, strict=True)
        },
        inputs=inputs,
    )  # fmt: skip
    dataset = xr.Dataset(
        {name: (("output", "parameter"), np.stack([getattr(one, name) for one in found.values()])) for name in KEYS},
        {"parameter": np.array(design.names, dtype=str), "output": list(found)},
    )
    commit(workspace, result, {"morris": dataset})
    return result
