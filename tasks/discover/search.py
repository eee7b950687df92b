"""The candidates of a cohort: all single effects, and the pairs that promise most, each fitted to every specimen."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import product

import numpy as np

from runner.ensemble import Desk
from tasks.discover.choose import Scored, criterion, room_for_two
from tasks.discover.explore import Effects, Explorer, each_for_all
from tasks.discover.fit import Candidate, Fitted, starts
from tasks.discover.sizes import library_for
from tasks.model.effect import Effect
from tasks.model.parameters import Parameter
from tasks.simulate import Array
from tasks.simulate.febio_effects import fit_together
from tasks.workspace import Workspace

HEADS = 3  # single effects that pairs are made with
FRESH = (2, 4)  # of the starts of the bare model: they exchange relaxation times
SMALL = 0.2  # of an effect's typical size
PAIRS = 10  # pairs that are fitted, of those that promise most


@dataclass
class Found:
    """What is known of a cohort: fits, in the order of the specimens, and scores; ``floor`` is a true model's loss."""

    null: list[Fitted]
    fits: dict[Effects, list[Fitted]]
    floor: float
    scored: dict[Effects, Scored] = field(default_factory=dict)

    @property
    def ordered(self) -> list[Effects]:
        return sorted(self.scored, key=lambda effects: self.scored[effects].criterion)

    @property
    def nothing(self) -> Scored:
        loss = sum(one.loss for one in self.null)
        return Scored((), loss, loss)

    def having(self, scored: Scored) -> Effects:
        return next(effects for effects, one in self.scored.items() if one is scored)

    def score(self) -> None:
        """Score all fits against the bare model as it is fitted now."""
        self.scored = _best_forms({effects: _score(effects, fits, self.null) for effects, fits in self.fits.items()})


def asked(workspace: Workspace, explored: Sequence[Explorer]) -> list[Effect]:
    """The effects that the study asks for, with ranges for specimens of this size."""
    slugs = workspace.study.discover.effects
    known = library_for([one.measured.specimen for one in explored])
    return [effect for slug, effect in known.items() if slugs == "all" or slug in slugs]


def search(workspace: Workspace, explored: Sequence[Explorer], null: list[Fitted]) -> Found:
    """Fit and score them; ``null`` are the best fits of the bare model so far, by specimen."""
    bare = Candidate(workspace.model)
    forms: list[Effects] = [(form,) for effect in asked(workspace, explored) for form in (effect, *effect.other_forms)]
    singles = [form for form in forms if _possible(form, explored)]
    best = list(null)

    def with_one(i: int, effects: Effects, desk: Desk) -> Fitted:
        fitted = explored[i].extended(desk, effects, null[i])
        if fitted.loss < best[i].loss:
            best[i] = fitted
            note_fit(workspace, explored[i].name, effects, fitted)
        return fitted

    columns = each_for_all(workspace, explored, "one effect", singles, with_one)
    floor = float(sum(fitted.points - bare.size for fitted in null))
    found = Found(null, dict(zip(singles, columns, strict=True)), floor)
    found.score()
    _note_best(workspace, found)
    heads = found.ordered[:HEADS]
    elsewhere = starts(bare, np.random.default_rng((workspace.study.seed, 12)), FRESH[1])[FRESH[0] :]

    def having(effects: Effects, at: Array, part: float) -> Array:
        candidate = Candidate(workspace.model, effects)
        return np.concatenate([at, candidate.null() + part * (candidate.typical() - candidate.null())])

    _improve(workspace, explored, found, heads, lambda _, effects: [having(effects, at, 1.0) for at in elsewhere])
    # where a fit with an effect came further, the bare model may do so, too, and then again the others from there:
    # nothing must look wrong, or right, for want of a start
    _bare_again(workspace, explored, found, heads)
    _improve(workspace, explored, found, heads, lambda i, effects: [having(effects, found.null[i].at, SMALL)])
    both = [(*head, *other) for head in heads for other in found.scored if other != head]
    pairs = [each for each in both if _possible(each, explored)]
    if pairs and room_for_two(found.nothing, list(found.scored.values()), floor):
        _add_pairs(workspace, explored, found, pairs, singles)
    return found


def _add_pairs(
    workspace: Workspace,
    explored: Sequence[Explorer],
    found: Found,
    pairs: Sequence[Effects],
    singles: Sequence[Effects],
) -> None:
    """Fit and score the pairs that promise most."""
    promises = each_for_all(
        workspace, explored, "looking ahead to two effects", pairs,
        lambda i, effects, desk: explored[i].promise(desk, effects, found.fits[effects[:1]][i]),
    )  # fmt: skip
    points = [one.points for one in found.null]
    wanted = _promising(pairs, [_criterion(*told, points) for told in zip(pairs, map(sum, promises), strict=True)])

    def with_two(i: int, effects: Effects, desk: Desk) -> Fitted:
        return explored[i].extended(desk, effects, found.fits[effects[:1]][i])

    columns = each_for_all(workspace, explored, "two effects", wanted, with_two)
    found.fits |= dict(zip(wanted, columns, strict=True))
    found.score()
    # each effect came in the form that is the best alone, which may not be so beside another
    first, second = next(effects for effects in found.ordered if len(effects) == 2)
    forms = product(*([form for (form,) in singles if form.slug == one.slug] for one in (first, second)))
    others: list[Effects] = [each for each in forms if each not in found.fits and _possible(each, explored)]
    if others:
        columns = each_for_all(workspace, explored, "two effects in other forms", others, with_two)
        found.fits |= dict(zip(others, columns, strict=True))
        found.score()
    _note_best(workspace, found)
    # a pair must not be preferred because one of its effects alone was not fitted as well as it could be
    pair = next(effects for effects in found.ordered if len(effects) == 2)
    size = Candidate(workspace.model).size
    ends = size + len(pair[0].parameters)
    own: dict[Effects, slice] = {pair[:1]: slice(size, ends), pair[1:]: slice(ends, None)}

    def apart(i: int, effects: Effects) -> list[Array]:
        at = found.fits[pair][i].at
        return [np.concatenate([at[:size], at[own[effects]]])]

    _improve(workspace, explored, found, list(own), apart)


