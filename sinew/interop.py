"""Results as the objects of the libraries that others work with, built from what is stored: SALib, pyABC, skopt, ArviZ.

Nothing is unpickled: numbers come from ``TASK.json``, the store, pyABC's SQLite database and a NetCDF file.
"""

import json
import os
import subprocess
from pathlib import Path
from types import MethodType, ModuleType
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from sinew import database_reading, posterior_file
from sinew.database_reading import Schema
from sinew.runner.errors import BadInput, brief, shown
from sinew.runner.limits import command
from sinew.runner.store.schema import STATUSES
from sinew.runner.store.store import open_store
from sinew.runner.store.table import Table
from sinew.tasks.calibrate.result import CalibrateResult, search_group
from sinew.tasks.infer.library import arviz
from sinew.tasks.simulate import Array
from sinew.tasks.simulate.block import block_of
from sinew.tasks.simulate.saltelli import MOST_NUMBERS, drawn
from sinew.tasks.sobol.result import KEYS, SobolResult
from sinew.tasks.study.result import believed

INFERRED = "what `sinew infer` writes; run it again"  # expected of its files
MAX_FILE_BYTES = 2**28
STEP, MAX_STEPS = 100_000, 5_000  # of the look at a database: instructions of SQLite together, and how often
POSTERIOR_S = 30  # of the look at a posterior, most of which goes into the import of libraries
WALL_S = 600.0


def salib_problem(result: SobolResult) -> dict[str, Any]:
    """SALib's problem: ``num_vars``, ``names`` and ``bounds`` of the free parameters of a Sobol study."""
    return {"num_vars": len(result.names), "names": list(result.names), "bounds": [list(b) for b in result.bounds]}


def salib_result(result: SobolResult, output: str = "total") -> Any:
    """The indices as :class:`SALib.util.ResultDict`, which plots itself and becomes data frames by ``to_df()``."""
    from SALib.analyze import sobol
    from SALib.util import ResultDict

    outputs = result.by_output()
    if output not in outputs:
        raise BadInput(f"{result.TASK}: output", shown(output), f"one of {', '.join(outputs)}")
    values = ((key, getattr(outputs[output], key, None)) for key in (*KEYS, "S2", "S2_conf"))
    found = ResultDict({key: value for key, value in values if value is not None})
    found.problem = salib_problem(result)
    found.to_df = MethodType(sobol.to_df, found)
    return found


def salib_samples(result: SobolResult, folder: Path, specimen: str) -> tuple[Array, Array]:
    """SALib's sample ``X`` ``[n, d]`` and output ``Y`` ``[n]`` of one specimen, in its own order.

    The output is what the study was of: the objective (N), or one of a template's outputs in its unit.

    ``SALib.analyze.sobol.analyze(problem, Y, calc_second_order=...)`` takes them. A row that failed is NaN, which SALib
    turns into indices of zero: leave its whole base sample out first.
    """
    where = folder / "sobol.json"
    if specimen not in result.tables:
        raise BadInput(f"{where}: specimen", shown(specimen), f"one of {', '.join(result.tables)}")
    problem, second = salib_problem(result), result.S2 is not None
    if result.correlations:
        raise BadInput(
            where, "its parameters are correlated, for which SALib has no design", "a study without correlations"
        )
    table = _table(folder, result.tables[specimen])
    names, asked = _parameters(table), problem["names"]
    unknown = [name for name in asked if name not in names]
    if unknown:
        raise BadInput(f"{where}: names", shown(", ".join(unknown)), f"some of {', '.join(names)}, each once")
    rows_drawn = result.base_samples * block_of(len(result.names), second)
    if result.base_samples > len(table) or rows_drawn * len(names) > MOST_NUMBERS:
        raise BadInput(where, f"{result.base_samples:,} base samples of {len(table):,} rows", "those of the store")
    sample = drawn(
        result.names, result.bounds, result.base_samples, result.seed, second_order=second, scrambles=result.scrambles
    )
    at = [names.index(name) for name in asked]
    full = np.repeat(table.parameters(np.arange(1)), len(sample), axis=0)  # the others are the same in every row
    full[:, at] = sample
    rows = table.find(full)
    if (rows < 0).any():
        raise BadInput(where, f"rows of {specimen} are not in the store", "`sinew sobol` on this study once more")
    return sample, table.read(result.field, rows).sum(axis=1)


def abc_history(folder: Path, site: str) -> Any:
    """The inference of a site as :class:`pyabc.History`, for all of ``pyabc.visualization``."""
    import pyabc
    from pyabc.storage.db_model import Base

    path = _of_site(folder, site, "db").absolute()
    if "?" in str(path):  # pyABC would open what is named before it
        raise BadInput(path, "has a '?' in its path", "a folder and a site without one")
    schema = {
        table.name: {column.name: column.type.python_type.__name__ for column in table.columns}
        for table in Base.metadata.sorted_tables
    }
    _refuse_program(path, schema)
    return pyabc.History(f"sqlite:///{path}", create=False)


