"""Figures of an inference, of whichever method."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from sinew.tasks.drawing.views import FigureKind
from sinew.tasks.infer.method import module
from sinew.tasks.infer.result import Posteriors
from sinew.tasks.study.workspace import Workspace


def draw(workspace: Workspace, result: Posteriors) -> None:
    """Write all figures, each with its table."""
    module(result, "figures").draw(workspace, result)


def _kind(name: str) -> FigureKind[Any]:
    def kind(result: Any) -> FigureKind[Any] | None:
        found: FigureKind[Any] | None = module(result, "figures").FIGURES.get(name)
        return found

    def drawn(result: Any, folder: Path, of: str) -> Figure:
        chosen = kind(result)
        assert chosen is not None
        return chosen.draw(result, folder, of)

    def each(result: Any) -> list[str]:
        chosen = kind(result)
        return chosen.each(result) if chosen is not None and chosen.each is not None else []

    return FigureKind(drawn, each)


FIGURES: Mapping[str, FigureKind[Any]] = {
    name: _kind(name) for name in ("populations", "specimens", "marginals", "joint", "thresholds")
}
"""Figures of a result by name, one at a time; those of the other method are there for none."""
