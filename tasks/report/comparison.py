"""Two result folders on one page: what was set otherwise, and how far results of the same name are apart."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import hypot, isfinite
from pathlib import Path
from typing import TypeVar, cast

from sinew.runner.errors import BadInput, one_line
from sinew.tasks.calibrate.result import CalibrateResult
from sinew.tasks.discover.result import DiscoverResult
from sinew.tasks.drawing.blocks import Block, Facts, Section, Table, Words, number, percent, plural
from sinew.tasks.infer.result import InferResult, Posteriors
from sinew.tasks.report.comparison_setup import other_ranges, setup
from sinew.tasks.report.folder import ResultFolder, read_folder
from sinew.tasks.report.page import Built, render
from sinew.tasks.sobol.result import SobolResult
from sinew.tasks.study.files import write_text
from sinew.tasks.study.result import Result

R = TypeVar("R", bound=Result)
FAR = 2.0  # standard deviations of a difference, beyond which it is told
INDEPENDENT = (
    "Differences are given in standard deviations of two independent results. Results of the same curves are not "
    "independent: there, even smaller differences come from what was set otherwise."
)


@dataclass(frozen=True)
class Pair:
    """Two result folders, and what their columns are called."""

    first: ResultFolder
    second: ResultFolder

    @property
    def names(self) -> tuple[str, str]:
        """The studies' names if they differ, else the folders."""
        names = (self.first.name, self.second.name)
        return names if names[0] != names[1] else (one_line(str(self.first.folder)), one_line(str(self.second.folder)))

    def results(self, kind: type[R]) -> tuple[R, R] | None:
        """A task's results, if both have one."""
        first, second = self.first.result(kind), self.second.result(kind)
        return (first, second) if first is not None and second is not None else None

    def missing(self, task: str) -> str:
        """Which of the two has no result of a task."""
        without = [name for name, one in zip(self.names, (self.first, self.second), strict=True)
                   if task not in one.results]  # fmt: skip
        return f"No {task} to compare: {' and '.join(without)} without a result."


def compare(first: Path, second: Path, page: Path) -> Built:
    """Write ``page`` with what two result folders have in common. Raises :class:`BadInput`."""
    if page.suffix != ".html" or page.is_dir():  # never a file of a result in place of a page
        raise BadInput(f"--out {page}", "is no name of a page", "a file that ends in .html")
    if not page.parent.is_dir():
        raise BadInput(f"--out {page}", f"{page.parent} is not there", "a file in a folder that is there")
    pair = Pair(read_folder(first), read_folder(second))
    trouble = [*pair.first.trouble, *pair.second.trouble]
    sections = []
    for build in (_setup, _discovery, _calibration, _sensitivity, _posterior):
        try:
            sections.append(build(pair))
        except Exception as error:  # noqa: BLE001 - fields that are right one by one may contradict each other
            trouble.append(one_line(f"{build.__name__[1:]} cannot be compared ({type(error).__name__}: {error})"))
    title = f"{pair.names[0]} and {pair.names[1]}"
    rows = [(name, one_line(str(one.folder))) for name, one in zip(pair.names, (pair.first, pair.second), strict=True)]
    write_text(page, render(title, Facts(rows), sections, trouble))
    return Built(page, tuple(trouble))


def _setup(pair: Pair) -> Section:
    return setup(pair.first, pair.second, pair.names)


def _discovery(pair: Pair) -> Section:
    title, question = "Discovery", "Is the same effect named?"
    if (found := pair.results(DiscoverResult)) is None:
        return Section("discovery", title, question, missing=pair.missing("discover"))
    rows = [
        ["verdict", *(one.headline for one in found)],
        ["part of the misfit", *(percent(one.explained) for one in found)],
        ["loss of the model as it is", *(number(one.null.loss, 4) for one in found)],
    ]
    table = Table("Verdicts", ["", *pair.names], rows, words=(1, 2))
    return Section("discovery", title, question, [table], found=" / ".join(one.headline for one in found))


def _calibration(pair: Pair) -> Section:
    title, question = "Calibration", "Are the fits as close, and where are their parameters?"
    if (found := pair.results(CalibrateResult)) is None:
        return Section("calibration", title, question, missing=pair.missing("calibrate"))
    first, second = found
    fits, parameters, far = [], [], 0
    widths = [dict(zip(each.free, (high - low for low, high in each.bounds), strict=True)) for each in found]
    both = [name for name in first.free if name in widths[1]]
    for name in (name for name in first.specimens if name in second.specimens):
        one, other = first.specimens[name], second.specimens[name]
        ratio = other.total_N / one.total_N if one.total_N else float("nan")
        fits.append([name, number(one.total_N, 4), number(other.total_N, 4), number(ratio, 3)])
        determined = [set(fit.determined) for fit in (one, other)]
        for parameter in both:
            values = [fit.parameters[parameter] for fit in (one, other)]
            known = all(parameter in names for names in determined)
            sds = [fit.sd_of_range[parameter] * width[parameter]
                   for fit, width in zip((one, other), widths, strict=True)]  # fmt: skip
            cells, apart = _apart(values, sds if known else None)
            far += apart
            parameters.append([f"{name} {parameter}", *cells])
    blocks: list[Block] = [
        Table("sum of RMSEs (N)", ["specimen", *pair.names, "second / first"], fits),
        *_beside(pair, first, second),
        *other_ranges([dict(zip(each.free, each.bounds, strict=True)) for each in found], pair.names),
        Table("Parameters", ["parameter", *pair.names, "difference", "in sd"], parameters, open=len(parameters) <= 40),
        Words(INDEPENDENT, "note"),
    ]
    for name, mine, others in ((pair.names[0], first, second), (pair.names[1], second, first)):
        known_there = set(others.names)
        if own := [parameter for parameter in mine.names if parameter not in known_there]:
            blocks.append(Words(f"Only in {name}: {', '.join(own)}."))
    words = f"{plural(len(fits), 'specimen')} in both; "
    words += f"{far} of {len(parameters)} parameters differ by more than {FAR:g} sd"
    return Section("calibration", title, question, blocks, found=words)


