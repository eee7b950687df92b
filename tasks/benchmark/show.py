"""The table of a benchmark of discoveries: for a person at a terminal, and as Markdown for the docs."""

from collections.abc import Sequence
from typing import Any

from sinew.runner.console import Console
from sinew.tasks.benchmark.tables import Table, as_markdown, printed
from sinew.tasks.discover.result import NAMES

# open: the verdict says which effects it cannot tell apart, and the truth is among them
GOOD = ("right", "open", "one of two", "some of them")


def tell(result: dict[str, Any], console: Console) -> None:
    """Cases, table, comparison with other selectors, and how many cases there are of each class."""
    printed(_tables(result), _lines(result), console)


def markdown(result: dict[str, Any]) -> str:
    """The same as a file for the docs."""
    return as_markdown(_tables(result), _lines(result))


def _tables(result: dict[str, Any]) -> list[Table]:
    rows = [[row["name"], *_counted(row)] for row in result["shares"]]
    rows += [
        [f"median {row['name']}", _median(row), _interval(row["interval"], row["unit"]),
         f"{row['of']} cases" + (f", {_interval(row['range'], row['unit'])}" if row["range"] else "")]
        for row in result["medians"]
    ]  # fmt: skip
    selectors = [
        [row["name"], *(_short(row[key]) for key in ("right", "wrong", "alarms"))] for row in result["selectors"]
    ]
    return [
        ("Cases", ["case", "hidden", "class", "verdict", "", "judged", "closed", "s"], [*map(_case, result["cases"])]),
        ("Blind benchmark", ["", "share", "95 % interval", "cases"], rows),
        (
            "Other selectors, same candidates",
            ["chosen by", "named correctly (detectable)", "wrong names", "false alarms on nulls"],
            selectors,
        ),
    ]


def _lines(result: dict[str, Any]) -> Sequence[str]:
    classes = ", ".join(f"{count} {name}" for name, count in result["classes"].items())
    lines = [f"{len(result['cases'])} cases: {classes}"]
    lines += [f"{case['name']} failed: {case['error']}" for case in result["cases"] if case["error"]]
    if result["mixed"]:
        lines.append(f"{result['mixed']} cases hold fits of another version of the program: begin a new --out")
    return lines


def _case(case: dict[str, Any]) -> list[str]:
    truth = " + ".join(case["truth"]) or "nothing"
    hidden = f"{truth} ({case['label']})" if case["label"] else truth
    said = " + ".join(case["effects"]) or " or ".join(case["set"])
    closed = "" if case["closed"] is None or case["verdict"] not in NAMES else f"{case['closed']:.2f}"
    seconds = "" if case["seconds"] is None else f"{case['seconds']:.0f}"
    good = "ok" if case["outcome"] in GOOD else "WRONG"
    return [case["name"], hidden, case["class"], f"{case['verdict'] or ''} {said}".strip(), good, case["outcome"],
            closed, seconds]  # fmt: skip


def _counted(row: dict[str, Any]) -> list[str]:
    if not row["of"]:
        return ["", "", "0 cases"]
    low, high = row["interval"]
    return [f"{100 * row['share']:.0f} %", f"{100 * low:.0f} to {100 * high:.0f} %", f"{row['count']} of {row['of']}"]


def _short(row: dict[str, Any]) -> str:
    share, interval, cases = _counted(row)
    return f"{share} ({interval}; {cases})" if row["of"] else cases


def _median(row: dict[str, Any]) -> str:
    return "" if row["median"] is None else f"{row['median']:.3g} {row['unit']}".strip()


def _interval(ends: Sequence[float] | None, unit: str) -> str:
    return "" if ends is None else f"{ends[0]:.3g} to {ends[1]:.3g} {unit}".strip()
