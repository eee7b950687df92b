"""How Sobol indices are shown: as tables and on the console."""

from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr
from rich.table import Table as Grid
from rich.text import Text

from sinew.runner.console import Console
from sinew.tasks.drawing.formats import protocols_of
from sinew.tasks.drawing.matrix import print_matrix
from sinew.tasks.sobol.result import SHORT, Indices, OfOutput, SobolResult, Surrogate


def table(result: SobolResult) -> pd.DataFrame:
    """Indices and intervals by output (``total``, each protocol, each of a template's outputs) and parameter."""
    parts = {
        name: pd.DataFrame({key: getattr(values, key) for key in result.keys}, index=result.names)
        for name, values in result.by_output().items()
    }
    return pd.concat(parts, names=["output", "parameter"])


def headline(result: SobolResult) -> str:
    """What came out, in one line."""
    values = getattr(result, result.leading)
    most = ", ".join(f"{result.names[j]} {values[j]:.2f}" for j in result.largest())
    return f"{result.rows:,} rows, {result.failed:,} failed; largest {SHORT[result.leading]}: {most}"


def convergence_table(result: SobolResult) -> pd.DataFrame:
    """Total order indices for each number of base samples."""
    curve, names = result.convergence, result.names
    sizes = np.array(curve.base_samples)
    columns = {"ST": curve.ST.ravel(), "ST_conf": curve.ST_conf.ravel()}
    return pd.DataFrame({"base_samples": np.repeat(sizes, len(names)), "parameter": names * sizes.size, **columns})


def time_table(dataset: xr.Dataset, output: str | None = None, key: str = "ST") -> pd.DataFrame:
    """Indices (``ST``, ``S1`` or ``Sh``) of the force, or of an output, at each kept moment of each protocol."""
    parts = []
    for protocol in protocols_of(dataset):
        kind, unit = beside(dataset, protocol, output)
        history = {"time_s": dataset[f"time_{protocol}"], f"{kind}_{unit}": dataset[f"{kind}_{protocol}"]}
        for j, name in enumerate(map(str, dataset["parameter"].to_numpy())):
            columns = {"protocol": protocol, "parameter": name, **{what: v.to_numpy() for what, v in history.items()}}
            both = (key, f"{key}_conf")
            columns |= {each: dataset[stored(each, protocol, output)].to_numpy()[j] for each in both}
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
    """Print the indices, and what is done about failed rows."""
    key = result.leading
    if len(result.specimens) > 1:
        _specimens_summary(result, console)
    every = result.keys[::2]
    grid = Grid("parameter", *every, *result.protocols, title=f"Sobol indices of the {result.objective}")
    order = result.largest(len(result.names))
    for j in [*order, *(j for j in range(len(result.names)) if j not in order)]:
        cells = [_with_interval(result, each, j) for each in every]
        cells += [_with_interval(values, key, j) for values in result.protocols.values()]
        grid.add_row(result.names[j], *cells)
    console.print(grid)
    console.print(
        f"{round(100 * result.confidence)} % intervals; columns of protocols show {key}{_of_dependent(result)}"
    )
    if result.outputs:
        _outputs_summary(result, console)
    for words in surrogate_words(result):
        console.print(words)
    if result.failed:
        failed = f"{result.failed:,} of {result.rows:,} rows failed"
        console.print(Text.assemble((failed, "red"), f"; {result.failures.rule}{_moved(result)}"))


def correlation_words(result: SobolResult) -> str:
    """The rank correlations of the parameters."""
    every = (
        (one, other, rank) for one, others in (result.correlations or {}).items() for other, rank in others.items()
    )
    return ", ".join(f"{one} and {other} {rank:g}" for one, other, rank in every)


def _of_dependent(result: SobolResult) -> str:
    """What Sh is, where there is one."""
    return "; Sh: Shapley effects, which divide what correlated parameters do together" if result.correlations else ""


def surrogate_words(result: SobolResult) -> list[str]:
    """A sentence on the polynomials that stand for the model; none where the model itself answered."""
    if (found := result.surrogate) is None:
        return []
    left = max(found.unexplained.values())
    runs = f"{result.rows:,} runs{_beside(found)}"
    words = f"{runs}; polynomials leave at most {100 * left:.2g} % of an outcome's variance unexplained"
    asked = f"± {found.error:g}"
    return [
        f"{words}; intervals are " + (f"within {asked}" if found.reached else f"wider than {asked}: more sobol.runs")
    ]


def _beside(surrogate: Surrogate) -> str:
    """Runs of cheaper versions of the model, in words; nothing where there are none."""
    versions = list((surrogate.versions or {}).items())[::-1]
    each = [f"{one.runs:,}{'' if number else ' runs'} of {name}" for number, (name, one) in enumerate(versions)]
    return f", beside {', '.join(each)}" if each else ""


def _specimens_summary(result: SobolResult, console: Console) -> None:
    """Each specimen's own indices, which the mean of their objectives may hide."""
    key = result.leading
    grid = Grid(
        "parameter", "median", "smallest", "largest", "largest in",
        title=f"{key} of each specimen's own objective ({len(result.specimens)} specimens)",
    )  # fmt: skip
    for row in specimens_table(result).itertuples():
        grid.add_row(
            str(row.Index), f"{row.median:.3f}", f"{row.smallest:.3f}", f"{row.largest:.3f}", str(row.largest_in)
        )
    console.print(grid)


def specimens_table(result: SobolResult) -> pd.DataFrame:
    """By parameter: median, smallest and largest index of all specimens' own objectives, and which has the largest."""
    key = result.leading
    names = list(result.specimens)
    every = np.array([getattr(one, key) for one in result.specimens.values()])  # [specimens, d]
    known = np.nan_to_num(every)
    table = pd.DataFrame(
        {
            "median": np.median(known, axis=0),
            "smallest": known.min(axis=0),
            "largest": known.max(axis=0),
            "largest_in": [names[at] for at in known.argmax(axis=0)],
        },
        index=result.names,
    )
    return table.sort_values("median", ascending=False, kind="stable")


def _moved(result: SobolResult) -> str:
    """How far failed rows could move total indices, in words; nothing where these were refused."""
    outcomes = result.failures.outcomes("ST")
    if result.refuses or not outcomes:
        return ""
    moved = max(float(np.max(np.abs(values - result.ST))) for values in outcomes)
    return (
        f" ({result.failures.base_samples_left_out:,} of {result.base_samples:,} were left out); giving all failed "
        f"rows the smallest, the mean or the largest outcome moves ST by up to {moved:.3f} (not a bound)"
    )


def _outputs_summary(result: SobolResult, console: Console) -> None:
    every = list((result.outputs or {}).values())
    heads = [f"{name} ({one.summary}, {one.unit})" for name, one in (result.outputs or {}).items()]
    print_matrix(
        console,
        f"{'Shapley effects' if result.correlations else 'Total order Sobol indices'} of each output, summed over the "
        "protocols",
        ("parameter", result.names),
        ("output", heads),
        lambda j, k: _with_interval(every[k], result.leading if result.correlations else "ST", j),
    )


def _with_interval(values: Indices | OfOutput | SobolResult, key: str, j: int) -> str:
    value, conf = getattr(values, key)[j], getattr(values, f"{key}_conf")[j]
    if np.isfinite(value):
        return f"{value:.3f} ± {conf:.3f}"
    return "refused" if key != "S1" and np.isfinite(values.S1).any() else "varies too little"
