"""Random forest importance from the rows of the Sobol study: no new simulations. The store keeps ``importance``."""

from functools import partial

import numpy as np
import xarray as xr

from sinew.runner.cluster.client import free_cores
from sinew.tasks.importance.method import forest_importance, split
from sinew.tasks.importance.result import KEYS, ImportanceResult
from sinew.tasks.importance.settings import Settings
from sinew.tasks.sobol.rows import sobol_rows
from sinew.tasks.sobol.settings import Settings as SobolSettings
from sinew.tasks.study.cached import cached, commit, key
from sinew.tasks.study.workspace import Workspace


def run(workspace: Workspace, settings: Settings) -> ImportanceResult:
    """Importance of each parameter for the total objective and each protocol's."""
    studied = workspace.study.section(SobolSettings).output
    found = sobol_rows(workspace)
    design, ok = found.design, found.ok
    names = [parameter.name for parameter in workspace.model.free]
    inputs = key(ImportanceResult, settings.model_dump(), workspace.seed, found.keys, ok, design.rows, studied)
    if (known := cached(workspace, ImportanceResult, inputs, ["importance"])) is not None:
        return known
    rows = split(design.base_samples, design.block, ok, settings.max_rows, workspace.seed)
    importance_of = partial(
        forest_importance, found.design.free_rows, rows=rows, trees=settings.trees, repeats=settings.repeats,
        seed=workspace.seed, threads=free_cores(),
    )  # fmt: skip
    forests = workspace.each("importance", "forests", importance_of, found.objectives())
    outputs = workspace.each("importance for outputs", "forests", importance_of, found.outputs())
    result = ImportanceResult(
        names=names,
        **vars(forests["total"]),
        objective=found.words,
        field=found.studied,
        protocols={name: forest for name, forest in forests.items() if name != "total"},
        rows_grown=rows.grown.size,
        rows_tested=rows.tested.size,
        failed=int((~ok).sum()),
        new_simulations=0,
        inputs=inputs,
        outputs=outputs or None,
    )
    every = forests | outputs
    dataset = xr.Dataset(
        {name: (("output", "parameter"), np.stack([getattr(one, name) for one in every.values()])) for name in KEYS},
        {"parameter": np.array(names, dtype=str), "output": list(every)},
    )
    commit(workspace, result, {"importance": dataset})
    return result
