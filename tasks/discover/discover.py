"""Where a model and measurements disagree, which effect of the library is missing, and the model with it.

Leaves ``discover.json`` (also as ``verdict.json``), and when an effect is named ``discover/model.yaml``: the study with
the effect in its model. See docs/discover.md.
"""

import difflib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from runner.ensemble import Desk
from tasks.discover.cells import Cell, cells, limit_by_chance, misfits
from tasks.discover.choose import Scored, Verdict, criterion, held_out_gain, verdict
from tasks.discover.explore import Effects, Explorer, agree, explorers, slugs, together
from tasks.discover.fit import Candidate, Fitted, derivatives, errors
from tasks.model.effects import library
from tasks.problems import BadInput
from tasks.simulate import Array
from tasks.simulate.uniaxial import Uniaxial
from tasks.workspace import Workspace, write_json, write_text

RUNNERS_UP = 2  # candidates beside the best that predict held-out curves
BLOCK = 50  # points whose errors may depend on each other


def discover(workspace: Workspace) -> dict[str, Any]:
    """The verdict on a cohort. Returns ``discover.json``.

    Raises :class:`BadInput` when the study's model has effects already, for another simulator than the embedded one,
    and when noise cannot be told from the curves.
    """
    study = workspace.study
    if study.model.effects:
        raise BadInput(f"{study.path}: model.effects", "is not empty", "a model without effects to begin with")
    if not isinstance(workspace.simulator, Uniaxial):
        problem = f"is {workspace.simulator.name}, and effects are fitted with the embedded simulator"
        raise BadInput(f"{study.path}: simulator", problem, "uniaxial")
    settings = study.discover
    explored = explorers(workspace)
    for one in explored:
        if not one.measured.noise.sd_N > 0:
            name = one.measured.specimen.name
            raise BadInput(workspace.cohort.folder / name, "no noise can be seen in its curves", "measured curves")
    bare: list[list[Fitted]] = together(
        workspace,
        explored,
        "the model as it is",
        lambda i, desk: explored[i].bare(desk, settings.starts, (study.seed, 9, i)),
    )
    null = [fits[0] for fits in bare]
    points = [fitted.points for fitted in null]
    chosen = library() if settings.effects == "all" else {slug: library()[slug] for slug in settings.effects}
    singles = [(effect,) for effect in chosen.values()]
    fits = _fits(workspace, explored, null, singles, "one effect")
    best = min(fits, key=lambda effects: _score(effects, fits[effects], points).criterion)
    # where a fit with an effect came further, the bare model may do so, too: it must not look wrong for want of a start
    again: list[Fitted] = together(
        workspace, explored, "the model as it is, again", lambda i, desk: explored[i].bare_from(desk, fits[best][i].at)
    )
    null = [min(pair, key=lambda one: one.loss) for pair in zip(null, again, strict=True)]
    pairs = [(best[0], other) for other in chosen.values() if other.slug != best[0].slug]
    fits |= _fits(workspace, explored, null, pairs, "two effects", {best: fits[best]})
    scored = {effects: _score(effects, fitted, points) for effects, fitted in fits.items()}
    nothing = _score((), null, points)
    shortlist = sorted(scored, key=lambda effects: scored[effects].criterion)[: 1 + RUNNERS_UP]
    held = _held_out(workspace, explored, null, fits, shortlist)
    for effects in shortlist:
        scored[effects] = _with_held_out(scored[effects], held[()], held[effects])
    before = [_map(one, Candidate(one.model), fitted, settings.chance / len(explored), (study.seed, 10, i))
              for i, (one, fitted) in enumerate(zip(explored, null, strict=True))]  # fmt: skip
    located = any(abs(cell["z"]) > cell["limit"] for told in before for cell in told)
    floor = float(sum(points)) - sum(Candidate(one.model).size for one in explored)
    trusted = all(
        agree(sorted([*each, more], key=lambda one: one.loss)) for each, more in zip(bare, again, strict=True)
    )
    found = verdict(nothing, list(scored.values()), floor, located, trusted)
    result = _told(workspace, explored, found, scored, fits, nothing, null, bare, before, held, floor)
    if found.word == "NAMED":
        effects = next(one for one in scored if slugs(one) == found.effects)
        result["after"] = {
            one.measured.specimen.name: _map(
                one, Candidate(one.model, effects), fitted, settings.chance / len(explored), (study.seed, 11, i)
            )
            for i, (one, fitted) in enumerate(zip(explored, fits[effects], strict=True))
        }
        result["model"] = _add(workspace, effects)
    write_json(workspace.out / "discover.json", result)
    write_json(workspace.out / "verdict.json", result)
    return result


