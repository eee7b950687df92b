"""How calibrations are shown: as tables and on the console."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from rich.table import Column
from rich.table import Table as Grid

from sinew.runner.console import Console
from sinew.tasks.calibrate.result import CalibrateResult, Correlations, SpecimenFit
from sinew.tasks.drawing.blocks import listed, plural, span, times
from sinew.tasks.drawing.formats import DRAWN
from sinew.tasks.drawing.matrix import print_matrix
from sinew.tasks.drawing.thinning import drawn_points
from sinew.tasks.model import Specimen
from sinew.tasks.simulate import Array
from sinew.tasks.simulate.series import with_unit


def table(result: CalibrateResult) -> pd.DataFrame:
    """A line for each specimen: its parameters, the total RMSE and the noise of its curves (N)."""
    rows = {
        name: {
            **{parameter: fit.parameters[parameter] for parameter in result.names},
            "rmse_N": fit.total_N,
            "noise_N": fit.noise_N,
            **({} if fit.quantities is None else {**fit.sums(), "objective": fit.objective}),
            "above_noise": fit.above_noise,
            "site": fit.site,
            "method": fit.method,
        }
        for name, fit in result.specimens.items()
    }
    return pd.DataFrame.from_dict(rows, orient="index").rename_axis("specimen")


def headline(result: CalibrateResult) -> str:
    """What came out, in one line."""
    fits = list(result.specimens.values())
    name = "RMSE" if fits[0].objective is None else "objective"
    return f"{plural(len(fits), 'specimen')}, {name} {in_words([fit.total for fit in fits], fits)}"


def in_words(totals: Sequence[float], fits: Sequence[SpecimenFit]) -> str:
    """Total objectives of fits: ``3.1 to 3.3 N``, or of several quantities ``6.1 (noise alone: 6)``."""
    floors = [fit.floor for fit in fits if fit.floor is not None]
    compared = floors and any(fit.objective is not None for fit in fits)
    return f"{span(totals)}{fits[0].behind}" + (f" (noise alone: {span(floors)})" if compared else "")


def often_on_bound(result: CalibrateResult) -> str:
    """Which parameters are often on a bound; empty where there are none."""
    names = ", ".join(result.often_on_bound)
    often = " in half of the specimens or more" if len(result.specimens) > 1 else ""
    where = f"Determined by the curves, and at an end of their range{often}"
    return f"{where}: {names}." if names else ""


def bound_advice(result: CalibrateResult) -> str:
    """What to do about parameters that are often on a bound; empty where there are none."""
    names = result.often_on_bound
    if not names:
        return ""
    zero = [name for name in names if result.often_at_zero(name)]
    sentences = [often_on_bound(result)]
    if len(zero) < len(names):
        widen = listed([name for name in names if name not in zero], len(names))
        sentences.append(
            f"Widen the range of {widen} (model.parameters in the study file) where it is a guess; where it is "
            "certain, the model lacks something."
        )
    if zero:
        where = "at or near 0, the lower end of its range"
        sentences.append(f"{', '.join(zero)}: {where}: the model fits as well without it.")
    return " ".join(sentences)


def unfinished(result: CalibrateResult) -> str:
    """Which searches were cut short, and what that means; empty where none was."""
    names = [name for name, fit in result.specimens.items() if fit.unfinished]
    if not names:
        return ""
    return (
        f"The search had used up its evaluations before it converged in {listed(names)}: parameters may be farther "
        "from the best ones than their standard deviations say. Raise calibrate.evaluations."
    )


def searches_table(result: CalibrateResult) -> pd.DataFrame:
    """The lowest objective so far of every specimen and method."""
    parts = [convergence_table(name, fit) for name, fit in result.specimens.items()]
    return pd.concat(parts, ignore_index=True)


def convergence_table(specimen: str, fit: SpecimenFit) -> pd.DataFrame:
    """The lowest objective so far of one specimen, and how far above its noise that is."""
    parts = []
    for method, found in fit.methods.items():
        used, totals = found.steps.T
        above = 100 * (totals / fit.floor - 1.0) if fit.floor else np.full(totals.size, np.nan)
        objective = "objective_N" if fit.objective is None else "objective"
        columns = {"evaluations": used.astype(int), objective: totals, "above_noise_percent": above}
        parts.append(pd.DataFrame({"specimen": specimen, "method": method, **columns}))
    return pd.concat(parts, ignore_index=True)


def curves_table(specimen: Specimen, forces: dict[str, Array]) -> pd.DataFrame:
    """Measured and fitted forces at the points that are drawn."""
    parts = []
    for curve in specimen.curves:
        history = curve.protocol
        keep = drawn_points(history, curve.force_N, forces[curve.name], count=DRAWN)
        columns = {"time_s": history.time_s, "displacement_mm": history.displacement_mm, "measured_N": curve.force_N}
        columns["model_N"] = forces[curve.name]
        kept = {name: values[keep] for name, values in columns.items()}
        parts.append(pd.DataFrame({"protocol": curve.name, **kept}))
    return pd.concat(parts, ignore_index=True)


def quantity_table(specimen: Specimen, name: str, unit: str, courses: dict[str, Array]) -> pd.DataFrame:
    """A quantity that is compared beside the force, measured and fitted, at the points at which it was measured."""
    parts = []
    for curve in specimen.curves:
        seen = curve.others[name]
        there, history = np.flatnonzero(np.isfinite(seen)), curve.protocol
        columns = {"time_s": history.time_s, "displacement_mm": history.displacement_mm}
        columns |= {with_unit(f"measured_{name}", unit): seen, with_unit(f"model_{name}", unit): courses[curve.name]}
        kept = {title: values[there] for title, values in columns.items()}
        parts.append(pd.DataFrame({"protocol": curve.name, **kept}))
    return pd.concat(parts, ignore_index=True)


def samples_table(
    names: list[str], points: Array, totals: Array, calibrated: Array, ending: str = "_N"
) -> pd.DataFrame:
    """Points ``[n, d]`` of a search with their objectives ``[n]`` (N, none where the model failed), and the end.

    ``ending``: of the objective's column, empty where it is not in newton.
    """
    table = pd.DataFrame(points, columns=names)
    table.insert(0, "point", "sampled")
    table[f"objective{ending}"] = np.where(np.isfinite(totals), totals, np.nan)
    end = pd.DataFrame([{"point": "calibrated", **dict(zip(names, calibrated, strict=True))}])
    return pd.concat([table, end], ignore_index=True)


def correlations_table(found: Correlations) -> pd.DataFrame:
    """A row for each pair of parameters; no numbers where one does not vary within donors."""
    rows = []
    for pair in found.pairs:
        first, second = pair.parameters
        numbers = {"r": pair.r, "p": pair.p, "p_holm": pair.p_holm, "determined": pair.determined}
        rows.append({"parameter": first, "other": second, **numbers})
    return pd.DataFrame(rows)


def summary(result: CalibrateResult, folder: Path, console: Console) -> None:
    """Print how far each fit stopped above the noise, and what it does not determine."""
    others = [name.removeprefix("rmse_") for name in next(iter(result.specimens.values())).sums()]
    grid = Grid(
        Column("specimen", overflow="fold"),
        "sum of RMSEs (N)",
        "sum of noise (N)",
        *(["objective"] if others else []),
        "RMSE / noise",
        "on a bound",
        "not determined",
        title="Calibration",
    )
    for name, fit in result.specimens.items():
        noise = "unknown" if fit.noise_N is None else f"{fit.noise_N:.4g}"
        more = [f"{fit.total:.4g}"] if others else []
        cells = (
            f"{fit.total_N:.4g}",
            noise,
            *more,
            times(fit.above_noise),
            listed(fit.on_bound, 3),
            listed(result.not_determined(fit), 3),
        )
        grid.add_row(name, *cells)
    console.print(grid)
    console.print("RMSEs and noise are summed over protocols; RMSE / noise is their ratio, 1 for a perfect fit")
    if others:
        sums = [list(fit.sums().values()) for fit in result.specimens.values()]
        print_matrix(
            console,
            "RMSE of each quantity, summed over protocols",
            ("specimen", list(result.specimens)),
            ("quantity", others),
            lambda i, k: f"{sums[i][k]:.4g}",
        )
        console.print(
            "objective: the sum of RMSE / noise over protocols and quantities; the ratio is that of objectives"
        )
    for words in filter(None, (unfinished(result), bound_advice(result))):
        console.print(words)
