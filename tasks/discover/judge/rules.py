"""The rules and thresholds by which a verdict is given, also to a second effect: pure functions of frozen evidence.

The criterion alone decides little. Nature's form of an effect is not the library's, so even the right effect leaves a
part of the misfit, and a second effect can feed on what the form of the first one leaves. Hence the rules below.
*Misfit* is loss beyond the noise, and every comparison of misfits allows for what noise may hide
(:mod:`sinew.tasks.discover.judge.scores`).

Which candidate is judged (:func:`leading`): the best single effect, unless the best candidate of all is a pair for
which all of these hold:

=====  ===============================================================================================================
       condition
=====  ===============================================================================================================
gain   Its criterion is better than the best single effect's by at least 20.
share  It takes away at least 80 % of the misfit that the single effect leaves; or at least 60 %, and three times what
       any other pair with that effect takes away, where at least three of these were fitted.
room   The single effect leaves more than 0.5 % of the bare model's misfit, which may be for its form; or it leaves
       three times what chance does, and the pair leaves no more than chance does.
=====  ===============================================================================================================

What the verdict is (:func:`verdict`), the first condition that holds:

====  =============================================================================================  =========
rule  condition                                                                                      verdict
====  =============================================================================================  =========
0     the criterion improves by less than 20, no cell disagrees far beyond chance, and most          AMBIGUOUS
      parameters of the bare model are pressed against the ends of their ranges
1     the criterion improves by less than 20, and no cell disagrees beyond chance                    NONE
2     it improves by less than 20, and no cell disagrees far beyond chance                           NONE
3     it improves by less than 20, and no two fits of the bare model agree                           AMBIGUOUS
4     it improves by less than 20                                                                    OUTSIDE
5     more than 2 % of the misfit is left for each effect                                            OUTSIDE
6     a rival has a criterion within 20, or leaves less than twice the misfit                        AMBIGUOUS
7     a check fails (:func:`failed_checks`)                                                          AMBIGUOUS
8     none of these                                                                                  NAMED
====  =============================================================================================  =========

A pair that is not NAMED gives way to the single effect where this leaves no more than 0.5 % of the misfit, or where the
pair takes away less than 80 % of what it leaves: the second effect may then be the form of the first.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

from sinew.tasks.discover.judge.scores import Score, Scores, explained, misfit_by_chance, misfit_left
from sinew.tasks.discover.judge.shared_checks import ends_on_bound, shows_in_few
from sinew.tasks.discover.measure.splits import LATER, PROTOCOL, SPECIMEN
from sinew.tasks.discover.result import Gain, Word
from sinew.tasks.drawing.blocks import listed

MIN_CRITERION_GAIN = 20.0  # twice the log likelihood; 10 are called very strong (Kass and Raftery 1995)
MAX_LEFT_PER_EFFECT = 0.02  # part of the bare model's misfit that may be left for the form of each named effect
MIN_RIVAL_RATIO = 2.0  # misfit that a rival leaves, in times of what the best leaves

MIN_SECOND_SHARE = 0.8  # part of what one effect leaves that a second must take away,
MIN_UNRIVALLED_SHARE = 0.6  # or this part, where it is
MIN_UNRIVALLED_RATIO = 3.0  # times what any other second effect takes away,
MIN_OTHER_SECONDS = 3  # and at least so many others were fitted
MAX_FORM_PART = 0.005  # part of the misfit that an effect may leave because nature's form of it is another
MIN_CHANCE_RATIO = 3.0  # misfit in times of what chance leaves, beyond which it is not chance

HELD_OUT = {PROTOCOL: "other tests", LATER: "later cycles", SPECIMEN: "another specimen"}
MIN_HELD_OUT_ERRORS = 2.0  # standard errors by which predictions of held-out data must improve,
MIN_SPLIT_KINDS = 2  # on so many kinds of splits
MOST_NAMED = 4  # candidates that fit about as well
MIN_PART_IN_PLACE = 0.5  # part of the improvement that must lie in cells which disagree,
MIN_RATIO_IN_PLACE = 2.0  # or so many times their part of all cells: a small misfit shows in few cells


@dataclass(frozen=True)
class Evidence:
    """What the rules look at: the scores, and what is known of the bare model.

    ``located``: some cell disagrees beyond chance; ``surely``: far beyond it. ``trusted``: its fits were found from
    more than one start; otherwise the misfit may be that of a poor fit. ``cornered``: names of its
    parameters that the data press against ends of their ranges, where these are most of them.
    """

    scores: Scores
    located: bool
    surely: bool
    trusted: bool = True
    cornered: tuple[str, ...] = ()


@dataclass(frozen=True)
class Verdict:
    """The ``word``; ``effects`` when NAMED, those that are ``alike`` when AMBIGUOUS; the part explained; and why.

    ``judged``: the effects of the candidate that the verdict is about.
    """

    word: Word
    effects: tuple[str, ...] = ()
    alike: tuple[str, ...] = ()
    explained: float | None = None
    why: str = ""
    judged: tuple[str, ...] = ()

    @property
    def named(self) -> bool:
        """Whether effects are named, with or without a remainder."""
        return self.word in ("NAMED", "PARTLY")


def verdict(evidence: Evidence) -> Verdict:
    """The verdict of the rules above."""
    scores = evidence.scores
    best, alone = leading(scores), scores.best_single
    ruled = _ruled(best, evidence)
    if ruled.word != "NAMED" and best is not alone:
        form = not _leaves_more_than_form(scores, alone)
        if form or _share_taken(scores, alone, best) < MIN_SECOND_SHARE:
            ruled, best = _ruled(alone, evidence), alone
    return replace(ruled, judged=best.effects)


# ---- which candidate is judged


def leading(scores: Scores) -> Score:
    """The candidate to be judged first: the best single effect, or a pair that takes away much of what that leaves."""
    alone, best = scores.best_single, scores.best
    share = _share_taken(scores, alone, best) >= MIN_SECOND_SHARE or _unrivalled(scores, alone, best)
    if alone.criterion - best.criterion < MIN_CRITERION_GAIN or not share:
        return alone
    chance_left = best.loss - scores.noise <= misfit_by_chance(scores.noise)
    room = _leaves_more_than_form(scores, alone) or (chance_left and _leaves_more_than_chance(scores, alone))
    return best if room else alone


def second_effect_possible(scores: Scores) -> bool:
    """Whether the best candidate leaves so much that a second effect could take away :data:`MIN_SECOND_SHARE` of it."""
    expected = replace(scores, candidates=())  # its noise is the expected floor
    best = min((scores.bare, *scores.candidates), key=lambda one: one.criterion)
    much = (1.0 - MIN_SECOND_SHARE) * misfit_left(best, scores.floor) >= misfit_by_chance(scores.floor) / 3.0
    return much and (_leaves_more_than_form(expected, best) or _leaves_more_than_chance(expected, best))


def _share_taken(scores: Scores, alone: Score, pair: Score) -> float:
    """Part of what one effect leaves that a pair takes away."""
    return 1.0 - misfit_left(pair, scores.noise) / misfit_left(alone, scores.noise)


def _unrivalled(scores: Scores, alone: Score, best: Score) -> bool:
    """Whether no other second effect does nearly what the best does. Where it is a matter of form, many would."""
    share = _share_taken(scores, alone, best)
    pairs = [one for one in scores.candidates if len(one.effects) == 2 and set(alone.effects) < set(one.effects)]
    others = [_share_taken(scores, alone, one) for one in pairs if one is not best]
    if best not in pairs or len(others) < MIN_OTHER_SECONDS:
        return False
    return share >= max(MIN_UNRIVALLED_SHARE, MIN_UNRIVALLED_RATIO * max(others))


def _leaves_more_than_form(scores: Scores, alone: Score) -> bool:
    return alone.loss - scores.noise > MAX_FORM_PART * (scores.bare.loss - scores.noise)


def _leaves_more_than_chance(scores: Scores, alone: Score) -> bool:
    return alone.loss - scores.noise > MIN_CHANCE_RATIO * misfit_by_chance(scores.noise)


# ---- what the verdict on it is


def _ruled(best: Score, evidence: Evidence) -> Verdict:
    """The rules in their order."""
    scores = evidence.scores
    if scores.gain(best) < MIN_CRITERION_GAIN:
        return _no_effect_helps(evidence)
    part = explained(scores.bare, best, scores.noise)
    explains = "all" if part is None else f"{100 * min(part, 1.0):.0f} %"
    may_leave = MAX_LEFT_PER_EFFECT * len(best.effects)
    left, whole = (misfit_left(one, scores.noise) for one in (best, scores.bare))
    if left > may_leave * whole + misfit_by_chance(scores.noise):
        needed = f"{100 * (1.0 - may_leave):.0f} % is needed to name it"
        kind = "pair" if len(best.effects) > 1 else "single effect"
        pairs = any(len(one.effects) > 1 for one in scores.candidates)
        share = f"{100 * MIN_SECOND_SHARE:.0f} % of what it leaves"
        second = f", and no second effect clearly takes away {share}" if pairs and kind != "pair" else ""
        if part is not None and needed.startswith(explains):
            explains = f"{math.floor(1000 * part) / 10:.1f} %"  # not "98 %" where 98 % is needed
        why = f"the best {kind} ({best.name}) explains {explains} of the misfit; {needed}{second}"
        return Verdict("OUTSIDE", explained=part, why=why)
    if close := rivals(scores, best):
        slugs = tuple(dict.fromkeys(slug for one in (best, *close) for slug in one.effects))
        named = listed([one.name for one in (best, *close)], MOST_NAMED)
        why = f"{named} fit about as well as each other"
        return Verdict("AMBIGUOUS", alike=slugs, explained=part, why=why)
    doubts = [*failed_checks(best)]
    if part is None and not evidence.located:
        doubts.append("no cell disagrees beyond chance without it")
    if doubts:
        why = f"{best.name} fits best, but {doubts[0]}"
        return Verdict("AMBIGUOUS", alike=best.effects, explained=part, why=why)
    return Verdict("NAMED", best.effects, explained=part, why=f"it explains {explains} of the misfit")


def _no_effect_helps(evidence: Evidence) -> Verdict:
    """Rules 0 to 4."""
    if evidence.cornered and not evidence.surely:
        names = listed(evidence.cornered, len(evidence.cornered))
        why = f"in the model without effects, the data push {names} to the ends of their ranges: widen these"
        return Verdict("AMBIGUOUS", why=why)
    if not evidence.located:
        return Verdict("NONE", why="no cell disagrees beyond chance, and no effect clearly improves the fit")
    if not evidence.surely:
        return Verdict(
            "NONE",
            why="some cell disagrees beyond chance, but not far beyond it, and no effect clearly improves the fit",
        )
    if not evidence.trusted:
        return Verdict("AMBIGUOUS", why="no two fits of the model as it is agree: more starts are needed")
    return Verdict("OUTSIDE", why="model and data disagree, and no effect of the library helps")


def rivals(scores: Scores, best: Score) -> list[Score]:
    """Candidates with as many effects as ``best`` that leave not much more than it does."""
    limit = MIN_RIVAL_RATIO * misfit_left(best, scores.noise)
    return [
        one
        for one in scores.candidates
        if one is not best
        and len(one.effects) == len(best.effects)
        and (one.criterion - best.criterion < MIN_CRITERION_GAIN or misfit_left(one, scores.noise) < limit)
    ]


def next_best(scores: Scores, best: Score) -> Score:
    """The best of the other candidates with as many effects; the bare model where there is none."""
    others = (one for one in scores.candidates if one is not best and len(one.effects) == len(best.effects))
    return min(others, key=lambda one: one.criterion, default=scores.bare)


def _in_errors(one: Gain) -> str:
    """A gain in its standard errors."""
    return f"{one.gain / one.error:.1f}" if one.error > 0 else "0"


def failed_checks(best: Score) -> Iterator[str]:
    """Why the best candidate is not to be named after all.

    =====================  ====================================================================================
    check                  it fails where
    =====================  ====================================================================================
    held-out data          predictions improve by more than two standard errors on fewer than two kinds of
                           splits, over the bare model or, for a pair, over the better effect alone
    bounds                 a parameter of the effect ended on a bound
    specimens              the criterion improves in fewer than two specimens (in none of one)
    place                  less than half of the improvement lies in cells that disagree, and less than twice
                           the part of the cells that they are
    =====================  ====================================================================================
    """
    for what, held in (("the model as it is", best.held), ("one of them alone", best.beyond)):
        weak = {kind: one for kind, one in held.items() if not one.gain > MIN_HELD_OUT_ERRORS * one.error}
        if len(held) - len(weak) < min(MIN_SPLIT_KINDS, len(held)):
            told = "; ".join(f"{HELD_OUT[kind]}: {_in_errors(one)}" for kind, one in weak.items())
            needed = f"{MIN_HELD_OUT_ERRORS:g} standard errors"
            yield f"it does not predict what it has not seen better than {what} by {needed} ({told})"
    yield from ends_on_bound(best.on_bound)
    yield from shows_in_few(best.gains)
    place = best.in_place
    if place is not None and place.improvement < min(MIN_PART_IN_PLACE, MIN_RATIO_IN_PLACE * place.cells):
        yield "most of its improvement lies where model and data do not disagree"
