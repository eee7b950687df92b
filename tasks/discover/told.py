"""What ``discover.json`` says of candidates and of the gap between model and measurements."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from tasks.discover.choose import Scored
from tasks.discover.explore import Effects, Explorer
from tasks.discover.fit import WIDTH, Candidate, Fitted, derivatives, errors
from tasks.discover.splits import LATER, PROTOCOL, splits
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
) -> dict[str, Any]:
    """One candidate: how much it gains, explains and predicts, and its parameters by specimen."""
    held, error = scored.held.get(PROTOCOL, scored.held.get(LATER, (None, None)))
    return {
        "effects": list(scored.effects),
        "loss": scored.loss,
        "free": len(explored) * sum(len(effect.parameters) for effect in effects),
        "gain": nothing.criterion - scored.criterion,
        "gains": dict(zip([one.name for one in explored], scored.gains, strict=True)),
        "explained": (nothing.loss - scored.loss) / max(nothing.loss - floor, 1e-9),
        "held_out": held,
        "held_out_error": error,
        "splits": {kind: {"gain": each[0], "error": each[1]} for kind, each in scored.held.items()},
        "beyond_one": {kind: {"gain": each[0], "error": each[1]} for kind, each in scored.beyond.items()},
        "in_place": scored.in_place,
        "on_bound": list(scored.on_bound),
        "parameters": {
            one.name: _parameters(effects, Candidate(one.model, effects), fitted)
            for one, fitted in zip(explored, fits, strict=True)
        },
    }


def _parameters(effects: Effects, candidate: Candidate, fitted: Fitted) -> dict[str, Any]:
    """Values and 90 % intervals of the effects' parameters, from the curvature at the fit."""
    low, high = candidate.bounds()
    values, spread = low + (high - low) * fitted.at, NORMAL_90 * (high - low) * fitted.uncertainty
    parameters = [parameter for effect in effects for parameter in effect.parameters]
    first = candidate.size - len(parameters)
    return {
        parameter.name: {
            "value": values[first + k],
            "unit": parameter.unit,
            "interval": [values[first + k] - spread[first + k], values[first + k] + spread[first + k]],
        }
        for k, parameter in enumerate(parameters)
    }


def gap_of(
    held: Mapping[Effects, Mapping[str, Mapping[str, Array]]],
    effects: Effects,
    explored: Sequence[Explorer],
    fits: Mapping[Effects, Sequence[Fitted]],
) -> dict[str, Any]:
    """Root mean square of the whitened errors on what was held out, without and with ``effects``.

    ``floor`` is what the model with the effects would come to if it were true: noise, which is 1, and what the fit of
    the rest does not know of its parameters (a parametric bootstrap with refit, linearised at the fit).
    """
    kind = next((kind for kind in (PROTOCOL, LATER) if kind in held[()]), None)
    if kind is None:
        return NO_GAP
    before, after = (_root_mean_square(held[each][kind].values()) for each in ((), effects))
    floor = _root_mean_square(
        [
            expected
            for one, fitted in zip(explored, fits[effects], strict=True)
            for expected in _expected(one, Candidate(one.model, effects), fitted, kind)
        ]
    )
    closed = (before - after) / (before - floor) if before > floor else None
    return {"split": kind, "before": before, "after": after, "floor": floor, "closed": closed}


def _root_mean_square(squares: Any) -> float:
    return float(np.sqrt(np.mean(np.concatenate(list(squares)))))


def _expected(one: Explorer, candidate: Candidate, fitted: Fitted, kind: str) -> list[Array]:
    """Squares ``[t]`` that a true model's errors have on average, on each curve that is held out."""
    found = []
    for split in splits(one.measured):
        if split.kind == kind:
            _, seen = derivatives(candidate, split.seen, fitted.at, split.seen.curves)
            upper = np.linalg.cholesky(seen.T @ seen + WIDTH * np.eye(seen.shape[1])).T
            for curve in one.measured.curves:
                if curve.name in split.judged:
                    _, slopes = derivatives(candidate, one.measured, fitted.at, [curve], errors)
                    spread = np.linalg.solve(upper.T, slopes[split.judged[curve.name] :].T)
                    found.append(1.0 + np.sum(spread**2, axis=0))
    return found
