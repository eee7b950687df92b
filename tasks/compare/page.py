"""Sites: whether the posteriors of two sites can be told apart."""

from collections.abc import Sequence
from typing import Any

from sinew.tasks.compare.result import Area, CompareResult, Pair
from sinew.tasks.compare.show import by_chance, interval_text, needed_text
from sinew.tasks.drawing import plots
from sinew.tasks.drawing.blocks import Block, Plots, Section, Table, Words, number, percent
from sinew.tasks.infer.result import FEW
from sinew.tasks.report.folder import ResultFolder
from sinew.tasks.simulate import Array

NAME = "sites"
MEANING = (
    "Specimens needed: how many of each site find a difference as large as the mean in 80 of 100 studies. "
    "Detectable: the smallest difference that as many specimens as there are find in 80 of 100."
)


def section(folder: ResultFolder) -> Section:
    """Everything of ``compare.json``."""
    title, question = "Sites", "Can the sites be told apart by their parameters?"
    result = folder.result(CompareResult)
    if result is None:
        return Section("sites", title, question, missing=folder.missing("compare"))
    few = [site for site, one in result.sites.items() if one.effective_sample_size < FEW]
    blocks: list[Block] = [_table(result), _plots(result), Words(f"Mind: {result.note}.", "note")]
    if result.contrasts:
        chance = by_chance(result)
        words = f"{MEANING} {chance[0].upper()}{chance[1:]}."
        blocks = [_contrasts(result), Words(words, "note"), *blocks]
    if few:
        words = f"{', '.join(few)}: too few effective particles to say much. Infer with a larger population."
        blocks.insert(0, Words(words, "warning"))
    areas = [f"{pair.name} {pair.auc:.2f}" for pair in result.pairs]
    known = [pair.all_parameters.p_value for pair in result.pairs if pair.all_parameters.p_value is not None]
    sure = f"p {', '.join(f'{value:.3f}' for value in known)}" if known else "no p value: too few particles"
    if result.contrasts:
        return Section("sites", title, question, blocks, found=_differences(result), sure=by_chance(result))
    return Section(
        "sites", title, question, blocks,
        found=f"AUC along the first component: {', '.join(areas)} (0.5: not at all)",
        sure=f"{sure}; the component has {percent(result.component.explained_variance)} of the variance",
        failed=f"too few effective particles: {', '.join(few)}" if few else "",
    )  # fmt: skip


def _differences(result: CompareResult) -> str:
    different = [f"{one.parameter} ({' / '.join(one.sites)})" for one in result.contrasts if one.different]
    if not different:
        return "no population differs from another: every interval of a difference of means holds zero"
    return f"population means differ: {', '.join(different)}"


def _contrasts(result: CompareResult) -> Table:
    level = percent(result.confidence)
    rows = [
        [" / ".join(one.sites), one.parameter, interval_text(one.difference), number(one.difference.direction),
         interval_text(one.spread_ratio), needed_text(one), number(one.detectable)]
        for one in result.contrasts
    ]  # fmt: skip
    paired = sorted({" / ".join(one.sites) for one in result.contrasts if one.paired})
    title = "Differences between populations: second site less first"
    header = ["sites", "parameter", f"difference of means ({level})", "direction", f"ratio of spreads ({level})",
              "specimens needed", "detectable"]  # fmt: skip
    return Table(f"{title}; specimens are paired by donor: {', '.join(paired)}" if paired else title, header, rows)


def _area(area: Area) -> str:
    low, high = area.interval
    return f"{area.auc:.2f} ({low:.2f} to {high:.2f})"


def _table(result: CompareResult) -> Table:
    level = percent(result.confidence)
    rows = [
        [pair.name, _area(pair), _area(pair.all_parameters), number(pair.all_parameters.p_value)]
        for pair in result.pairs
    ]
    header = ["sites", f"AUC of the component ({level})", f"AUC of all parameters, unseen ({level})", "p"]
    return Table("Areas under the ROC curves", header, rows)


def _plots(result: CompareResult) -> Plots:
    pairs, more_pairs = plots.first(result.pairs, "pairs")
    sites, more_sites = plots.first(result.densities.shown().items(), "sites")
    drawn = [
        plots.plot("sites-roc", _roc(pairs), "ROC curves of each pair of sites"),
        plots.plot(
            "sites-densities",
            _densities(result.densities.component, sites),
            "Densities of each site along the first component",
        ),
        plots.plot("sites-loadings", _loadings(result), "Loadings of the first component"),
    ]
    words = f"ROC curves, posteriors along the first component, and its loadings.{more_pairs}{more_sites}"
    return Plots("sites-separation", words, drawn)


def _roc(pairs: Sequence[Pair]) -> Any:
    roc = plots.figure("part of the first site above the threshold", "part of the second site above it", height=330)
    entries = []
    for k, pair in enumerate(pairs):
        source = plots.source(f"roc-{k}", {"x": pair.roc.false_positive, "y": pair.roc.true_positive})
        line = roc.line("x", "y", source=source, color=plots.colour(k + 3), line_dash=plots.dash(k), line_width=2)
        rows = [("sites", pair.name), ("first", "@x{0.00}"), ("second", "@y{0.00}"), ("AUC", _area(pair))]
        plots.hover(roc, line, rows)
        entries.append((f"{pair.name}: {pair.auc:.2f}", [line]))
    roc.line([0, 1], [0, 1], color=plots.MUTED, line_dash="dotted")
    plots.legend(roc, entries)
    return roc


def _densities(component: Array, sites: Sequence[tuple[str, Any]]) -> Any:
    along = plots.figure("first principal component", "density", height=330)
    entries = []
    for site, (k, values) in sites:
        source = plots.source(f"density-{k}", {"x": component, "y": values})
        colour = plots.colour(k)
        area = along.varea("x", 0, "y", source=source, color=colour, alpha=0.12)
        line = along.line("x", "y", source=source, color=colour, line_dash=plots.dash(k), line_width=2)
        plots.hover(along, line, [("site", plots.words(site)), ("component", "@x{0.00}"), ("density", "@y{0.000}")])
        entries.append((site, [line, area]))
    if entries:
        plots.legend(along, entries)
    return along


def _loadings(result: CompareResult) -> Any:
    loadings = result.component.loadings
    columns = {"parameter": list(loadings), "loading": list(loadings.values())}
    plot = plots.figure("loading on the component", "", height=330, y_range=[*map(plots.plain, loadings)][::-1])
    source = plots.source("loadings", columns)
    bars = plot.hbar("parameter", right="loading", height=0.7, source=source, color=plots.MEASURED)
    plots.hover(plot, bars, [("parameter", "@parameter"), ("loading", "@loading{0.00}")])
    return plot
