"""How comparisons of sites are shown: as tables and on the console."""

from pathlib import Path

import pandas as pd
from rich.table import Column
from rich.table import Table as Grid
from rich.text import Text

from sinew.runner.console import Console
from sinew.tasks.compare.result import Area, CompareResult, Contrast, Interval
from sinew.tasks.infer.result import FEW


def table(result: CompareResult) -> pd.DataFrame:
    """Area under the ROC curve by pair of sites, of the component and of all parameters."""
    rows = {
        tuple(pair.sites): {
            **_area_columns(pair, "component"),
            **_area_columns(pair.all_parameters, "all_parameters"),
            "p_value": pair.all_parameters.p_value,
        }
        for pair in result.pairs
    }
    return pd.DataFrame.from_dict(rows, orient="index").rename_axis(["first", "second"])


def _area_columns(area: Area, name: str) -> dict[str, float]:
    low, high = area.interval
    return {f"auc_{name}": area.auc, f"auc_{name}_low": low, f"auc_{name}_high": high}


def contrast_table(result: CompareResult) -> pd.DataFrame:
    """One row for each pair of sites and parameter: differences of means, ratios of spreads, and power."""
    rows = []
    for one in result.contrasts:
        row = {"first": one.sites[0], "second": one.sites[1], "parameter": one.parameter, "paired": one.paired}
        for name, part in (("difference", one.difference), ("spread_ratio", one.spread_ratio)):
            row |= {name: part.mean, f"{name}_low": part.low, f"{name}_high": part.high}
            row |= {f"{name}_direction": part.direction}
        rows.append(row | {"needed": one.needed, "detectable": one.detectable})
    return pd.DataFrame(rows).astype({"needed": "Int64"} if rows else {})


def by_chance(result: CompareResult) -> str:
    """How many of the contrasts would be called different if there were no differences."""
    expected = (1 - result.confidence) * len(result.contrasts)
    return f"of {len(result.contrasts)} contrasts about {expected:.0f} would be called different by chance"


def headline(result: CompareResult) -> str:
    """What came out, in one line."""
    if result.contrasts:
        different = [one for one in result.contrasts if one.different]
        return f"{len(result.sites)} sites; {len(different)} of {len(result.contrasts)} contrasts are different"
    share = 100 * result.component.explained_variance
    return f"{len(result.sites)} sites; the component has {share:.0f} % of the variance"


def separation_table(result: CompareResult) -> pd.DataFrame:
    """The three panels of the figure, one below the other: ``x`` and ``y`` are what their axes say."""
    parts = []
    for pair in result.pairs:
        curve = {"x": pair.roc.false_positive, "y": pair.roc.true_positive}
        parts.append(pd.DataFrame({"panel": "roc", "series": pair.name, **curve}))
    for site, (_, values) in result.densities.shown().items():
        curve = {"x": result.densities.component, "y": values}
        parts.append(pd.DataFrame({"panel": "density", "series": site, **curve}))
    loadings = result.component.loadings
    parts.append(pd.DataFrame({"panel": "loading", "series": list(loadings), "x": list(loadings.values())}))
    return pd.concat(parts, ignore_index=True)


def summary(result: CompareResult, folder: Path, console: Console) -> None:
    """Print the contrasts that are different, and the areas under the ROC curves by pair of sites."""
    percent = round(100 * result.confidence)
    if result.contrasts:
        _contrasts(result, percent, console)
    columns = (f"AUC of the component ({percent} %)", f"of all parameters, unseen ({percent} %)", "p")
    grid = Grid(
        Column("sites", overflow="fold"), *columns, title="How well posteriors can be told apart (0.5: not at all)"
    )
    for pair in result.pairs:
        p = pair.all_parameters.p_value
        areas = (area_text(pair), area_text(pair.all_parameters))
        grid.add_row(pair.name, *areas, "" if p is None else f"{p:.3f}")
    console.print(grid)
    for site, one in result.sites.items():
        if one.effective_sample_size < FEW:
            few = f"{site}: {one.particles} particles are worth {one.effective_sample_size:.1f} of equal weight"
            words = ", which says little of a posterior: infer with a larger population"
            console.print(Text.assemble((few, "red"), words))
    share = 100 * result.component.explained_variance
    console.print(f"the component has {share:.0f} % of the variance; {result.note}")


def _contrasts(result: CompareResult, percent: int, console: Console) -> None:
    names = ("sites", "parameter", f"difference of means ({percent} %)", "direction", "specimens of each site needed")
    grid = Grid(*names, title="Populations that differ (second site less first)")
    different = [one for one in result.contrasts if one.different]
    for one in different:
        grid.add_row(" / ".join(one.sites), one.parameter, interval_text(one.difference),
                     f"{one.difference.direction:.3f}", needed_text(one))  # fmt: skip
    if different:
        console.print(grid)
    console.print(f"{headline(result)}; {by_chance(result)}. All of them: compare.csv")


def interval_text(part: Interval) -> str:
    """A mean with its interval."""
    return f"{part.mean:.3g} ({part.low:.3g} to {part.high:.3g})"


def needed_text(one: Contrast) -> str:
    """How many specimens of each site a difference needs."""
    return "more than 1,000" if one.needed is None else str(one.needed)


def area_text(area: Area) -> str:
    """An area under an ROC curve with its interval."""
    low, high = area.interval
    return f"{area.auc:.2f} ({low:.2f}, {high:.2f})"
