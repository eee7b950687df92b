"""Figures of an inference: how the threshold fell, marginals against the prior, and joint distributions."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib import pyplot as plt
from matplotlib.figure import Figure
from scipy.stats import gaussian_kde

from sinew.runner.store.store import open_store
from sinew.tasks.drawing.blocks import with_its_unit
from sinew.tasks.drawing.figures import COLOURS, STYLE, headline, save, symbol
from sinew.tasks.drawing.views import FigureKind
from sinew.tasks.infer.abc.result import AbcResult, Posterior, stored_particles
from sinew.tasks.simulate import Array
from sinew.tasks.study.workspace import Workspace


def draw(workspace: Workspace, result: AbcResult) -> None:
    """Write all figures, each with its table."""
    folder = workspace.out / "figures"
    for site in result.sites:
        particles = stored_particles(workspace.store, site, result.names)
        tables = figure_tables(particles, result, site)
        for name, figure in figures_of(particles, result, site).items():
            save(figure, folder, f"infer_{site}_{name}", tables[name])


def figure_tables(particles: xr.Dataset, result: AbcResult, site: str) -> dict[str, pd.DataFrame]:
    """A table for each of the figures of a site."""
    posterior = result.sites[site]
    generations = posterior.generations
    thresholds = {
        "generation": range(1, len(generations) + 1),
        "threshold": posterior.epsilon,
        "judged": [each.judged for each in generations],
        "accepted": [each.accepted for each in generations],
    }
    parts = []
    for name in result.names:
        marginal = posterior.parameters[name]
        grid, prior, density = curves_of(particles, result, site, name)
        numbers = {"mean": marginal.mean, "hdi_low": marginal.hdi[0], "hdi_high": marginal.hdi[1]}
        columns = {"value": grid, "prior_density": prior, "posterior_density": density}
        parts.append(pd.DataFrame({"parameter": name, **columns, **numbers}))
    joint = pd.DataFrame(particles["parameters"].values[-1], columns=result.names)
    joint.insert(0, "weight", particles["weight"].values[-1])
    return {"thresholds": pd.DataFrame(thresholds), "marginals": pd.concat(parts, ignore_index=True), "joint": joint}


def _kind(kind: str) -> FigureKind[AbcResult]:
    def draw(result: AbcResult, folder: Path, site: str) -> Figure:
        particles = stored_particles(open_store(folder), site, result.names)
        if kind == "marginals":
            return marginals(particles, result, site)
        if kind == "joint":
            return joint(particles, result.names, site)
        return thresholds(result.sites[site], site)

    return FigureKind(draw, lambda result: list(result.sites))


def figures_of(particles: xr.Dataset, result: AbcResult, site: str) -> dict[str, Figure]:
    """All figures of a site by name; ``particles`` as ``infer/SITE`` in the store."""
    return {
        "thresholds": thresholds(result.sites[site], site),
        "marginals": marginals(particles, result, site),
        "joint": joint(particles, result.names, site),
    }


def thresholds(posterior: Posterior, site: str) -> Figure:
    """Threshold and acceptance rate of each generation."""
    generations = posterior.generations
    at = np.arange(1, len(generations) + 1)
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots(1, 2, figsize=(7.5, 2.6))
        axes[0].plot(at, posterior.epsilon, "o-")
        axes[0].set_ylabel("threshold (relative distance)")
        axes[0].set_ylim(bottom=0)
        axes[1].plot(at, [100 * each.accepted / each.judged for each in generations], "o-", color=COLOURS[1])
        axes[1].set_ylabel("proposals accepted (%)")
        axes[1].set_ylim(bottom=0)
        for axis in axes:
            axis.set_xlabel("generation")
            axis.set_xticks(at)
        headline(figure, site, 10)
    return figure


def marginals(particles: xr.Dataset, result: AbcResult, site: str) -> Figure:
    """Density of each parameter in the last generation over the prior's, with mean and HDI."""
    names, units = result.names, result.units
    columns = 4
    rows = -(-len(names) // columns)
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots(rows, columns, figsize=(9, 1.75 * rows + 0.4), squeeze=False)
        for axis in axes.ravel()[len(names) :]:
            axis.set_axis_off()
        for axis, name, unit in zip(axes.ravel(), names, units, strict=False):
            marginal = result.sites[site].parameters[name]
            grid, prior, posterior = curves_of(particles, result, site, name)
            axis.plot(grid, prior, color="0.6", label="prior")
            axis.plot(grid, posterior, color=COLOURS[0], label="posterior")
            axis.axvspan(*marginal.hdi, color=COLOURS[0], alpha=0.12, lw=0)
            axis.axvline(marginal.mean, color=COLOURS[0], lw=0.8, ls="--")
            axis.set_title(with_its_unit(symbol(name), unit), fontsize=9)
            axis.set_yticks([])
        axes[0, 0].legend(fontsize=7)
        percent = round(100 * result.interval)
        headline(figure, f"{site}: dashed, mean; shaded, {percent} % HDI", 10)
    return figure


def curves_of(particles: xr.Dataset, result: AbcResult, site: str, name: str) -> tuple[Array, Array, Array]:
    """Values of a parameter, and the densities of its prior and of its posterior there, each ``[200]``."""
    values = particles["parameters"].values[-1][:, result.names.index(name)]
    marginal = result.sites[site].parameters[name]
    low, high = (marginal.prior_mean + side * marginal.prior_sd for side in (-2, 2))
    grid = np.linspace(min(values.min(), max(low, 0.0)), max(values.max(), high), 200)
    prior = marginal.prior_density(grid)
    return (
        grid,
        prior / np.trapezoid(prior, grid),
        density(values, particles["weight"].values[-1], grid, marginal.within),
    )


def joint(particles: xr.Dataset, names: list[str], site: str) -> Figure:
    """All pairs of parameters (S3-S5 of Pekedis 2025): particles below the diagonal, their correlation above it.

    All panels are unit squares of one pair of axes: many axes take many seconds.
    """
    values, weight = particles["parameters"].values[-1], particles["weight"].values[-1]
    count = len(names)
    covariance = np.cov(values, rowvar=False, aweights=weight).reshape(count, count)
    scale = np.sqrt(np.diag(covariance))
    correlation = covariance / np.where(np.outer(scale, scale) > 0, np.outer(scale, scale), 1.0)
    low, span = values.min(axis=0), np.ptp(values, axis=0)
    inside = 0.08 + 0.84 * (values - low) / np.where(span > 0, span, 1.0)
    above, below = np.triu_indices(count, 1), np.tril_indices(count, -1)
    shown = np.full((count, count), np.nan)
    shown[above] = correlation[above]
    with plt.rc_context(STYLE):
        side = 0.5 * count + 1.2
        figure, axis = plt.subplots(figsize=(side + 0.8, side))
        colours = axis.pcolormesh(shown, cmap="RdBu_r", vmin=-1, vmax=1)
        for i, j in zip(*above, strict=True):
            ink = "white" if abs(correlation[i, j]) > 0.7 else "black"
            axis.text(j + 0.5, i + 0.5, f"{correlation[i, j]:.2f}", ha="center", va="center", color=ink, fontsize=6)
        across = np.concatenate([inside[:, j] + j for _, j in zip(*below, strict=True)])
        up = np.concatenate([1.0 - inside[:, i] + i for i, _ in zip(*below, strict=True)])
        sizes = np.tile(60 * weight, len(below[0]))
        axis.scatter(across, up, s=sizes, color=COLOURS[0], lw=0, alpha=0.7)
        grid = np.linspace(0.0, 1.0, 60)
        for k in range(count):
            height = density(inside[:, k], weight, grid)
            axis.plot(k + grid, k + 0.95 - 0.85 * height / (height.max() or 1.0), color=COLOURS[1], lw=1)
        axis.set_xticks(np.arange(count) + 0.5, [symbol(name) for name in names])
        axis.set_yticks(np.arange(count) + 0.5, [symbol(name) for name in names])
        axis.hlines(np.arange(count + 1), 0, count, color="0.85", lw=0.5)
        axis.vlines(np.arange(count + 1), 0, count, color="0.85", lw=0.5)
        axis.set_xlim(0, count)
        axis.set_ylim(count, 0)
        axis.tick_params(length=0)
        figure.colorbar(colours, ax=axis, shrink=0.5, label="correlation")
        axis.set_title(f"{site}: particles (size: weight), densities, correlations", loc="left", fontsize=10)
    return figure


def density(values: Array, weight: Array, grid: Array, within: tuple[float, float] = (-np.inf, np.inf)) -> Array:
    """Kernel density ``[g]`` of weighted ``values`` ``[n]`` on ``grid``; zeros where all values are the same.

    What would lie beyond the ends that values are ``within`` is reflected there (Silverman 1986, section 2.10).
    """
    if np.ptp(values) == 0.0:
        return np.zeros(grid.size)
    kernel = gaussian_kde(values, weights=weight)
    found: Array = kernel(grid)
    for end in within:
        if np.isfinite(end):
            found += kernel(2.0 * end - grid)
    return np.where((grid < within[0]) | (grid > within[1]), 0.0, found)


FIGURES: Mapping[str, FigureKind[AbcResult]] = {kind: _kind(kind) for kind in ("marginals", "joint", "thresholds")}
