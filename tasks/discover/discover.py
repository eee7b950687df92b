"""Where a model and measurements disagree, which effect of the library is missing, and the model with it.

Leaves ``discover.json`` (also as ``verdict.json``), and when an effect is named ``discover/model.yaml``: the study with
the effect in its model. See docs/discover.md.
"""

from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from runner.ensemble import Desk
from tasks.discover.added import add_to_study, checks
from tasks.discover.cells import located_part, misfit_map
from tasks.discover.choose import CLEARLY, Evidence, Scored, leading, realised, rivals, single, verdict
from tasks.discover.confidence import confidence
from tasks.discover.conflict import conflict, together
from tasks.discover.experiment import Experiment, Rival, next_experiment
from tasks.discover.explore import Effects, Explorer, agree, each_for_all, explorers
from tasks.discover.fit import Fitted
from tasks.discover.intervals import Profiled
from tasks.discover.search import Found, asked, note_fit, search
from tasks.discover.shape import shape
from tasks.discover.sizes import library_for
from tasks.discover.solver import in_febio
from tasks.discover.splits import gain
from tasks.discover.told import NO_GAP, gap_of, simulated, told_candidate
from tasks.model import file_name
from tasks.problems import BadInput
from tasks.provenance import code
from tasks.simulate import Array
from tasks.workspace import Workspace, attempts_folder, digest, read_result, write_json

BLOCK = 50  # points whose errors may depend on each other
RIVALS, ASKED = 4, 4  # that the next experiment is sought for, and in how many specimens
SURELY = 0.02  # of the chance of a cell beyond chance: one that is beyond this, too, is there


def discover(workspace: Workspace) -> dict[str, Any]:
    """The verdict on a cohort. Returns ``discover.json``.

    Raises :class:`BadInput` when the study's model has effects already, for effects that its simulator does not have,
    and when noise cannot be told from the curves.
    """
    settings, seed = workspace.study.discover, workspace.study.seed
    inputs = _inputs(workspace)
    files = [workspace.out / name for name in ("discover.json", "verdict.json")]
    if (kept := _kept(workspace, files, inputs)) is not None:
        return kept
    explored = _ready(workspace)

    def without_effects(i: int, _: None, desk: Desk) -> list[Fitted]:
        fits = explored[i].bare(desk, settings.starts, (seed, 9, i))
        note_fit(workspace, explored[i].name, (), fits[0])
        return fits

    bare: list[list[Fitted]] = each_for_all(workspace, explored, "the model as it is", [None], without_effects)[0]
    found = search(workspace, explored, [fits[0] for fits in bare])
    floor = realised(list(found.scored.values()), found.floor)
    trusted = all(
        agree(sorted([*fits, null], key=lambda one: one.loss)) for fits, null in zip(bare, found.null, strict=True)
    )
    held = _hold_out(workspace, explored, found)
    conflicts = _conflicts(workspace, explored, found.null)
    chance = settings.chance / len(explored)
    before = [
        misfit_map(one.measured, one.candidate(), null, chance, SURELY, (seed, 10, i))
        for i, (one, null) in enumerate(zip(explored, found.null, strict=True))
    ]
    after = {
        effects: [
            misfit_map(one.measured, one.candidate(effects), fitted, chance, SURELY, (seed, 11, i))
            for i, (one, fitted) in enumerate(zip(explored, found.fits[effects], strict=True))
        ]
        for effects in held
        if effects
    }
    for effects, told in after.items():
        found.scored[effects] = replace(found.scored[effects], in_place=located_part(before, told))
    about = Evidence(
        found.floor,
        located=any(abs(cell["z"]) > cell["limit"] for cells in before for cell in cells),
        surely=any(abs(cell["z"]) > cell["sure"] for cells in before for cell in cells),
        trusted=trusted,
    )
    decided = verdict(found.nothing, list(found.scored.values()), about)
    best = next((one for one in found.scored.values() if one.effects == decided.judged), found.nothing)
    ends = _profiled(workspace, explored, found, best) if decided.word in ("NAMED", "AMBIGUOUS") else {}
    names = [one.name for one in explored]
    result: dict[str, Any] = {
        "verdict": decided.word,
        "effects": list(decided.effects),
        "set": list(decided.alike),
        "why": decided.why,
        "confidence": confidence(decided.word),
        "explained": decided.explained,
        "null": {
            "loss": found.nothing.loss,
            "floor": found.floor,
            "trusted": trusted,
            "starts": {name: [one.loss for one in fits] for name, fits in zip(names, bare, strict=True)},
        },
        "conflict": conflicts,
        "located": about.located,
        "surely": about.surely,
        "noise": {one.name: asdict(one.measured.noise) for one in explored},
        "candidates": [
            told_candidate(
                found.scored[effects],
                found.nothing,
                floor,
                effects,
                explored,
                found.fits[effects],
                ends.get(effects),
            )
            for effects in found.ordered
        ],
        "cells": dict(zip(names, before, strict=True)),
        "shown": list(best.effects),
        "gap": gap_of(held, found.having(best), explored, found.fits) if held else NO_GAP,
        "next_experiment": None,
        "outside": None,
        "model": None,
        "inputs": inputs,
    }
    shown = found.having(best) if best.effects else ()
    for i, one in enumerate(explored):
        curves = simulated(one, found.null[i], shown, found.fits[shown][i] if shown else None)
        workspace.store.write_result(_curves_name(one.name), curves)
    if shown in after:
        result["after"] = dict(zip(names, after[shown], strict=True))
    if decided.word == "AMBIGUOUS" and best.effects:
        result["next_experiment"] = _experiment(workspace, explored, found, best)
    if decided.word == "OUTSIDE":
        described = [one.measured for one in explored[:ASKED]]
        ats = [one.at for one in found.null[:ASKED]]
        known = library_for([one.measured.specimen for one in explored])
        result["outside"] = shape(workspace.model, described, ats, known).told()
    if decided.word == "NAMED":
        result["model"] = add_to_study(workspace, shown)
        result["model"]["checks"] = checks(explored, shown, found.fits[shown])
        result["model"]["febio"] = in_febio(workspace, explored[0], shown, found.fits[shown][0])
    for file in files:
        write_json(file, result)
    return result


