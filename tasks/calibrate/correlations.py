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
from itertools import combinations
from typing import Any

import numpy as np
import pandas as pd

from sinew.tasks.calibrate.result import Correlations, NoCorrelations, PairCorrelation, SpecimenFit
from sinew.tasks.model import Parameter
from sinew.tasks.simulate import Array

Specimens = Mapping[str, SpecimenFit]
DONORS = 3  # the fewest that leave degrees of freedom to test with
STILL = 1e-3  # of a parameter's range: two values nearer than this to each other are one (both on a bound)
MOSTLY = 0.5  # of the specimens


def correlations(specimens: Specimens, parameters: Sequence[Parameter]) -> Correlations | NoCorrelations:
    """Correlation within donors, across sites, of every pair of free ``parameters``.

    Donors with specimens of one site only are left out. A pair has a reason in place of numbers where a parameter does
    not vary within donors.
    """
    sites = {fit.site for fit in specimens.values()} - {None}
    if len(sites) < 2:
        return NoCorrelations("specimens of fewer than two sites")
    if not any(fit.donor is not None for fit in specimens.values()):
        return NoCorrelations("donors are not known")
    used = _repeated(specimens)
    donors = sorted({str(fit.donor) for fit in used})
    if len(donors) < DONORS:
        return NoCorrelations(f"{len(donors)} donors have specimens of two sites or more, at least {DONORS} are needed")
    names = [parameter.name for parameter in parameters]
    values = pd.DataFrame([{name: fit.parameters[name] for name in names} for fit in used], dtype=float)
    values["donor"] = [str(fit.donor) for fit in used]
    share = {name: float(np.mean([name in fit.determined for fit in used])) for name in names}
    still = {parameter.name for parameter in parameters if not _varies(values, parameter)}
    numbers = {pair: _correlated(values, *pair, still) for pair in combinations(names, 2)}
    tested = [pair for pair, found in numbers.items() if "p" in found]
    for pair, p_holm in zip(tested, _holm([numbers[pair]["p"] for pair in tested]), strict=True):
        numbers[pair]["p_holm"] = p_holm
    return Correlations(
        sites=sorted({str(fit.site) for fit in used}),
        donors=donors,
        specimens=len(used),
        names=names,
        determined=share,
        tests=len(tested),
        pairs=[
            PairCorrelation(parameters=[first, second], determined=min(share[first], share[second]) >= MOSTLY, **found)
            for (first, second), found in numbers.items()
        ],
    )


def _repeated(specimens: Specimens) -> list[SpecimenFit]:
    """Specimens of the donors that were measured at two sites or more."""
    sites: dict[str, set[str]] = {}
    for fit in specimens.values():
        if fit.donor is not None and fit.site is not None:
            sites.setdefault(fit.donor, set()).add(fit.site)
    known = [fit for fit in specimens.values() if fit.site is not None]
    return [fit for fit in known if len(sites.get(str(fit.donor), ())) > 1]


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
    for site in dict.fromkeys(fit.site for fit in specimens.values()):
        here = [fit for fit in specimens.values() if fit.site == site]
        for parameter in parameters:
            name = parameter.name
            counts = [sum(name in fit.on_bound for fit in here), sum(name in fit.determined for fit in here)]
            numbers = _mean_and_sd(fit.parameters[name] for fit in here)
            writer.writerow([site or "", name, parameter.unit, len(here), *numbers, *counts])
        writer.writerow([site or "", "rmse_N", "N", len(here), *_mean_and_sd(fit.total_N for fit in here), "", ""])
    return text.getvalue()


def _mean_and_sd(values: Iterable[float]) -> tuple[str, str]:
    numbers: Array = np.array(list(values), dtype=float)
    return f"{numbers.mean():.6g}", f"{numbers.std(ddof=1):.6g}" if numbers.size > 1 else ""
