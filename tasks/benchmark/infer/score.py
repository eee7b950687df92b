"""From posteriors and truths to coverage: simulation-based calibration and what its numbers are worth.

========================  =============================================================================================
rank                      the share of a posterior's draws below the truth: uniform if posteriors are right, for truths
                          from the prior (Talts et al. 2018, arXiv:1804.06788)
coverage                  how often the middle 50, 80 and 95 % of the draws hold the truth, and the reported interval
TARP                      the share of draws that are nearer to a random point than the truth, of all parameters at
                          once: uniform if posteriors are right (Lemos et al. 2023, arXiv:2302.03026)
========================  =============================================================================================

Parameters of one cohort are not independent. Intervals of shares therefore count cohorts: Clopper and Pearson's for as
many independent trials as have the same variance (Korn and Graubard 1998, Survey Methodology 24, 193).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import beta, binom, kstest
from scipy.stats import t as student_t

from sinew.tasks.benchmark.infer.result import CohortResult, Ranked
from sinew.tasks.simulate import Array

LEVELS = (0.5, 0.8, 0.95)
REPORTED = "reported 95 %"
BINS = 10  # of a histogram of ranks


@dataclass(frozen=True)
class Covered:
    """How many of ``of`` truths an interval held, and the 95 % interval of that share.

    Of shares of curves, ``count`` is their sum.
    """

    count: float
    of: int
    interval: tuple[float, float]

    @property
    def share(self) -> float:
        return self.count / self.of


def rank(draws: Array, truth: float) -> float:
    """The share of ``draws`` ``[m]`` below ``truth``; ties count half."""
    return float((draws < truth).mean() + 0.5 * (draws == truth).mean())


def nearer(draws: Array, truth: Array, point: Array) -> float:
    """The share of ``draws`` ``[m, k]`` that are nearer to a random ``point`` ``[k]`` than ``truth`` ``[k]``."""
    apart = np.square(draws - point).sum(axis=1)
    return rank(apart, float(np.square(truth - point).sum()))


def covered(held: Sequence[tuple[int, bool]]) -> Covered | None:
    """Coverage from (cohort, whether the truth was held); None without any."""
    if not held:
        return None
    cohorts = sorted({cohort for cohort, _ in held})
    place = {cohort: number for number, cohort in enumerate(cohorts)}
    counts, sizes = np.zeros(len(cohorts)), np.zeros(len(cohorts))
    for cohort, inside in held:
        counts[place[cohort]] += inside
        sizes[place[cohort]] += 1
    return of_cohorts(counts, sizes)


def of_cohorts(counts: Array, sizes: Array) -> Covered:
    """The share of ``counts`` in ``sizes``, both ``[n]`` by cohort."""
    total, share = sizes.sum(), counts.sum() / sizes.sum()
    return Covered(round(float(counts.sum()), 3), int(total), _interval(share, _independent(counts, sizes)))


def _independent(counts: Array, sizes: Array) -> float:
    """How many independent trials have the variance that cohorts with ``counts`` of ``sizes`` ``[n]`` show."""
    n, total = len(sizes), sizes.sum()
    share = counts.sum() / total
    if n == 1 or share in (0.0, 1.0):
        return float(n)
    variance = n / (n - 1) * np.square(counts - share * sizes).sum() / total**2
    if not variance:
        return float(total)
    wider = (student_t.ppf(0.975, total - 1) / student_t.ppf(0.975, n - 1)) ** 2
    return float(min(total, share * (1 - share) / variance * wider))


def _interval(share: float, trials: float) -> tuple[float, float]:
    """Clopper and Pearson's 95 % interval of a share, for any number of trials."""
    count = share * trials
    low = float(beta.ppf(0.025, count, trials - count + 1)) if count > 0 else 0.0
    high = float(beta.ppf(0.975, count + 1, trials - count)) if count < trials else 1.0
    return low, high


def histogram(ranks: Sequence[float]) -> list[int]:
    """How many ranks lie in each of ``BINS`` equal parts of 0 to 1."""
    return [int(count) for count in np.histogram(ranks, bins=BINS, range=(0.0, 1.0))[0]]


def band(count: int) -> tuple[int, int]:
    """How many of ``count`` independent uniform ranks are in one of ``BINS`` parts, with probability 99 %."""
    return int(binom.ppf(0.005, count, 1 / BINS)), int(binom.ppf(0.995, count, 1 / BINS))


def uniform(ranks: Sequence[float]) -> float | None:
    """The p-value of Kolmogorov and Smirnov's test that independent ``ranks`` are uniform; None for fewer than two."""
    return float(kstest(ranks, "uniform").pvalue) if len(ranks) > 1 else None