def _beside(pair: Pair, first: CalibrateResult, second: CalibrateResult) -> Iterator[Table]:
    """The errors of what both fits compare beside the force, a table for each quantity."""
    both = [(name, fit.sums(), second.specimens[name].sums()) for name, fit in first.specimens.items()
            if name in second.specimens]  # fmt: skip
    for quantity in dict.fromkeys(each for _, one, other in both for each in one if each in other):
        rows = []
        for name, one, other in both:
            if quantity in one and quantity in other:
                ratio = other[quantity] / one[quantity] if one[quantity] else float("nan")
                rows.append([name, number(one[quantity], 4), number(other[quantity], 4), number(ratio, 3)])
        yield Table(
            f"{quantity.removeprefix('rmse_')}, sum of RMSEs", ["specimen", *pair.names, "second / first"], rows
        )


def _apart(values: Sequence[float], sds: Sequence[float] | None) -> tuple[list[str], bool]:
    """Two values, their difference, and that in standard deviations; whether it is a large one."""
    difference = values[1] - values[0]
    spread = hypot(*sds) if sds is not None else 0.0
    in_sd = difference / spread if spread > 0 else float("nan")
    shown = [number(values[0], 4), number(values[1], 4), number(difference, 3), number(in_sd, 2)]
    return (shown if spread > 0 else [*shown[:3], "not determined"]), abs(in_sd) > FAR


def _sensitivity(pair: Pair) -> Section:
    title, question = "Sensitivity", "Do the same parameters matter?"
    if (found := pair.results(SobolResult)) is None:
        return Section("sensitivity", title, question, missing=pair.missing("sobol"))
    rows, apart, unknown = [], [], []
    places = [{name: i for i, name in enumerate(one.names)} for one in found]
    for name in (name for name in places[0] if name in places[1]):
        at = [place[name] for place in places]
        values = [float(one.ST[i]) for one, i in zip(found, at, strict=True)]
        bounds = [float(one.ST_conf[i]) for one, i in zip(found, at, strict=True)]
        difference, spread = values[1] - values[0], hypot(*bounds)
        known = isfinite(difference) and isfinite(spread)
        beyond = known and abs(difference) > spread
        apart += [name] if beyond else []
        unknown += [] if known else [name]
        shown = [f"{number(value)} ± {number(bound, 2)}" for value, bound in zip(values, bounds, strict=True)]
        rows.append([name, *shown, number(difference, 2), "differs" if beyond else "" if known else "not known"])
    of = [f"Of {name}: {one.objective}." for name, one in zip(pair.names, found, strict=True)]
    header = ["parameter", *pair.names, "difference", ""]
    blocks: list[Block] = [
        *other_ranges([_ranges(one) for one in found], pair.names),
        Table("Total indices with their intervals", header, rows, words=(4,)),
        Words(" ".join(of)),
    ]
    words = f"beyond their intervals: {', '.join(apart)}" if apart else "no index differs beyond its interval"
    words += f"; not known: {', '.join(unknown)}" if unknown else ""
    return Section("sensitivity", title, question, blocks, found=words)


def _ranges(found: SobolResult) -> dict[str, Sequence[float]]:
    """The range of each parameter; of groups, the file does not tell which range is whose."""
    return {} if found.groups else dict(zip(found.names, found.bounds, strict=True))


def _posterior(pair: Pair) -> Section:
    title, question = "Posterior", "Where are the parameters of each site?"
    if (found := pair.results(InferResult)) is None:
        return Section("posterior", title, question, missing=pair.missing("infer"))
    rows = list(_marginals(*cast(tuple[Posteriors, Posteriors], found)))
    far = sum(apart for _, apart in rows)
    table = Table("Posterior means", ["parameter", *pair.names, "difference", "in sd"], [cells for cells, _ in rows])
    words = f"{far} of {len(rows)} means differ by more than {FAR:g} sd"
    return Section("posterior", title, question, [table, Words(INDEPENDENT, "note")], found=words)


def _marginals(first: Posteriors, second: Posteriors) -> Iterator[tuple[list[str], bool]]:
    """A row for each site and parameter of both."""
    for site, posterior in first.sites.items():
        others = second.sites[site].parameters if site in second.sites else {}
        for name, one in posterior.parameters.items():
            if name in others:
                cells, apart = _apart([one.mean, others[name].mean], [one.sd, others[name].sd])
                yield [f"{site} {name}", *cells], apart