def _possible(effects: Effects, explored: Sequence[Explorer]) -> bool:
    """Whether what solves the model can have these effects in it, all at once."""
    return explored[0].solver is None or (all(effect.febio for effect in effects) and fit_together(effects))


def _improve(
    workspace: Workspace,
    explored: Sequence[Explorer],
    found: Found,
    chosen: Sequence[Effects],
    begins: Callable[[int, Effects], list[Array]],
) -> None:
    """Fit the chosen candidates again, from ``begins(number of the specimen, effects)``, and keep what is better."""
    columns = each_for_all(
        workspace, explored, "again from elsewhere", chosen,
        lambda i, effects, desk: explored[i].refitted(desk, effects, found.fits[effects][i], begins(i, effects)),
    )  # fmt: skip
    found.fits |= dict(zip(chosen, columns, strict=True))
    found.score()
    _note_best(workspace, found)


def _bare_again(workspace: Workspace, explored: Sequence[Explorer], found: Found, chosen: Sequence[Effects]) -> None:
    """Fit the bare model again, from where it ended with the chosen effects beside it."""
    size = Candidate(workspace.model).size
    (found.null,) = each_for_all(
        workspace, explored, "the model as it is, again", [None],
        lambda i, _, desk: explored[i].refitted(
            desk, (), found.null[i], [found.fits[effects][i].at[:size] for effects in chosen]
        ),
    )  # fmt: skip
    found.score()


def note_fit(workspace: Workspace, specimen: str, effects: Effects, fitted: Fitted) -> None:
    """Tell those who look on of the best fit to a specimen so far; a true model's loss is about its points."""
    having = " + ".join(effect.name for effect in effects) or "the model as it is"
    words = f"loss {fitted.loss:,.0f} with {having}; {fitted.points:,} points"
    workspace.note("discover", specimen, words, value=fitted.loss, points=fitted.points)


def _note_best(workspace: Workspace, found: Found) -> None:
    """Tell those who look on which candidate is the best of a cohort so far."""
    effects = found.ordered[0]
    best, nothing = found.scored[effects], found.nothing
    words = " + ".join(effect.name for effect in effects)
    words += f": loss {best.loss:,.0f}, {nothing.loss:,.0f} without; a true model's is about {found.floor:,.0f}"
    workspace.note("discover", "all specimens", words, value=best.loss, without=nothing.loss, floor=found.floor)


def _best_forms(scored: dict[Effects, Scored]) -> dict[Effects, Scored]:
    """Of each effect, the form that fits best."""
    best: dict[tuple[str, ...], Effects] = {}
    for effects, one in scored.items():
        if one.effects not in best or one.criterion < scored[best[one.effects]].criterion:
            best[one.effects] = effects
    return {effects: scored[effects] for effects in best.values()}


def _criterion(effects: Effects, loss: float, points: Sequence[int]) -> float:
    return criterion(loss, sum(len(effect.parameters) for effect in effects), points)


def _promising(pairs: Sequence[Effects], promises: Sequence[float]) -> list[Effects]:
    """The pairs that promise most, each in one order only."""
    chosen: dict[frozenset[str], Effects] = {}
    for number in np.argsort(promises, kind="stable"):
        chosen.setdefault(frozenset(effect.slug for effect in pairs[number]), pairs[number])
    return list(chosen.values())[:PAIRS]


def _at_limit(effect: Effect, parameter: Parameter, at: float) -> bool:
    """Whether the end of a range that a parameter is on is its null, or a limit of the law: beyond these is nothing."""
    end = parameter.minimum if at < 0.5 else parameter.maximum
    return end in (effect.null.get(parameter.name), parameter.floor)


def _score(effects: Effects, fitted: Sequence[Fitted], null: Sequence[Fitted]) -> Scored:
    points = [one.points for one in null]
    parameters = [(effect, parameter) for effect in effects for parameter in effect.parameters]
    first = len(fitted[0].at) - len(parameters)
    on_bound = [
        parameter.name
        for k, (effect, parameter) in enumerate(parameters, first)
        if any(one.pressed[k] and not _at_limit(effect, parameter, one.at[k]) for one in fitted)
    ]
    gains = [
        alone.loss - criterion(one.loss, len(parameters), [count])
        for one, alone, count in zip(fitted, null, points, strict=True)
    ]
    loss = sum(one.loss for one in fitted)
    names = tuple(effect.slug for effect in effects)
    return Scored(names, _criterion(effects, loss, points), loss, tuple(gains), on_bound=tuple(on_bound))
