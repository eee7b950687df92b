"""How posteriors are shown: as tables and on the console."""

from pathlib import Path

import numpy as np
import pandas as pd
from rich.table import Table as Grid

from sinew.runner.console import Console
from sinew.tasks.calibrate.result import CalibrateResult
from sinew.tasks.infer.abc.result import ENOUGH, AbcResult

FAR_OUT = 0.25  # of the width of an interval: values farther from it than this are far outside
FAR_OFF = 0.5  # of the measured curves: simulations that miss more do not describe them


def table(result: AbcResult) -> pd.DataFrame:
    """Mean, standard deviation and highest density interval by site and parameter."""
    rows = {
        (site, name): {
            "unit": unit,
            "mean": marginal.mean,
            "sd": marginal.sd,
            "hdi_low": marginal.hdi[0],
            "hdi_high": marginal.hdi[1],
            "prior_mean": marginal.prior_mean,
            "prior_sd": marginal.prior_sd,
        }
        for site, posterior in result.sites.items()
        for name, unit in zip(result.names, result.units, strict=True)
        for marginal in [posterior.parameters[name]]
    }
    return pd.DataFrame.from_dict(rows, orient="index").rename_axis(["site", "parameter"])


def headline(result: AbcResult) -> str:
    """What came out, in one line."""
    return f"effective sample sizes: {sizes(result)} particles"


def sizes(result: AbcResult) -> str:
    """The effective sample size of each site, and of how many particles it is."""
    sites = result.sites.items()
    return ", ".join(f"{site} {one.effective_sample_size:.0f} of {one.particles:,}" for site, one in sites)


def beyond_ranges(result: AbcResult, calibration: CalibrateResult | None) -> list[str]:
    """A sentence for each posterior that leaves the range that its parameter had in the calibration."""
    return [] if calibration is None else result.beyond(calibration.free, calibration.bounds)


def apart_from_fits(result: AbcResult, calibration: CalibrateResult | None) -> list[str]:
    """A sentence for each site in which the median of the calibrated values is far from an interval.

    The specimens of a site differ, so single values may be far from it on either side.
    """
    found, known = [], calibration.specimens if calibration is not None else {}
    for site, posterior in result.sites.items():
        fits = [known[one] for one in posterior.specimens if one in known]
        names = []
        for name, marginal in posterior.parameters.items():
            low, high = marginal.hdi
            values = [fit.parameters[name] for fit in fits if name in fit.determined and name in fit.parameters]
            middle = float(np.median(values)) if values else (low + high) / 2.0
            if max(low - middle, middle - high) > FAR_OUT * (high - low):
                names.append(name)
        if names:
            found.append(
                f"{site}: calibrated values of {', '.join(names)} lie far outside the posterior's intervals; trust "
                "neither until you have seen which of them fits the curves"
            )
    return found


def too_short(result: AbcResult) -> str:
    """That some particles are worth fewer of equal weight than were asked for; empty if they are not."""
    if not result.short:
        return ""
    return (
        f"{', '.join(result.short)}: the effective sample size is below the {result.ess:,} that infer.ess asks for; "
        "the ends of intervals depend a little on the seed. A larger infer.population helps."
    )


def far_off(result: AbcResult) -> list[str]:
    """A sentence for each site whose accepted simulations miss what was measured by a large part of it."""
    return [
        f"{site}: accepted simulations differ from the measured curves by up to {100 * one.epsilon[-1]:.0f} % (root "
        "mean square), so the parameters of this posterior do not describe them; look at the calibration first"
        for site, one in result.sites.items()
        if not one.distance_weights and one.epsilon[-1] > FAR_OFF
    ]


def summary(result: AbcResult, folder: Path, console: Console) -> None:
    """Print the posterior of each site, and how its inference went."""
    percent = round(100 * result.interval)
    grid = Grid("parameter", *result.sites, title=f"Posterior: mean ± sd ({percent} % HDI)")
    for name in result.names:
        marginals = [posterior.parameters[name] for posterior in result.sites.values()]
        cells = (f"{m.mean:.4g} ± {m.sd:.3g} ({m.hdi[0]:.4g}, {m.hdi[1]:.4g})" for m in marginals)
        grid.add_row(name, *cells)
    console.print(grid)
    calibration = CalibrateResult.read(folder)
    for remark in (*far_off(result), *beyond_ranges(result, calibration), *apart_from_fits(result, calibration)):
        console.print(remark)
    for site, posterior in result.sites.items():
        console.print(
            f"{site}: {len(posterior.generations)} generations, {posterior.judged:,} proposals, "
            f"threshold {posterior.epsilon[-1]:.3g}, "
            f"effective sample size {posterior.effective_sample_size:.0f} of {posterior.particles:,} particles"
        )
    if words := too_short(result):
        console.print(words)
    if result.few:
        console.print(
            f"{', '.join(result.few)}: below an effective sample size of {ENOUGH}, means and intervals depend on the "
            "seed; infer with a larger population, or by likelihood"
        )
