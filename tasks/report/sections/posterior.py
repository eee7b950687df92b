"""Posterior: what is known of each site's parameters after the inference."""

from typing import Any

import numpy as np
import xarray as xr

from tasks.report import plots
from tasks.report.blocks import Block, Plot, Plots, Section, Table, Words, meanings, number, percent, plural
from tasks.report.folder import Found
from tasks.report.posterior import density
from tasks.sites import FEW

GRID = 120  # points of a density


def section(found: Found) -> Section:
    """Everything of ``infer.json``, and the particles of the last generations."""
    title, question = "Posterior", "What is known of each site's parameters, and how surely?"
    result = found.results.get("infer")
    if result is None:
        return Section("posterior", title, question, missing=found.missing("infer"))
    sites = result["sites"]
    sizes = {site: told["effective_sample_size"] for site, told in sites.items()}
    few = [site for site, size in sizes.items() if size < FEW]
    blocks: list[Block] = []
    if few:
        words = f"{', '.join(few)}: the particles are worth fewer than {FEW} of equal weight, which says little of a "
        blocks.append(Words(f"{words}posterior. Infer with a larger population.", "warning"))
    if found.store is not None:
        particles = {site: found.store.read_result(f"infer/{site}") for site in sites}
        blocks.append(_marginals(result, particles))
    blocks += [_table(result), _thresholds(result)]
    narrower = [
        told["sd"] / told["prior_sd"]
        for site in sites.values()
        for told in site["parameters"].values()
        if told["prior_sd"]
    ]
    failed = sum(generation["failed"] for told in sites.values() for generation in told["generations"])
    ends = ", ".join(f"{site} {number(told['epsilon'][-1], 2)}" for site, told in sites.items())
    return Section(
        "posterior", title, question, blocks,
        found=f"{plural(len(sites), 'site')}; posteriors are {number(float(np.median(narrower)), 2)} times as wide as "
        f"the priors (median); last thresholds: {ends}",
        sure="effective sample size " + ", ".join(f"{site} {size:.0f}" for site, size in sizes.items())
        + f" of {result['population']}",
        failed=", ".join(
            ([f"worth few particles: {', '.join(few)}"] if few else [])
            + ([f"{failed:,} proposals failed"] if failed else [])
        ),
    )  # fmt: skip


def _marginals(result: dict[str, Any], particles: dict[str, xr.Dataset]) -> Block:
    names, sites = result["names"], list(result["sites"])
    units = dict(zip(names, result["units"], strict=True))

    def columns(name: str) -> dict[str, Any]:
        j = names.index(name)
        lasts = {
            site: (each["parameters"].values[-1][:, j], each["weight"].values[-1]) for site, each in particles.items()
        }
        low = min(float(values.min()) for values, _ in lasts.values())
        high = max(float(values.max()) for values, _ in lasts.values())
        margin = 0.15 * (high - low) or 1.0
        grid = np.linspace(low - margin, high + margin, GRID)
        told: dict[str, Any] = {"intervals": {"site": [], "mean": [], "sd": [], "low": [], "high": [], "at": []}}
        top = max(float(density(values, weight, grid).max()) for values, weight in lasts.values()) or 1.0
        for k, (site, (values, weight)) in enumerate(lasts.items()):
            found = result["sites"][site]["parameters"][name]
            told[f"density-{k}"] = {"value": grid, "density": density(values, weight, grid)}
            prior = np.exp(-0.5 * ((grid - found["prior_mean"]) / found["prior_sd"]) ** 2)
            told[f"prior-{k}"] = {"value": grid, "density": prior / (found["prior_sd"] * np.sqrt(2 * np.pi))}
            row = {"site": site, "mean": found["mean"], "sd": found["sd"], "low": found["hdi"][0],
                   "high": found["hdi"][1], "at": -0.07 * top * (k + 1)}  # fmt: skip
            for key, value in row.items():
                told["intervals"][key].append(value)
        return told

    def draw(sources: plots.Sources) -> list[Plot]:
        plot = plots.figure("value", "density", height=340)
        entries, told = [], sources["intervals"]
        colours = [plots.colour(k) for k in range(len(sites))]
        for k, site in enumerate(sites):
            prior = plot.line(
                "value", "density", source=sources[f"prior-{k}"], color=colours[k], alpha=0.35, line_width=1
            )
            style = {"color": colours[k], "line_dash": plots.dash(k), "line_width": 2}
            line = plot.line("value", "density", source=sources[f"density-{k}"], **style)
            plots.hover(plot, line, [("site", site), ("value", "@value{0.0000}"), ("density", "@density{0.0000}")])
            entries.append((site, [line, prior]))
        told.add(colours, "colour")
        plot.segment("low", "at", "high", "at", source=told, color="colour", line_width=2)
        dots = plot.scatter("mean", "at", source=told, color="colour", size=8)
        rows = [("site", "@site"), ("mean", "@mean{0.0000} ± @sd{0.0000}"), ("HDI", "@low{0.0000} to @high{0.0000}")]
        plots.hover(plot, dots, rows)
        plots.legend(plot, entries)
        plot.yaxis.visible = False  # the height of a density says nothing, and the intervals have none
        plot.ygrid.visible = False
        return [plots.plot("posterior-density", plot, "Posterior density of the picked parameter by site", wide=True)]

    level = percent(result["interval"])
    caption = (
        f"Densities of the last generation, pale: the prior; below: means and {level} HDI (highest density intervals)."
    )
    told = {name: name + ("" if units[name] == "1" else f" ({units[name]})") for name in names}
    return plots.picked(
        "posterior-parameters", caption, "Parameter", {name: columns(name) for name in names}, draw, told
    )