def _refuse_program(path: Path, schema: Schema) -> None:
    """Refuse a database with more than plain tables: all else is a program, which may fill the memory or never end.

    One that has other tables, columns or types than ``schema`` would end in errors of the library that reads it.
    """
    for ending in ("-journal", "-wal", "-shm"):  # SQLite would take the database back, and delete what a journal names
        if os.path.lexists(beside := path.with_name(path.name + ending)):
            raise BadInput(beside, "is there", "no file of an interrupted change; delete it")
    if (size := path.stat().st_size) > MAX_FILE_BYTES:
        raise BadInput(path, f"has {size:,} bytes", INFERRED)
    _refuse(path, database_reading, str(path), str(MAX_STEPS), str(STEP), json.dumps(schema))


def _refuse(path: Path, look: ModuleType, *arguments: str) -> None:
    """Refuse a file with which something is wrong, as ``look`` says in a process of its own."""
    try:
        started = command(look.__name__, *arguments)
        done = subprocess.run(started, capture_output=True, timeout=WALL_S, check=False)
        found = json.loads(done.stdout) if done.returncode == 0 else "takes too long, or too much memory, to look at"
    except subprocess.TimeoutExpired:
        found = f"takes more than {WALL_S:g} s to look at"
    if found:
        raise BadInput(path, brief(found, 120), INFERRED)


def posterior(folder: Path, site: str) -> Any:
    """1,000 draws of equal weight from the posterior of a site as :class:`arviz.InferenceData`."""
    path = _of_site(folder, site, "nc")
    _refuse(path, posterior_file, str(path.absolute()), str(MAX_FILE_BYTES), str(POSTERIOR_S))
    return arviz().from_netcdf(str(path), engine="h5netcdf")


def skopt_result(result: CalibrateResult, folder: Path, specimen: str, *, surrogate: bool = False) -> Any:
    """The Bayesian search of a specimen as skopt's ``OptimizeResult``; rows that failed are left out.

    With ``surrogate``, a Gaussian process of skopt is fitted to it, as ``skopt.plots.plot_objective`` needs. It is not
    the process that proposed the points, which knows the residuals along the curves (see docs/methods.md).
    """
    where = CalibrateResult.path(folder)
    if specimen not in result.specimens:
        raise BadInput(f"{where}: specimen", shown(specimen), f"one of {', '.join(result.specimens)}")
    if not result.has_search:
        raise BadInput(where, "holds no Bayesian search", "a study with calibrate.methods: [bayesian]")
    seen = open_store(folder).read_result(search_group(specimen))
    with believed(where):
        return _search(result, seen, surrogate=surrogate)


def _search(result: CalibrateResult, seen: xr.Dataset, *, surrogate: bool) -> Any:
    """A kept search as skopt's result."""
    from skopt.space import Real, Space
    from skopt.utils import cook_estimator, create_result

    alive = np.isfinite(seen["total"].to_numpy())
    points = seen["parameters"].sel(parameter=result.free).to_numpy()[alive]
    totals = seen["total"].to_numpy()[alive]
    space = Space([Real(low, high, name=name) for name, (low, high) in zip(result.free, result.bounds, strict=True)])
    models = []
    if surrogate:
        process = cook_estimator("GP", space=space, random_state=0)
        models = [process.fit(space.transform(points.tolist()), totals)]
    return create_result(points.tolist(), totals, space, models=models)


def _errors(table: Table) -> list[str]:
    """The fields with the RMSE of each quantity, where several are compared."""
    return [name for name in table.fields if name.startswith("rmse_")]


def samples(folder: Path, name: str) -> pd.DataFrame:
    """All evaluations of a table of the store: parameters, objective of each protocol (N), what became of the row.

    Of a template's outputs there is one number for each protocol, in the output's unit. Where several quantities are
    compared, the objective has no unit, and ``rmse_NAME_PROTOCOL`` are in that of each.
    """
    table = _table(folder, name)
    rows = np.arange(len(table))
    columns = dict(zip(_parameters(table), table.parameters(rows).T, strict=True))
    protocols = [str(name) for name in table.dataset()["protocol"].to_numpy()] if "protocol" in table.group else []
    for field in (name for name in table.fields if name.startswith("summary_")):
        columns |= {f"{field}_{protocol}": table.read(field, rows)[:, i] for i, protocol in enumerate(protocols)}
    if "objective" in table.fields:
        objective = table.read("objective", rows)
        errors = {"objective": objective, **{name: table.read(name, rows) for name in _errors(table)}}
        if len(errors) > 1:  # several quantities are compared
            columns |= {f"{name}_{each}": one[:, i] for name, one in errors.items() for i, each in enumerate(protocols)}
            columns["objective"] = objective.sum(axis=1)
        else:
            columns |= {f"rmse_{protocol}_N": objective[:, i] for i, protocol in enumerate(protocols)}
            columns["total_N"] = objective.sum(axis=1)
    words = ("pending", *STATUSES)
    columns["status"] = np.array([words[status + 1] for status in table.status[rows]], dtype=object)
    columns["wall_seconds"] = table.read("wall_seconds", rows)
    return pd.DataFrame(columns).rename_axis("row")


def particles(folder: Path, site: str) -> pd.DataFrame:
    """Every particle of every generation of a site: parameters, weight and distance."""
    kept, parts = open_store(folder).read_result(f"infer/{site}"), []
    with believed(folder / "infer.json"):
        for generation in range(kept.sizes["generation"]):
            one = kept.isel(generation=generation)
            names = [str(name) for name in one["parameter"].to_numpy()]
            frame = pd.DataFrame(one["parameters"].transpose("particle", "parameter").to_numpy(), columns=names)
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
