"""How Sobol indices are shown: as tables and on the console."""

from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr
from rich.table import Table as Grid
from rich.text import Text

from sinew.runner.console import Console
from sinew.tasks.drawing.formats import protocols_of
from sinew.tasks.sobol.result import KEYS, Indices, OfOutput, SobolResult


def table(result: SobolResult) -> pd.DataFrame:
    """Indices and intervals by output (``total``, each protocol, each of a template's outputs) and parameter."""
    parts = {
        name: pd.DataFrame({key: getattr(values, key) for key in KEYS}, index=result.names)
        for name, values in result.by_output().items()
    }
    return pd.concat(parts, names=["output", "parameter"])


def headline(result: SobolResult) -> str:
    """What came out, in one line."""
    order = np.argsort(-np.nan_to_num(result.ST))[:3]
    most = ", ".join(f"{result.names[j]} {result.ST[j]:.2f}" for j in order if np.isfinite(result.ST[j]))
    return f"{result.rows:,} rows, {result.failed:,} failed; largest total indices: {most}"


def convergence_table(result: SobolResult) -> pd.DataFrame:
    """Total order indices for each number of base samples."""
    curve, names = result.convergence, result.names
    sizes = np.array(curve.base_samples)
    columns = {"ST": curve.ST.ravel(), "ST_conf": curve.ST_conf.ravel()}
    return pd.DataFrame({"base_samples": np.repeat(sizes, len(names)), "parameter": names * sizes.size, **columns})


def time_table(dataset: xr.Dataset, output: str | None = None) -> pd.DataFrame:
    """Indices of the force, or of an output, at each kept moment of each protocol."""
    parts = []
    for protocol in protocols_of(dataset):
        kind, unit = beside(dataset, protocol, output)
        history = {"time_s": dataset[f"time_{protocol}"], f"{kind}_{unit}": dataset[f"{kind}_{protocol}"]}
        for j, name in enumerate(map(str, dataset["parameter"].to_numpy())):
            columns = {"protocol": protocol, "parameter": name, **{key: v.to_numpy() for key, v in history.items()}}
            columns |= {key: dataset[stored(key, protocol, output)].to_numpy()[j] for key in ("ST", "ST_conf")}
            parts.append(pd.DataFrame(columns))
    return pd.concat(parts, ignore_index=True)


def stored(key: str, protocol: str, output: str | None) -> str:
    """What the store calls indices of the force, or of an output, along a protocol."""
    return f"{key}_{protocol}" if output is None else f"{key}_{output}_{protocol}"


def beside(dataset: xr.Dataset, protocol: str, output: str | None) -> tuple[str, str]:
    """What is shown beside indices along time, and its unit: the measured force, else the displacement."""
    measured = output is None and f"measured_{protocol}" in dataset
    return ("measured", "N") if measured else ("displacement", "mm")


def summary(result: SobolResult, folder: Path, console: Console) -> None:
    """Print the indices, and how far failed rows could move them."""
    grid = Grid("parameter", "S1", "ST", *result.protocols, title=f"Sobol indices of the {result.objective}")
    for j in np.argsort(-np.nan_to_num(result.ST)):
        cells = [_with_interval(result, key, j) for key in ("S1", "ST")]
        cells += [_with_interval(values, "ST", j) for values in result.protocols.values()]
        grid.add_row(result.names[j], *cells)
    console.print(grid)
    console.print(f"{round(100 * result.confidence)} % intervals; columns of protocols show ST")
    if result.outputs:
        _outputs_summary(result, console)
    if result.failed:
        reported = {"S1": result.S1, "ST": result.ST}
        moved = max(
            float(np.max(np.abs(values - reported[key])))
            for key in reported
            for values in result.failures.outcomes(key)
        )
        failed = f"{result.failed:,} of {result.rows:,} rows failed"
        words = (
            f"; {result.failures.rule} ({result.failures.base_samples_left_out:,} of {result.base_samples:,}); "
            "giving all of them the smallest, the mean or the largest outcome moves an index by up to "
            f"{moved:.3f} (not a bound)"
        )
        console.print(Text.assemble((failed, "red"), words))


def _outputs_summary(result: SobolResult, console: Console) -> None:
    outputs = result.outputs or {}
    heads = [f"{name} ({one.summary}, {one.unit})" for name, one in outputs.items()]
    grid = Grid("parameter", *heads, title="Total order Sobol indices of each output, summed over the protocols")
    for j, name in enumerate(result.names):
        grid.add_row(name, *(_with_interval(one, "ST", j) for one in outputs.values()))
    console.print(grid)


def _with_interval(values: Indices | OfOutput | SobolResult, key: str, j: int) -> str:
    value, conf = getattr(values, key)[j], getattr(values, f"{key}_conf")[j]
    return f"{value:.3f} ± {conf:.3f}" if np.isfinite(value) else "does not vary"
