"""Posterior: what is known of each site's parameters after the inference."""

from typing import Any

import numpy as np
import xarray as xr

from sinew.tasks.calibrate.result import CalibrateResult
from sinew.tasks.drawing import plots
from sinew.tasks.drawing.blocks import (
    Block,
    Plot,
    Plots,
    Section,
    Table,
    Words,
    number,
    percent,
    plural,
    unit_cell,
    with_its_unit,
)
from sinew.tasks.infer.abc.figures import density
from sinew.tasks.infer.abc.result import ENOUGH, AbcResult, check_weights, particles_group
from sinew.tasks.infer.abc.show import apart_from_fits, beyond_ranges, far_off, sizes, too_short
from sinew.tasks.report.folder import ResultFolder, read_results

NAME, TITLE = "posterior", "Posterior"
QUESTION = "What is known of each site's parameters, and how surely?"
GRID = 120  # points of a density
AS_WIDE = 0.95  # from which ratio of their widths on a posterior is called as wide as its prior


def section(folder: ResultFolder, result: AbcResult) -> Section:
    """Everything of ``infer.json``, and the particles of the last generations."""
    sites = result.sites
    blocks: list[Block] = []
    if result.few:
        words = f"{', '.join(result.few)}: the particles are worth fewer than {ENOUGH} of equal weight, so means and "
        words += "intervals depend on the seed. Infer with a larger population, or by likelihood."
        blocks.append(Words(words, "warning"))
    far = far_off(result)
    blocks += [Words(f"{remark}.", "warning") for remark in far]
    if words := too_short(result):
        blocks.append(Words(words, "note"))
    if folder.store is not None:
        groups = [particles_group(site) for site in sites]
        particles = dict(zip(sites, read_results(folder.store, groups, parameter=result.names), strict=True))
        for site, kept in particles.items():
            check_weights(folder.store, site, kept)
        blocks.append(_marginals(result, particles))
    blocks += [_table(result), _thresholds(result)]
    beyond = beyond_ranges(result, folder.result(CalibrateResult))
    apart = apart_from_fits(result, folder.result(CalibrateResult))
    blocks += [Words(f"{remark}.", "warning") for remark in (*beyond, *apart)]
    failed = sum(generation.failed for posterior in sites.values() for generation in posterior.generations)
    ends = ", ".join(f"{site} {number(posterior.epsilon[-1], 2)}" for site, posterior in sites.items())
    return Section(
        NAME, TITLE, QUESTION, blocks,
        found=f"{plural(len(sites), 'site')}; posteriors are {_narrowed(result)} the priors (median); "
        f"last thresholds: {ends}",
        sure=f"effective sample size {sizes(result)} particles",
        failed=", ".join(
            ([f"worth few particles: {', '.join(result.few)}"] if result.few else [])
            + (["far from the measured curves"] if far else [])
            + ([f"{plural(len(beyond), 'interval')} beyond the study's ranges"] if beyond else [])
            + ([f"{failed:,} proposals failed"] if failed else [])
        ),
    )  # fmt: skip


def _narrowed(result: AbcResult) -> str:
    ratio = _narrowing(result)
    return "as wide as" if AS_WIDE < ratio < 1.0 / AS_WIDE else f"{number(ratio, 2)} times as wide as"


def _narrowing(result: AbcResult) -> float:
    """The median ratio of posterior to prior standard deviations over all parameters and sites."""
    marginals = [each for posterior in result.sites.values() for each in posterior.parameters.values()]
    return float(np.median([each.sd / each.prior_sd for each in marginals if each.prior_sd]))


