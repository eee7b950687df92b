"""What each figure shows, as a table for its CSV file: long, a row for each point, units in the names of columns."""

from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from tasks.evaluate import kept_points
from tasks.model import Specimen
from tasks.report.figures import DRAWN, beside
from tasks.report.frames import by_output
from tasks.report.posterior import curves_of
from tasks.simulate import Array


def sobol(result: dict[str, Any]) -> pd.DataFrame:
    """First and total order indices of each objective."""
    keys = ("S1", "S1_conf", "ST", "ST_conf")
    return _by_objective(result, keys)


def importance(result: dict[str, Any]) -> pd.DataFrame:
    """Impurity and permutation importance of each objective."""
    return _by_objective(result, ("impurity_percent", "impurity_sd", "permutation", "permutation_sd"))


def _by_objective(result: dict[str, Any], keys: tuple[str, ...]) -> pd.DataFrame:
    parts = []
    for name, values in by_output(result).items():
        columns = {key: np.array(values[key], dtype=float) for key in keys}
        parts.append(pd.DataFrame({"objective": name, "parameter": result["names"], **columns}))
    return pd.concat(parts, ignore_index=True)


def sobol_convergence(result: dict[str, Any]) -> pd.DataFrame:
    """Indices for each number of base samples."""
    curve, names = result["convergence"], result["names"]
    sizes = np.array(curve["base_samples"])
    columns = {key: np.array(curve[key], dtype=float).ravel() for key in ("ST", "ST_conf")}
    return pd.DataFrame(
        {"base_samples": np.repeat(sizes, len(names)), "parameter": list(names) * sizes.size, **columns}
    )


def sobol_along_time(dataset: xr.Dataset, output: str | None = None) -> pd.DataFrame:
    """Indices of the force, or of an output, at each kept moment of each protocol."""
    prefix = "" if output is None else f"{output}_"
    parts = []
    for dim in sorted(str(name) for name in dataset.dims if str(name).startswith("time_")):
        protocol = dim.removeprefix("time_")
        kind, unit = beside(dataset, protocol, output)
        history = {"time_s": dataset[dim].to_numpy(), f"{kind}_{unit}": dataset[f"{kind}_{protocol}"].to_numpy()}
        for j, name in enumerate(map(str, dataset["parameter"].to_numpy())):
            columns = {"protocol": protocol, "parameter": name, **history}
            columns |= {key: dataset[f"{key}_{prefix}{protocol}"].to_numpy()[j] for key in ("ST", "ST_conf")}
            parts.append(pd.DataFrame(columns))
    return pd.concat(parts, ignore_index=True)


def calibration_convergence(result: dict[str, Any]) -> pd.DataFrame:
    """The lowest objective so far of every specimen and method."""
    parts = [convergence(name, told) for name, told in result["specimens"].items()]
    return pd.concat(parts, ignore_index=True)


def convergence(specimen: str, told: dict[str, Any]) -> pd.DataFrame:
    """The lowest objective so far of one specimen, and how far above its noise that is."""
    parts = []
    for method, found in told["methods"].items():
        used, totals = np.array(found["trace"], dtype=float).reshape(-1, 2).T
        above = 100 * (totals / told["noise_N"] - 1.0) if told["noise_N"] else np.full(totals.size, np.nan)
        columns = {"evaluations": used.astype(int), "objective_N": totals, "above_noise_percent": above}
        parts.append(pd.DataFrame({"specimen": specimen, "method": method, **columns}))
    return pd.concat(parts, ignore_index=True)


def fitted_curves(specimen: Specimen, forces: dict[str, Array]) -> pd.DataFrame:
    """Measured and fitted forces at the points that are drawn."""
    parts = []
    for curve in specimen.curves:
        history, keep = curve.protocol, kept_points(curve.protocol, DRAWN)
        columns = {"time_s": history.time_s, "displacement_mm": history.displacement_mm, "measured_N": curve.force_N}
        columns["model_N"] = forces[curve.name]
        kept = {name: values[keep] for name, values in columns.items()}
        parts.append(pd.DataFrame({"protocol": curve.name, **kept}))
    return pd.concat(parts, ignore_index=True)


def samples(names: list[str], points: Array, totals: Array, calibrated: Array) -> pd.DataFrame:
    """Points ``[n, d]`` of a search with their objectives ``[n]`` (N, none where the model failed), and the end."""
    table = pd.DataFrame(points, columns=names)
    table.insert(0, "point", "sampled")
    table["objective_N"] = np.where(np.isfinite(totals), totals, np.nan)
    end = pd.DataFrame([{"point": "calibrated", **dict(zip(names, calibrated, strict=True))}])
    return pd.concat([table, end], ignore_index=True)


