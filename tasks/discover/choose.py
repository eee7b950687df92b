"""Which effect is missing, if any: from fits with and without, to a verdict.

Each candidate is nested on the bare model. Its criterion is twice the negative log likelihood (whitened, so correlated
noise does not count twice) plus a penalty of ln(points) for each parameter of each specimen (Schwarz 1978). That alone
decides little: nature's form of an effect is not the library's, so even the right effect leaves something, and a second
effect can feed on what the first one's form leaves. Whoever is named must therefore explain nearly all of the misfit,
leave rivals far behind, predict what was held out, recur in other specimens, and end inside its bounds.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

CLEARLY = 20.0  # of the criterion: 10 of twice the log likelihood are called very strong (Kass and Raftery 1995)
FORMS_LEAVE = 0.02  # part of the misfit beyond noise that each effect of a name may leave: for its form
FAR_BEHIND = 2.0  # how many times what the best leaves a rival must leave
SECOND = 0.8  # part of what one effect leaves that a second must take away,
LONELY = 0.6, 3.0  # or a smaller part, if that is so many times what any of
OTHERS = 3  # others takes away, at least so many of which were fitted
FORM = 0.005  # part of the misfit that an effect may leave because nature's form of it is another,
BEYOND = 3.0  # and how many times what chance leaves: below one of both, a second effect is not looked for
HELD_OUT_ERRORS = 2.0  # standard errors by which the prediction of what a fit has not seen must improve
KINDS = 2  # of splits on which it must
PLACES = 0.5  # part of the improvement that must lie in cells which disagree,
CROWDED = 2.0  # or at least so many times the part of the cells that they are: a small misfit shows in few


@dataclass(frozen=True)
class Scored:
    """A candidate: its effects' slugs, criterion and loss (whitened sum of squares over all specimens).

    ``gains``: improvement of the criterion by specimen. ``held``: by kind of split, the gain on what was held out and
    its standard error; for two effects, ``beyond`` has the same against the better of them alone. Empty where nothing
    was held out. ``on_bound``: parameters of the effects that ended on a bound in any specimen; null values and limits
    of a law are none. ``in_place``: part of the improvement that lies in cells beyond chance, and part of all cells
    that these are (None: there are none, or nobody looked).
    """

    effects: tuple[str, ...]
    criterion: float
    loss: float
    gains: tuple[float, ...] = ()
    held: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    beyond: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    on_bound: tuple[str, ...] = ()
    in_place: tuple[float, float] | None = None


@dataclass(frozen=True)
class Evidence:
    """About the bare model: the loss that a true model would have, and whether some cell of it disagrees.

    ``located``: beyond chance; ``surely``: so far beyond that a lab can rely on it. ``trusted``: its fits were found
    from more than one start; otherwise what they leave may be for want of a better fit, and says nothing.
    """

    floor: float
    located: bool
    surely: bool
    trusted: bool = True


@dataclass(frozen=True)
class Verdict:
    """``word`` is NONE, NAMED, AMBIGUOUS or OUTSIDE; ``effects`` when named, ``alike`` when ambiguous; and why.

    ``judged``: the effects of the candidate that it is about.
    """

    word: str
    effects: tuple[str, ...] = ()
    alike: tuple[str, ...] = ()
    explained: float | None = None
    why: str = ""
    judged: tuple[str, ...] = ()


def criterion(loss: float, parameters: int, points: Sequence[int]) -> float:
    """Of a candidate with ``parameters`` more than the bare model in each specimen of so many ``points``."""
    return loss + parameters * float(np.sum(np.log(points)))


def single(null: Scored, candidates: Sequence[Scored]) -> Scored:
    """The best candidate with one effect."""
    return min((one for one in candidates if len(one.effects) == 1), key=lambda one: one.criterion, default=null)


def leading(null: Scored, candidates: Sequence[Scored], floor: float) -> Scored:
    """The candidate to be judged first: the best single effect, or a pair that takes away much of what that leaves."""
    floor = realised(candidates, floor)
    alone = single(null, candidates)
    best = min(candidates, key=lambda one: one.criterion, default=null)
    much = _takes(alone, best, floor) >= SECOND or _lonely(alone, best, candidates, floor)
    if alone.criterion - best.criterion < CLEARLY or not much:
        return alone
    noise_alone = best.loss - floor <= _rest_by_chance(floor) and _far_beyond_chance(alone, floor)
    return best if noise_alone or _leaves_more_than_form(null, alone, floor) else alone


def realised(candidates: Sequence[Scored], floor: float) -> float:
    """What noise leaves of these data: a true model's loss or, where a single effect came below that, the smallest.

    The noise is the same for all candidates. Where it happens to be small, a misfit that is well beyond it would not
    show beside the noise of other data.
    """
    return min([floor, *(one.loss for one in candidates if len(one.effects) == 1)])


def _takes(alone: Scored, pair: Scored, floor: float) -> float:
    """Part of what one effect leaves that a pair takes away."""
    return 1.0 - _rest(pair, floor) / _rest(alone, floor)


def _lonely(alone: Scored, best: Scored, candidates: Sequence[Scored], floor: float) -> bool:
    """Whether no other second effect does nearly what the best does: the form of the first would not care which."""
    least, times = LONELY
    takes = _takes(alone, best, floor)
    seconds = [one for one in candidates if len(one.effects) == 2 and set(alone.effects) < set(one.effects)]
    others = [_takes(alone, one, floor) for one in seconds if one is not best]
    return best in seconds and len(others) >= OTHERS and takes >= max(least, times * max(others))


def _leaves_more_than_form(null: Scored, alone: Scored, floor: float) -> bool:
    return alone.loss - floor > FORM * (null.loss - floor)


def _far_beyond_chance(alone: Scored, floor: float) -> bool:
    return alone.loss - floor > BEYOND * _rest_by_chance(floor)


def room_for_two(null: Scored, candidates: Sequence[Scored], floor: float) -> bool:
    """Whether the best single effect leaves so much that a second could take away :data:`SECOND` of it."""
    least = min((null, *candidates), key=lambda one: one.criterion)
    much = (1.0 - SECOND) * _rest(least, floor) >= _rest_by_chance(floor) / 3.0
    return much and (_leaves_more_than_form(null, least, floor) or _far_beyond_chance(least, floor))


def rivals(best: Scored, candidates: Sequence[Scored], floor: float) -> list[Scored]:
    """Candidates with as many effects that leave not much more than ``best`` does."""
    floor = realised(candidates, floor)
    limit = FAR_BEHIND * _rest(best, floor)
    return [
        one
        for one in candidates
        if one is not best
        and len(one.effects) == len(best.effects)
        and (one.criterion - best.criterion < CLEARLY or _rest(one, floor) < limit)
    ]


def verdict(null: Scored, candidates: Sequence[Scored], about: Evidence) -> Verdict:
    """The verdict on the bare model ``null`` and what was added to it.

    Where what the best single effect leaves may be for its form, a pair is named or nothing is said of it.
    """
    about = replace(about, floor=realised(candidates, about.floor))
    best, alone = leading(null, candidates, about.floor), single(null, candidates)
    found = _judged(null, best, candidates, about)
    if found.word != "NAMED" and best is not alone and _may_be_form(null, alone, best, about.floor):
        found, best = _judged(null, alone, candidates, about), alone
    return replace(found, judged=best.effects)


def _may_be_form(null: Scored, alone: Scored, best: Scored, floor: float) -> bool:
    return not _leaves_more_than_form(null, alone, floor) or _takes(alone, best, floor) < SECOND


def _judged(null: Scored, best: Scored, candidates: Sequence[Scored], about: Evidence) -> Verdict:
    gain = null.criterion - best.criterion
    if gain < CLEARLY:
        if not about.located:
            return Verdict("NONE", why="no cell disagrees beyond chance, and no effect improves the fit clearly")
        if not about.surely:
            return Verdict("NONE", why="a cell disagrees hardly beyond chance, and no effect improves the fit clearly")
        if not about.trusted:
            return Verdict("AMBIGUOUS", why="no two fits of the model as it is agree: more starts are needed")
        return Verdict("OUTSIDE", why="model and data disagree, and no effect of the library helps")
    name = " + ".join(best.effects)
    part = explained(null, best, about.floor)
    takes = "takes away all" if part is None else f"takes away {100 * min(part, 1.0):.0f} %"
    may_leave = FORMS_LEAVE * len(best.effects)
    if _rest(best, about.floor) > may_leave * _rest(null, about.floor) + _rest_by_chance(about.floor):
        why = (
            f"the best of the library ({name}) {takes} of the misfit, and a name takes {100 * (1.0 - may_leave):.0f} %"
        )
        return Verdict("OUTSIDE", explained=part, why=why)
    alike = rivals(best, candidates, about.floor)
    if alike:
        slugs = tuple(dict.fromkeys(slug for one in (best, *alike) for slug in one.effects))
        why = f"{1 + len(alike)} candidates fit about as well as each other"
        return Verdict("AMBIGUOUS", (), slugs, part, why)
    doubts = _doubts(best)
    if part is None and not about.located:
        doubts.append("no cell disagrees beyond chance without it")
    if doubts:
        return Verdict("AMBIGUOUS", (), best.effects, part, f"{name} fits best, but {doubts[0]}")
    return Verdict("NAMED", best.effects, (), part, f"it {takes} of the misfit")


def _doubts(best: Scored) -> list[str]:
    """Why the best candidate is not to be named after all."""
    found = []
    for what, held in (("the model as it is", best.held), ("one of them alone", best.beyond)):
        better = sum(gain > HELD_OUT_ERRORS * error for gain, error in held.values())
        if better < min(KINDS, len(held)):
            found.append(f"does not predict what it has not seen better than {what}")
    if best.on_bound:
        found.append(f"{', '.join(best.on_bound)} ended on a bound: the effect is not what the library has")
    seen = sum(gain > 0 for gain in best.gains)
    if seen < min(2, len(best.gains)):
        found.append(f"it shows in {seen} of {len(best.gains)} specimens")
    if best.in_place is not None and best.in_place[0] < min(PLACES, CROWDED * best.in_place[1]):
        found.append("it improves the fit elsewhere than where model and data disagree")
    return found


def _rest(one: Scored, floor: float) -> float:
    """What a candidate leaves beyond noise, and as much as noise may hide."""
    return max(one.loss - floor, 0.0) + _rest_by_chance(floor) / 3.0


def _rest_by_chance(floor: float) -> float:
    """Three standard deviations of a true model's loss."""
    return 3.0 * float(np.sqrt(2.0 * floor))


def explained(null: Scored, one: Scored, floor: float) -> float | None:
    """Part of the misfit beyond noise that a candidate takes away; None where there is hardly any."""
    misfit = null.loss - floor
    return (null.loss - one.loss) / misfit if misfit > _rest_by_chance(floor) else None
