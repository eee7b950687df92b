"""Effects beside what no effect explains: added one after the other, with a look back at those that came before.

Each step tries the effects that promise most and adds the one with the largest evidence beside a discrepancy
(:mod:`sinew.tasks.discover.fit.beside`). An effect that is no longer needed with those added after it is dropped. For
each of the effects in the end: what is lost without it, and, if that is asked, which other effect could take its place.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from sinew.runner.evaluation.adaptive import Session
from sinew.tasks.discover.fit.beside import Beside
from sinew.tasks.discover.fit.bounds import pressed_in_most
from sinew.tasks.discover.fit.fit import Fitted
from sinew.tasks.discover.fit.search import Candidates
from sinew.tasks.discover.fit.specimen_fits import Effects, SpecimenFits, each_for_all
from sinew.tasks.drawing.blocks import plural
from sinew.tasks.model.effect import Effect
from sinew.tasks.simulate import Array
from sinew.tasks.study.workspace import Workspace

MAX_EFFECTS = 4
MAX_STEPS = 5  # effects may be dropped again, so there can be more steps than effects
TRIED = 3  # the most promising forms of each step
TRIED_PLAIN = 2  # and the best candidates of as many effects, fitted without a discrepancy
RIVALS = 2  # effects that are tried in the place of each
MIN_STEP = 20.0  # twice the log evidence that an effect must add to be looked at
MIN_KEPT = 10.0  # and that it must be worth once others were added


@dataclass(frozen=True, eq=False)
class Member:
    """One of the effects in the end, a ``form``.

    ``gains``: twice the log evidence that is lost without it, by specimen. ``without``: fits of the other effects
    without a discrepancy. ``pressed``: its parameters that data press against a bound in most specimens.
    """

    form: Effect
    gains: tuple[float, ...]
    without: tuple[Fitted, ...]
    pressed: tuple[str, ...]


Fits = Sequence[Beside]


@dataclass
class _Search:
    """What the steps share: the fits beside a discrepancy so far, by effects."""

    workspace: Workspace
    cohort: Sequence[SpecimenFits]
    candidates: Candidates
    forms: Sequence[Effect]
    known: dict[Effects, Fits] = field(default_factory=dict)

    def fitted(self, several: Mapping[Effects, Sequence[tuple[Array, Array | None]]], title: str) -> list[Fits]:
        """The fits with each of several sets of effects, from a start and sizes for each specimen."""

        def work(i: int, effects: Effects, session: Session) -> Beside:
            start, sizes = several[effects][i]
            return self.cohort[i].beside(session, effects, start, sizes)

        columns = each_for_all(self.workspace, self.cohort, title, list(several), work)
        for effects, fits in zip(several, columns, strict=True):
            if effects not in self.known or evidence(fits) < evidence(self.known[effects]):
                self.known[effects] = fits
        return [self.known[effects] for effects in several]

    def promising(
        self, effects: Effects, count: int, each_slug: int
    ) -> dict[Effects, list[tuple[Array, Array | None]]]:
        """The most promising sets with one effect more, with the starts of their fits; so many forms of one effect."""
        there = {effect.slug for effect in effects}
        longer: list[Effects] = [(*effects, form) for form in self.forms if form.slug not in there]
        several = [each for each in longer if self.cohort[0].candidate().possible(each)]
        before, plain = self.known[effects], self.candidates.fits

        def work(i: int, wanted: Effects, session: Session) -> tuple[float, Array, Array]:
            known = plain[wanted][i].at if wanted in plain else None
            return self.cohort[i].promise_beside(session, wanted, before[i], known)

        columns = each_for_all(self.workspace, self.cohort, "trying further effects with a discrepancy", several, work)
        order = sorted(range(len(several)), key=lambda k: sum(one[0] for one in columns[k]))
        chosen: dict[Effects, list[tuple[Array, Array | None]]] = {}
        for k in order:
            same = [one for one in chosen if one[-1].slug == several[k][-1].slug]
            if len(chosen) < count and len(same) < each_slug:
                chosen[several[k]] = [(start, sizes) for _, start, sizes in columns[k]]
        return chosen


@dataclass(frozen=True, eq=False)
class Rival:
    """An effect that was tried in the place of another.

    ``gain``: how much of twice the log evidence it regains; ``fits``: with it, without a discrepancy, by specimen.
    """

    effect: str
    gain: float
    fits: tuple[Fitted, ...]


@dataclass(frozen=True, eq=False)
class Stepwise:
    """The effects in the end, and the ``fits`` of all of them together without a discrepancy, by specimen."""

    members: tuple[Member, ...]
    fits: tuple[Fitted, ...]
    search: _Search

    @property
    def effects(self) -> Effects:
        return tuple(member.form for member in self.members)

    def rivals(self, member: Member) -> list[Rival]:
        """The effects that promise most in the place of one."""
        return _rivals(self.search, self.effects, member.form)


def stepwise(
    workspace: Workspace, cohort: Sequence[SpecimenFits], candidates: Candidates, forms: Sequence[Effect]
) -> Stepwise:
    """The effects that are worth adding beside a discrepancy; none where the first is not."""
    search = _Search(workspace, cohort, candidates, forms)
    search.fitted({(): [(one.at, None) for one in candidates.bare]}, "the bare model with a discrepancy")
    chosen: Effects = ()
    seen: set[frozenset[Effect]] = set()
    for _ in range(MAX_STEPS):
        longer = _step(search, chosen) if len(chosen) < MAX_EFFECTS else None
        if longer is None or frozenset(longer) in seen:
            break
        seen.add(frozenset(longer))
        chosen = _look_back(search, longer)
    return _result(search, chosen)


def _step(search: _Search, chosen: Effects) -> Effects | None:
    """The best admissible set with one effect more; None where none is worth it."""
    starts = search.promising(chosen, TRIED, each_slug=2)
    size = len(chosen) + 1
    plain = [effects for effects in search.candidates.ordered if len(effects) == size][:TRIED_PLAIN]
    for effects in plain:
        if effects not in starts:
            starts[effects] = [(one.at, None) for one in search.candidates.fits[effects]]
    search.fitted(starts, f"{plural(size, 'effect')} with a discrepancy")
    admissible = [effects for effects in starts if not any(_pressed(search, effects, form) for form in effects)]
    if not admissible:
        return None
    best = min(admissible, key=lambda effects: evidence(search.known[effects]))
    return best if evidence(search.known[chosen]) - evidence(search.known[best]) >= MIN_STEP else None


def _look_back(search: _Search, chosen: Effects) -> Effects:
    """What is left of a set when effects that are not worth their place are dropped, the least worth first."""
    while len(chosen) > 1:
        losses = {form: sum(each) for form, each in _losses(search, chosen, chosen[:-1]).items()}
        least = min(losses, key=lambda form: losses[form])
        if losses[least] >= MIN_KEPT:
            break
        chosen = _others(chosen, least)
    return chosen


def _others(chosen: Effects, form: Effect) -> Effects:
    return tuple(other for other in chosen if other is not form)


def _losses(search: _Search, chosen: Effects, forms: Effects) -> dict[Effect, list[float]]:
    """Twice the log evidence that each specimen loses without one of the effects, for some ``forms`` of them."""
    fits = search.known[chosen]
    starts: dict[Effects, list[tuple[Array, Array | None]]] = {
        others: [(_without(search, chosen, form, one.fitted.at), one.sizes) for one in fits]
        for form in forms
        if (others := _others(chosen, form))
    }
    if starts:
        search.fitted(starts, "without one of the effects")
    return {
        form: [
            less.evidence - one.evidence for less, one in zip(search.known[_others(chosen, form)], fits, strict=True)
        ]
        for form in forms
    }


def _without(search: _Search, chosen: Effects, form: Effect, at: Array) -> Array:
    """A point ``[k]`` without the parameters of one of the effects."""
    begin, end = _own(search, chosen, form)
    return np.delete(at, slice(begin, end))


def _own(search: _Search, chosen: Effects, form: Effect) -> tuple[int, int]:
    """Where the parameters of one of the effects stand in a point."""
    begin = search.cohort[0].candidate().size
    for other in chosen:
        if other is form:
            break
        begin += len(other.parameters)
    return begin, begin + len(form.parameters)


def _pressed(search: _Search, chosen: Effects, form: Effect) -> tuple[str, ...]:
    """Parameters of an effect that data press against a bound in most specimens; null values do not count."""
    begin, _ = _own(search, chosen, form)
    fits = [one.fitted for one in search.known[chosen]]
    return pressed_in_most(form.parameters, begin, fits, form.null)


def _result(search: _Search, chosen: Effects) -> Stepwise:
    """The effects with what each is worth, and their fits without a discrepancy."""
    if not chosen:
        return Stepwise((), tuple(search.candidates.bare), search)
    worth = _losses(search, chosen, chosen)
    fits = _plain(search, [chosen, *(_others(chosen, form) for form in chosen)])
    members = tuple(
        Member(form, tuple(worth[form]), tuple(fits[_others(chosen, form)]), _pressed(search, chosen, form))
        for form in chosen
    )
    return Stepwise(members, tuple(fits[chosen]), search)


def _rivals(search: _Search, chosen: Effects, form: Effect) -> list[Rival]:
    """Effects in the place of another, with and without a discrepancy: those that promise most, and all tried before.

    What promises most is told from slopes. An effect of which little is known at its beginning, such as a threshold,
    may do better than that.
    """
    others = _others(chosen, form)
    there = {one.slug for one in chosen}
    before = [effects for effects in search.known if effects and effects[:-1] == others]
    starts = {
        effects: begins
        for effects, begins in search.promising(others, RIVALS + 2, each_slug=1).items()
        if effects[-1].slug not in there
    }
    wanted = dict(list(starts.items())[:RIVALS])
    if wanted:
        search.fitted(wanted, "another effect in the place of one")
    rivals = [effects for effects in dict.fromkeys([*wanted, *before]) if effects[-1].slug not in there]
    plain, without = _plain(search, rivals), evidence(search.known[others])
    return [
        Rival(effects[-1].slug, without - evidence(search.known[effects]), tuple(plain[effects])) for effects in rivals
    ]


def _plain(search: _Search, several: Iterable[Effects]) -> dict[Effects, list[Fitted]]:
    """Fits without a discrepancy, from where those beside one ended, or better ones that are there already."""
    candidates, wanted = search.candidates, [effects for effects in dict.fromkeys(several) if effects]

    def work(i: int, effects: Effects, session: Session) -> Fitted:
        begins = [search.known[effects][i].fitted.at]
        if effects in candidates.fits:
            return search.cohort[i].refitted(session, effects, candidates.fits[effects][i], begins)
        return search.cohort[i].fitted_from(session, effects, begins)

    columns = each_for_all(search.workspace, search.cohort, "without a discrepancy", wanted, work)
    return {(): candidates.bare, **dict(zip(wanted, columns, strict=True))}


def evidence(fits: Fits) -> float:
    """Minus twice the log evidence of all specimens together."""
    return sum(one.evidence for one in fits)