def correlations(found: dict[str, Any]) -> pd.DataFrame:
    """A row for each pair of parameters; no numbers where one does not vary within donors."""
    rows = []
    for pair in found["pairs"]:
        first, second = pair["parameters"]
        numbers = {key: pair.get(key) for key in ("r", "p", "p_holm", "determined")}
        rows.append({"parameter": first, "other": second, **numbers})
    return pd.DataFrame(rows)


def posterior(particles: xr.Dataset, result: dict[str, Any], site: str) -> dict[str, pd.DataFrame]:
    """A table for each of the figures of a site."""
    told = result["sites"][site]
    generations = told["generations"]
    thresholds = {"generation": range(1, len(generations) + 1), "threshold": told["epsilon"]}
    thresholds |= {key: [each[key] for each in generations] for key in ("judged", "accepted")}
    parts = []
    for name in result["names"]:
        found = told["parameters"][name]
        grid, prior, density = curves_of(particles, result, site, name)
        numbers = {"mean": found["mean"], "hdi_low": found["hdi"][0], "hdi_high": found["hdi"][1]}
        columns = {"value": grid, "prior_density": prior, "posterior_density": density}
        parts.append(pd.DataFrame({"parameter": name, **columns, **numbers}))
    joint = pd.DataFrame(particles["parameters"].values[-1], columns=result["names"])
    joint.insert(0, "weight", particles["weight"].values[-1])
    return {"thresholds": pd.DataFrame(thresholds), "marginals": pd.concat(parts, ignore_index=True), "joint": joint}


def prediction(dataset: xr.Dataset, prefix: str = "") -> pd.DataFrame:
    """Every point of the bands of a site: forces (N), or with ``stress_`` the stresses (MPa) of one specimen."""
    dim = f"{prefix}point"
    names = sorted(str(name) for name, values in dataset.variables.items() if values.dims == (dim,))
    first = [name for name in (f"{prefix}specimen", f"{prefix}protocol", f"{prefix}time") if name in names]
    ordered = [*first, *(name for name in names if name not in first)]
    table = pd.DataFrame(
        {name: dataset[name].to_numpy().astype(object if name in first[:2] else float) for name in ordered}
    )
    units = {f"{prefix}time": "time_s", f"{prefix}displacement": "displacement_mm"}
    unit = "MPa" if prefix else "N"
    return table.rename(columns=lambda name: units.get(name, name if name in first else f"{name}_{unit}"))


def separation(result: dict[str, Any]) -> pd.DataFrame:
    """The three panels of a comparison, one below the other: ``x`` and ``y`` as their axes say."""
    parts = []
    for pair in result["pairs"]:
        curve = {"x": pair["roc"]["false_positive"], "y": pair["roc"]["true_positive"]}
        parts.append(pd.DataFrame({"panel": "roc", "series": " / ".join(pair["sites"]), **curve}))
    for site, values in result["densities"]["sites"].items():
        if values is not None:
            curve = {"x": result["densities"]["component"], "y": values}
            parts.append(pd.DataFrame({"panel": "density", "series": site, **curve}))
    named = result["component"]["loadings"]
    parts.append(pd.DataFrame({"panel": "loading", "series": list(named), "x": list(named.values())}))
    return pd.concat(parts, ignore_index=True)


def cells(result: dict[str, Any]) -> pd.DataFrame:
    """Misfit of every cell, for the model as it is and with the effects."""
    rows = []
    for model, found in (("as it is", result["cells"]), (" + ".join(result["shown"]), result.get("after", {}))):
        rows += [{"specimen": name, "model": model, **cell} for name, every in found.items() for cell in every]
    return pd.DataFrame(rows)


def curves(kept: xr.Dataset) -> pd.DataFrame:
    """Measured and modelled forces of a specimen before and after."""
    parts = []
    for dim in sorted(str(name) for name in kept.dims if str(name).startswith("time_")):
        protocol = dim.removeprefix("time_")
        columns = {"protocol": protocol, "time_s": kept[dim].to_numpy()}
        named = (("displacement", "displacement_mm"), ("measured", "measured_N"))
        for kind, name in (*named, ("bare", "as_it_is_N"), ("having", "with_effects_N")):
            if f"{kind}_{protocol}" in kept:
                columns[name] = kept[f"{kind}_{protocol}"].to_numpy()
        parts.append(pd.DataFrame(columns))
    return pd.concat(parts, ignore_index=True)
