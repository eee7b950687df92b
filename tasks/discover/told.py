"""What ``discover.json`` says of candidates and of the gap between model and measurements."""

from collections.abc import Mapping, Sequence
from itertools import repeat
from typing import Any

import numpy as np
import xarray as xr
from scipy.stats import chi2

from tasks.discover.choose import Scored, explained
from tasks.discover.explore import Effects, Explorer
from tasks.discover.fit import Candidate, Fitted, covariance, derivatives, errors
from tasks.discover.intervals import Profiled
from tasks.discover.splits import LATER, PROTOCOL, SPECIMEN, splits
from tasks.simulate import Array

NORMAL_90 = 1.645  # standard deviations to either side of a 90 % interval
NO_GAP: dict[str, Any] = dict.fromkeys(("split", "before", "after", "floor", "closed"))


def told_candidate(
    scored: Scored,
    nothing: Scored,
    floor: float,
    effects: Effects,
    explored: Sequence[Explorer],
    fits: Sequence[Fitted],
    profiled: Sequence[Profiled] | None = None,
) -> dict[str, Any]:
    """One candidate: how much it gains, explains and predicts, and its parameters by specimen.

    ``profiled``: for each specimen, where intervals by profile likelihood are known.
    """
    candidates = [one.candidate(effects) for one in explored]
    held, error = scored.held.get(PROTOCOL, scored.held.get(LATER, (None, None)))
    return {
        "effects": list(scored.effects),
        "forms": [effect.name for effect in effects],
        "loss": scored.loss,
        "free": len(explored) * sum(len(effect.parameters) for effect in effects),
        "gain": nothing.criterion - scored.criterion,
        "gains": dict(zip([one.name for one in explored], scored.gains, strict=True)),
        "explained": explained(nothing, scored, floor),
        "held_out": held,
        "held_out_error": error,
        "splits": {kind: {"gain": each[0], "error": each[1]} for kind, each in scored.held.items()},
        "beyond_one": {kind: {"gain": each[0], "error": each[1]} for kind, each in scored.beyond.items()},
        "in_place": dict(zip(("improvement", "cells"), scored.in_place, strict=True)) if scored.in_place else None,
        "on_bound": list(scored.on_bound),
        "parameters": {
            one.name: _parameters(effects, candidate, fitted, each)
            for one, candidate, fitted, each in zip(
                explored, candidates, fits, profiled or repeat(None, len(fits)), strict=True
            )
        },
        "shared": _shared(effects, candidates[0], fits),
    }


def _shared(effects: Effects, candidate: Candidate, fits: Sequence[Fitted]) -> dict[str, Any]:
    """What belongs to the machine, as one value for all specimens, and how likely it is that there is one (chi-square).

    It is told, and does not decide: where nature's form of an effect is another, values differ by more than noise.
    """
    if len(fits) < 2:
        return {}
    low, high = candidate.bounds()
    parameters = [(effect, parameter) for effect in effects for parameter in effect.parameters]
    first = candidate.size - len(parameters)
    found = {}
    for k, (effect, parameter) in enumerate(parameters, first):
        if parameter.name in effect.shared:
            values = np.array([low[k] + (high[k] - low[k]) * fitted.at[k] for fitted in fits])
            weights = np.array([((high[k] - low[k]) * fitted.uncertainty[k]) ** -2.0 for fitted in fits])
            mean = float(weights @ values / weights.sum())
            p = float(chi2.sf(float(weights @ (values - mean) ** 2), len(fits) - 1))
            half = NORMAL_90 / float(np.sqrt(weights.sum()))
            found[parameter.name] = {
                "value": mean,
                "unit": parameter.unit,
                "interval": [mean - half, mean + half],
                "p": p,
            }
    return found


