"""How elementary effects are shown: as a table and on the console."""

from pathlib import Path

import numpy as np
import pandas as pd
from rich.table import Table as Grid
from rich.text import Text

from sinew.runner.console import Console
from sinew.tasks.morris.result import KEYS, MorrisResult


def table(result: MorrisResult) -> pd.DataFrame:
    """Effects by output (``total``, each protocol) and parameter, in units of the outcome."""
    parts = {
        name: pd.DataFrame({key: getattr(effects, key) for key in KEYS}, index=result.names)
        for name, effects in {"total": result.total, **result.protocols}.items()
    }
    return pd.concat(parts, names=["output", "parameter"])


def headline(result: MorrisResult) -> str:
    """What came out, in one line."""
    most = ", ".join(f"{result.names[j]} {result.mu_star[j]:.3g}" for j in np.argsort(-result.mu_star)[:3])
    return f"{result.trajectories_used} of {result.trajectories} trajectories; largest mu* ({result.unit}): {most}"


def summary(result: MorrisResult, folder: Path, console: Console) -> None:
    """Print the effects on the total objective, the largest first."""
    grid = Grid("parameter", "mu*", "mu", "sigma", title=f"Elementary effects on the {result.objective}")
    for j in np.argsort(-result.mu_star):
        star = f"{result.mu_star[j]:.4g} ± {result.mu_star_conf[j]:.2g}"
        grid.add_row(result.names[j], star, f"{result.mu[j]:.4g}", f"{result.sigma[j]:.4g}")
    console.print(grid)
    console.print(
        f"{round(100 * result.confidence)} % intervals; effects of a parameter's whole range, in {result.unit}; "
        "sigma: how far they depend on the other parameters"
    )
    if result.failed:
        left_out = result.trajectories - result.trajectories_used
        failed = (f"{result.failed:,} of {result.rows:,} rows failed", "red")
        console.print(Text.assemble(failed, f"; {left_out:,} of {result.trajectories:,} trajectories are left out"))
