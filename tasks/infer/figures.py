"""Figures of an inference, of whichever method."""

from collections.abc import Mapping
from typing import Any

from sinew.tasks.drawing.views import FigureKind
from sinew.tasks.infer.method import module
from sinew.tasks.infer.result import Posteriors
from sinew.tasks.study.workspace import Workspace


def draw(workspace: Workspace, result: Posteriors) -> None:
    """Write all figures, each with its table."""
    module(result, "figures").draw(workspace, result)


def kinds(result: Posteriors) -> Mapping[str, FigureKind[Any]]:
    """Figures by name, one at a time: those of the method that the result is of."""
    found: Mapping[str, FigureKind[Any]] = module(result, "figures").FIGURES
    return found
