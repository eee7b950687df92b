"""How PAWN indices are shown: as a table and on the console."""

from pathlib import Path

import numpy as np
import pandas as pd
from rich.table import Table as Grid

from sinew.runner.console import Console
from sinew.tasks.pawn.result import KEYS, PawnResult


def table(result: PawnResult) -> pd.DataFrame:
    """Indices by output (``total``, each protocol, each of a template's outputs) and parameter."""
    parts = {
        name: pd.DataFrame({key: getattr(found, key) for key in KEYS}, index=result.names).assign(
            no_influence=found.no_influence
        )
        for name, found in result.by_output().items()
    }
    return pd.concat(parts, names=["output", "parameter"])


def headline(result: PawnResult) -> str:
    """What came out, in one line."""
    most = ", ".join(f"{result.names[j]} {result.median[j]:.2f}" for j in np.argsort(-result.median)[:3])
    above = int((result.median > result.no_influence).sum())
    return f"{above} of {len(result.names)} parameters above the level of no influence; largest medians: {most}"


def summary(result: PawnResult, folder: Path, console: Console) -> None:
    """Print the indices for the total objective, the largest first."""
    grid = Grid("parameter", "median", "interval", "maximum", "influence", title=f"PAWN indices, {result.objective}")
    for j in np.argsort(-result.median):
        interval = f"{result.median_low[j]:.3f} to {result.median_high[j]:.3f}"
        seen = "yes" if result.median[j] > result.no_influence else "not seen"
        grid.add_row(result.names[j], f"{result.median[j]:.3f}", interval, f"{result.maximum[j]:.3f}", seen)
    console.print(grid)
    console.print(
        f"{round(100 * result.confidence)} % intervals from {result.rows:,} rows in {result.slides} slides; a median "
        f"below {result.no_influence:.3f} cannot be told from no influence; no new simulations"
    )
