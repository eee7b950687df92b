"""What Pekedis (2025, arXiv:2503.09900) published beside table 2, which is :func:`sinew.tasks.data.virtual.published`.

The middle site's interval of E_f lacks its closing bracket in table 3; all other numbers are as printed.
"""

from dataclasses import dataclass

import numpy as np
import pandas as pd

from sinew.tasks.data.virtual import published as table_2
from sinew.tasks.study.resources import resource

SOBOL = {"E_f": 0.7325, "E_m": 0.4905, "alpha_f": 0.3587}  # total indices of a typical specimen
RMSE_N = {"one_step": 5.693, "two_step": 3.871, "cyclic": 13.232}  # of one fit (figure 5)
AUC = {("distal", "middle"): 0.50, ("distal", "proximal"): 0.51, ("middle", "proximal"): 0.51}
IMPORTANT = ("E_f", "alpha_f", "E_m")  # to a random forest, in that order
UNIFORM_WIDTH, NORMAL_WIDTH = 3.29, 3.92  # of a 95 % interval, in standard deviations
CORRELATIONS = {  # pairs as the text names them (figure 8)
    ("tau_3m", "tau_1f"): 0.80,
    ("g_3m", "g_3f"): 0.71,
    ("tau_2m", "tau_1f"): 0.69,
    ("g_2m", "tau_1f"): 0.65,
    ("g_2m", "g_3f"): 0.64,
    ("E_m", "tau_1f"): -0.48,
}


@dataclass(frozen=True)
class Printed:
    """A posterior of table 3: mean, standard deviation, and ends of the 95 % interval of highest density."""

    mean: float
    sd: float
    low: float
    high: float


@dataclass(frozen=True)
class OfSite:
    """A parameter of table 2's specimens at one site: mean, standard deviation, and standard error of the mean."""

    mean: float
    sd: float
    error: float


def correlation(first: str, second: str) -> float:
    """The repeated-measures correlation of two parameters in table 2, the specimen's number being the donor."""
    table = table_2()
    apart = [(table[name] - table.groupby("specimen")[name].transform("mean")).to_numpy() for name in (first, second)]
    return float(np.corrcoef(apart)[0, 1])


def exchanged(names: tuple[str, str]) -> tuple[str, str]:
    """Names of parameters with matrix and fibre exchanged: the last letter says which."""
    first, second = (name[:-1] + ("f" if name[-1] == "m" else "m") for name in names)
    return first, second


def table_3() -> dict[tuple[str, str], Printed]:
    """Posteriors by site and parameter."""
    table = pd.read_csv(resource("configs/table3.csv"), dtype={"site": str, "parameter": str})
    return {(str(row[0]), str(row[1])): Printed(*map(float, row[2:])) for row in table.itertuples(index=False)}


def of_sites() -> dict[tuple[str, str], OfSite]:
    """What is true of the specimens of each site, by site and parameter."""
    found = {}
    for site, members in table_2().groupby("site"):
        for name in members.columns.drop(["site", "specimen", "rmse_N"]):
            values = members[name].to_numpy(dtype=float)
            sd = float(values.std(ddof=1))
            found[str(site), str(name)] = OfSite(float(values.mean()), sd, sd / len(values) ** 0.5)
    return found
