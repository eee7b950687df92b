"""The study with the effects that were named: as a file, with what it changes, and checked to do what it should."""

import difflib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from tasks.discover.explore import Effects, Explorer
from tasks.discover.fit import Fitted
from tasks.model.effects import named
from tasks.workspace import Workspace, write_text


def add_to_study(workspace: Workspace, effects: Effects) -> dict[str, Any]:
    """Write the study with the effects in its model beside the results; its path there, and what changed."""
    path: Path = workspace.out / "discover" / "model.yaml"
    old = yaml.safe_load(workspace.study.path.read_text("utf-8"))
    model = old.get("model") or {}
    # where the cohort's size has changed the ranges of the library, the study must say so
    written = {parameter for effect in effects for parameter in named()[effect.name].parameters}
    ranges = {
        one.name: {"min": one.minimum, "max": one.maximum, "reference": one.reference, "unit": one.unit}
        for effect in effects
        for one in effect.parameters
        if one not in written
    }
    model |= {"parameters": (model.get("parameters") or {}) | ranges} if ranges else {}
    new = {**old, "model": {**model, "effects": [effect.name for effect in effects]}}
    new["cohort"] = str(workspace.cohort.folder.resolve())
    before, after = (yaml.safe_dump(each, sort_keys=False, allow_unicode=True) for each in (old, new))
    path.parent.mkdir(exist_ok=True)
    write_text(path, after)
    difference = difflib.unified_diff(before.splitlines(), after.splitlines(), "study", "with effects", lineterm="")
    return {"path": str(path.relative_to(workspace.out)), "difference": "\n".join(difference)}


def checks(explored: Sequence[Explorer], effects: Effects, fits: Sequence[Fitted]) -> dict[str, Any]:
    """What the added effects change: nothing at their null values, and more than noise at the fitted ones (N).

    ``at_null_N`` and ``at_fit_N`` are the largest changes of the force over all curves, ``noise_N`` the noise there.
    """
    at_null, at_fit = 0.0, 0.0
    for one, fitted in zip(explored, fits, strict=True):
        having, bare = one.candidate(effects), one.candidate()
        own = fitted.at[: bare.size]
        points = np.array([np.concatenate([own, having.null()]), fitted.at])
        for curve in one.measured.curves:
            without = bare.forces(one.measured.specimen, curve.protocol, own[np.newaxis])[0]
            null, fit = having.forces(one.measured.specimen, curve.protocol, points)
            at_null = max(at_null, float(np.abs(null - without).max()))
            at_fit = max(at_fit, float(np.abs(fit - without).max()))
    noise = max(one.measured.noise.sd_N for one in explored)
    return {"at_null_N": at_null, "at_fit_N": at_fit, "noise_N": noise, "not_inert": at_fit > noise}
