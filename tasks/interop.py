"""Results as the objects of the libraries that others work with, built from what is stored: SALib, pyABC, skopt, ArviZ.

Nothing is unpickled: numbers come from ``TASK.json``, the store, pyABC's SQLite database and a NetCDF file.
"""

import warnings
from pathlib import Path
from types import MethodType
from typing import Any

import numpy as np
import pandas as pd

from runner.store import STATUSES, Table, open_store
from tasks.model import file_name
from tasks.problems import BadInput, shown
from tasks.report.frames import by_output
from tasks.simulate import Array

Told = dict[str, Any]


def salib_problem(told: Told, where: Path) -> dict[str, Any]:
    """SALib's problem: ``num_vars``, ``names`` and ``bounds`` of the free parameters of ``sobol.json``."""
    if "bounds" not in told:
        raise BadInput(where, "holds no bounds", "`sinew sobol` on this study once more, by this version")
    return {"num_vars": len(told["names"]), "names": list(told["names"]), "bounds": [list(b) for b in told["bounds"]]}


def salib_result(told: Told, where: Path, output: str = "total") -> Any:
    """The indices as :class:`SALib.util.ResultDict`, which plots itself and becomes data frames by ``to_df()``."""
    from SALib.analyze import sobol
    from SALib.util import ResultDict

    outputs = by_output(told)
    if output not in outputs:
        raise BadInput(f"{where}: output", shown(output), f"one of {', '.join(outputs)}")
    values = outputs[output]
    keys = ("S1", "S1_conf", "ST", "ST_conf", "S2", "S2_conf")
    found = ResultDict({key: np.array(values[key], dtype=float) for key in keys if key in values})
    found.problem = salib_problem(told, where)
    found.to_df = MethodType(sobol.to_df, found)
    return found


def salib_samples(told: Told, folder: Path, specimen: str) -> tuple[Array, Array]:
    """SALib's sample ``X`` ``[n, d]`` and output ``Y`` ``[n]`` of one specimen, in its own order.

    The output is what the study was of: the objective (N), or one of a template's outputs in its unit.

    ``SALib.analyze.sobol.analyze(problem, Y, calc_second_order=...)`` takes them. A row that failed is NaN, which SALib
    turns into indices of zero: leave its whole base sample out first.
    """
    from SALib.sample import sobol

    where = folder / "sobol.json"
    if specimen not in told["tables"]:
        raise BadInput(f"{where}: specimen", shown(specimen), f"one of {', '.join(told['tables'])}")
    problem = salib_problem(told, where)
    base, seed = int(told["base_samples"]), int(told["seed"])
    drawn = sobol.sample(problem, base, calc_second_order="S2" in told, scramble=True, seed=seed)
    table = _table(folder, told["tables"][specimen])
    names = _parameters(table)
    at = [names.index(name) for name in problem["names"]]
    full = np.repeat(table.parameters(np.arange(1)), len(drawn), axis=0)  # the others are the same in every row
    full[:, at] = drawn
    rows = table.find(full)
    if (rows < 0).any():
        raise BadInput(where, f"rows of {specimen} are not in the store", "`sinew sobol` on this study once more")
    return drawn, table.read(told.get("field", "objective"), rows).sum(axis=1)


def abc_history(folder: Path, site: str) -> Any:
    """The inference of a site as :class:`pyabc.History`, for all of ``pyabc.visualization``."""
    import pyabc

    return pyabc.History(f"sqlite:///{_of_site(folder, site, 'db').absolute()}", create=False)


def posterior(folder: Path, site: str) -> Any:
    """1,000 draws of equal weight from the posterior of a site as :class:`arviz.InferenceData`."""
    path = _of_site(folder, site, "nc")
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", r"[\s\S]*ArviZ is undergoing a major refactor", FutureWarning)
        import arviz
    return arviz.from_netcdf(str(path), engine="h5netcdf")