def summary(cohorts: Sequence[CohortResult]) -> dict[str, Any]:
    """Coverage, ranks and contrasts of all cohorts, for ``benchmark.json``."""
    whole = [one for one in cohorts if one.error is None]
    ranked = [each for one in whole for each in one.ranked]
    return {
        "cohorts": len(cohorts),
        "refused": [{"cohort": one.number, "error": one.error} for one in cohorts if one.error is not None],
        "seconds": float(np.median([one.seconds for one in whole])) if whole else None,
        "coverage": _coverage(ranked),
        "ranks": _ranks(ranked),
        "tarp": _tarp(whole),
        "contrasts": _contrasts(whole),
        "left_out": _left_out(whole),
    }


def _levels(ranked: Sequence[Ranked]) -> dict[str, list[Ranked]]:
    """By level; of specimens those that their own curves determine, and the others."""
    found: dict[str, list[Ranked]] = {}
    for one in ranked:
        level = one.level if one.level != "specimen" else f"specimen, {'' if one.determined else 'not '}determined"
        found.setdefault(level, []).append(one)
    return found


def _coverage(ranked: Sequence[Ranked]) -> list[dict[str, Any]]:
    """A row for each level, and for each level and parameter: coverage by interval."""
    rows = []
    for level, every in _levels(ranked).items():
        by_name: dict[str, list[Ranked]] = {}
        for one in every:
            by_name.setdefault(one.parameter, []).append(one)
        for parameter, some in {"all": every, **dict(sorted(by_name.items()))}.items():
            shares = {f"{100 * at:.0f} %": covered([(one.cohort, one.inside(at)) for one in some]) for at in LEVELS}
            shares[REPORTED] = covered([(one.cohort, one.held) for one in some])
            rows.append({"level": level, "parameter": parameter, "of": len(some),
                         "shares": {name: _share(one) for name, one in shares.items()}})  # fmt: skip
    return rows


def _share(found: Covered | None) -> dict[str, Any] | None:
    return None if found is None else {"share": found.share, "interval": list(found.interval)}


def _ranks(ranked: Sequence[Ranked]) -> list[dict[str, Any]]:
    """Histograms of ranks by level and parameter; one site of each cohort, so that ranks are independent."""
    firsts = [one for one in ranked if one.of in ("first", "first/1")]
    found: dict[tuple[str, str], list[float]] = {}
    for one in firsts:
        found.setdefault((one.level, one.parameter), []).append(one.rank)
    levels, parameters = (dict.fromkeys(getattr(one, name) for one in firsts) for name in ("level", "parameter"))
    return [
        {
            "level": level, "parameter": parameter, "counts": histogram(ranks), "band": list(band(len(ranks))),
            "p": uniform(ranks),
        }
        for level in levels
        for parameter in parameters
        for ranks in [found.get((level, parameter), [])]
    ]  # fmt: skip


def _tarp(cohorts: Sequence[CohortResult]) -> list[dict[str, Any]]:
    rows = []
    for level in dict.fromkeys(level for one in cohorts for level in one.tarp):
        every = [(one.number, float(share)) for one in cohorts for share in one.tarp[level]]
        firsts = [float(one.tarp[level][0]) for one in cohorts]
        shares = {f"{100 * at:.0f} %": _share(covered([(n, share <= at) for n, share in every])) for at in LEVELS}
        rows.append({"level": level, "shares": shares, "p": uniform(firsts)})
    return rows


def _left_out(cohorts: Sequence[CohortResult]) -> dict[str, Any] | None:
    """Of specimens that no inference knew: points in the pointwise band, and whole curves in the other."""
    some = [one for one in cohorts if one.left_out]
    if not some:
        return None
    sizes = np.array([len(one.left_out) for one in some], dtype=float)
    found = {
        "points": np.array([sum(each.points for each in one.left_out) for one in some]),
        "whole": np.array([sum(each.whole for each in one.left_out) for one in some], dtype=float),
    }
    return {
        "cohorts": len(some),
        "curves": int(sizes.sum()),
        **{name: _share(of_cohorts(counts, sizes)) for name, counts in found.items()},
    }


def _contrasts(cohorts: Sequence[CohortResult]) -> dict[str, Any] | None:
    """How many differences that are none were called different; cohorts with as many contrasts count alike."""
    counts = np.array([one.different for one in cohorts], dtype=float)
    sizes = np.array([one.contrasts for one in cohorts], dtype=float)
    if not sizes.sum():
        return None
    found = of_cohorts(counts, sizes)
    return {"different": int(found.count), "of": found.of, "share": found.share, "interval": list(found.interval)}
