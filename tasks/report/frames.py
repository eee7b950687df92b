"""Results as tables: what is in ``TASK.json``, one pandas ``DataFrame`` for each task, with names as its index."""

from typing import Any

import numpy as np
import pandas as pd

Told = dict[str, Any]


def by_output(told: Told) -> dict[str, Told]:
    """What a sensitivity study tells of: all together (``total``), each protocol, each of a template's outputs."""
    return {"total": told, **told["protocols"], **told.get("outputs", {})}


def courses(told: Told) -> dict[str, tuple[str, str | None]]:
    """What there are Sobol indices of along time, by a name: a specimen, and an output (None: the force)."""
    outputs = {None if one["is_force"] else name: name for name, one in told.get("outputs", {}).items()} or {None: ""}
    found = {}
    for specimen in told["tables"]:
        for output, name in outputs.items():
            both = f"{specimen}: {name}" if len(told["tables"]) > 1 else name
            found[both if name else specimen] = (specimen, output)
    return found


def sobol(told: Told) -> pd.DataFrame:
    """Indices and intervals by output (``total``, each protocol, each of a template's outputs) and parameter."""
    return _by_output(told["names"], by_output(told), ("S1", "S1_conf", "ST", "ST_conf"))


def importance(told: Told) -> pd.DataFrame:
    """Importance by output and parameter: impurity in percent, permutation as a loss of R2."""
    return _by_output(
        told["names"], by_output(told), ("impurity_percent", "impurity_sd", "permutation", "permutation_sd")
    )


def calibrate(told: Told) -> pd.DataFrame:
    """A line for each specimen: its parameters, the total RMSE and the noise of its curves (N)."""
    rows = {
        name: {
            **{parameter: one["parameters"][parameter] for parameter in told["names"]},
            "rmse_N": one["total_N"],
            "noise_N": one["noise_N"],
            "above_noise": one["above_noise"],
            "site": one["site"],
            "method": one["method"],
        }
        for name, one in told["specimens"].items()
    }
    return pd.DataFrame.from_dict(rows, orient="index").rename_axis("specimen")


def infer(told: Told) -> pd.DataFrame:
    """Mean, standard deviation and highest-density interval by site and parameter."""
    rows = {
        (site, name): {
            "unit": unit,
            "mean": found["mean"],
            "sd": found["sd"],
            "hdi_low": found["hdi"][0],
            "hdi_high": found["hdi"][1],
            "prior_mean": found["prior_mean"],
            "prior_sd": found["prior_sd"],
        }
        for site, one in told["sites"].items()
        for name, unit in zip(told["names"], told["units"], strict=True)
        for found in [one["parameters"][name]]
    }
    return pd.DataFrame.from_dict(rows, orient="index").rename_axis(["site", "parameter"])


def predict(told: Told) -> pd.DataFrame:
    """Part of the measured points inside each band, by site, of all points and by protocol."""
    sites = {site: one["coverage"] for site, one in told["sites"].items()} | {"all": told["coverage"]}
    rows = {
        (site, band): {"all": found["all"], **found["protocols"]}
        for site, bands in sites.items()
        for band, found in bands.items()
        if found["all"] is not None
    }
    return pd.DataFrame.from_dict(rows, orient="index").rename_axis(["site", "band"])


def compare(told: Told) -> pd.DataFrame:
    """Area under the ROC curve by pair of sites, of the component and of all parameters."""
    rows = {
        tuple(pair["sites"]): {
            **_area(pair, "component"),
            **_area(pair["all_parameters"], "all_parameters"),
            "p_value": pair["all_parameters"]["p_value"],
        }
        for pair in told["pairs"]
    }
    return pd.DataFrame.from_dict(rows, orient="index").rename_axis(["first", "second"])


def discover(told: Told) -> pd.DataFrame:
    """The candidates, the best first: gain of the criterion, part of the misfit explained, gain on held-out data."""
    keys = ("gain", "explained", "held_out", "held_out_error")
    rows = {" + ".join(one["effects"]): {key: one[key] for key in keys} for one in told["candidates"]}
    return pd.DataFrame.from_dict(rows, orient="index", dtype=float).rename_axis("effects")


TABLES = {
    "sobol": sobol,
    "importance": importance,
    "calibrate": calibrate,
    "infer": infer,
    "predict": predict,
    "compare": compare,
    "discover": discover,
}


def headline(task: str, told: Told) -> str:
    """What came out, in one line."""
    if task == "sobol":
        order = np.argsort(-np.nan_to_num(np.array(told["ST"], dtype=float)))[:3]
        most = ", ".join(f"{told['names'][j]} {told['ST'][j]:.2f}" for j in order if told["ST"][j] is not None)
        return f"{told['rows']:,} rows, {told['failed']:,} failed; largest total indices: {most}"
    if task == "importance":
        return f"R2 on unseen base samples {told['r2_on_unseen']:.3f}"
    if task == "calibrate":
        totals = [one["total_N"] for one in told["specimens"].values()]
        return f"{len(totals)} specimens, RMSE {min(totals):.3g} to {max(totals):.3g} N"
    if task == "infer":
        sizes = ", ".join(f"{site} {one['effective_sample_size']:.0f}" for site, one in told["sites"].items())
        return f"{told['population']} particles for each site; effective sample sizes: {sizes}"
    if task == "predict":
        return f"{told['rows']:,} simulations, {told['failed']:,} failed"
    if task == "compare":
        part = 100 * told["component"]["explained_variance"]
        return f"{len(told['sites'])} sites; the component has {part:.0f} % of the variance"
    what = " + ".join(told["effects"]) or " or ".join(told["set"])
    return f"{told['verdict']} {what}".strip() + f": {told['why']}"


def _by_output(names: list[str], outputs: dict[str, Told], keys: tuple[str, ...]) -> pd.DataFrame:
    parts = {
        output: pd.DataFrame({key: np.array(values[key], dtype=float) for key in keys}, index=names)
        for output, values in outputs.items()
    }
    return pd.concat(parts, names=["output", "parameter"])


def _area(found: Told, name: str) -> dict[str, float]:
    low, high = found["interval"]
    return {f"auc_{name}": found["auc"], f"auc_{name}_low": low, f"auc_{name}_high": high}
