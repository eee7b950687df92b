"""Which parameters matter, by random forests (scikit-learn) on the rows of the Sobol study: no new simulations.

Stores: ``importance``. Leaves ``importance.json``. Impurity importance as in Pekedis (2025), in percent, and
permutation importance on base samples that the forest has not seen. Rows of one base sample share coordinates, so they
are kept together when rows for growing and for testing the forest are parted.
"""

from typing import Any

import numpy as np
import xarray as xr
from sklearn.ensemble import RandomForestRegressor
from sklearn.inspection import permutation_importance

from runner.cluster import free_cores
from runner.store import Table
from tasks.model import Specimen
from tasks.problems import BadInput
from tasks.sensitivity import Design, objectives_by_output, quantity, saltelli
from tasks.simulate import Array, outputs_of
from tasks.workspace import Workspace, digest, read_result, write_json

TEST_SHARE = 0.25


def importance(workspace: Workspace) -> dict[str, Any]:
    """Importance of each parameter for the total objective and each protocol's. Returns ``importance.json``."""
    settings = workspace.study.importance
    design, specimens, evaluated = _sobol_rows(workspace)
    status = np.stack([table.status[rows] for table, rows in evaluated])
    ok = (status == 0).all(axis=0)
    inputs = digest(settings.model_dump(), workspace.seed, [table.key for table, _ in evaluated], ok, design.rows,
                    workspace.study.sobol.output)  # fmt: skip
    previous = read_result(workspace.out / "importance.json")
    if previous is not None and previous.get("inputs") == inputs and "importance" in workspace.store.root:
        return previous
    studied, words = quantity(workspace.evaluation(specimens[0]), workspace.study.sobol.output)
    outputs = objectives_by_output(specimens, [table.read(studied, rows) for table, rows in evaluated])
    features = design.rows[:, [workspace.model.names.index(name) for name in design.names]]
    rng = np.random.default_rng([workspace.seed, 2])
    blocks = rng.permutation(design.base_samples)[: max(8, settings.max_rows // design.block)]
    tested = blocks[: max(1, round(TEST_SHARE * blocks.size))]
    grown = blocks[tested.size :]
    found = {name: _forest(workspace, design, features, values, ok, grown, tested) for name, values in outputs.items()}
    result = {
        "names": list(design.names),
        **found["total"],
        "objective": words,
        "field": studied,
        "protocols": {name: values for name, values in found.items() if name != "total"},
        "rows_grown": int(ok.reshape(design.base_samples, -1)[grown].sum()),
        "rows_tested": int(ok.reshape(design.base_samples, -1)[tested].sum()),
        "failed": int((~ok).sum()),
        "new_simulations": 0,
        "inputs": inputs,
    }
    for output in outputs_of(workspace.simulator):
        sums = [table.read(f"summary_{output.name}", rows).sum(axis=1) for table, rows in evaluated]
        values = _forest(workspace, design, features, np.mean(sums, axis=0), ok, grown, tested)
        found[output.name] = result.setdefault("outputs", {})[output.name] = values
    keys = ("impurity_percent", "impurity_sd", "permutation", "permutation_sd")
    dims = ("output", "parameter")
    dataset = xr.Dataset(
        {key: (dims, np.stack([values[key] for values in found.values()])) for key in keys},
        {"parameter": np.array(design.names, dtype=str), "output": list(found)},
    )
    workspace.store.write_result("importance", dataset)
    write_json(workspace.out / "importance.json", result)
    return result


def _sobol_rows(workspace: Workspace) -> tuple[Design, tuple[Specimen, ...], list[tuple[Table, Array]]]:
    """The rows of the last Sobol study. Raises :class:`BadInput` when they are not all there."""
    settings = workspace.study.sobol
    last = read_result(workspace.out / "sobol.json")
    missing = BadInput(workspace.out / "sobol.json", "no finished Sobol study", "`sinew sobol` on this study first")
    if last is None:
        raise missing
    design = saltelli(workspace.model, int(last["base_samples"]), settings.second_order, workspace.seed)
    specimens = workspace.specimens(settings.specimens, "sobol.specimens")
    evaluated = []
    for specimen in specimens:
        table = workspace.store.table(workspace.evaluation(specimen).table())
        rows = table.find(design.rows)
        if (rows < 0).any() or table.pending(rows).size:
            raise missing
        evaluated.append((table, rows))
    return design, specimens, evaluated


def _forest(
    workspace: Workspace, design: Design, features: Array, output: Array, ok: Array, grown: Array, tested: Array
) -> dict[str, Any]:
    settings = workspace.study.importance

    def rows(blocks: Array) -> Array:
        chosen = (np.sort(blocks)[:, np.newaxis] * design.block + np.arange(design.block)).ravel()
        return chosen[ok[chosen]]

    seed = int(np.random.SeedSequence([workspace.seed, 3]).generate_state(1)[0])
    forest = RandomForestRegressor(settings.trees, random_state=seed, n_jobs=free_cores())
    forest.fit(features[rows(grown)], output[rows(grown)])
    forest.set_params(n_jobs=1)  # threads would add up the trees' predictions in the order in which they end
    by_tree = np.stack([tree.feature_importances_ for tree in forest.estimators_])
    test = rows(tested)
    permuted = permutation_importance(
        forest, features[test], output[test], n_repeats=settings.repeats, random_state=seed, scoring="r2"
    )
    return {
        "impurity_percent": 100 * forest.feature_importances_,
        "impurity_sd": 100 * by_tree.std(axis=0, ddof=1),
        "permutation": permuted.importances_mean,
        "permutation_sd": permuted.importances_std,
        "r2_on_unseen": float(forest.score(features[test], output[test])),
    }
