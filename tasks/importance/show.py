"""How random forest importance is shown: as tables and on the console."""

from pathlib import Path

import numpy as np
import pandas as pd
from rich.table import Table as Grid

from sinew.runner.console import Console
from sinew.tasks.importance.result import KEYS, ImportanceResult


def table(result: ImportanceResult) -> pd.DataFrame:
    """Importance by output and parameter: impurity in percent, permutation as a loss of R2."""
    parts = {
        name: pd.DataFrame({key: getattr(values, key) for key in KEYS}, index=result.names)
        for name, values in result.by_output().items()
    }
    return pd.concat(parts, names=["output", "parameter"])


def headline(result: ImportanceResult) -> str:
    """What came out, in one line."""
    return f"R2 on unseen base samples {result.r2_on_unseen:.3f}"


def summary(result: ImportanceResult, folder: Path, console: Console) -> None:
    """Print the importance of each parameter for the total objective."""
    grid = Grid("parameter", "impurity (%)", "permutation", title=f"Random forest importance, {result.objective}")
    for j in np.argsort(-result.permutation):
        grid.add_row(
            result.names[j],
            f"{result.impurity_percent[j]:.1f} ± {result.impurity_sd[j]:.1f}",
            f"{result.permutation[j]:.4f} ± {result.permutation_sd[j]:.4f}",
        )
    console.print(grid)
    console.print(f"R2 on unseen base samples {result.r2_on_unseen:.3f}; no new simulations")
