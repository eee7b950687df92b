"""The tables of a benchmark of posteriors: for a person at a terminal, and as Markdown for the docs."""

from typing import Any

from sinew.runner.console import Console
from sinew.tasks.benchmark.tables import Table, as_markdown, printed

LEVELS = {
    "mean": "population mean",
    "spread": "population spread",
    "specimen, determined": "specimen, determined",
    "specimen, not determined": "specimen, others",
}
UNIFORM = 0.01  # p-value below which ranks are not uniform


def tell(result: dict[str, Any], console: Console) -> None:
    """Coverage, ranks, and what else was counted."""
    printed(_tables(result, by_parameter=False), lines(result), console)


def markdown(result: dict[str, Any]) -> str:
    """The same, with a table by parameter, as a file for the docs."""
    return as_markdown(_tables(result, by_parameter=True), lines(result))


def _hidden(said: dict[str, Any]) -> str:
    """What the specimens have and the model has not."""
    effect = f", beside the model: {said['effect']}" if said["effect"] else ""
    return effect + (f", a screw that is off by {100 * said['screw']:g} %" if said["screw"] else "")


def lines(result: dict[str, Any]) -> list[str]:
    """What was run, what was refused, and differences that are none."""
    said = result["conditions"]
    words = [
        f"method {result['method']}: {result['cohorts']} cohorts of two sites of {said['per_site']} specimens "
        f"({', '.join(said['tests'])} at {said['rate_hz']:g} Hz, noise {100 * said['noise']:g} % of the peak force"
        f"{_hidden(said)}), drawn from the prior; intervals of shares count cohorts"
    ]
    if result["seconds"] is not None:
        words.append(f"median time of a cohort: {result['seconds']:.0f} s")
    if result["refused"]:
        words.append(f"{len(result['refused'])} cohorts have no posterior, and count nowhere:")
        words += [f"cohort {one['cohort']}: {one['error']}" for one in result["refused"]]
    if (found := result["contrasts"]) is not None:
        low, high = found["interval"]
        words.append(
            f"differences of zero between two sites: {found['different']} of {found['of']} called different at 5 %: "
            f"{100 * found['share']:.1f} % ({100 * low:.1f} to {100 * high:.1f} %)"
        )
    if (out := result["left_out"]) is not None:
        points, whole = (_cell(out[name]) for name in ("points", "whole"))
        words.append(
            f"one more specimen of each site, of {out['cohorts']} cohorts: {points} % of the points of {out['curves']} "
            f"curves inside the pointwise 95 % band of a new specimen, {whole} % of the curves inside the band for "
            "whole curves"
        )
    odd = [f"{row['parameter']} ({row['level']})" for row in result["ranks"] if (row["p"] or 1.0) < UNIFORM]
    expected = UNIFORM * len(result["ranks"])
    words.append(
        f"ranks that are not uniform (p < {UNIFORM:g}): {', '.join(odd) or 'none'} "
        f"of {len(result['ranks'])}; {expected:.1f} would be by chance"
    )
    return words


def _tables(result: dict[str, Any], *, by_parameter: bool) -> list[Table]:
    coverage, tarp = result["coverage"], result["tarp"]
    shares = list(coverage[0]["shares"]) if coverage else []
    every, single = [], []
    for row in coverage:
        cells = [str(row["of"]), *(_cell(row["shares"][name]) for name in shares)]
        if row["parameter"] == "all":
            every.append([LEVELS[row["level"]], *cells])
        else:
            single.append([LEVELS[row["level"]], row["parameter"], *cells])
    regions = list(tarp[0]["shares"]) if tarp else []
    joint = [[row["level"], *(_cell(row["shares"][name]) for name in regions), _p(row["p"])] for row in tarp]
    tables = [
        ("Coverage of intervals (%), with its 95 % interval", ["of", "cases", *shares], every),
        ("Coverage of regions of all parameters at once (TARP, %)", ["of", *regions, "p"], joint),
    ]
    if by_parameter:
        tables.append(("Coverage by parameter (%)", ["of", "parameter", "cases", *shares], single))
    return tables


def _p(value: float | None) -> str:
    return "" if value is None else f"{value:.2g}"


def _cell(found: dict[str, Any] | None) -> str:
    if found is None:
        return ""
    low, high = found["interval"]
    return f"{100 * found['share']:.1f} ({100 * low:.0f} to {100 * high:.0f})"
