"""The study with the named effects: its file, the difference from the original study, and checks of the effects."""

import difflib
import os
from collections.abc import Sequence
from pathlib import Path, PurePath
from typing import cast

import numpy as np

from sinew.runner.files import remove_folder
from sinew.tasks.discover.fit.fit import Fitted
from sinew.tasks.discover.fit.specimen_fits import Effects, SpecimenFits
from sinew.tasks.discover.follow_up import Checks
from sinew.tasks.discover.result import TEMPLATE, WITH_EFFECTS
from sinew.tasks.model.effects import effect_named
from sinew.tasks.simulate.febio.simulator import FEBio
from sinew.tasks.study.files import write_text
from sinew.tasks.study.own_template import template_texts
from sinew.tasks.study.settings_file import as_yaml, from_yaml
from sinew.tasks.study.workspace import Workspace


def study_with(workspace: Workspace, effects: Effects, where: Path = WITH_EFFECTS) -> tuple[str, str]:
    """Write the study with the effects in its model, to ``where`` in the result folder, and its template beside it.

    Returns that path, and what changed.
    """
    path: Path = workspace.out / where
    old = from_yaml(workspace.study.text)  # as it was judged: the file may have changed since
    model = old.get("model") or {}
    # ranges that were scaled to the cohort's size must be in the study
    written = {parameter for effect in effects for parameter in effect_named(effect.name).parameters}
    ranges = {
        one.name: {"min": one.minimum, "max": one.maximum, "reference": one.reference, "unit": one.unit}
        for effect in effects
        for one in effect.parameters
        if one not in written
    }
    model |= {"parameters": (model.get("parameters") or {}) | ranges} if ranges else {}
    new = {**old, "model": {**model, "effects": [effect.name for effect in effects]}}
    path.parent.mkdir(exist_ok=True)
    settings = workspace.study.simulator
    if settings.own_template is not None:
        template = cast(FEBio, workspace.simulator).template
        remove_folder(workspace.out / TEMPLATE)  # of another template, which this one may have replaced
        for name, text in {**template_texts(workspace.study), **template.files}.items():
            (copy := workspace.out / TEMPLATE / name).parent.mkdir(parents=True, exist_ok=True)
            write_text(copy, text)
        new["simulator"] = {**new["simulator"], settings.template_field: f"{TEMPLATE.name}/{template.main}"}
        if settings.further_templates:
            coarse = new["simulator"]["coarse"]
            new["simulator"]["coarse"] = {**coarse, "file": f"{TEMPLATE.name}/{PurePath(coarse['file']).name}"}
    elif workspace.simulator.name != settings.name:  # options of the command replaced these two
        new["simulator"] = workspace.simulator.name
    if workspace.study.seed != old.get("seed", type(workspace.study).model_fields["seed"].default):
        new["seed"] = workspace.study.seed
    # from the file itself, so that a study and its results may be moved together
    new["cohort"] = os.path.relpath(workspace.cohort.folder.resolve(), path.parent.resolve())
    before, after = (as_yaml(each) for each in (old, new))
    write_text(path, after)
    difference = difflib.unified_diff(before.splitlines(), after.splitlines(), "study", "with effects", lineterm="")
    return str(path.relative_to(workspace.out)), "\n".join(difference)


def checks(cohort: Sequence[SpecimenFits], effects: Effects, fits: Sequence[Fitted]) -> Checks:
    """What the added effects change: nothing at their null values, and more than noise at the fit, if all is right."""
    at_null, at_fit = 0.0, 0.0
    for one, fitted in zip(cohort, fits, strict=True):
        having, bare = one.candidate(effects), one.candidate()
        own = fitted.at[: bare.size]
        points = np.array([np.concatenate([own, having.null()]), fitted.at])
        for curve in one.measured.curves:
            without = bare.forces(one.measured.specimen, curve.protocol, own[np.newaxis])[0]
            null, fit = having.forces(one.measured.specimen, curve.protocol, points)
            at_null = max(at_null, float(np.abs(null - without).max()))
            at_fit = max(at_fit, float(np.abs(fit - without).max()))
    noise = max(one.measured.noise.sd_N for one in cohort)
    return Checks(at_null, at_fit, noise, at_fit > noise)
