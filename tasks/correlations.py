"""What the calibrated parameters of a cohort have in common: repeated-measures correlations, and a table by site.

A donor's specimens are not independent. The correlation of Bakdash and Marusich (2017,
https://doi.org/10.3389/fpsyg.2017.00456) is that within donors: one slope for all, an intercept for each.

Calibrations make such correlations hard to read, for reasons that have nothing to do with tissue: parameters that stop
on a bound in many specimens vary by jumps; a parameter that the curves do not determine (Poisson's ratio) stops where
the optimiser left it; and where two are confounded in the fit of one specimen, their errors correlate across specimens.
All pairs are reported, and those are marked of which a parameter is determined in fewer than half of the specimens.
"""

import csv
import io
import warnings
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from tasks.model import Parameter
from tasks.simulate import Array

Specimens = Mapping[str, Mapping[str, Any]]
DONORS = 3  # the fewest that leave degrees of freedom to test with
STILL = 1e-3  # of a parameter's range: two values nearer than this to each other are one (both on a bound)
MOSTLY = 0.5  # of the specimens


def correlations(specimens: Specimens, parameters: Sequence[Parameter]) -> dict[str, Any]:
    """Correlation within donors, across sites, of every pair of free ``parameters``.

    ``specimens`` as in ``calibrate.json``. Donors with specimens of one site only are left out. Gives ``pairs``, each
    ``parameters``, ``r``, ``dof``, ``p``, ``p_holm`` (adjusted for the number of pairs that have a number, by Holm's
    method), ``interval`` (95 %) and ``determined``, or a ``reason`` in place of numbers. When nothing can be said of
    any pair, the ``reason`` is all there is.
    """
    sites = {told["site"] for told in specimens.values()} - {None}
    if len(sites) < 2:
        return {"reason": "specimens of fewer than two sites"}
    if not any(told["donor"] is not None for told in specimens.values()):
        return {"reason": "donors are not known"}
    used = _repeated(specimens)
    donors = sorted({told["donor"] for told in used})
    if len(donors) < DONORS:
        return {"reason": f"{len(donors)} donors have specimens of two sites or more, at least {DONORS} are needed"}
    names = [parameter.name for parameter in parameters]
    values = pd.DataFrame([{name: told["parameters"][name] for name in names} for told in used], dtype=float)
    values["donor"] = [str(told["donor"]) for told in used]
    share = {name: float(np.mean([name in told["determined"] for told in used])) for name in names}
    still = {parameter.name for parameter in parameters if not _varies(values, parameter)}
    pairs = [
        {
            "parameters": [first, second],
            **_correlated(values, first, second, still),
            "determined": min(share[first], share[second]) >= MOSTLY,
        }
        for number, first in enumerate(names)
        for second in names[number + 1 :]
    ]
    tested = [pair for pair in pairs if "p" in pair]
    for pair, adjusted in zip(tested, _holm([pair["p"] for pair in tested]), strict=True):
        pair["p_holm"] = adjusted
    return {
        "sites": sorted({told["site"] for told in used}),
        "donors": donors,
        "specimens": len(used),
        "names": names,
        "determined": share,
        "tests": len(tested),
        "pairs": pairs,
    }


def _repeated(specimens: Specimens) -> list[Mapping[str, Any]]:
    """Specimens of the donors that were measured at two sites or more."""
    sites: dict[str, set[str]] = {}
    for told in specimens.values():
        if told["donor"] is not None and told["site"] is not None:
            sites.setdefault(told["donor"], set()).add(told["site"])
    known = [told for told in specimens.values() if told["site"] is not None]
    return [told for told in known if len(sites.get(told["donor"], ())) > 1]


def _varies(values: pd.DataFrame, parameter: Parameter) -> bool:
    within = values.groupby("donor")[parameter.name]
    spread = within.max() - within.min()
    return bool(spread.max() > STILL * (parameter.maximum - parameter.minimum))


def _correlated(values: pd.DataFrame, first: str, second: str, still: set[str]) -> dict[str, Any]:
    unvaried = [name for name in (first, second) if name in still]
    if unvaried:
        return {"reason": f"{' and '.join(unvaried)} {'does' if len(unvaried) == 1 else 'do'} not vary within donors"}
    import pingouin  # here, because it takes seconds to import, which no other task needs to wait for

    with warnings.catch_warnings(), np.errstate(divide="ignore"):  # a correlation of 1 leaves no error to divide by
        warnings.filterwarnings("ignore", "The inplace keyword in DataFrame", DeprecationWarning)  # pingouin 0.7
        warnings.filterwarnings("ignore", "Sample size is too small to estimate power", UserWarning)  # not used here
        found = pingouin.rm_corr(values, x=first, y=second, subject="donor").iloc[0]
        # rm_corr itself rounds the interval to two digits
        low, high = pingouin.compute_esci(stat=found["r"], nx=found["dof"] + 2, eftype="pearson", decimals=12)
    numbers = {"r": float(found["r"]), "dof": int(found["dof"]), "p": float(found["pval"])}
    return {**numbers, "interval": [float(low), float(high)]}


def _holm(p: list[float]) -> list[float]:
    import pingouin

    return [float(each) for each in pingouin.multicomp(p, method="holm")[1]] if p else []


def sites_table(specimens: Specimens, parameters: Sequence[Parameter]) -> str:
    """``calibrate_sites.csv``: mean and sample standard deviation of each of ``parameters`` by site, a line for each.

    The deviation is left empty where a site has one specimen. ``on_bound`` and ``determined`` count specimens. The
    total RMSE of the fits is there as a parameter, ``rmse_N``. Specimens without a site share an empty name.
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["site", "parameter", "unit", "specimens", "mean", "sd", "on_bound", "determined"])
    for site in dict.fromkeys(told["site"] for told in specimens.values()):
        here = [told for told in specimens.values() if told["site"] == site]
        for parameter in parameters:
            name = parameter.name
            counts = [sum(name in told[key] for told in here) for key in ("on_bound", "determined")]
            numbers = _mean_and_sd(told["parameters"][name] for told in here)
            writer.writerow([site or "", name, parameter.unit, len(here), *numbers, *counts])
        writer.writerow([site or "", "rmse_N", "N", len(here), *_mean_and_sd(t["total_N"] for t in here), "", ""])
    return text.getvalue()


def _mean_and_sd(values: Iterable[float]) -> tuple[str, str]:
    numbers: Array = np.array(list(values), dtype=float)
    return f"{numbers.mean():.6g}", f"{numbers.std(ddof=1):.6g}" if numbers.size > 1 else ""
