"""Interactive plots in one style, as JSON that a page embeds; they differ by dash and marker as well as by colour."""

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from html import escape
from typing import Any, Literal, TypeVar

import numpy as np
from bokeh.embed import json_item
from bokeh.layouts import column
from bokeh.models import ColumnDataSource, HoverTool
from bokeh.models.annotations import Legend
from bokeh.plotting import figure as bokeh_figure

from sinew.tasks.drawing.blocks import Data, Plot, Plots
from sinew.tasks.drawing.figures import COLOURS

INK, MUTED, RULE, MEASURED = "#1d2329", "#5a646e", "#e4e7ea", "#7a858f"
DASHES = ("solid", "dashed", "dotdash", "dotted", [10, 3, 2, 3, 2, 3], [2, 5])
MARKERS = ("circle", "square", "triangle", "diamond", "inverted_triangle", "star", "hex", "plus")
DIGITS = 5  # significant ones of numbers in the page
MOST_NUMBERS = 5_000_000  # of what can be picked
MOST_LINES = 40  # of a plot, and plots beside each other
HEIGHT = 270
NARROW = 300  # pixels of the narrowest plot, as on a phone
_ID = re.compile(r"p\d+")
_TEX = re.compile(r"(\$\$|\\\(|\\\[)")

Sources = Mapping[str, ColumnDataSource]
T = TypeVar("T")


def first(what: Iterable[T], called: str) -> tuple[list[T], str]:
    """As many as can be drawn, and a sentence that says so where there are more; ``called``: what they are."""
    every = list(what)
    more = f" Drawn are the first {MOST_LINES} of {len(every):,} {called}." if len(every) > MOST_LINES else ""
    return every[:MOST_LINES], more


def figure(x: str, y: str, *, height: int = HEIGHT, **options: Any) -> Any:
    """An empty plot in the page's style, ``x`` and ``y`` its axes' words."""
    plot: Any = bokeh_figure(  # type: ignore[call-arg]
        height=height,
        sizing_mode="stretch_width",
        tools="pan,box_zoom,wheel_zoom,reset,save",
        active_drag="box_zoom",
        active_scroll=None,
        toolbar_location="above",
        x_axis_label=plain(x),
        y_axis_label=plain(y),
        **options,
    )
    plot.toolbar.autohide = True
    plot.toolbar.logo = None
    plot.outline_line_color = None
    plot.min_border_right = 12
    for axis in plot.axis:
        axis.axis_line_color = MUTED
        axis.major_tick_line_color = MUTED
        axis.minor_tick_line_color = None
        axis.major_label_text_color = INK
        axis.axis_label_text_color = INK
        axis.axis_label_text_font_style = "normal"
        axis.axis_label_text_font_size = "12px"
        axis.major_label_text_font_size = "11px"
    plot.grid.grid_line_color = RULE
    return plot


def legend(plot: Any, entries: Sequence[tuple[str, Sequence[Any]]]) -> None:
    """A legend above the plot; a click on an entry hides what it names."""
    widest = max(7 * len(name) + 34 for name, _ in entries)
    above = Legend(
        items=[(plain(name), list(glyphs)) for name, glyphs in entries],
        orientation="horizontal",
        click_policy="hide",
        border_line_color=None,
        background_fill_alpha=0.0,
        label_text_font_size="11px",
        margin=0,
        ncols=max(1, NARROW // widest),
        location="left",
    )
    plot.add_layout(above, "above")


def words(name: str) -> str:
    """A name as a row of what :func:`hover` shows, where Bokeh takes HTML and names of columns."""
    return escape(name).replace("@", "&#64;").replace("$", "&#36;").replace("{", "&#123;")


def hover(plot: Any, glyph: Any, rows: Sequence[tuple[str, str]], mode: Literal["mouse", "vline"] = "mouse") -> None:
    """Show values of ``glyph`` at the pointer."""
    plot.add_tools(HoverTool(tooltips=list(rows), renderers=[glyph], mode=mode, point_policy="snap_to_data"))


def colour(number: int) -> str:
    """The colour of the ``number``-th of several things; yellow is too pale for lines on white."""
    usable = [each for each in COLOURS if each != "#F0E442"]
    return usable[number % len(usable)]


def dash(number: int) -> Any:
    """The dash of the ``number``-th of several lines."""
    return DASHES[number % len(DASHES)]


def source(name: str, columns: Mapping[str, Any]) -> ColumnDataSource:
    """Columns that a page can exchange by their ``name``."""
    return ColumnDataSource({key: numbers(values) for key, values in columns.items()}, name=name)


def numbers(values: Any) -> list[Any]:
    """A column as a list: numbers of few digits, NaN where there is none; words as they are."""
    if any(isinstance(value, str) for value in values):  # NumPy would take as much for each as for the longest
        return [str(value) for value in values]
    array = np.asarray([np.nan if value is None else value for value in values])
    return [float(f"{value:.{DIGITS}g}") for value in array.astype(float)]


def _size(values: Any) -> int:
    """What a column takes in the page, in numbers."""
    return 10 + len(values) + sum(len(value) // DIGITS for value in values if isinstance(value, str))


def plain(text: str) -> str:
    """Text that a plot shows as it is, although it might look like a formula."""
    return _TEX.sub(lambda found: "\u200b".join(found.group(0)), text)


def plot(name: str, drawn: Any, label: str, *, below: Any = None, wide: bool = False) -> Plot:
    """A finished plot, with another ``below`` that zooms with it. ``label`` says in words what it shows."""
    if below is None:
        return Plot(name, item(drawn), label, int(drawn.height), wide)
    both = column(drawn, below, sizing_mode="stretch_width")
    return Plot(name, item(both), label, int(drawn.height + below.height), wide)


def item(drawn: Any) -> dict[str, Any]:
    """A plot as JSON; equal plots give equal bytes, whatever was drawn before."""
    found = json_item(drawn)
    drawn.document.clear()  # so that its sources may serve other plots
    known: dict[str, str] = {}

    def renamed(value: Any) -> Any:
        if isinstance(value, dict):
            return {
                key: known.setdefault(each, f"p{len(known)}")
                if key in ("id", "root_id") and isinstance(each, str) and _ID.fullmatch(each)
                else renamed(each)
                for key, each in value.items()
                if key != "target_id"
            }
        return [renamed(each) for each in value] if isinstance(value, list) else value

    return renamed(dict(found))


def picked(
    name: str,
    caption: str,
    pick: str,
    data: Mapping[str, Data],
    draw: Callable[[Sources], Sequence[Plot]],
    notes: Mapping[str, str] | None = None,
) -> Plots:
    """Plots of one of several things. ``data`` holds the same sources for each; ``draw`` gets those of the first.

    Of very many things, only the first can be picked.
    """
    rounded: dict[str, dict[str, dict[str, list[Any]]]] = {}
    room = MOST_NUMBERS
    for option, found in data.items():
        room -= sum(_size(values) for columns in found.values() for values in columns.values())
        if room < 0 and rounded:
            caption += f" The first {len(rounded):,} of {len(data):,} can be picked."
            break
        rounded[option] = {
            key: {column: numbers(values) for column, values in columns.items()} for key, columns in found.items()
        }
    first = next(iter(rounded.values()))
    plots = draw({key: ColumnDataSource(dict(columns), name=key) for key, columns in first.items()})
    return Plots(name, caption, plots, pick, list(rounded), rounded, notes or {})
