"""Each result of the paper beside the truth and what sinew finds, and why they differ."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from sinew.tasks.benchmark.paper.published import (
    AUC,
    CORRELATIONS,
    IMPORTANT,
    NORMAL_WIDTH,
    RMSE_N,
    SOBOL,
    UNIFORM_WIDTH,
    correlation,
    exchanged,
    of_sites,
    table_3,
)
from sinew.tasks.benchmark.tables import Table
from sinew.tasks.calibrate.result import CalibrateResult, Correlations
from sinew.tasks.compare.result import CompareResult
from sinew.tasks.drawing.blocks import number, percent
from sinew.tasks.importance.result import ImportanceResult
from sinew.tasks.infer.abc.result import AbcResult
from sinew.tasks.predict.result import PredictResult
from sinew.tasks.sobol.result import SobolResult

MOST = 5  # parameters that are listed
FAR = 2.0  # standard errors

Row = list[str]


def comparison(results: dict[str, Any]) -> Table:
    """All results but the tables, a row for each: what, the paper, the truth, sinew, and why they differ."""
    rows = [
        *_sobol(results["sobol"]),
        _forest(results["importance"]),
        *_calibration(results["calibrate"]),
        *_posteriors(results["infer"]),
        *_bands(results["predict"]),
        *_areas(results["compare"]),
    ]
    return "The paper, the truth, and this run", ["what", "paper", "truth", "here", "why"], rows


def _sobol(result: SobolResult) -> Iterator[Row]:
    typical = next(iter(result.specimens))
    for of, found in ((typical, result.specimens[typical]), ("mean objective of all specimens", result)):
        total = dict(zip(result.names, found.ST, strict=True))
        half = dict(zip(result.names, found.ST_conf, strict=True))
        ours = ", ".join(f"{name} {total[name]:.2f} ± {half[name]:.2f}" for name in SOBOL if name in total)
        published = ", ".join(f"{name} {value:.2f}" for name, value in SOBOL.items()) if of == typical else ""
        sums = f"here, totals add up to {np.nansum(found.ST):.2f}, first-order ones to {np.nansum(found.S1):.2f}; "
        why = (
            "indices depend on the specimen and on how far the ranges let the model miss its curves, which it "
            "describes here" if of == typical else "a mean of objectives has less interaction than each of them"
        )  # fmt: skip
        yield [f"Sobol total indices, {of} (figure 10)", published, "", ours, sums + why]


def _forest(result: ImportanceResult) -> Row:
    order = np.argsort(-np.asarray(result.impurity_percent))[:MOST]
    ours = ", ".join(f"{result.names[j]} {result.impurity_percent[j]:.0f} %" for j in order)
    return ["most important to a random forest (figure 9)", ", ".join(IMPORTANT), "", ours, "as for the indices"]


def _calibration(result: CalibrateResult) -> Iterator[Row]:
    name, fit = next(iter(result.specimens.items()))
    yield [
        f"RMSE of a typical fit by protocol (figure 5), here {name} (N)",
        ", ".join(f"{protocol} {value:.2f}" for protocol, value in RMSE_N.items()),
        "" if fit.noise_N is None else f"{fit.noise_N:.2f} in all: the noise",
        ", ".join(f"{protocol} {value:.2f}" for protocol, value in fit.rmse_N.items()),
        "the paper's are measured curves, which no model describes; here noise is all that is left",
    ]
    totals = [one.total_N for one in result.specimens.values()]
    yield [
        "RMSE of all fits (table 2, N)", "9.4 to 43.7", "", f"{min(totals):.1f} to {max(totals):.1f}",
        "as above; the parameters themselves are in table_2.csv",
    ]  # fmt: skip
    found = result.correlations
    if isinstance(found, Correlations):
        known = {frozenset(one.parameters): one.r for one in found.pairs if one.r is not None}
        for pair, published in CORRELATIONS.items():
            swapped = exchanged(pair)
            here = ["none" if one is None else f"{one:.2f}" for one in (known.get(frozenset(pair)),
                                                                        known.get(frozenset(swapped)))]  # fmt: skip
            yield [
                f"correlation of {' and '.join(pair)} (figure 8)",
                f"{published:.2f}",
                f"{correlation(*pair):.2f} by table 2; {correlation(*swapped):.2f} with matrix and fibre exchanged",
                f"{here[0]}; {here[1]} exchanged",
                "the paper's are those of its table 2 with matrix and fibre exchanged; calibrations scatter, and many "
                "end on bounds",
            ]


def _posteriors(result: AbcResult) -> Iterator[Row]:
    """What decides about table 3, whose numbers are in table_3.csv."""
    paper = table_3()
    widths = float(np.median([(one.high - one.low) / one.sd for one in paper.values()]))
    ours = [(one.hdi[1] - one.hdi[0]) / one.sd for site in result.sites.values() for one in site.parameters.values()]
    yield [
        "interval over standard deviation, median (table 3)", f"{widths:.2f}",
        f"{UNIFORM_WIDTH} if uniform, {NORMAL_WIDTH} if normal", f"{np.median(ours):.2f}",
        "the paper's posteriors have the shape of a hardly updated uniform prior, not of the stated normal one",
    ]  # fmt: skip
    names = sorted({name for _, name in paper})
    same = sum(
        getattr(paper["middle", name], end) == getattr(paper["proximal", name], end)
        for name in names
        for end in ("low", "high")
    )
    yield [
        "ends of intervals that middle and proximal share to all digits (table 3)", f"{same} of {2 * len(names)}", "0",
        str(_shared(result)), "two sites with other data cannot have equal posteriors by chance",
    ]  # fmt: skip
    truth = of_sites()
    errors = _standard_errors(
        {
            (site, name): one.mean
            for site, posterior in result.sites.items()
            for name, one in posterior.parameters.items()
        }
    )
    for site, posterior in result.sites.items():
        if "E_f" not in posterior.parameters or (site, "E_f") not in truth:
            continue
        one, known, published = posterior.parameters["E_f"], truth[site, "E_f"], paper[site, "E_f"]
        yield [
            f"E_f, {site} (table 3, MPa)",
            f"{published.mean:.1f} ± {published.sd:.1f} ({published.low:.1f} to {published.high:.1f})",
            f"{known.mean:.1f} ± {known.error:.1f} (standard error; between specimens {known.sd:.1f})",
            f"{one.mean:.1f} ± {one.sd:.1f} ({one.hdi[0]:.1f} to {one.hdi[1]:.1f})",
            f"{errors[site, 'E_f']:.1f} standard errors from the mean of the specimens: one parameter set stands for "
            f"all of a site, its width is set by the last threshold ({number(posterior.epsilon[-1])}), and "
            f"{result.population} particles are worth {posterior.effective_sample_size:.0f} of equal weight",
        ]  # fmt: skip
    if errors:
        of_paper = _standard_errors({key: one.mean for key, one in paper.items()})
        yield [
            "posterior means more than two standard errors from the specimens' mean (table 3)", _far(of_paper),
            "5 %", _far(errors),
            "neither the paper's posteriors nor these estimate the mean of a population",
        ]  # fmt: skip


def _shared(result: AbcResult) -> int:
    """How many ends of intervals of middle and proximal are the same."""
    sites = [result.sites[name] for name in ("middle", "proximal") if name in result.sites]
    if len(sites) < 2:
        return 0
    ends = [np.array([site.parameters[name].hdi for name in result.names]) for site in sites]
    return int((ends[0] == ends[1]).sum())


def _standard_errors(means: Mapping[tuple[str, str], float]) -> dict[tuple[str, str], float]:
    """How many standard errors of the specimens' mean each posterior mean is from it, by site and parameter."""
    truth = of_sites()
    return {
        key: abs(mean - truth[key].mean) / truth[key].error
        for key, mean in means.items()
        if key in truth and truth[key].error > 0
    }


