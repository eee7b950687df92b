"""Which effects are certainly missing where the library does not explain all of the misfit.

Each effect of a set that was built up beside a discrepancy (:mod:`sinew.tasks.discover.fit.stepwise`) is compared with
nothing in its place, and with the other effects that promise most there. It is certain when all of these hold
(:func:`doubts`):

==========  =========================================================================================================
            condition
==========  =========================================================================================================
evidence    Without it, and with any other in its place, twice the log evidence is smaller by at least 50. Without it,
            it is smaller in at least two specimens (in one of one).
misfit      Without it, and with any other in its place, a fit without a discrepancy leaves at least twice the misfit.
form        Where it loses displacement, and another effect of the set that matters more does, too: without it, more
            than 2 % of the bare model's misfit is left. That much may be left because nature's form of the other one is
            not the library's.
bounds      Data do not press its parameters against a bound.
outdone     Of the effects that are certain by all this, no other in its place leaves less misfit in a fit without a
            discrepancy, beyond chance, unless its parameters end on a bound (:func:`outdone`).
==========  =========================================================================================================
"""

from collections.abc import Iterator
from dataclasses import dataclass

from sinew.tasks.discover.judge.rules import MAX_LEFT_PER_EFFECT, Verdict
from sinew.tasks.discover.judge.scores import Score, Scores, explained, misfit_by_chance
from sinew.tasks.discover.judge.shared_checks import as_good, ends_on_bound, shows_in_few

MIN_EVIDENCE = 50.0  # twice the log evidence: 10 are called very strong (Kass and Raftery 1995); errors are no splines
MIN_MISFIT_RATIO = 2.0  # misfit without an effect, in times of that with it


@dataclass(frozen=True)
class Form:
    """Another effect of a set, whose form one may only mend: it loses displacement as well, and matters more.

    ``left``: the part of the bare model's misfit that is left without the one.
    """

    effect: str
    left: float


@dataclass(frozen=True)
class InPlace:
    """What another effect is worth in the place of one.

    ``gain``: twice the log evidence that it regains. ``ratio``: the misfit with it, in times of that with the one.
    """

    effect: str
    gain: float
    ratio: float


@dataclass(frozen=True)
class Worth:
    """What one of several effects is worth.

    ``gains``: twice the log evidence that is lost without it, by specimen. ``ratio``: the misfit that the others leave,
    in times of what all leave. ``rivals``: effects that were tried in its place. ``pressed``: parameters that are
    pressed against a bound. ``form``: what it may mend the form of, if anything.
    """

    effect: str
    gains: tuple[float, ...]
    ratio: float
    rivals: tuple[InPlace, ...] = ()
    pressed: tuple[str, ...] = ()
    form: Form | None = None

    @property
    def evidence(self) -> float:
        """Twice the log evidence that all specimens lose without it."""
        return sum(self.gains)

    @property
    def mends(self) -> str | None:
        """The effect whose form it may only mend."""
        return self.form.effect if self.form is not None and self.form.left <= MAX_LEFT_PER_EFFECT else None

    @property
    def nearest(self) -> InPlace | None:
        """The rival that leaves least misfit."""
        return min(self.rivals, key=lambda one: one.ratio, default=None)


def doubts(worth: Worth) -> Iterator[str]:
    """Why an effect is not certain; nothing where it is."""
    if worth.evidence < MIN_EVIDENCE:
        yield "a smooth error of the model would do nearly as well"
    yield from shows_in_few(worth.gains)
    if worth.ratio < MIN_MISFIT_RATIO:
        yield "without it, the other effects leave hardly more misfit"
    for rival in sorted(worth.rivals, key=lambda one: one.ratio):
        if worth.evidence - rival.gain < MIN_EVIDENCE or rival.ratio < MIN_MISFIT_RATIO:
            yield as_good(rival.effect)
    if worth.form is not None and worth.mends:
        left = f"{100 * worth.form.left:.1f} %"
        yield f"{worth.form.effect} leaves {left} without it, which another form of {worth.form.effect} may explain"
    yield from ends_on_bound(worth.pressed)


def outdone(effects: tuple[str, ...], scores: Scores) -> dict[str, str]:
    """The effects of a candidate in whose place another leaves less misfit, by their names, and the best of those.

    Rivals are tried beside all effects that were built up. Some of these may turn out not to be certain, and without
    them another effect may do better. Candidates that were not fitted do not count, nor those that end on a bound.
    """
    chance = misfit_by_chance(scores.floor)
    least = min(one.loss for one in scores.candidates if set(one.effects) == set(effects))
    found: dict[str, str] = {}
    for one in sorted(scores.candidates, key=lambda score: score.loss):
        new, gone = set(one.effects) - set(effects), set(effects) - set(one.effects)
        if len(new) == len(gone) == 1 and one.loss < least - chance and not one.on_bound:
            found.setdefault(gone.pop(), new.pop())
    return found


def partly(scores: Scores, certain: Score) -> Verdict:
    """The verdict that names the effects of a candidate, each of which is certain.

    NAMED where they leave no more misfit than chance may, PARTLY otherwise.
    """
    part = explained(scores.bare, certain, scores.floor)
    words = "all" if part is None else f"{100 * part:.0f} %"
    if certain.loss - scores.floor <= misfit_by_chance(scores.floor):
        why = f"together they explain {words} of the misfit, and no other effect would do in the place of one"
        return Verdict("NAMED", certain.effects, explained=part, why=why, judged=certain.effects)
    why = f"{'it explains' if len(certain.effects) == 1 else 'they explain'} {words} of the misfit; the rest is left"
    return Verdict("PARTLY", certain.effects, explained=part, why=why, judged=certain.effects)