def _fits(
    workspace: Workspace,
    explored: Sequence[Explorer],
    null: Sequence[Fitted],
    candidates: Sequence[Effects],
    title: str,
    known: dict[Effects, list[Fitted]] | None = None,
) -> dict[Effects, list[Fitted]]:
    """Fits of every candidate to every specimen; pairs also begin where the first of them ended alone."""

    def work(i: int, desk: Desk) -> list[Fitted]:
        found = []
        for effects in candidates:
            others = None
            if known and (single := known.get(effects[:1])):
                alone, size = single[i].at, Candidate(explored[i].model).size
                second = Candidate(explored[i].model, effects[1:])
                begin = second.null() + 0.3 * (second.typical() - second.null())
                others = np.concatenate([alone[size:], begin])
            found.append(explored[i].having(desk, effects, null[i], others))
        return found

    columns = together(workspace, explored, title, work)
    return {effects: [column[k] for column in columns] for k, effects in enumerate(candidates)}


def _score(effects: Effects, fitted: Sequence[Fitted], points: Sequence[int]) -> Scored:
    loss = sum(one.loss for one in fitted)
    count = sum(len(effect.parameters) for effect in effects)
    names = [parameter.name for effect in effects for parameter in effect.parameters]
    null = [
        effect.null.get(parameter.name) == parameter.minimum for effect in effects for parameter in effect.parameters
    ]
    on_bound = [
        name
        for k, name in enumerate(names)
        if any(one.at_bound[len(one.at) - count + k] and not null[k] for one in fitted)
    ]
    return Scored(slugs(effects), criterion(loss, count, points), loss, on_bound=tuple(on_bound))


def _held_out(
    workspace: Workspace,
    explored: Sequence[Explorer],
    null: Sequence[Fitted],
    fits: dict[Effects, list[Fitted]],
    shortlist: Sequence[Effects],
) -> dict[Effects, dict[str, Array]]:
    """By candidate, and for the bare model: whitened squared errors of every curve, predicted from the others."""

    def work(i: int, desk: Desk) -> list[dict[str, Array]]:
        return [
            explored[i].held_out(desk, effects, null[i].at if effects == () else fits[effects][i].at)
            for effects in [(), *shortlist]
        ]

    columns = together(workspace, explored, "predicting what was left out", work)
    return {
        effects: {
            f"{one.measured.specimen.name} {name}": errors
            for one, column in zip(explored, columns, strict=True)
            for name, errors in column[k].items()
        }
        for k, effects in enumerate([(), *shortlist])
    }


def _with_held_out(scored: Scored, without: dict[str, Array], having: dict[str, Array]) -> Scored:
    if not without:
        return scored
    gain, error = held_out_gain({name: (without[name], having[name]) for name in without}, BLOCK)
    return Scored(scored.effects, scored.criterion, scored.loss, gain, error, scored.on_bound)


def _map(
    one: Explorer, candidate: Candidate, fitted: Fitted, chance: float, seed: tuple[int, ...]
) -> list[dict[str, Any]]:
    """Every cell of a specimen: how far measurement and model are apart there, in newton and in units of chance."""
    curves = one.measured.curves
    every: list[Cell] = []
    inside: list[Array] = []
    newtons: list[float] = []
    total, first = sum(curve.force_N.size for curve in curves), 0
    for curve in curves:
        error = curve.force_N - candidate.forces(one.measured.specimen, curve.protocol, fitted.at[np.newaxis])[0]
        for cell in cells(curve):
            every.append(cell)
            row = np.zeros(total)
            row[first + cell.points] = 1.0
            inside.append(row)
            newtons.append(float(error[cell.points].mean()))
        first += curve.force_N.size
    which = np.array(inside)
    white, slopes = derivatives(candidate, one.measured, fitted.at, curves, errors)
    z = -misfits(which, white)  # measured minus simulated
    limit = limit_by_chance(which, slopes, chance, np.random.default_rng(seed))
    return [
        {
            "protocol": cell.protocol,
            "phase": cell.phase,
            "number": cell.number,
            "z": z[c],
            "mean_N": newtons[c],
            "limit": limit,
        }
        for c, cell in enumerate(every)
    ]


