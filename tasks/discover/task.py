"""Where the model and the measurements disagree, which effect of the library is missing, and the model with it.

Writes ``discover.json`` (also as ``verdict.json``) and, when an effect is named, ``discover/model.yaml``: the study
with the effect in its model. The store keeps the curves of each specimen, ``discover/SPECIMEN``. See docs/discover.md.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from sinew.runner.errors import BadInput, brief
from sinew.runner.evaluation.adaptive import Session
from sinew.tasks.data.noise import refuse_none, remark_on_others
from sinew.tasks.discover.after.added import checks, study_with
from sinew.tasks.discover.after.curves import simulated, stored, stored_as
from sinew.tasks.discover.after.estimates import candidate_result
from sinew.tasks.discover.after.solver import in_febio
from sinew.tasks.discover.after.telling import MAX_SPECIMENS, telling_experiment
from sinew.tasks.discover.compound import compound, remainder
from sinew.tasks.discover.described import described
from sinew.tasks.discover.fit.bounds import cornered
from sinew.tasks.discover.fit.fit import Fitted
from sinew.tasks.discover.fit.held_out import SquaredErrors, hold_out, hold_out_of
from sinew.tasks.discover.fit.intervals import Profiled
from sinew.tasks.discover.fit.search import Candidates, asked, note_fit, reasons, search
from sinew.tasks.discover.fit.sizes import library_for
from sinew.tasks.discover.fit.specimen_fits import (
    Effects,
    SpecimenFits,
    agree,
    each_for_all,
    fits_of_each,
    profiled_each,
)
from sinew.tasks.discover.follow_up import AddedModel, NextExperiment, Outside, Part, Remainder
from sinew.tasks.discover.judge.confidence import confidence
from sinew.tasks.discover.judge.partly import partly
from sinew.tasks.discover.judge.rules import Evidence, Verdict, next_best, rivals, verdict
from sinew.tasks.discover.judge.scores import Score, Scores, misfit_by_chance
from sinew.tasks.discover.known import inputs_of, known_verdict
from sinew.tasks.discover.measure.cells import located_part
from sinew.tasks.discover.measure.shape import shape
from sinew.tasks.discover.misfit_map import CellMisfit, NoiseLevel, OtherNoise
from sinew.tasks.discover.on_workers import conflicts, gap_of, misfits, on_a_worker
from sinew.tasks.discover.result import BareFit, CandidateResult, Conflict, DiscoverResult
from sinew.tasks.discover.settings import Settings
from sinew.tasks.fitting.measured import remark_on_few
from sinew.tasks.model import Specimen
from sinew.tasks.simulate import Array
from sinew.tasks.study import streams
from sinew.tasks.study.cached import commit
from sinew.tasks.study.streams import Stream
from sinew.tasks.study.workspace import Workspace

MAX_RIVALS = 4  # candidates that the next experiment has to separate
LEFT_OVER = ("PARTLY", "OUTSIDE")  # words of verdicts after which a law is looked for


@dataclass(frozen=True, eq=False)
class Findings:
    """All that the verdict rests on.

    ``bare``: fits of the bare model from each start, the best first, by specimen. ``candidates`` also hold the final
    fits of the bare model. ``held_out``: squared errors on held-out data. ``before`` and ``after``: misfit maps
    of the specimens, for the bare model and for the candidates that the verdict may be about.
    """

    cohort: list[SpecimenFits]
    bare: list[list[Fitted]]
    candidates: Candidates
    held_out: SquaredErrors
    conflict: Conflict
    before: list[tuple[CellMisfit, ...]]
    after: dict[Effects, list[tuple[CellMisfit, ...]]]

    @property
    def names(self) -> list[str]:
        return [one.name for one in self.cohort]

    @property
    def evidence(self) -> Evidence:
        """The evidence that the rules of the verdict are applied to."""
        cells = [cell for every in self.before for cell in every]
        ended = [
            agree(sorted([*fits, last], key=lambda one: one.loss))
            for fits, last in zip(self.bare, self.candidates.bare, strict=True)
        ]
        return Evidence(
            self.candidates.scores,
            located=any(cell.beyond_chance for cell in cells),
            surely=any(cell.far_beyond_chance for cell in cells),
            trusted=all(ended),
            cornered=cornered(self.cohort[0].candidate().free, self.candidates.bare),
        )


def run(workspace: Workspace, settings: Settings) -> DiscoverResult:
    """The verdict on a cohort.

    Raises :class:`BadInput` when the study's model has effects already, for effects that its simulator does not have,
    and when the noise cannot be estimated from the curves.
    """
    specimens = workspace.specimens(settings.specimens, "discover.specimens")
    inputs = inputs_of(workspace, settings, specimens)
    if (known := known_verdict(workspace, specimens, inputs)) is not None:
        return known
    cohort = _ready(workspace, settings, specimens)
    findings = _findings(workspace, settings, cohort)
    decided = verdict(findings.evidence)
    parts: tuple[Part, ...] = ()
    if _several(decided, findings.candidates.scores):
        found = compound(workspace, cohort, findings.candidates)
        parts = found.parts
        certain = found.certain
        if certain and covers(certain, parts, decided.effects):
            findings = _with_effects(workspace, settings, findings, certain)
            decided = partly(findings.candidates.scores, findings.candidates.scored[certain])
        elif decided.named:
            decided = partly(findings.candidates.scores, _judged(decided, findings.candidates.scores))
    scores = findings.candidates.scores
    judged = _judged(decided, scores)
    result = _result(workspace, findings, decided, judged, parts, inputs)
    shown = findings.candidates.effects_of(judged)
    if settings.laws and cohort[0].solver is None and decided.word in LEFT_OVER:
        beside = shown if decided.named else ()
        result = replace(result, law=described(workspace, cohort, findings.candidates, beside))
    commit(workspace, result, _curves(workspace, findings, shown))
    return result


def covers(certain: Effects, parts: Sequence[Part], named: Sequence[str]) -> bool:
    """Whether all effects that are ``named`` are certain, but for those that may only mend the form of another."""
    needed = set(named) - {part.effect for part in parts if part.mends}
    return needed <= {form.slug for form in certain}


def _judged(decided: Verdict, scores: Scores) -> Score:
    """The candidate that the verdict is about."""
    return next((one for one in scores.candidates if one.effects == decided.judged), scores.bare)


def _several(decided: Verdict, scores: Scores) -> bool:
    """Whether there may be several effects of which some are certain.

    No candidate is all of it, pairs are alike, or more than chance is left beside the effects that are named.
    """
    if decided.word == "NAMED":
        return _judged(decided, scores).loss - scores.floor > misfit_by_chance(scores.floor)
    return bool(decided.judged) and (
        decided.word == "OUTSIDE" or (decided.word == "AMBIGUOUS" and len(decided.judged) > 1)
    )


# ---- fits and measures


def _ready(workspace: Workspace, settings: Settings, specimens: Sequence[Specimen]) -> list[SpecimenFits]:
    """The specimens, after checks that a verdict on them is possible."""
    study = workspace.study
    if study.model.effects:
        raise BadInput(f"{study.path}: model.effects", "is not empty", "a model without effects to begin with")
    cohort = fits_of_each(workspace, specimens)
    solver = cohort[0].solver
    if solver is not None and (why := reasons(solver, asked(settings, cohort))):
        instead = "" if study.simulator.own_template is not None else ", or simulator: uniaxial"
        expected = f"effects that FEBio has or that act around it (docs/effects.md){instead}"
        raise BadInput(f"{study.path}: discover.effects", brief(why, 200), expected)
    for one in cohort:
        refuse_none(one.measured.noise, workspace.cohort.folder / one.name)
    if remark := remark_on_others(specimens, [one.measured.noise for one in cohort]):
        workspace.say(f"discover: {remark}")
    if remark := remark_on_few([one.measured for one in cohort], study.noise_given):
        workspace.say(f"discover: {remark}")
    return cohort


def _findings(workspace: Workspace, settings: Settings, cohort: list[SpecimenFits]) -> Findings:
    """Fit the bare model and the candidates, predict held-out data with the best, and map the misfit."""
    bare = _bare_fits(workspace, settings, cohort)
    candidates = search(workspace, settings, cohort, [fits[0] for fits in bare])
    held_out = hold_out(workspace, cohort, candidates)
    disagree = conflicts(workspace, cohort, candidates.bare)
    before = misfits(workspace, settings.chance, cohort, (), candidates.bare)
    fits = candidates.fits
    judged = [effects for effects in held_out if effects in candidates.scored]  # the others are no effect's best form
    after = {effects: misfits(workspace, settings.chance, cohort, effects, fits[effects]) for effects in judged}
    for effects, cells in after.items():
        candidates.scored[effects] = replace(candidates.scored[effects], in_place=located_part(before, cells))
    return Findings(cohort, bare, candidates, held_out, disagree, before, after)


def _with_effects(workspace: Workspace, settings: Settings, findings: Findings, effects: Effects) -> Findings:
    """The findings with predictions and misfits of one candidate more."""
    cohort, candidates = findings.cohort, findings.candidates
    held_out = hold_out_of(workspace, cohort, candidates, effects)
    after = misfits(workspace, settings.chance, cohort, effects, candidates.fits[effects])
    candidates.scored[effects] = replace(candidates.scored[effects], in_place=located_part(findings.before, after))
    return replace(findings, held_out=held_out, after={**findings.after, effects: after})


def _bare_fits(workspace: Workspace, settings: Settings, cohort: Sequence[SpecimenFits]) -> list[list[Fitted]]:
    """Fits of the model without effects, the best first, by specimen."""

    def work(i: int, _: None, session: Session) -> list[Fitted]:
        seed = streams.key(workspace.seed, Stream.BARE_FIT_STARTS, i)
        fits = cohort[i].bare(session, settings.starts, seed)
        note_fit(workspace, cohort[i].name, (), fits[0])
        return fits

    fits: list[list[Fitted]] = each_for_all(workspace, cohort, "the model as it is", [None], work)[0]
    return fits


# ---- after the verdict


def _result(
    workspace: Workspace, findings: Findings, decided: Verdict, judged: Score, parts: tuple[Part, ...], inputs: str
) -> DiscoverResult:
    """The result with what its verdict comes with: intervals, the next experiment, a description, or the new model."""
    cohort, candidates, names = findings.cohort, findings.candidates, findings.names
    evidence = findings.evidence
    shown = candidates.effects_of(judged)
    noise = {one.name: one.measured.noise for one in cohort}
    return DiscoverResult(
        verdict=decided.word,
        effects=decided.effects,
        set=decided.alike,
        why=decided.why,
        confidence=confidence(decided.word, workspace.model.law, workspace.study.compared),
        explained=decided.explained,
        null=BareFit(
            candidates.scores.bare.loss,
            candidates.floor,
            evidence.trusted,
            {name: tuple(one.loss for one in fits) for name, fits in zip(names, findings.bare, strict=True)},
        ),
        conflict=findings.conflict,
        located=evidence.located,
        surely=evidence.surely,
        noise={name: NoiseLevel(one.sd_N, one.ar1, one.proportional) for name, one in noise.items()},
        compared=_compared(workspace, cohort),
        candidates=_candidates(workspace, findings, decided, shown),
        cells=dict(zip(names, findings.before, strict=True)),
        shown=judged.effects,
        gap=gap_of(workspace, cohort, findings.held_out, shown, candidates.with_bare[shown]),
        next_experiment=_experiment(workspace, findings, judged)
        if decided.word == "AMBIGUOUS" and decided.alike and shown
        else None,
        outside=_outside(workspace, findings) if decided.word == "OUTSIDE" else None,
        model=_model(workspace, findings, shown) if decided.named else None,
        inputs=inputs,
        parts=parts,
        left_out=candidates.left_out or None,
        remainder=_remainder(workspace, findings, judged, shown) if decided.named else None,
        after=dict(zip(names, findings.after[shown], strict=True)) if shown in findings.after else None,
    )


def _compared(workspace: Workspace, cohort: Sequence[SpecimenFits]) -> Mapping[str, Mapping[str, OtherNoise]] | None:
    """The noise of what is compared beside the force, by specimen; None where the force is all."""
    if not workspace.study.compared:
        return None
    units = {output.name: output.unit for output in workspace.simulator.capabilities.outputs}
    given = workspace.study.noise_given
    every = {one.name: one.measured.others for one in cohort}
    return {
        name: {each: OtherNoise(one.sd_N, one.ar1, units[each], each in given) for each, one in others.items()}
        for name, others in every.items()
    }


def _curves(workspace: Workspace, findings: Findings, shown: Effects) -> dict[str, Any]:
    """The curves of each specimen for the store."""
    cohort, candidates = findings.cohort, findings.candidates

    def work(i: int, _: None, session: Session) -> dict[str, Array]:
        having = candidates.fits[shown][i] if shown else None
        forces: dict[str, Array] = session.compute(simulated, cohort[i], candidates.bare[i], shown, having)
        return forces

    (found,) = each_for_all(workspace, cohort, "the curves", [None], work)
    both = zip(cohort, found, strict=True)
    return {stored_as(one.name): stored(one.measured.specimen, shown, forces) for one, forces in both}


def _candidates(
    workspace: Workspace, findings: Findings, decided: Verdict, shown: Effects
) -> tuple[CandidateResult, ...]:
    """All candidates, the best first."""
    cohort, candidates = findings.cohort, findings.candidates
    intervals = _intervals(workspace, findings, shown) if shown and (decided.named or decided.alike) else {}
    scores = candidates.scores
    return tuple(
        candidate_result(candidates.scored[each], scores, each, cohort, candidates.fits[each], intervals.get(each))
        for each in candidates.ordered
    )


def _intervals(workspace: Workspace, findings: Findings, shown: Effects) -> Mapping[Effects, list[Profiled]]:
    """Intervals by profile likelihood of the candidate that the verdict is about, by specimen.

    With the real solver they would take hours: those from the curvature have to do.
    """
    cohort, fits = findings.cohort, findings.candidates.fits[shown]
    if cohort[0].solver is not None:
        return {}
    return {shown: profiled_each(workspace, cohort, "intervals", shown, fits)}


def _experiment(workspace: Workspace, findings: Findings, judged: Score) -> NextExperiment | None:
    """The experiment that separates the rivals; without rivals, the best candidate from the next best."""
    candidates = findings.candidates
    close = rivals(candidates.scores, judged)[: MAX_RIVALS - 1] or [next_best(candidates.scores, judged)]
    several = [candidates.effects_of(one) for one in (judged, *close)]
    models = [(effects, candidates.with_bare[effects]) for effects in several]
    return telling_experiment(workspace, findings.cohort, models, "the experiment that would tell")


def _outside(workspace: Workspace, findings: Findings) -> Outside:
    """A description of the misfit."""
    cohort = findings.cohort
    measured = [one.measured for one in cohort]
    points = [one.at for one in findings.candidates.bare[:MAX_SPECIMENS]]
    every = library_for([one.specimen for one in measured])
    known = {slug: effect for slug, effect in every.items() if effect.name not in findings.candidates.left_out}
    ask = partial(shape, cohort[0].candidate().stand_in, measured[:MAX_SPECIMENS], points, known)
    return on_a_worker(workspace, cohort, "what the misfit looks like", ask)


def _remainder(workspace: Workspace, findings: Findings, judged: Score, shown: Effects) -> Remainder | None:
    """What the model with the named effects leaves; None where nothing was held against the bare model's misfit."""
    candidates = findings.candidates
    beyond = judged.loss - candidates.floor > misfit_by_chance(candidates.floor)
    cohort, after = findings.cohort, findings.after.get(shown, [])
    what = (cohort, candidates.bare, shown, candidates.fits[shown], candidates.floor, beyond, after)
    return on_a_worker(workspace, cohort, "what is left", partial(remainder, *what))


def _model(workspace: Workspace, findings: Findings, shown: Effects) -> AddedModel:
    """The study with the named effects, written and checked."""
    cohort, fits = findings.cohort, findings.candidates.fits[shown]
    path, difference = study_with(workspace, shown)
    febio = in_febio(workspace, cohort[0], shown, fits[0])
    checked = on_a_worker(workspace, cohort, "checks of the effects", partial(checks, cohort, shown, fits))
    return AddedModel(path, difference, checked, febio)
