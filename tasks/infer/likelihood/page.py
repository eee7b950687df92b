"""Posterior: what is known of each site's population and of its specimens."""

from typing import Any

from sinew.tasks.drawing import plots
from sinew.tasks.drawing.blocks import (
    Block,
    Plot,
    Section,
    Table,
    Words,
    behind,
    number,
    percent,
    plural,
    unit_cell,
    with_its_unit,
)
from sinew.tasks.infer.likelihood.result import LikelihoodResult
from sinew.tasks.infer.likelihood.show import discrepant, misfitting, simulated, undetermined
from sinew.tasks.report.folder import ResultFolder

NAME, TITLE = "posterior", "Posterior"
QUESTION = "What is known of each site's population and of its specimens, and how surely?"


def section(folder: ResultFolder, result: LikelihoodResult) -> Section:
    """Everything of ``infer.json``."""
    blocks: list[Block] = [
        _populations(result),
        _picked(result),
        _specimens(result),
        _misfit(result),
        _convergence(result),
    ]
    wrong = misfitting(result)
    blocks = [*(Words(f"{remark[:1].upper()}{remark[1:]}.", "warning") for remark in wrong), *blocks]
    remarks = [
        *(f"{remark[:1].upper()}{remark[1:]}" for remark in discrepant(result)),
        *undetermined(result),
        *simulated(result),
    ]
    blocks += [Words(f"{remark}.", "note") for remark in remarks]
    sites = result.sites.values()
    sizes = [len(site.specimens) for site in sites]
    name, unit = result.names[0], behind(result.units[0])
    means = "; ".join(
        f"{site} {number(each.population[name].mean)} ({number(each.population[name].low)} to "
        f"{number(each.population[name].high)}){unit}"
        for site, each in result.sites.items()
    )
    worst = max(site.largest_rhat for site in sites)
    return Section(
        NAME, TITLE, QUESTION, blocks,
        found=f"population mean of {name}: {means}; {plural(sum(sizes), 'specimen')}",
        sure=f"smallest effective sample size {min(site.smallest_ess for site in sites):,.0f}, largest R-hat "
        f"{worst:.3f}",
        failed=", ".join(
            ([f"{plural(len(result.misfitting), 'specimen')} not described by the model"] if wrong else [])
            + ([f"not determined by every specimen: {', '.join(result.undetermined)}"] if result.undetermined else [])
        ),
    )  # fmt: skip


def _populations(result: LikelihoodResult) -> Table:
    rows = []
    for name, unit, meaning in zip(result.names, result.units, result.meanings, strict=True):
        cells = []
        for site in result.sites.values():
            each = site.population[name]
            cells.append(f"{number(each.mean, 4)} ({number(each.low, 4)} to {number(each.high, 4)})")
            cells.append(f"{number(each.spread)} ({number(each.spread_low)} to {number(each.spread_high)})")
        rows.append([name, unit_cell(unit), meaning, *cells])
    columns = [f"{site}, {what}" for site in result.sites for what in ("mean", "spread")]
    level = percent(result.interval)
    title = f"Populations: mean, and spread (standard deviation) between specimens, with {level} intervals"
    return Table(title, ["parameter", "unit", "what it is", *columns], rows, words=(1, 2))


