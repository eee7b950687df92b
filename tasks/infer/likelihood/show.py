"""How posteriors by likelihood are shown: as tables and on the console."""

from dataclasses import asdict
from pathlib import Path

import pandas as pd
from rich.table import Table as Grid

from sinew.runner.console import Console
from sinew.tasks.drawing.blocks import behind, plural
from sinew.tasks.infer.likelihood.result import LikelihoodResult


def table(result: LikelihoodResult) -> pd.DataFrame:
    """Mean and spread of each site's population by parameter, with intervals."""
    rows = {
        (site, name): {"unit": unit, **asdict(posterior.population[name])}
        for site, posterior in result.sites.items()
        for name, unit in zip(result.names, result.units, strict=True)
    }
    return pd.DataFrame.from_dict(rows, orient="index").rename_axis(["site", "parameter"])


def headline(result: LikelihoodResult) -> str:
    """What came out, in one line."""
    name, unit = result.names[0], behind(result.units[0])
    means = (
        f"{site} {posterior.population[name].mean:.4g} ({posterior.population[name].low:.4g} to "
        f"{posterior.population[name].high:.4g}){unit}"
        for site, posterior in result.sites.items()
    )
    return f"population mean of {name} with its {round(100 * result.interval)} % interval: {', '.join(means)}"


def misfitting(result: LikelihoodResult) -> list[str]:
    """A sentence of caution where more than noise is left that no discrepancy takes up; none else."""
    found = result.misfitting
    if not found:
        return []
    worst = max(found, key=lambda name: found[name])
    which = "the model and its discrepancy do" if result.discrepancy else "the model does"
    return [
        f"{which} not describe {plural(len(found), 'specimen')} (what is left of {worst} is {found[worst]:.3g} "
        "times the noise): intervals of these posteriors leave that error out, and are too narrow"
    ]


def discrepant(result: LikelihoodResult) -> list[str]:
    """A sentence where posteriors allow for an error of the model; none else."""
    found = result.discrepant if result.discrepancy else {}
    if not found:
        return []
    worst = max(found, key=lambda name: found[name])
    return [
        f"the model alone does not describe {plural(len(found), 'specimen')} (it leaves {found[worst]:.3g} times the "
        f"noise of {worst}): intervals allow for an error of the model as large as that"
    ]


def undetermined(result: LikelihoodResult) -> list[str]:
    """A sentence for each parameter that curves do not determine."""
    found = [f"{name}: no curve depends on it; its posterior is its prior" for name in result.blind]
    for name, specimens in result.undetermined.items():
        of = f"of {len(specimens)} of {len(result.specimens)} specimens" if len(specimens) > 1 else f"of {specimens[0]}"
        found.append(f"{name}: the curves {of} do not say where in its range it is")
    return found


def runs_of_each(result: LikelihoodResult) -> str:
    """How many runs of the simulator the store holds of a specimen, ``388`` or ``379 to 388``."""
    rows = sorted(one.rows for site in result.sites.values() for one in site.runs.values())
    return f"{rows[0]:,}" if rows[0] == rows[-1] else f"{rows[0]:,} to {rows[-1]:,}"


def simulated(result: LikelihoodResult) -> list[str]:
    """A sentence for each site whose simulator takes time; none else."""
    said = []
    for name, site in result.sites.items():
        if not site.runs:
            continue
        one = next(iter(site.runs.values()))
        how = (
            f"the posterior is that of {one.weighted:,} draws that the simulator has weighted"
            if one.weighted
            else f"checked by draws that the simulator has computed, posterior means are off by {one.apart:.2g} "
            "standard deviations at most"
        )
        said.append(f"{name}: chains ran on emulators; {how}")
    return [f"{runs_of_each(result)} runs of the simulator for each specimen", *said] if said else []


def summary(result: LikelihoodResult, folder: Path, console: Console) -> None:
    """Print the population of each site, and how well the chains have converged."""
    percent = round(100 * result.interval)
    grid = Grid("parameter", *result.sites, title=f"Population: mean ({percent} % interval), spread between specimens")
    for name in result.names:
        marginals = [posterior.population[name] for posterior in result.sites.values()]
        cells = (f"{m.mean:.4g} ({m.low:.4g} to {m.high:.4g}), {m.spread:.3g}" for m in marginals)
        grid.add_row(name, *cells)
    console.print(grid)
    for remark in (*misfitting(result), *discrepant(result), *undetermined(result), *simulated(result)):
        console.print(remark)
    for site, posterior in result.sites.items():
        count = plural(len(posterior.specimens), "specimen")
        console.print(
            f"{site}: {count}, {result.chains} chains of {posterior.sweeps:,} sweeps, smallest effective sample size "
            f"{posterior.smallest_ess:,.0f}, largest R-hat {posterior.largest_rhat:.3f}"
        )
