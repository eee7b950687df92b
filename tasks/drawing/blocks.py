"""What a section of the page is made of: plain data, which the template turns into HTML and escapes."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

from sinew.runner.errors import one_line

Data = Mapping[str, Mapping[str, Sequence[Any]]]  # columns by name of the source


@dataclass(frozen=True)
class Words:
    """A paragraph; ``tone`` is plain, note or warning."""

    text: str
    tone: str = "plain"
    kind: ClassVar[str] = "words"


@dataclass(frozen=True)
class Table:
    """A table: the first column names the row, the others are numbers unless ``words`` says which are not."""

    caption: str
    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    words: Sequence[int] = ()
    open: bool = True
    kind: ClassVar[str] = "table"


@dataclass(frozen=True)
class Code:
    """Text to be shown as it is: a study, a difference, commands."""

    caption: str
    text: str
    open: bool = True
    kind: ClassVar[str] = "code"


@dataclass(frozen=True)
class Plot:
    """An interactive plot: ``item`` from :func:`sinew.tasks.drawing.plots.item`; ``label`` for screen readers."""

    name: str
    item: Mapping[str, Any]
    label: str
    height: int
    wide: bool = False


@dataclass(frozen=True)
class Plots:
    """Plots side by side. With ``options``, a person picks one of them: ``data`` and ``notes`` hold what it shows."""

    name: str
    caption: str
    plots: Sequence[Plot]
    pick: str = ""
    options: Sequence[str] = ()
    data: Mapping[str, Data] = field(default_factory=dict)
    notes: Mapping[str, str] = field(default_factory=dict)
    kind: ClassVar[str] = "plots"


@dataclass(frozen=True)
class Facts:
    """Names and values."""

    rows: Sequence[tuple[str, str]]
    kind: ClassVar[str] = "facts"


Block = Words | Table | Code | Plots | Facts


@dataclass(frozen=True)
class Section:
    """A section of the page. ``found``, ``sure`` and ``failed`` are its line in the summary.

    ``missing`` says why there is nothing to show; ``folded`` sections of that kind share one line of the page.
    """

    name: str
    title: str
    question: str
    blocks: Sequence[Block] = ()
    found: str = ""
    sure: str = ""
    failed: str = ""
    missing: str = ""
    folded: bool = False


LARGE = 1e15  # beyond it, a number is written with its power of ten
FAR_BELOW = -10.0  # a part of one


def number(value: Any, digits: int = 3) -> str:
    """A number for a person, a dash where there is none."""
    if value is None or not math.isfinite(value):
        return "–"
    if abs(value) >= LARGE:
        return f"{value:.{digits}g}"
    if value == int(value):
        return f"{int(value):,}"
    if abs(value) >= 10**digits:
        return f"{value:,.0f}"
    return f"{value:.{digits}g}"


def span(values: Sequence[float], digits: int = 3) -> str:
    """From the smallest to the largest for a person: ``3.1 to 3.3``, or ``3.2`` where these are written alike."""
    ends = dict.fromkeys(number(end, digits) for end in (min(values), max(values)))
    return " to ".join(ends)


def percent(part: Any, digits: int = 0) -> str:
    """A part of one as percent; what is far below zero, as of a fit that ended nowhere, only as that."""
    if part is None or not math.isfinite(part):
        return "–"
    return f"{round(100 * part, digits) + 0.0:.{digits}f} %" if part > FAR_BELOW else f"below {100 * FAR_BELOW:.0f} %"


def level(probability: float) -> str:
    """The probability of a band or interval as percent, which is never rounded to all."""
    return f"{100.0 * probability:.6g} %"


def times(above: Any) -> str:
    """How many times a reference something is, from the part of it by which it is ``above``."""
    return "–" if above is None else f"{1.0 + above:.4g}"


def plain_paragraph(text: str) -> str:
    """A text as one paragraph of Markdown, without elements, links and headings: it may come from elsewhere."""
    words = one_line(text).replace("<", "&lt;").replace("](", "]\\(")
    return f"\\{words}" if words.startswith("#") else words


def listed(names: Sequence[str], most: int = 4) -> str:
    """Names in a sentence; of many, the first."""
    if len(names) > most:
        return f"{', '.join(names[:most])} and {len(names) - most} more"
    return ", ".join(names[:-1]) + " and " + names[-1] if len(names) > 1 else "".join(names)


def largest(names: Sequence[str], values: Sequence[float] | Any, most: int = 3) -> str:
    """The names with the largest values ``[n]`` and these, largest first: ``E_f 0.8, E_m 0.1``."""
    order = sorted(range(len(names)), key=lambda j: -values[j] if math.isfinite(values[j]) else math.inf)
    return ", ".join(f"{names[j]} {number(values[j])}" for j in order[:most])


def behind(unit: str) -> str:
    """A unit as it stands behind a number, with the space before it; nothing for a number without a unit."""
    return "" if unit == "1" else f" {unit}"


def unit_cell(unit: str) -> str:
    """A unit in a cell of its own, which stays empty for a number without a unit."""
    return "" if unit == "1" else unit


def with_its_unit(name: str, unit: str) -> str:
    """What an axis or a column shows: ``width change (mm)``, or the name alone for a number without a unit."""
    return name if unit == "1" else f"{name} ({unit})"


def plural(count: int, word: str) -> str:
    """``3 rows``, ``1 row``."""
    return f"{count:,} {word}{'' if count == 1 else 's'}"


def duration(seconds: float | None) -> str:
    """Seconds in the unit that suits them."""
    if seconds is None:
        return "–"
    for size, unit in ((86_400, "d"), (3600, "h"), (60, "min")):
        if seconds >= 2 * size:
            return f"{seconds / size:.1f} {unit}"
    return f"{seconds:.3g} s"
