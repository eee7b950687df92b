"""How posteriors are shown: as tables and on the console."""

from pathlib import Path

import pandas as pd

from sinew.runner.console import Console
from sinew.tasks.infer.method import module
from sinew.tasks.infer.result import Posteriors


def table(result: Posteriors) -> pd.DataFrame:
    """Posterior by site and parameter."""
    found: pd.DataFrame = module(result, "show").table(result)
    return found


def headline(result: Posteriors) -> str:
    """What came out, in one line."""
    return str(module(result, "show").headline(result))


def summary(result: Posteriors, folder: Path, console: Console) -> None:
    """Print the posterior of each site, and how its inference went."""
    module(result, "show").summary(result, folder, console)
