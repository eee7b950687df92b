"""Where a model and measurements disagree, which effect of the library is missing, and the model with it.

Leaves ``discover.json`` (also as ``verdict.json``), and when an effect is named ``discover/model.yaml``: the study with
the effect in its model. See docs/discover.md.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from runner.ensemble import Desk
from tasks.discover.added import add_to_study, checks
from tasks.discover.cells import located_part, misfit_map
from tasks.discover.choose import CLEARLY, Evidence, Scored, criterion, leading, rivals, room_for_two, verdict
from tasks.discover.explore import Effects, Explorer, agree, each_for_all, explorers
from tasks.discover.fit import Candidate, Fitted
from tasks.discover.solver import in_febio
from tasks.discover.splits import gain
from tasks.discover.told import NO_GAP, gap_of, simulated, told_candidate
from tasks.model.effects import library
from tasks.problems import BadInput
from tasks.simulate import Array
from tasks.simulate.uniaxial import Uniaxial
from tasks.workspace import Workspace, write_json

HEADS = 3  # single effects that pairs are made with
PAIRS = 10  # pairs that are fitted, of those that promise most
BLOCK = 50  # points whose errors may depend on each other
SURELY = 0.02  # of the chance of a cell beyond chance: one that is beyond this, too, is there


@dataclass
class _Found:
    """What is known of a cohort so far; fits are in the order of the specimens."""

    null: list[Fitted]
    fits: dict[Effects, list[Fitted]]
    scored: dict[Effects, Scored]
    floor: float

    @property
    def ordered(self) -> list[Effects]:
        return sorted(self.scored, key=lambda effects: self.scored[effects].criterion)

    @property
    def nothing(self) -> Scored:
        loss = sum(one.loss for one in self.null)
        return Scored((), loss, loss)

    def having(self, scored: Scored) -> Effects:
        return next(effects for effects, one in self.scored.items() if one is scored)


def discover(workspace: Workspace) -> dict[str, Any]:
    """The verdict on a cohort. Returns ``discover.json``.

    Raises :class:`BadInput` when the study's model has effects already, for another simulator than the embedded one,
    and when noise cannot be told from the curves.
    """
    settings, seed = workspace.study.discover, workspace.study.seed
    explored = _ready(workspace)
    bare: list[list[Fitted]] = each_for_all(
        workspace,
        explored,
        "the model as it is",
        [None],
        lambda i, _, desk: explored[i].bare(desk, settings.starts, (seed, 9, i)),
    )[0]
    found = _explored(workspace, explored, [fits[0] for fits in bare])
    trusted = all(
        agree(sorted([*fits, null], key=lambda one: one.loss)) for fits, null in zip(bare, found.null, strict=True)
    )
    held = _hold_out(workspace, explored, found)
    chance = settings.chance / len(explored)
    before = [
        misfit_map(one.measured, Candidate(one.model), null, chance, SURELY, (seed, 10, i))
        for i, (one, null) in enumerate(zip(explored, found.null, strict=True))
    ]
    after = {
        effects: [
            misfit_map(one.measured, Candidate(one.model, effects), fitted, chance, SURELY, (seed, 11, i))
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
    best = leading(found.nothing, list(found.scored.values()), found.floor)
    names = [one.name for one in explored]
    result: dict[str, Any] = {
        "verdict": decided.word,
        "effects": list(decided.effects),
        "set": list(decided.alike),
        "why": decided.why,
        "explained": decided.explained,
        "null": {
            "loss": found.nothing.loss,
            "floor": found.floor,
            "trusted": trusted,
            "starts": {name: [one.loss for one in fits] for name, fits in zip(names, bare, strict=True)},
        },
        "located": about.located,
        "surely": about.surely,
        "noise": {one.name: {"sd_N": one.measured.noise.sd_N, "ar1": one.measured.noise.ar1} for one in explored},
        "candidates": [
            told_candidate(found.scored[effects], found.nothing, found.floor, effects, explored, found.fits[effects])
            for effects in found.ordered
        ],
        "cells": dict(zip(names, before, strict=True)),
        "shown": list(best.effects),
        "gap": gap_of(held, found.having(best), explored, found.fits) if held else NO_GAP,
        "next_experiment": None,
        "model": None,
    }
    shown = found.having(best) if best.effects else ()
    for i, one in enumerate(explored):
        curves = simulated(one, found.null[i], shown, found.fits[shown][i] if shown else None)
        workspace.store.write_result(f"discover/{one.name.replace('/', '_')}", curves)
    if shown in after:
        result["after"] = dict(zip(names, after[shown], strict=True))
    if decided.word == "NAMED":
        result["model"] = add_to_study(workspace, shown)
        result["model"]["checks"] = checks(explored, shown, found.fits[shown])
        result["model"]["febio"] = in_febio(workspace, explored[0], shown, found.fits[shown][0])
    write_json(workspace.out / "discover.json", result)
    write_json(workspace.out / "verdict.json", result)
    return result


def _ready(workspace: Workspace) -> list[Explorer]:
    """The specimens, once it is sure that a verdict on them is possible."""
    study = workspace.study
    if study.model.effects:
        raise BadInput(f"{study.path}: model.effects", "is not empty", "a model without effects to begin with")
    if not isinstance(workspace.simulator, Uniaxial):
        problem = f"is {workspace.simulator.name}, and effects are fitted with the embedded simulator"
        raise BadInput(f"{study.path}: simulator", problem, "uniaxial")
    explored = explorers(workspace)
    for one in explored:
        if not one.measured.noise.sd_N > 0:
            raise BadInput(workspace.cohort.folder / one.name, "no noise can be seen in its curves", "measured curves")
    return explored


def _explored(workspace: Workspace, explored: Sequence[Explorer], null: list[Fitted]) -> _Found:
    """All single effects, and the pairs of the best of them with those that promise most."""
    points = [fitted.points for fitted in null]
    slugs = workspace.study.discover.effects
    chosen = [effect for slug, effect in library().items() if slugs == "all" or slug in slugs]
    floor = float(sum(points)) - sum(Candidate(one.model).size for one in explored)
    singles: list[Effects] = [(form,) for effect in chosen for form in (effect, *effect.other_forms)]
    columns = each_for_all(
        workspace,
        explored,
        "one effect",
        singles,
        lambda i, effects, desk: explored[i].extended(desk, effects, null[i]),
    )
    fits = dict(zip(singles, columns, strict=True))
    # where a fit with an effect came further, the bare model may do so, too: it must not look wrong for want of a start
    best = min(fits, key=lambda effects: sum(one.loss for one in fits[effects]))
    again = each_for_all(
        workspace, explored, "the model as it is, again", [best],
        lambda i, effects, desk: explored[i].bare_from(desk, fits[effects][i].at),
    )[0]  # fmt: skip
    found = _Found([min(pair, key=lambda one: one.loss) for pair in zip(null, again, strict=True)], fits, {}, floor)
    found.scored = _best_forms({effects: _score(effects, fits[effects], found.null, points) for effects in singles})
    if not room_for_two(found.nothing, list(found.scored.values()), floor):
        return found
    heads = found.ordered[:HEADS]
    pairs = [(*head, *other) for head in heads for other in found.scored if other != head]
    promises = each_for_all(
        workspace, explored, "looking ahead to two effects", pairs,
        lambda i, effects, desk: explored[i].promise(desk, effects, fits[effects[:1]][i]),
    )  # fmt: skip
    for effects in _promising(pairs, [sum(each) for each in promises]):
        found.fits[effects] = []
    wanted = [effects for effects in found.fits if len(effects) > 1]
    columns = each_for_all(
        workspace, explored, "two effects", wanted,
        lambda i, effects, desk: explored[i].extended(desk, effects, fits[effects[:1]][i]),
    )  # fmt: skip
    found.fits |= dict(zip(wanted, columns, strict=True))
    found.scored |= {effects: _score(effects, found.fits[effects], found.null, points) for effects in wanted}
    return found


def _best_forms(scored: dict[Effects, Scored]) -> dict[Effects, Scored]:
    """Of each effect, the form that fits best."""
    best: dict[tuple[str, ...], Effects] = {}
    for effects, one in scored.items():
        if one.effects not in best or one.criterion < scored[best[one.effects]].criterion:
            best[one.effects] = effects
    return {effects: scored[effects] for effects in best.values()}


def _promising(pairs: Sequence[Effects], losses: Sequence[float]) -> list[Effects]:
    """The pairs that promise most, each in one order only."""
    chosen: dict[frozenset[str], Effects] = {}
    for number in np.argsort(losses, kind="stable"):
        chosen.setdefault(frozenset(effect.slug for effect in pairs[number]), pairs[number])
    return list(chosen.values())[:PAIRS]


def _score(effects: Effects, fitted: Sequence[Fitted], null: Sequence[Fitted], points: Sequence[int]) -> Scored:
    parameters = [parameter for effect in effects for parameter in effect.parameters]
    idle = [
        effect.null.get(parameter.name) == parameter.minimum for effect in effects for parameter in effect.parameters
    ]
    first = len(fitted[0].at) - len(parameters)
    on_bound = [
        parameter.name
        for k, parameter in enumerate(parameters)
        if not idle[k] and any(one.at_bound[first + k] for one in fitted)
    ]
    gains = [
        alone.loss - criterion(one.loss, len(parameters), [count])
        for one, alone, count in zip(fitted, null, points, strict=True)
    ]
    loss = sum(one.loss for one in fitted)
    names = tuple(effect.slug for effect in effects)
    return Scored(names, criterion(loss, len(parameters), points), loss, tuple(gains), on_bound=tuple(on_bound))


Held = dict[Effects, dict[str, dict[str, Array]]]


def _hold_out(workspace: Workspace, explored: Sequence[Explorer], found: _Found) -> Held:
    """Squared errors of what was left out, by candidate, kind of split, and curve of a specimen; scores learn of it."""
    best = leading(found.nothing, list(found.scored.values()), found.floor)
    if found.nothing.criterion - best.criterion < CLEARLY:
        return {}
    chosen = found.having(best)
    close = rivals(best, list(found.scored.values()), found.floor)
    wanted: list[Effects] = [(), chosen, *(found.having(one) for one in close[:1])]
    alone = chosen[:1]
    if len(chosen) == 2:
        wanted.append(min((effects for effects in found.fits if effects in ((chosen[0],), (chosen[1],))),
                          key=lambda effects: found.scored[effects].criterion))  # fmt: skip
        alone = wanted[-1]
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
        if effects:
            found.scored[effects] = replace(found.scored[effects], held=_gains(held[()], held[effects]))
    if len(chosen) == 2:
        found.scored[chosen] = replace(found.scored[chosen], beyond=_gains(held[alone], held[chosen]))
    return held


def _gains(without: dict[str, dict[str, Array]], having: dict[str, dict[str, Array]]) -> dict[str, tuple[float, float]]:
    return {
        kind: gain({name: (without[kind][name], errors) for name, errors in curves.items()}, BLOCK)
        for kind, curves in having.items()
    }
