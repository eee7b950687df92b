"""Figures of a result by name, one at a time: for notebooks, and whoever wants a single one."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar

from matplotlib import pyplot as plt
from matplotlib.figure import Figure

from sinew.runner.errors import BadInput, shown

R = TypeVar("R")


@dataclass(frozen=True)
class FigureKind(Generic[R]):
    """``draw(result, folder, of)`` draws a figure. ``each(result)`` lists what there is one of each for (None: one)."""

    draw: Callable[[R, Path, str], Figure]
    each: Callable[[R], list[str]] | None = None


def names(kinds: Mapping[str, FigureKind[Any]], result: Any) -> dict[str, list[str]]:
    """Figures by name, the plainest first, and what there is one of each for (nothing: there is one)."""
    found = {name: [] if kind.each is None else kind.each(result) for name, kind in kinds.items()}
    return {name: each for name, each in found.items() if each or kinds[name].each is None}


def one_figure(
    kinds: Mapping[str, FigureKind[Any]], task: str, result: Any, folder: Path, name: str | None, of: str | None
) -> Figure:
    """A figure of a task: the first, or that of ``name``; ``of`` a specimen or site, or the first of them.

    Raises :class:`BadInput` for names that are not there.
    """
    name = next(iter(kinds)) if name is None else name
    if name not in kinds:
        raise BadInput(f"{task}: figure", shown(name), f"one of {', '.join(kinds)}")
    kind = kinds[name]
    choices = kind.each(result) if kind.each else []
    if of is not None and of not in choices:
        expected = f"one of {', '.join(choices)}" if choices else "nothing: there is one of it"
        raise BadInput(f"{task}: figure {name}", f"of {shown(of)}", expected)
    if kind.each and not choices:
        raise BadInput(f"{task}: figure {name}", "there is none of it", f"one of {', '.join(names(kinds, result))}")
    figure = kind.draw(result, folder, of or (choices[0] if choices else ""))
    plt.close(figure)  # the caller has it; a notebook that keeps track of open figures would show it twice
    return figure