def _inputs(workspace: Workspace) -> str:
    """Names all that a verdict depends on: also the rules by which it is given, and the solver that checks it."""
    study = workspace.study
    solver = study.solver_with((), attempts_folder(workspace.out)).identity()
    specimens = {specimen.name: specimen.identity() for specimen in workspace.cohort.specimens}
    told = (study.path.read_text("utf-8"), study.seed, str(workspace.cohort.folder.resolve()), specimens)
    return digest(*told, workspace.simulator.identity(), solver, code())


def _kept(workspace: Workspace, files: Sequence[Path], inputs: str) -> dict[str, Any] | None:
    """The verdict on the same inputs, if all that goes with it is there and nothing is to be tried again."""
    found, again = (read_result(file) for file in files)
    if workspace.retry_failed or found is None or found != again or found.get("inputs") != inputs:
        return None
    there = all(_curves_name(name) in workspace.store.root for name in found["cells"])
    written = [found["model"]["path"], *found["model"]["febio"]["inputs"]] if found["model"] else []
    return found if there and all((workspace.out / path).is_file() for path in written) else None


def _curves_name(specimen: str) -> str:
    return f"discover/{file_name(specimen)}"


def _ready(workspace: Workspace) -> list[Explorer]:
    """The specimens, once it is sure that a verdict on them is possible."""
    study = workspace.study
    if study.model.effects:
        raise BadInput(f"{study.path}: model.effects", "is not empty", "a model without effects to begin with")
    explored = explorers(workspace)
    missing = [effect.slug for effect in asked(workspace, explored) if not effect.febio]
    if missing and explored[0].solver is not None:
        expected = "effects with a FEBio partial (docs/effects.md), or simulator: uniaxial"
        raise BadInput(f"{study.path}: discover.effects", f"{', '.join(missing)}: not in FEBio", expected)
    for one in explored:
        if not one.measured.noise.sd_N > 0:
            raise BadInput(workspace.cohort.folder / one.name, "no noise can be seen in its curves", "measured curves")
    return explored


def _conflicts(workspace: Workspace, explored: Sequence[Explorer], null: Sequence[Fitted]) -> dict[str, Any]:
    """Whether one set of parameters can be right for all protocols, by specimen and for all of them."""
    title = "the model as it is, for each curve alone"
    (alone,) = each_for_all(workspace, explored, title, [None], lambda i, _, desk: explored[i].alone(desk, null[i]))
    found = [
        conflict(one.candidate(), one.measured, fitted, own)
        for one, fitted, own in zip(explored, null, alone, strict=True)
    ]
    statistic, freedom, p = together(found)
    specimens = {one.name: asdict(each) for one, each in zip(explored, found, strict=True)}
    return {"statistic": statistic, "freedom": freedom, "p": p, "specimens": specimens}