def _table(result: dict[str, Any]) -> Table:
    sites, level = result["sites"], percent(result["interval"])
    rows = []
    for name, unit, meaning in zip(result["names"], result["units"], meanings(result), strict=True):
        cells = []
        for told in sites.values():
            found = told["parameters"][name]
            low, high = found["hdi"]
            cells.append(f"{number(found['mean'], 4)} ± {number(found['sd'])} ({number(low, 4)} to {number(high, 4)})")
        rows.append([name, "" if unit == "1" else unit, meaning, *cells])
    header = ["parameter", "unit", "what it is", *sites]
    return Table(f"Mean ± standard deviation ({level} HDI)", header, rows, words=(1, 2))


def _thresholds(result: dict[str, Any]) -> Block:
    plot = plots.figure("generation", "threshold (relative distance)", height=260)
    accepted = plots.figure("generation", "proposals accepted (%)", height=260)
    lines: list[tuple[str, list[Any]]] = []
    parts: list[tuple[str, list[Any]]] = []
    for k, (site, told) in enumerate(result["sites"].items()):
        columns = {
            "generation": np.arange(1, len(told["generations"]) + 1),
            "threshold": told["epsilon"],
            "accepted": [100 * each["accepted"] / max(each["judged"], 1) for each in told["generations"]],
            "judged": [each["judged"] for each in told["generations"]],
        }
        source = plots.source(f"thresholds-{k}", columns)
        for drawn, key, entries in ((plot, "threshold", lines), (accepted, "accepted", parts)):
            style = {"color": plots.colour(k), "line_dash": plots.dash(k)}
            line = drawn.line("generation", key, source=source, **style)
            dots = drawn.scatter(
                "generation", key, source=source, color=plots.colour(k), marker=plots.MARKERS[k % 8], size=7
            )
            rows = [("site", site), ("generation", "@generation"), (key, f"@{key}{{0.000}}"), ("judged", "@judged")]
            plots.hover(drawn, dots, rows)
            entries.append((site, [line, dots]))
    longest = max(len(told["generations"]) for told in result["sites"].values())
    for drawn in (plot, accepted):
        drawn.xaxis.ticker = list(range(1, longest + 1, 1 + longest // 12))
    plots.legend(plot, lines)
    plots.legend(accepted, parts)
    both = [plots.plot("posterior-threshold", plot, "Threshold of each generation by site"),
            plots.plot("posterior-accepted", accepted, "Accepted proposals of each generation by site")]  # fmt: skip
    return Plots("posterior-thresholds", "How the inference went.", both)
