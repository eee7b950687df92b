"""Sites: whether the posteriors of two sites can be told apart."""

from typing import Any

from tasks.report import plots
from tasks.report.blocks import Block, Plots, Section, Table, Words, number, percent
from tasks.report.folder import Found
from tasks.sites import FEW


def section(found: Found) -> Section:
    """Everything of ``compare.json``."""
    title, question = "Sites", "Can the sites be told apart by their parameters?"
    result = found.results.get("compare")
    if result is None:
        return Section("sites", title, question, missing=found.missing("compare"))
    few = [site for site, told in result["sites"].items() if told["effective_sample_size"] < FEW]
    blocks: list[Block] = [_table(result), _plots(result), Words(f"Mind: {result['note']}.", "note")]
    if few:
        words = f"{', '.join(few)}: too few effective particles to say much. Infer with a larger population."
        blocks.insert(0, Words(words, "warning"))
    pairs = result["pairs"]
    values = [pair["all_parameters"]["p_value"] for pair in pairs]
    told = [f"{a} / {b} {pair['auc']:.2f}" for pair in pairs for a, b in (pair["sites"],)]
    known = [value for value in values if value is not None]
    sure = f"p {', '.join(f'{value:.3f}' for value in known)}" if known else "no p value: too few particles"
    part = percent(result["component"]["explained_variance"])
    return Section(
        "sites", title, question, blocks,
        found=f"AUC along the first component: {', '.join(told)} (0.5: not at all)",
        sure=f"{sure}; the component has {part} of the variance",
        failed=f"too few effective particles: {', '.join(few)}" if few else "",
    )  # fmt: skip


def _area(told: dict[str, Any]) -> str:
    low, high = told["interval"]
    return f"{told['auc']:.2f} ({low:.2f} to {high:.2f})"


def _table(result: dict[str, Any]) -> Table:
    level = percent(result["confidence"])
    rows = [
        [
            " / ".join(pair["sites"]),
            _area(pair),
            _area(pair["all_parameters"]),
            number(pair["all_parameters"]["p_value"]),
        ]
        for pair in result["pairs"]
    ]
    header = ["sites", f"AUC of the component ({level})", f"AUC of all parameters, unseen ({level})", "p"]
    return Table("Areas under the ROC curves", header, rows)


def _plots(result: dict[str, Any]) -> Plots:
    roc = plots.figure("part of the first site above the threshold", "part of the second site above it", height=330)
    entries = []
    for k, pair in enumerate(result["pairs"]):
        name = " / ".join(pair["sites"])
        curve = pair["roc"]
        told = plots.source(f"roc-{k}", {"x": curve["false_positive"], "y": curve["true_positive"]})
        line = roc.line("x", "y", source=told, color=plots.colour(k + 3), line_dash=plots.dash(k), line_width=2)
        plots.hover(roc, line, [("sites", name), ("first", "@x{0.00}"), ("second", "@y{0.00}"), ("AUC", _area(pair))])
        entries.append((f"{name}: {pair['auc']:.2f}", [line]))
    roc.line([0, 1], [0, 1], color=plots.MUTED, line_dash="dotted")
    plots.legend(roc, entries)
    along = plots.figure("first principal component", "density", height=330)
    grid, entries = result["densities"]["component"], []
    for k, (site, values) in enumerate(result["densities"]["sites"].items()):
        if values is not None:
            told = plots.source(f"density-{k}", {"x": grid, "y": values})
            colour = plots.colour(k)
            area = along.varea("x", 0, "y", source=told, color=colour, alpha=0.12)
            line = along.line("x", "y", source=told, color=colour, line_dash=plots.dash(k), line_width=2)
            plots.hover(along, line, [("site", site), ("component", "@x{0.00}"), ("density", "@y{0.000}")])
            entries.append((site, [line, area]))
    if entries:
        plots.legend(along, entries)
    named = result["component"]["loadings"]
    columns = {"parameter": list(named), "loading": list(named.values())}
    loadings = plots.figure("loading on the component", "", height=330, y_range=[*map(plots.plain, named)][::-1])
    bars = loadings.hbar(
        "parameter", right="loading", height=0.7, source=plots.source("loadings", columns), color=plots.MEASURED
    )
    plots.hover(loadings, bars, [("parameter", "@parameter"), ("loading", "@loading{0.00}")])
    drawn = [
        plots.plot("sites-roc", roc, "ROC curves of each pair of sites"),
        plots.plot("sites-densities", along, "Densities of each site along the first component"),
        plots.plot("sites-loadings", loadings, "What the first component is made of"),
    ]
    return Plots("sites-separation", "ROC curves, posteriors along the first component, and its loadings.", drawn)