def _picked(result: LikelihoodResult) -> Block:
    sites = list(result.sites)

    def draw(sources: plots.Sources) -> list[Plot]:
        plot = plots.figure("value of the picked parameter", "specimen", height=max(260, 60 + 18 * _count(result)))
        source = sources["specimens"]
        plot.segment("low", "at", "high", "at", source=source, color="colour", line_width=2)
        dots = plot.scatter("mean", "at", source=source, color="colour", size=6)
        rows = [("specimen", "@specimen"), ("mean", "@mean{0.0000} ± @sd{0.0000}"),
                ("interval", "@low{0.0000} to @high{0.0000}"), ("determined", "@determined")]  # fmt: skip
        plots.hover(plot, dots, rows)
        means = sources["populations"]
        plot.quad("low", "high", "bottom", "top", source=means, color="colour", alpha=0.2, line_alpha=0)
        plot.segment("mean", "bottom", "mean", "top", source=means, color="colour")
        plot.yaxis.visible = False
        plot.ygrid.visible = False
        return [plots.plot("posterior-specimens", plot, "Specimens and populations of the picked parameter", wide=True)]

    caption = "Dots: specimens with their intervals, site by site; shaded: the population's mean with its interval."
    units = dict(zip(result.names, result.units, strict=True))
    labels = {name: with_its_unit(name, units[name]) for name in result.names}
    data = {name: _columns(result, name, sites) for name in result.names}
    return plots.picked("posterior-parameters", caption, "Parameter", data, draw, labels)


def _count(result: LikelihoodResult) -> int:
    return sum(len(site.specimens) + 1 for site in result.sites.values())


def _columns(result: LikelihoodResult, name: str, sites: list[str]) -> dict[str, Any]:
    """A row for each specimen, from the top, and one for each population."""
    specimens: dict[str, list[Any]] = {
        key: [] for key in ("specimen", "mean", "sd", "low", "high", "determined", "at", "colour")
    }
    populations: dict[str, list[Any]] = {key: [] for key in ("mean", "low", "high", "bottom", "top", "colour")}
    at = 0
    for k, site in enumerate(sites):
        top = at
        for specimen in result.sites[site].specimens:
            each = result.specimens[specimen][name]
            row = (specimen, each.mean, each.sd, each.low, each.high, "yes" if each.determined else "no", -at,
                   plots.colour(k) if each.determined else "#999999")  # fmt: skip
            for key, value in zip(specimens, row, strict=True):
                specimens[key].append(value)
            at += 1
        mean = result.sites[site].population[name]
        bounds = (mean.mean, mean.low, mean.high, -at + 0.4, -top + 0.6, plots.colour(k))
        for key, value in zip(populations, bounds, strict=True):
            populations[key].append(value)
        at += 1
    return {"specimens": specimens, "populations": populations}


def _specimens(result: LikelihoodResult) -> Table:
    rows = []
    for specimen, marginals in result.specimens.items():
        cells = []
        for name in result.names:
            each = marginals[name]
            cells.append(f"{number(each.mean)} ({number(each.low)} to {number(each.high)})"
                         + ("" if each.determined else " *"))  # fmt: skip
        rows.append([specimen, *cells])
    level = percent(result.interval)
    title = f"Specimens: mean ({level} interval); * not determined by the specimen's own curves"
    return Table(title, ["specimen", *result.names], rows, words=(0,))


def _misfit(result: LikelihoodResult) -> Table:
    quantities = ["force", *result.compared] if result.compared else []
    rows = [
        [
            name,
            number(one.bare),
            *([number(one.discrepancy), number(one.left)] if result.discrepancy else []),
            *(number((one.quantities or {}).get(quantity, float("nan"))) for quantity in quantities),
        ]
        for name, one in result.misfit.items()
    ]
    header = ["specimen", "left by the model", *(["discrepancy", "left beside it"] if result.discrepancy else [])]
    header += [f"of {quantity}" for quantity in quantities]
    return Table("What the best fit leaves, in units of the noise (1: nothing but noise)", header, rows, words=(0,))


def _convergence(result: LikelihoodResult) -> Table:
    rows = [
        [site, str(len(each.specimens)), f"{each.sweeps:,}", f"{each.smallest_ess:,.0f}", f"{each.largest_rhat:.3f}"]
        for site, each in result.sites.items()
    ]
    header = ["site", "specimens", "sweeps of each chain", "smallest effective sample size", "largest R-hat"]
    return Table(f"Convergence of {result.chains} chains", header, rows, words=(0,))