def _parameters(effects: Effects, candidate: Candidate, fitted: Fitted, profiled: Profiled | None) -> dict[str, Any]:
    """Values and 90 % intervals of the effects' parameters: by profile, or else from the curvature at the fit."""
    low, high = candidate.bounds()
    parameters = [parameter for effect in effects for parameter in effect.parameters]
    own = slice(candidate.size - len(parameters), None)
    if profiled is not None:
        fitted, ends = profiled.fitted, profiled.ends
    else:
        ends = fitted.at[own, np.newaxis] + NORMAL_90 * fitted.uncertainty[own, np.newaxis] * np.array([-1.0, 1.0])
    values = low[own] + (high - low)[own] * fitted.at[own]
    intervals = low[own, np.newaxis] + (high - low)[own, np.newaxis] * ends
    return {
        parameter.name: {"value": value, "unit": parameter.unit, "interval": interval.tolist()}
        for parameter, value, interval in zip(parameters, values.tolist(), intervals, strict=True)
    }


def gap_of(
    held: Mapping[Effects, Mapping[str, Mapping[str, Array]]],
    effects: Effects,
    explored: Sequence[Explorer],
    fits: Mapping[Effects, Sequence[Fitted]],
) -> dict[str, Any]:
    """The gap on what was held out, by kind of split, and in front that of the first kind there is.

    An effect that comes from other specimens is judged on everything; a protocol that is left out may be the only one
    in which the effect shows, so that nothing of it is known without.
    """
    gaps = {kind: _gap(held, effects, explored, fits, kind) for kind in (SPECIMEN, LATER, PROTOCOL) if kind in held[()]}
    if not gaps:
        return NO_GAP
    kind = next(iter(gaps))
    return {"split": kind, **gaps[kind], "splits": gaps}


def _gap(
    held: Mapping[Effects, Mapping[str, Mapping[str, Array]]],
    effects: Effects,
    explored: Sequence[Explorer],
    fits: Mapping[Effects, Sequence[Fitted]],
    kind: str,
) -> dict[str, Any]:
    """Root mean square of the whitened errors without and with ``effects``.

    ``floor`` is what the model with the effects would come to if it were true: noise, which is 1, and what the fit of
    the rest does not know of its parameters (a parametric bootstrap with refit, linearised at the fit).
    """
    before, after = (_root_mean_square(held[each][kind].values()) for each in ((), effects))
    floor = _root_mean_square(
        [
            expected
            for one, fitted in zip(explored, fits[effects], strict=True)
            for expected in _expected(one, one.candidate(effects), fitted, kind)
        ]
        or [np.ones(1)]
    )
    closed = (before - after) / (before - floor) if before > floor else None
    return {"before": before, "after": after, "floor": floor, "closed": closed}


def simulated(one: Explorer, null: Fitted, effects: Effects, fitted: Fitted | None) -> xr.Dataset:
    """The curves of a specimen (mm, N): measured, by the model as it is and, where there are ``effects``, with them."""
    specimen, bare = one.measured.specimen, one.candidate()
    found: dict[str, Any] = {}
    for curve in specimen.curves:
        dimension = f"time_{curve.name}"
        found[f"displacement_{curve.name}"] = (dimension, curve.protocol.displacement_mm)
        found[f"measured_{curve.name}"] = (dimension, curve.force_N)
        found[f"bare_{curve.name}"] = (dimension, bare.forces(specimen, curve.protocol, null.at[np.newaxis])[0])
        if fitted is not None:
            having = one.candidate(effects).forces(specimen, curve.protocol, fitted.at[np.newaxis])[0]
            found[f"having_{curve.name}"] = (dimension, having)
    times = {f"time_{curve.name}": curve.protocol.time_s for curve in specimen.curves}
    return xr.Dataset(found, coords=times, attrs={"effects": [effect.slug for effect in effects]})


def _root_mean_square(squares: Any) -> float:
    return float(np.sqrt(np.mean(np.concatenate(list(squares)))))


def _expected(one: Explorer, candidate: Candidate, fitted: Fitted, kind: str) -> list[Array]:
    """Squares ``[t]`` that a true model's errors have on average, on each curve that is held out."""
    found = []
    for split in splits(one.measured):
        if split.kind == kind:
            _, seen = derivatives(candidate, split.seen, fitted.at, split.seen.curves)
            spread = covariance(seen)
            for curve in one.measured.curves:
                if curve.name in split.judged:
                    _, slopes = derivatives(candidate, one.measured, fitted.at, [curve], errors)
                    own = slopes[split.judged[curve.name] :]
                    found.append(1.0 + np.sum((own @ spread) * own, axis=1))
    return found
