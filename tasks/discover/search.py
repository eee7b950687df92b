"""The candidates of a cohort: all single effects, and the pairs that promise most, each fitted to every specimen."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from tasks.discover.choose import Scored, criterion, room_for_two
from tasks.discover.explore import Effects, Explorer, each_for_all
from tasks.discover.fit import Candidate, Fitted, starts
from tasks.model.effects import library
from tasks.simulate import Array
from tasks.workspace import Workspace

HEADS = 3  # single effects that pairs are made with
FRESH = (2, 4)  # of the starts of the bare model: they exchange relaxation times
PAIRS = 10  # pairs that are fitted, of those that promise most


@dataclass
class Found:
    """What is known of a cohort: fits, in the order of the specimens, and scores; ``floor`` is a true model's loss."""

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


def search(workspace: Workspace, explored: Sequence[Explorer], null: list[Fitted]) -> Found:
    """Fit and score them; ``null`` are the best fits of the bare model so far, by specimen."""
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
    bare = Candidate(workspace.model)
    null = each_for_all(
        workspace, explored, "the model as it is, again", [best],
        lambda i, effects, desk: explored[i].refitted(desk, (), null[i], [fits[effects][i].at[: bare.size]]),
    )[0]  # fmt: skip
    found = Found(null, fits, {}, floor)
    score = partial(_score, null=null, points=points)
    found.scored = _best_forms({effects: score(effects, fits[effects]) for effects in singles})
    heads = found.ordered[:HEADS]
    elsewhere = starts(bare, np.random.default_rng((workspace.study.seed, 12)), FRESH[1])[FRESH[0] :]

    def fresh(_: int, effects: Effects) -> list[Array]:
        return [np.concatenate([at, Candidate(workspace.model, effects).typical()]) for at in elsewhere]

    _improve(workspace, explored, found, score, heads, fresh)
    if not room_for_two(found.nothing, list(found.scored.values()), floor):
        return found
    pairs = [(*head, *other) for head in heads for other in found.scored if other != head]
    promises = each_for_all(
        workspace, explored, "looking ahead to two effects", pairs,
        lambda i, effects, desk: explored[i].promise(desk, effects, fits[effects[:1]][i]),
    )  # fmt: skip
    wanted = _promising(pairs, [sum(each) for each in promises])
    columns = each_for_all(
        workspace, explored, "two effects", wanted,
        lambda i, effects, desk: explored[i].extended(desk, effects, fits[effects[:1]][i]),
    )  # fmt: skip
    fits |= dict(zip(wanted, columns, strict=True))
    found.scored |= {effects: score(effects, fits[effects]) for effects in wanted}
    # a pair must not be preferred because one of its effects alone was not fitted as well as it could be
    first, second = min(wanted, key=lambda effects: found.scored[effects].criterion)
    ends: dict[Effects, slice] = {(first,): slice(bare.size, bare.size + len(first.parameters)),
            (second,): slice(bare.size + len(first.parameters), None)}  # fmt: skip

    def apart(i: int, effects: Effects) -> list[Array]:
        both = fits[first, second][i].at
        return [np.concatenate([both[: bare.size], both[ends[effects]]])]

    _improve(workspace, explored, found, score, list(ends), apart)
    return found


def _improve(
    workspace: Workspace,
    explored: Sequence[Explorer],
    found: Found,
    score: Callable[[Effects, list[Fitted]], Scored],
    chosen: Sequence[Effects],
    begins: Callable[[int, Effects], list[Array]],
) -> None:
    """Fit the chosen candidates again, from ``begins(number of the specimen, effects)``, and keep what is better."""
    columns = each_for_all(
        workspace, explored, "again from elsewhere", chosen,
        lambda i, effects, desk: explored[i].refitted(desk, effects, found.fits[effects][i], begins(i, effects)),
    )  # fmt: skip
    for effects, column in zip(chosen, columns, strict=True):
        found.fits[effects] = column
        found.scored[effects] = score(effects, column)


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
