"""The figures of each task by name, drawn from its JSON and the store, for those who look at one at a time."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import xarray as xr
from matplotlib import pyplot as plt
from matplotlib.figure import Figure

from runner.store import open_store
from tasks.model import file_name
from tasks.problems import BadInput, shown
from tasks.report import calibration, discovery, figures, posterior, prediction, site_figures
from tasks.report.frames import courses

Told = dict[str, Any]


@dataclass(frozen=True)
class View:
    """``draw(told, folder, of)`` draws a figure; ``each`` gives what there is one of each for, None: there is one."""

    draw: Callable[[Told, Path, str], Figure]
    each: Callable[[Told], list[str]] | None = None


def names(task: str, told: Told) -> dict[str, list[str]]:
    """The figures of a task by name, the plainest first, and what there is one of each for (nothing: there is one)."""
    found = {name: [] if one.each is None else one.each(told) for name, one in VIEWS[task].items()}
    return {name: each for name, each in found.items() if each or VIEWS[task][name].each is None}


def view(task: str, told: Told, folder: Path, name: str | None, of: str | None) -> Figure:
    """A figure of a task: the first, or that of ``name``; ``of`` a specimen or site, or the first of them.

    Raises :class:`BadInput` for names that are not there.
    """
    name = next(iter(VIEWS[task])) if name is None else name
    if name not in VIEWS[task]:
        raise BadInput(f"{task}: figure", shown(name), f"one of {', '.join(VIEWS[task])}")
    chosen = VIEWS[task][name]
    choices = chosen.each(told) if chosen.each else []
    if of is not None and of not in choices:
        expected = f"one of {', '.join(choices)}" if choices else "nothing: there is one of it"
        raise BadInput(f"{task}: figure {name}", f"of {shown(of)}", expected)
    if chosen.each and not choices:
        raise BadInput(f"{task}: figure {name}", "there is none of it", f"one of {', '.join(names(task, told))}")
    figure = chosen.draw(told, folder, of or (choices[0] if choices else ""))
    plt.close(figure)  # the caller has it; a notebook that keeps track of open figures would show it twice
    return figure


def _kept(folder: Path, name: str) -> xr.Dataset:
    return open_store(folder).read_result(name)


def _of_sites(told: Told) -> list[str]:
    return list(told["sites"])


def _posterior(kind: str) -> View:
    def draw(told: Told, folder: Path, site: str) -> Figure:
        particles = _kept(folder, f"infer/{site}")
        return {
            "marginals": lambda: posterior.marginals(particles, told, site),
            "joint": lambda: posterior.joint(particles, told["names"], site),
            "thresholds": lambda: posterior.thresholds(told["sites"][site], site),
        }[kind]()

    return View(draw, _of_sites)


def _predicted(draw: Callable[[xr.Dataset, Told, str], Figure], needs: str | None = None) -> View:
    return View(
        lambda told, folder, site: draw(_kept(folder, f"predict/{site}"), told["sites"][site], site),
        lambda told: [site for site, one in told["sites"].items() if needs is None or one[needs] is not None],
    )


VIEWS: dict[str, dict[str, View]] = {
    "sobol": {
        "indices": View(lambda told, folder, _: figures.sobol_indices(told)),
        "convergence": View(lambda told, folder, _: figures.sobol_convergence(told)),
        "time": View(
            lambda told, folder, course: _along_time(told, folder, *courses(told)[course]),
            lambda told: list(courses(told)),
        ),
    },
    "importance": {"importance": View(lambda told, folder, _: figures.forest_importance(told))},
    "calibrate": {
        "convergence": View(lambda told, folder, _: figures.calibration_convergence(told)),
        "search": View(
            lambda told, folder, specimen: calibration.convergence(specimen, told["specimens"][specimen]),
            lambda told: list(told["specimens"]),
        ),
        "correlations": View(lambda told, folder, _: _correlations(told, folder)),
    },
    "infer": {kind: _posterior(kind) for kind in ("marginals", "joint", "thresholds")},
    "predict": {
        "bands": _predicted(prediction.site_bands),
        "specimens": _predicted(prediction.each_specimen),
        "stresses": _predicted(prediction.stress_bands, "stresses_of"),
    },
    "compare": {"sites": View(lambda told, folder, _: site_figures.separation(told))},
    "discover": {
        "cells": View(lambda told, folder, _: discovery.cell_map(told)),
        "curves": View(
            lambda told, folder, specimen: discovery.before_and_after(
                _kept(folder, f"discover/{file_name(specimen)}"), told, specimen
            ),
            lambda told: list(told["cells"]),
        ),
    },
}


def _along_time(told: Told, folder: Path, specimen: str, output: str | None) -> Figure:
    kept = _kept(folder, f"sobol_time/{told['tables'][specimen]}")
    return figures.sobol_along_time(kept, told["names"], output)


def _correlations(told: Told, folder: Path) -> Figure:
    found = told["correlations"]
    if not found.get("pairs"):
        raise BadInput(folder / "calibrate.json", "holds no correlations", f"more specimens ({found.get('reason')})")
    return calibration.correlation_matrix(found)