def _experiment(
    workspace: Workspace, explored: Sequence[Explorer], found: Found, best: Scored
) -> dict[str, object] | None:
    """What would tell the rivals apart; where there are none, what would tell the best from the model as it is."""
    close = rivals(best, list(found.scored.values()), found.floor)
    several = [found.having(one) for one in (best, *close[: RIVALS - 1])]
    told = [Rival(effects, tuple(one.at for one in found.fits[effects][:ASKED])) for effects in several]
    if not close:
        told.append(Rival((), tuple(one.at for one in found.null[:ASKED])))
    measured = [one.measured for one in explored[:ASKED]]

    def work(_: int, __: None, desk: Desk) -> Experiment | None:
        answer: Experiment | None = desk.compute(next_experiment, workspace.model, told, measured)
        return answer

    ((experiment,),) = each_for_all(workspace, explored[:1], "the experiment that would tell", [None], work)
    return experiment.told() if experiment else None


def _to_judge(found: Found) -> list[Effects]:
    """Whom the verdict may be about, the first first: a pair, or one alone; nobody where nothing helps clearly."""
    candidates = list(found.scored.values())
    best, alone = leading(found.nothing, candidates, found.floor), single(found.nothing, candidates)
    helps = found.nothing.criterion - best.criterion >= CLEARLY
    return list(dict.fromkeys(found.having(one) for one in (best, alone))) if helps else []


def _profiled(
    workspace: Workspace, explored: Sequence[Explorer], found: Found, best: Scored
) -> dict[Effects, list[Profiled]]:
    """Intervals of the candidate that the verdict is about, by specimen."""
    if not best.effects or explored[0].solver is not None:  # with the solver it would take hours; curvature has to do
        return {}
    effects = found.having(best)
    (column,) = each_for_all(
        workspace, explored, "intervals", [effects],
        lambda i, effects, desk: explored[i].profiled(desk, effects, found.fits[effects][i]),
    )  # fmt: skip
    return {effects: column}


Held = dict[Effects, dict[str, dict[str, Array]]]


def _hold_out(workspace: Workspace, explored: Sequence[Explorer], found: Found) -> Held:
    """Squared errors of what was left out, by candidate, kind of split, and curve of a specimen; scores learn of it."""
    judged = _to_judge(found)
    if not judged:
        return {}
    chosen, best = judged[0], found.scored[judged[0]]
    close = rivals(best, list(found.scored.values()), found.floor)
    wanted: list[Effects] = [(), *judged, *(found.having(one) for one in close[:1])]
    alone = chosen
    if len(chosen) == 2:  # in whichever form each fits best
        singles = [effects for effects in found.fits if len(effects) == 1 and effects[0].slug in best.effects]
        alone = min(singles, key=lambda effects: sum(one.loss for one in found.fits[effects]))
        wanted.append(alone)
    wanted = list(dict.fromkeys(wanted))

    def work(i: int, effects: Effects, desk: Desk) -> dict[str, dict[str, Array]]:
        fits = found.fits[effects] if effects else found.null
        told = explored[i].held_out(desk, effects, fits[i].at)
        count = sum(len(effect.parameters) for effect in effects)
        if len(explored) > 1:
            values = np.mean([fit.at[fit.at.size - count :] for k, fit in enumerate(fits) if k != i], axis=0)
            told |= explored[i].of_others(desk, effects, fits[i].at, values)
        return told

    columns = each_for_all(workspace, explored, "predicting what was left out", wanted, work)
    held: Held = {}
    for effects, column in zip(wanted, columns, strict=True):
        kinds = held.setdefault(effects, {})
        for one, told in zip(explored, column, strict=True):
            for kind, errors in told.items():
                kinds.setdefault(kind, {}).update({f"{one.name} {name}": each for name, each in errors.items()})
    for effects in wanted:
        if effects in found.scored:
            found.scored[effects] = replace(found.scored[effects], held=_gains(held[()], held[effects]))
    if len(chosen) == 2:
        found.scored[chosen] = replace(found.scored[chosen], beyond=_gains(held[alone], held[chosen]))
    return held


def _gains(without: dict[str, dict[str, Array]], having: dict[str, dict[str, Array]]) -> dict[str, tuple[float, float]]:
    return {
        kind: gain({name: (without[kind][name], errors) for name, errors in curves.items()}, BLOCK)
        for kind, curves in having.items()
    }