def _told(
    workspace: Workspace,
    explored: Sequence[Explorer],
    found: Verdict,
    scored: dict[Effects, Scored],
    fits: dict[Effects, list[Fitted]],
    nothing: Scored,
    null: Sequence[Fitted],
    bare: Sequence[Sequence[Fitted]],
    before: Sequence[list[dict[str, Any]]],
    held: dict[Effects, dict[str, Array]],
    floor: float,
) -> dict[str, Any]:
    names = [one.measured.specimen.name for one in explored]
    ordered = sorted(scored, key=lambda effects: scored[effects].criterion)
    return {
        "verdict": found.word,
        "effects": list(found.effects),
        "set": list(found.alike),
        "why": found.why,
        "explained": found.explained,
        "null": {
            "loss": nothing.loss,
            "floor": floor,
            "starts": {name: [one.loss for one in each] for name, each in zip(names, bare, strict=True)},
        },
        "noise": {
            one.measured.specimen.name: {"sd_N": one.measured.noise.sd_N, "ar1": one.measured.noise.ar1}
            for one in explored
        },
        "candidates": [
            {
                "effects": list(scored[effects].effects),
                "gain": nothing.criterion - scored[effects].criterion,
                "explained": (nothing.loss - scored[effects].loss) / max(nothing.loss - floor, 1e-9),
                "held_out": scored[effects].held_out,
                "held_out_error": scored[effects].held_out_error,
                "on_bound": list(scored[effects].on_bound),
                "parameters": _parameters(effects, explored, fits[effects]),
            }
            for effects in ordered
        ],
        "cells": dict(zip(names, before, strict=True)),
        "gap": _gap(held, ordered[0]),
        "next_experiment": None,
        "model": None,
    }


def _parameters(effects: Effects, explored: Sequence[Explorer], fitted: Sequence[Fitted]) -> dict[str, Any]:
    """Values and 90 % intervals of the effects' parameters by specimen, from the curvature at the fit."""
    told: dict[str, Any] = {}
    for one, each in zip(explored, fitted, strict=True):
        candidate = Candidate(one.model, effects)
        low, high = candidate.bounds()
        values, spread = low + (high - low) * each.at, (high - low) * each.uncertainty
        names = [parameter.name for effect in effects for parameter in effect.parameters]
        first = candidate.size - len(names)
        told[one.measured.specimen.name] = {
            name: {"value": values[first + k], "interval": [values[first + k] - 1.645 * spread[first + k],
                                                            values[first + k] + 1.645 * spread[first + k]]}
            for k, name in enumerate(names)
        }  # fmt: skip
    return told


def _gap(held: dict[Effects, dict[str, Array]], best: Effects) -> dict[str, Any]:
    """Root mean square of the whitened errors on held-out curves: 1 is noise alone."""
    if not held[()]:
        return {"before": None, "after": None, "floor": None, "closed": None}
    before, after = (float(np.sqrt(np.mean(np.concatenate(list(held[each].values()))))) for each in ((), best))
    closed = (before - after) / (before - 1.0) if before > 1.0 else None
    return {"before": before, "after": after, "floor": 1.0, "closed": closed}


def _add(workspace: Workspace, effects: Effects) -> dict[str, str]:
    """The study with the effects in its model, as a file beside the results, and what changed."""
    path: Path = workspace.out / "discover" / "model.yaml"
    old = yaml.safe_load(workspace.study.path.read_text("utf-8"))
    new = {**old, "model": {**(old.get("model") or {}), "effects": list(slugs(effects))}}
    new["cohort"] = str(workspace.cohort.folder.resolve())
    before, after = (yaml.safe_dump(each, sort_keys=False, allow_unicode=True) for each in (old, new))
    path.parent.mkdir(exist_ok=True)
    write_text(path, after)
    difference = difflib.unified_diff(before.splitlines(), after.splitlines(), "study", "with effects", lineterm="")
    return {"path": str(path.relative_to(workspace.out)), "difference": "\n".join(difference)}