def _far(errors: Mapping[tuple[str, str], float]) -> str:
    """How many posterior means are far from that of the specimens."""
    far = sum(apart > FAR for apart in errors.values())
    return f"{far} of {len(errors)} ({percent(far / len(errors))})"


def _bands(result: PredictResult) -> Iterator[Row]:
    why = {
        "hdi": "all parameters on their bounds at once happen to make a wide band; it is not made for a specimen",
        "draws": "as narrow as the posterior of one parameter set; noise and differences of specimens are not in it",
        "new": "not in the paper: made for a specimen that is left out",
    }
    for band, words in why.items():
        share = result.coverage[band].all
        where = "" if band == "new" else " (figure 12)"
        yield [
            f"points inside the band `{band}`{where}", "" if band == "new" else "shown", "95 %",
            "none" if share is None else percent(share, 1), words,
        ]  # fmt: skip


def _areas(result: CompareResult) -> Iterator[Row]:
    for pair in result.pairs:
        sites = tuple(sorted(pair.sites))
        published = AUC.get((sites[0], sites[1]))
        yield [
            f"AUC, {pair.sites[0]} and {pair.sites[1]} (figure 13)",
            "" if published is None else f"{published:.2f}",
            "",
            f"{pair.auc:.2f} ({pair.interval[0]:.2f} to {pair.interval[1]:.2f})",
            "Monte Carlo noise: with these particles, repeats of an inference scatter by more than the interval; "
            "posteriors that are hardly updated have AUCs of 0.5",
        ]
