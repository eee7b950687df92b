"""Where one or two effects do not explain all of the misfit: which effects are certainly missing, and what is left."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from sinew.runner.evaluation.adaptive import Session
from sinew.tasks.discover.after.estimates import NORMAL_90
from sinew.tasks.discover.fit.fit import Fitted, residuals
from sinew.tasks.discover.fit.search import Candidates
from sinew.tasks.discover.fit.specimen_fits import Effects, SpecimenFits, each_for_all
from sinew.tasks.discover.fit.stepwise import Member, Stepwise, stepwise
from sinew.tasks.discover.follow_up import Part, Remainder
from sinew.tasks.discover.judge.partly import Form, InPlace, Worth, doubts, outdone
from sinew.tasks.discover.judge.scores import Score, misfit_left
from sinew.tasks.discover.measure.shape import smooth
from sinew.tasks.discover.misfit_map import CellMisfit
from sinew.tasks.discover.on_workers import on_a_worker
from sinew.tasks.model import FORCE
from sinew.tasks.simulate import Array
from sinew.tasks.study.workspace import Workspace

BLOCK = 50  # groups of points: misfits that are farther apart count as independent
MAX_CELLS = 3  # that are told


@dataclass(frozen=True)
class Compound:
    """The effects that were looked at, and those that are ``certain``, in their forms."""

    parts: tuple[Part, ...]
    certain: Effects


def compound(workspace: Workspace, cohort: Sequence[SpecimenFits], candidates: Candidates) -> Compound:
    """Build up a set of effects and judge each; fits of the certain ones together are added to the candidates."""
    found = stepwise(workspace, cohort, candidates, [effects[0] for effects in candidates.fits if len(effects) == 1])
    parts = tuple(_part(workspace, cohort, candidates, found, member) for member in found.members)
    certain = tuple(member.form for member, part in zip(found.members, parts, strict=True) if part.doubt is None)
    while certain:
        starts = [_only(cohort[0], found, certain, one.at) for one in found.fits]
        fitted = _added(workspace, cohort, candidates, certain, starts)
        better = outdone(tuple(form.slug for form in certain), candidates.scores)
        if not better:
            return Compound(parts, fitted)
        parts = tuple(_outdone(part, better) for part in parts)
        certain = tuple(form for form in certain if form.slug not in better)
    return Compound(parts, ())


def _outdone(part: Part, better: Mapping[str, str]) -> Part:
    rival = better.get(part.effect)
    return part if rival is None else replace(part, doubt=f"{rival} explains more in its place")


def _added(
    workspace: Workspace,
    cohort: Sequence[SpecimenFits],
    candidates: Candidates,
    effects: Effects,
    starts: Sequence[Array],
) -> Effects:
    """Fit effects without a discrepancy, or better than before, and score them as a candidate.

    Returns them in the forms that fit best: without a discrepancy, others may.
    """

    def work(i: int, wanted: Effects, session: Session) -> Fitted:
        if wanted in candidates.fits:
            return cohort[i].refitted(session, wanted, candidates.fits[wanted][i], [starts[i]])
        return cohort[i].fitted_from(session, wanted, [starts[i]])

    (fits,) = each_for_all(workspace, cohort, "the effects that are certain", [effects], work)
    return candidates.add(effects, fits)


def _only(one: SpecimenFits, found: Stepwise, certain: Effects, at: Array) -> Array:
    """A point ``[k]`` of all effects, with the parameters of those that are certain only."""
    begin = one.candidate().size
    parts = [at[:begin]]
    for form in found.effects:
        end = begin + len(form.parameters)
        if form in certain:
            parts.append(at[begin:end])
        begin = end
    return np.concatenate(parts)


def _part(
    workspace: Workspace, cohort: Sequence[SpecimenFits], candidates: Candidates, found: Stepwise, member: Member
) -> Part:
    """What one of the effects is worth, in the words of the result."""
    floor = candidates.floor

    def ratio(fits: Sequence[Fitted]) -> float:
        """The misfit of ``fits`` in times of that with all effects."""
        other, all_of_them = (sum(one.loss for one in each) for each in (fits, found.fits))
        return misfit_left(Score((), other, other), floor) / misfit_left(Score((), all_of_them, all_of_them), floor)

    form = _form_that_it_may_mend(found, member, candidates)
    worth = Worth(member.form.slug, member.gains, ratio(member.without), pressed=member.pressed, form=form)
    if next(doubts(worth), None) is None:  # rivals take a while to find
        rivals = found.rivals(member)
        worth = replace(worth, rivals=tuple(InPlace(one.effect, one.gain, ratio(one.fits)) for one in rivals))
    nearest = worth.nearest
    others = tuple(form for form in found.effects if form is not member.form)
    what = (cohort, candidates.bare, (others, member.without), (found.effects, found.fits), floor)
    share, interval = on_a_worker(workspace, cohort, "what an effect takes away", partial(taken_away, *what))
    return Part(
        effect=member.form.slug,
        form=member.form.name,
        share=share,
        interval=interval,
        evidence=worth.evidence,
        ratio=worth.ratio,
        rival=nearest.effect if nearest else None,
        rival_evidence=nearest.gain if nearest else None,
        rival_ratio=nearest.ratio if nearest else None,
        doubt=next(doubts(worth), None),
        mends=worth.mends,
    )


def _form_that_it_may_mend(found: Stepwise, member: Member, candidates: Candidates) -> Form | None:
    """The effect of the set without which most is left, if it is another one and both lose displacement."""
    lost = {one.form.slug: sum(fit.loss for fit in one.without) for one in found.members if one.form.displacement}
    first = max(lost, key=lost.__getitem__, default=None)
    if first is None or member.form.slug not in lost or first == member.form.slug:
        return None
    bare = sum(fit.loss for fit in candidates.bare)
    without, whole = (misfit_left(Score((), loss, loss), candidates.floor) for loss in (lost[member.form.slug], bare))
    return Form(first, without / whole)


def taken_away(
    cohort: Sequence[SpecimenFits],
    bare: Sequence[Fitted],
    before: tuple[Effects, Sequence[Fitted]],
    after: tuple[Effects, Sequence[Fitted]],
    floor: float,
) -> tuple[float, tuple[float, float]]:
    """Part of the bare model's misfit that fits ``after`` leave less than those ``before``, with its 90 % interval.

    The interval is that of a ratio of sums over blocks of :data:`BLOCK` groups of points (delta method).
    """
    whole, less = (
        np.concatenate(each)
        for each in zip(
            *(
                (_squares(one, (), alone), _squares(one, before[0], b) - _squares(one, after[0], a))
                for one, alone, b, a in zip(cohort, bare, before[1], after[1], strict=True)
            ),
            strict=True,
        )
    )
    misfit = whole.sum() - floor
    share = float(less.sum() / misfit)
    noise = floor / whole.size  # of each block, about
    error = float(np.sqrt(whole.size) * np.std(less - share * (whole - noise), ddof=1) / misfit)
    return share, (share - NORMAL_90 * error, share + NORMAL_90 * error)


def _squares(one: SpecimenFits, effects: Effects, fitted: Fitted) -> Array:
    """Whitened squared residuals ``[b]`` of a specimen, summed over blocks."""
    measured = one.measured
    squares = residuals(one.candidate(effects), measured, fitted.at[np.newaxis], measured.curves)[0] ** 2
    every = measured.thinned.values()
    own = np.split(squares, np.cumsum([each.size for each in every])[:-1])
    # what several quantities have in common at a time is one error
    groups = np.concatenate([each.by_group(part) for each, part in zip(every, own, strict=True)])
    sums: Array = np.add.reduceat(groups, np.arange(0, groups.size, BLOCK))
    return sums


def remainder(
    cohort: Sequence[SpecimenFits],
    bare: Sequence[Fitted],
    effects: Effects,
    fits: Sequence[Fitted],
    floor: float,
    beyond_noise: bool,
    after: Sequence[Sequence[CellMisfit]],
) -> Remainder:
    """What fits with ``effects`` leave of the misfit; ``after``: their misfit maps, by specimen."""
    taken, (low, high) = taken_away(cohort, bare, ((), bare), (effects, fits), floor)
    largest = sorted((cell for cells in after for cell in cells), key=lambda cell: -abs(cell.z))
    names = dict.fromkeys(cell.name for cell in largest if cell.beyond_chance)
    most = max(range(len(cohort)), key=lambda i: fits[i].loss - fits[i].points)
    candidate, measured = cohort[most].candidate(effects), cohort[most].measured
    left = -residuals(candidate, measured, fits[most].at[np.newaxis], measured.curves)[0]
    like = smooth(measured, left[measured.places[FORCE]], candidate.size).sentence
    newtons = float(np.sqrt(max(np.mean(np.concatenate(list(_beyond_noise(cohort, effects, fits)))), 0.0)))
    return Remainder(1.0 - taken, (1.0 - high, 1.0 - low), newtons, beyond_noise, tuple(names)[:MAX_CELLS], like)


def _beyond_noise(cohort: Sequence[SpecimenFits], effects: Effects, fits: Sequence[Fitted]) -> Iterator[Array]:
    """Squared errors ``[t]`` (N^2) of each curve, less the variance of the noise."""
    for one, fitted in zip(cohort, fits, strict=True):
        for curve in one.measured.curves:
            error = one.candidate(effects).forces(one.measured.specimen, curve.protocol, fitted.at[np.newaxis])[0]
            yield (error - curve.force_N) ** 2 - one.measured.noise.sd_at(curve.force_N) ** 2