def skopt_result(told: Told, folder: Path, specimen: str, *, surrogate: bool = False) -> Any:
    """The Bayesian search of a specimen as skopt's ``OptimizeResult``; rows that failed are left out.

    With ``surrogate``, a Gaussian process of skopt is fitted to it, as ``skopt.plots.plot_objective`` needs. It is not
    the process that proposed the points, which knows the residuals along the curves (see docs/methods.md).
    """
    from skopt.space import Real, Space
    from skopt.utils import cook_estimator, create_result

    where = folder / "calibrate.json"
    if specimen not in told["specimens"]:
        raise BadInput(f"{where}: specimen", shown(specimen), f"one of {', '.join(told['specimens'])}")
    if "bounds" not in told:
        raise BadInput(where, "holds no bounds", "`sinew calibrate` by this version, with another --out")
    if not {"bayesian", "hybrid"} & set(told["methods"]):
        raise BadInput(where, "holds no Bayesian search", "a study with calibrate.methods: [bayesian]")
    seen = open_store(folder).read_result(f"calibrate/{file_name(specimen)}")
    alive = np.isfinite(seen["total"].to_numpy())
    points = seen["parameters"].sel(parameter=told["free"]).to_numpy()[alive]
    totals = seen["total"].to_numpy()[alive]
    space = Space([Real(low, high, name=name) for name, (low, high) in zip(told["free"], told["bounds"], strict=True)])
    models = []
    if surrogate:
        process = cook_estimator("GP", space=space, random_state=0)
        models = [process.fit(space.transform(points.tolist()), totals)]
    return create_result(points.tolist(), totals, space, models=models)


def samples(folder: Path, name: str) -> pd.DataFrame:
    """All evaluations of a table of the store: parameters, objective of each protocol (N), what became of the row.

    Of a template's outputs there is one number for each protocol, in the output's unit.
    """
    table = _table(folder, name)
    rows = np.arange(len(table))
    columns = dict(zip(_parameters(table), table.parameters(rows).T, strict=True))
    protocols = [str(name) for name in table.dataset()["protocol"].to_numpy()] if "protocol" in table.group else []
    for field in (name for name in table.fields if name.startswith("summary_")):
        columns |= {f"{field}_{protocol}": table.read(field, rows)[:, i] for i, protocol in enumerate(protocols)}
    if "objective" in table.fields:
        objective = table.read("objective", rows)
        columns |= {f"rmse_{protocol}_N": objective[:, i] for i, protocol in enumerate(protocols)}
        columns["total_N"] = objective.sum(axis=1)
    words = ("pending", *STATUSES)
    columns["status"] = np.array([words[status + 1] for status in table.status[rows]], dtype=object)
    columns["wall_seconds"] = table.read("wall_seconds", rows)
    return pd.DataFrame(columns).rename_axis("row")


def particles(folder: Path, site: str) -> pd.DataFrame:
    """Every particle of every generation of a site: parameters, weight and distance."""
    kept = open_store(folder).read_result(f"infer/{site}")
    parts = []
    for generation in range(kept.sizes["generation"]):
        one = kept.isel(generation=generation)
        frame = pd.DataFrame(one["parameters"].to_numpy(), columns=[str(name) for name in one["parameter"].to_numpy()])
        frame.insert(0, "generation", generation)
        parts.append(frame.assign(weight=one["weight"].to_numpy(), distance=one["distance"].to_numpy()))
    return pd.concat(parts, ignore_index=True)


def _table(folder: Path, name: str) -> Table:
    tables = {table.name: table for table in open_store(folder).tables()}
    if name not in tables:
        raise BadInput(folder / "store.zarr", f"no evaluations {shown(name)}", f"one of {', '.join(tables)}")
    return tables[name]


def _parameters(table: Table) -> list[str]:
    return [str(name) for name in table.dataset()["parameter"].to_numpy()]


def _of_site(folder: Path, site: str, kind: str) -> Path:
    """A file of an inference, whose name must be that of a site that is there."""
    found = {path.stem: path for path in sorted((folder / "infer").glob(f"*.{kind}"))}
    if site not in found:
        expected = f"one of {', '.join(found)}" if found else "`sinew infer` on this study first"
        raise BadInput(folder / "infer", f"no posterior of {shown(site)}", expected)
    return found[site]