def _marginals(result: AbcResult, particles: dict[str, xr.Dataset]) -> Block:
    names = result.names
    sites, more = plots.first(result.sites, "sites")
    particles = {site: particles[site] for site in sites}
    units = dict(zip(names, result.units, strict=True))

    def draw(sources: plots.Sources) -> list[Plot]:
        plot = plots.figure("value of the picked parameter", "density", height=340)
        entries, intervals = [], sources["intervals"]
        colours = [plots.colour(k) for k in range(len(sites))]
        for k, site in enumerate(sites):
            prior = plot.line(
                "value", "density", source=sources[f"prior-{k}"], color=colours[k], alpha=0.35, line_width=1
            )
            style = {"color": colours[k], "line_dash": plots.dash(k), "line_width": 2}
            line = plot.line("value", "density", source=sources[f"density-{k}"], **style)
            plots.hover(
                plot, line, [("site", plots.words(site)), ("value", "@value{0.0000}"), ("density", "@density{0.0000}")]
            )
            entries.append((site, [line, prior]))
        intervals.add(colours, "colour")
        plot.segment("low", "at", "high", "at", source=intervals, color="colour", line_width=2)
        dots = plot.scatter("mean", "at", source=intervals, color="colour", size=8)
        rows = [("site", "@site"), ("mean", "@mean{0.0000} ± @sd{0.0000}"), ("HDI", "@low{0.0000} to @high{0.0000}")]
        plots.hover(plot, dots, rows)
        plots.legend(plot, entries)
        plot.yaxis.visible = False  # the height of a density says nothing, and the intervals have none
        plot.ygrid.visible = False
        return [plots.plot("posterior-density", plot, "Posterior density of the picked parameter by site", wide=True)]

    level = percent(result.interval)
    caption = (
        f"Densities of the last generation, pale: the prior; below: means and {level} HDI (highest density intervals)."
        f"{more}"
    )
    labels = {name: with_its_unit(name, units[name]) for name in names}
    data = {name: _columns(result, particles, name) for name in names}
    return plots.picked("posterior-parameters", caption, "Parameter", data, draw, labels)


def _columns(result: AbcResult, particles: dict[str, xr.Dataset], name: str) -> dict[str, Any]:
    """Densities of one parameter by site, and a row of mean and interval for each site below them."""
    j = result.names.index(name)
    lasts = {site: (each["parameters"].values[-1][:, j], each["weight"].values[-1]) for site, each in particles.items()}
    low = min(float(values.min()) for values, _ in lasts.values())
    high = max(float(values.max()) for values, _ in lasts.values())
    margin = 0.15 * (high - low) or 1.0
    grid = np.linspace(low - margin, high + margin, GRID)
    intervals: dict[str, list[Any]] = {"site": [], "mean": [], "sd": [], "low": [], "high": [], "at": []}
    columns: dict[str, Any] = {"intervals": intervals}
    marginals = {site: result.sites[site].parameters[name] for site in lasts}
    densities = {
        site: density(values, weight, grid, marginals[site].within) for site, (values, weight) in lasts.items()
    }
    top = max(float(each.max()) for each in densities.values()) or 1.0
    for k, (site, marginal) in enumerate(marginals.items()):
        columns[f"density-{k}"] = {"value": grid, "density": densities[site]}
        columns[f"prior-{k}"] = {"value": grid, "density": marginal.prior_density(grid)}
        row = {"site": site, "mean": marginal.mean, "sd": marginal.sd, "low": marginal.hdi[0],
               "high": marginal.hdi[1], "at": -0.07 * top * (k + 1)}  # fmt: skip
        for key, value in row.items():
            intervals[key].append(value)
    return columns


def _table(result: AbcResult) -> Table:
    rows = []
    for name, unit, meaning in zip(result.names, result.units, result.meanings, strict=True):
        cells = []
        for posterior in result.sites.values():
            marginal = posterior.parameters[name]
            low, high = (number(bound, 4) for bound in marginal.hdi)
            cells.append(f"{number(marginal.mean, 4)} ± {number(marginal.sd)} ({low} to {high})")
        rows.append([name, unit_cell(unit), meaning, *cells])
    header = ["parameter", "unit", "what it is", *result.sites]
    return Table(f"Mean ± standard deviation ({percent(result.interval)} HDI)", header, rows, words=(1, 2))


def _thresholds(result: AbcResult) -> Block:
    plot = plots.figure("generation", "threshold (relative distance)", height=260)
    accepted = plots.figure("generation", "proposals accepted (%)", height=260)
    lines: list[tuple[str, list[Any]]] = []
    parts: list[tuple[str, list[Any]]] = []
    sites, more = plots.first(result.sites.items(), "sites")
    for k, (site, posterior) in enumerate(sites):
        columns = {
            "generation": np.arange(1, len(posterior.generations) + 1),
            "threshold": posterior.epsilon,
            "accepted": [100 * each.accepted / max(each.judged, 1) for each in posterior.generations],
            "judged": [each.judged for each in posterior.generations],
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
    longest = max(len(posterior.generations) for _, posterior in sites)
    for drawn in (plot, accepted):
        drawn.xaxis.ticker = list(range(1, longest + 1, 1 + longest // 12))
    plots.legend(plot, lines)
    plots.legend(accepted, parts)
    both = [plots.plot("posterior-threshold", plot, "Threshold of each generation by site"),
            plots.plot("posterior-accepted", accepted, "Accepted proposals of each generation by site")]  # fmt: skip
    return Plots("posterior-thresholds", f"How the inference went.{more}", both)
