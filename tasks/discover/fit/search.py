"""The candidates of a cohort: all single effects and the most promising pairs, each fitted to every specimen."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import product

import numpy as np

from sinew.runner.errors import BadInput, brief
from sinew.runner.evaluation.adaptive import Session
from sinew.tasks.discover.fit.acting import why_not
from sinew.tasks.discover.fit.bounds import at_limit
from sinew.tasks.discover.fit.fit import Fitted, starts
from sinew.tasks.discover.fit.sizes import library_for
from sinew.tasks.discover.fit.specimen_fits import Effects, SpecimenFits, each_for_all
from sinew.tasks.discover.judge.rules import second_effect_possible
from sinew.tasks.discover.judge.scores import Score, Scores, criterion
from sinew.tasks.discover.settings import Settings
from sinew.tasks.model.effect import Effect
from sinew.tasks.simulate import Array, TakesEffects
from sinew.tasks.study.streams import Stream, generator
from sinew.tasks.study.workspace import Workspace

MAX_FIRST_EFFECTS = 3  # best single effects, from which pairs are formed
FRESH_STARTS = slice(2, 4)  # of the starts of the bare model: those with exchanged relaxation times
SMALL_PART = 0.2  # of an effect's typical size
MAX_PAIRS = 10  # most promising pairs that are fitted


@dataclass
class Candidates:
    """The candidates of a cohort: fits, in the order of the specimens, and scores.

    ``bare`` holds the best fits of the model without effects, ``floor`` is the loss expected of a true model.
    ``left_out``: effects that the solver does not have as it should, by name, and why.
    """

    bare: list[Fitted]
    fits: dict[Effects, list[Fitted]]
    floor: float
    scored: dict[Effects, Score] = field(default_factory=dict)
    left_out: dict[str, str] = field(default_factory=dict)

    @property
    def ordered(self) -> list[Effects]:
        return sorted(self.scored, key=lambda effects: self.scored[effects].criterion)

    @property
    def scores(self) -> Scores:
        """The scores as the rules of the verdict take them."""
        loss = sum(one.loss for one in self.bare)
        return Scores(Score((), loss, loss), tuple(self.scored.values()), self.floor)

    @property
    def with_bare(self) -> dict[Effects, list[Fitted]]:
        """The fits of all candidates, and of the bare model."""
        return {(): self.bare, **self.fits}

    def effects_of(self, score: Score) -> Effects:
        """The effects, in their forms, of a candidate with this score; none for the bare model."""
        return next((effects for effects, one in self.scored.items() if one is score), ())

    def add(self, effects: Effects, fits: list[Fitted]) -> Effects:
        """Score one more candidate, and return these effects in the forms that fit best: those, or those known before.

        What is known of the others, such as their predictions of held-out data, stays.
        """
        self.fits[effects] = fits
        slugs = tuple(effect.slug for effect in effects)
        found = {one: score for one, score in self.scored.items() if score.effects == slugs and one != effects}
        best = _best_forms({**found, effects: _score(effects, fits, self.bare)})
        self.scored = {one: score for one, score in self.scored.items() if score.effects != slugs} | best
        return next(iter(best))

    def score(self) -> None:
        """Score all fits against the bare model as it is fitted now."""
        self.scored = _best_forms({effects: _score(effects, fits, self.bare) for effects, fits in self.fits.items()})


def asked(settings: Settings, cohort: Sequence[SpecimenFits]) -> list[Effect]:
    """The effects that the study asks for, with ranges for specimens of this size.

    All are those of the library that the simulator can have.
    """
    slugs = settings.effects
    known = library_for([one.measured.specimen for one in cohort])
    if slugs == "all":
        model = cohort[0].candidate().stand_in
        return [effect for effect in known.values() if any(model.possible((form,)) for form in _forms(effect))]
    return [effect for slug, effect in known.items() if slug in slugs]


def reasons(solver: TakesEffects, effects: Sequence[Effect]) -> str:
    """Which of the effects a solver cannot have in any form, and why; empty where it can have all."""
    by_reason: dict[str, list[str]] = {}
    for effect in effects:
        found = [solver.why_not(form) for form in _forms(effect)]
        if None not in found:
            by_reason.setdefault(str(found[0]), []).append(effect.slug)
    return "; ".join(f"{', '.join(slugs)}: {why}" for why, slugs in by_reason.items())


def _forms(effect: Effect) -> tuple[Effect, ...]:
    return (effect, *effect.other_forms)


def search(
    workspace: Workspace, settings: Settings, cohort: Sequence[SpecimenFits], bare_fits: list[Fitted]
) -> Candidates:
    """Fit and score all candidates; ``bare_fits`` holds the best fits of the bare model so far, by specimen."""
    bare = cohort[0].candidate()
    forms: list[Effects] = [(form,) for effect in asked(settings, cohort) for form in _forms(effect)]
    could = [form for form in forms if _possible(form, cohort)]
    left_out = _left_out(workspace, cohort, could, bare_fits[0])
    singles = [form for form in could if form[0].name not in left_out]
    if not singles:
        problem = brief("; ".join(f"{name}: {why}" for name, why in left_out.items()), 200)
        raise BadInput(f"{workspace.study.path}: discover.effects", problem, "effects that this model can have")
    best = list(bare_fits)

    def with_one(i: int, effects: Effects, session: Session) -> Fitted:
        fitted = cohort[i].extended(session, effects, bare_fits[i])
        if fitted.loss < best[i].loss:
            best[i] = fitted
            note_fit(workspace, cohort[i].name, effects, fitted)
        return fitted

    columns = each_for_all(workspace, cohort, "one effect", singles, with_one)
    floor = float(sum(fitted.points - bare.size for fitted in bare_fits))
    candidates = Candidates(bare_fits, dict(zip(singles, columns, strict=True)), floor, left_out=left_out)
    candidates.score()
    _note_best(workspace, candidates)
    firsts = candidates.ordered[:MAX_FIRST_EFFECTS]
    elsewhere = starts(bare, generator(workspace.seed, Stream.FRESH_FIT_STARTS), FRESH_STARTS.stop)[FRESH_STARTS]

    def begin(effects: Effects, at: Array, part: float) -> Array:
        candidate = bare.having(*effects)
        return np.concatenate([at, candidate.null() + part * (candidate.typical() - candidate.null())])

    _improve(workspace, cohort, candidates, firsts, lambda _, effects: [begin(effects, at, 1.0) for at in elsewhere])
    # The bare model, started from a fit with an effect, may fit better than before, and candidates started from that
    # fit may, too. No model must look worse than another only because of where its fit was started.
    _bare_again(workspace, cohort, candidates, firsts)
    _improve(
        workspace, cohort, candidates, firsts,
        lambda i, effects: [begin(effects, candidates.bare[i].at, SMALL_PART)],
    )  # fmt: skip
    both = [(*first, *other) for first in firsts for other in candidates.scored if other != first]
    pairs = [each for each in both if _possible(each, cohort)]
    if pairs and second_effect_possible(candidates.scores):
        _add_pairs(workspace, cohort, candidates, pairs, singles)
    return candidates


def _left_out(
    workspace: Workspace, cohort: Sequence[SpecimenFits], forms: Sequence[Effects], bare: Fitted
) -> dict[str, str]:
    """Effects inside a model of the user's own that do not act as they should, by name, and why.

    ``bare``: the best fit of the first specimen, at which single ``forms`` are run.
    """
    if workspace.model.law == "tendon":
        return {}
    own = set(workspace.model.names)
    taken = {form[0].name: f"the model has a parameter {', '.join(both)}" for form in forms
             if (both := sorted(own & set(form[0].names)))}  # fmt: skip
    inside = [form for form in forms if not (form[0].around or form[0].name in taken)]
    found = each_for_all(
        workspace, cohort[:1], "effects inside the model", inside,
        lambda i, effects, session: why_not(cohort[i].tried(session, effects, bare)),
    ) if inside else []  # fmt: skip
    return taken | {form[0].name: why for form, (why,) in zip(inside, found, strict=True) if why is not None}


def _add_pairs(
    workspace: Workspace,
    cohort: Sequence[SpecimenFits],
    candidates: Candidates,
    pairs: Sequence[Effects],
    singles: Sequence[Effects],
) -> None:
    """Fit and score the most promising pairs."""
    promises = each_for_all(
        workspace, cohort, "trying pairs of effects", pairs,
        lambda i, effects, session: cohort[i].promise(session, effects, candidates.fits[effects[:1]][i]),
    )  # fmt: skip
    points = [one.points for one in candidates.bare]
    wanted = _promising(pairs, [_criterion(*both, points) for both in zip(pairs, map(sum, promises), strict=True)])

    def with_two(i: int, effects: Effects, session: Session) -> Fitted:
        return cohort[i].extended(session, effects, candidates.fits[effects[:1]][i])

    columns = each_for_all(workspace, cohort, "two effects", wanted, with_two)
    candidates.fits |= dict(zip(wanted, columns, strict=True))
    candidates.score()
    # the form of an effect that fits best alone may not be the best one in a pair
    first, second = next(effects for effects in candidates.ordered if len(effects) == 2)
    forms = product(*([form for (form,) in singles if form.slug == one.slug] for one in (first, second)))
    others: list[Effects] = [each for each in forms if each not in candidates.fits and _possible(each, cohort)]
    if others:
        columns = each_for_all(workspace, cohort, "two effects in other forms", others, with_two)
        candidates.fits |= dict(zip(others, columns, strict=True))
        candidates.score()
    _note_best(workspace, candidates)
    # a pair must not be preferred because one of its effects alone was fitted badly
    pair = next(effects for effects in candidates.ordered if len(effects) == 2)
    size = cohort[0].candidate().size
    ends = size + len(pair[0].parameters)
    own: dict[Effects, slice] = {pair[:1]: slice(size, ends), pair[1:]: slice(ends, None)}

    def apart(i: int, effects: Effects) -> list[Array]:
        at = candidates.fits[pair][i].at
        return [np.concatenate([at[:size], at[own[effects]]])]

    _improve(workspace, cohort, candidates, list(own), apart)


def _possible(effects: Effects, cohort: Sequence[SpecimenFits]) -> bool:
    """Whether the simulator can have these effects, all at once."""
    return cohort[0].candidate().possible(effects)


def _improve(
    workspace: Workspace,
    cohort: Sequence[SpecimenFits],
    candidates: Candidates,
    chosen: Sequence[Effects],
    begins: Callable[[int, Effects], list[Array]],
) -> None:
    """Refit the chosen candidates from ``begins(number of the specimen, effects)``, and keep the better fits."""
    columns = each_for_all(
        workspace, cohort, "again from elsewhere", chosen,
        lambda i, effects, session: cohort[i].refitted(
            session, effects, candidates.fits[effects][i], begins(i, effects)
        ),
    )  # fmt: skip
    candidates.fits |= dict(zip(chosen, columns, strict=True))
    candidates.score()
    _note_best(workspace, candidates)


def _bare_again(
    workspace: Workspace, cohort: Sequence[SpecimenFits], candidates: Candidates, chosen: Sequence[Effects]
) -> None:
    """Refit the bare model, started from its parameters in the fits with the chosen effects."""
    size = cohort[0].candidate().size
    (candidates.bare,) = each_for_all(
        workspace, cohort, "the model as it is, again", [None],
        lambda i, _, session: cohort[i].refitted(
            session, (), candidates.bare[i], [candidates.fits[effects][i].at[:size] for effects in chosen]
        ),
    )  # fmt: skip
    candidates.score()


def note_fit(workspace: Workspace, specimen: str, effects: Effects, fitted: Fitted) -> None:
    """Show the best fit to a specimen so far; the loss of a true model is about the number of residuals."""
    having = " + ".join(effect.name for effect in effects) or "the model as it is"
    words = f"loss {fitted.loss:,.0f} with {having}; {fitted.points:,} residuals"
    workspace.note("discover", specimen, words, value=fitted.loss, points=fitted.points)


def _note_best(workspace: Workspace, candidates: Candidates) -> None:
    """Show which candidate is the best of the cohort so far."""
    effects = candidates.ordered[0]
    best, bare = candidates.scored[effects], candidates.scores.bare
    words = " + ".join(effect.name for effect in effects)
    words += f": loss {best.loss:,.0f}, {bare.loss:,.0f} without; a true model's is about {candidates.floor:,.0f}"
    workspace.note("discover", "all specimens", words, value=best.loss, without=bare.loss, floor=candidates.floor)


def _best_forms(scored: dict[Effects, Score]) -> dict[Effects, Score]:
    """Of each effect, the form that fits best."""
    best: dict[tuple[str, ...], Effects] = {}
    for effects, one in scored.items():
        if one.effects not in best or one.criterion < scored[best[one.effects]].criterion:
            best[one.effects] = effects
    return {effects: scored[effects] for effects in best.values()}


def _criterion(effects: Effects, loss: float, points: Sequence[int]) -> float:
    return criterion(loss, sum(len(effect.parameters) for effect in effects), points)


def _promising(pairs: Sequence[Effects], promises: Sequence[float]) -> list[Effects]:
    """The most promising pairs, each in one order only."""
    chosen: dict[frozenset[str], Effects] = {}
    for number in np.argsort(promises, kind="stable"):
        chosen.setdefault(frozenset(effect.slug for effect in pairs[number]), pairs[number])
    return list(chosen.values())[:MAX_PAIRS]


def _score(effects: Effects, fitted: Sequence[Fitted], bare_fits: Sequence[Fitted]) -> Score:
    points = [one.points for one in bare_fits]
    parameters = [(effect, parameter) for effect in effects for parameter in effect.parameters]
    first = len(fitted[0].at) - len(parameters)
    on_bound = [
        parameter.name
        for k, (effect, parameter) in enumerate(parameters, first)
        if any(one.pressed[k] and not at_limit(parameter, one.at[k], effect.null) for one in fitted)
    ]
    gains = [
        alone.loss - criterion(one.loss, len(parameters), [count])
        for one, alone, count in zip(fitted, bare_fits, points, strict=True)
    ]
    loss = sum(one.loss for one in fitted)
    names = tuple(effect.slug for effect in effects)
    return Score(names, _criterion(effects, loss, points), loss, tuple(gains), on_bound=tuple(on_bound))
