"""Virtual specimens whose lateral strain was measured beside the force, by a camera slower than the load cell."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from sinew.tasks.data.cohort import write_cohort
from sinew.tasks.data.virtual import autoregressive, virtual_cohort
from sinew.tasks.model import Model, Specimen
from sinew.tasks.simulate.lateral import lateral

NOISE = 3e-4  # of the lateral strain
EVERY = 5  # rows between two pictures of the camera


def measured_laterally(
    count: int = 1, rate_hz: float = 5.0, per_site: int = 1
) -> tuple[list[Specimen], Mapping[str, Any]]:
    """Specimens with a column ``lateral_strain``, and the true parameters of each by name."""
    specimens, truth = virtual_cohort(seed=3, per_site=per_site, rate_hz=rate_hz)
    model, found = Model(), []
    for number, one in enumerate(specimens[:count]):
        values = np.array([[truth["specimens"][one.name]["parameters"][name] for name in model.names]])
        rng = np.random.default_rng([5, number])
        curves = []
        for curve in one.curves:
            strain = 0.5 * (one.stretch(curve.protocol) ** 2 - 1.0)
            seen = lateral("lateral_strain", model, one, values, strain)[0]
            seen = seen + NOISE * autoregressive(rng, seen.size, 0.3)
            seen[np.arange(seen.size) % EVERY != 0] = np.nan
            curves.append(replace(curve, others={"lateral_strain": seen}))
        found.append(replace(one, curves=tuple(curves)))
    return found, {name: each["parameters"] for name, each in truth["specimens"].items()}


def write_measured(folder: Path, count: int = 1, rate_hz: float = 5.0, per_site: int = 1) -> Mapping[str, Any]:
    """Write such specimens to ``FOLDER/cohort``; returns the true parameters of each by name."""
    specimens, truth = measured_laterally(count, rate_hz, per_site)
    write_cohort(folder / "cohort", specimens)
    return truth


def study_of(folder: Path, more: str, compared: str = "measured: {force: {}, lateral_strain: {}}") -> Path:
    """A study of the cohort in ``folder`` that compares the lateral strain too."""
    path = folder / "study.yaml"
    path.write_text(f"name: several\nseed: 1\ncohort: cohort\n{compared}\n{more}\n", "utf-8")
    return path
