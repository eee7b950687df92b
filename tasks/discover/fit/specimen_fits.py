"""The fits of a discovery, on the study's cluster.

For each specimen: the bare model from several starts, then with one effect, starting from the bare fit, then with two
effects, then without the held-out data. Fits are kept beside the store, so an interrupted run does not repeat them.
"""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, fields
from functools import partial
from pathlib import Path
from threading import Lock
from typing import Any

import numpy as np

from sinew.runner.errors import BadInput, shown
from sinew.runner.evaluation.adaptive import AdaptiveRun, Session
from sinew.tasks.discover.fit import acting
from sinew.tasks.discover.fit.beside import Beside, blocks_of, first_sizes, fit_beside, promise_beside
from sinew.tasks.discover.fit.candidate import Candidate
from sinew.tasks.discover.fit.fit import FAR, Fitted, errors, extended, fit, look_ahead, starts
from sinew.tasks.discover.fit.intervals import Profiled, profiled
from sinew.tasks.discover.measure.splits import SPECIMEN, splits
from sinew.tasks.fitting import few_runs
from sinew.tasks.fitting.discrepancy import possible_sizes
from sinew.tasks.fitting.measured import Measured, measured_of_each
from sinew.tasks.model import Model, Specimen, file_name
from sinew.tasks.model.effect import Effect
from sinew.tasks.simulate import Array, TakesEffects, around, taking_effects
from sinew.tasks.simulate.effects import VERSION
from sinew.tasks.simulate.febio import effects_inside
from sinew.tasks.study.checkpoint import Checkpoint, Possible, in_unit_cube
from sinew.tasks.study.files import digest
from sinew.tasks.study.workspace import Workspace

MAX_STARTS_RATIO = 4  # times the starts, while no two fits of the bare model agree
MAX_SAME_LOSS = 2.0  # difference of whitened sums of squares of two fits that found the same minimum
MAX_PARALLEL_FITS = 4  # of one specimen

Effects = tuple[Effect, ...]


def agree(fits: Sequence[Fitted]) -> bool:
    """Whether the best of fits from different starts, the best first, was found twice."""
    return len(fits) > 1 and fits[1].loss - fits[0].loss < MAX_SAME_LOSS


@dataclass(frozen=True, eq=False)
class SpecimenFits:
    """The fits of one specimen: made on the cluster, or read from ``folder``, which keeps those made before.

    ``solver``: what solves the model; None for the embedded simulator. ``retries``: of runs that fail by accident.
    """

    measured: Measured
    model: Model
    folder: Path
    solver: TakesEffects | None = None
    retries: int = 0

    @property
    def name(self) -> str:
        return self.measured.specimen.name

    def candidate(self, effects: Effects = ()) -> Candidate:
        """The model with ``effects``."""
        return Candidate(self.model, effects, self.solver, self.retries, compared=tuple(self.measured.others))

    def _checkpoint(self, width: int, *what: Any, possible: Possible | None = Fitted.possible) -> Checkpoint:
        """The file of one kind of fits, with ``width`` numbers of each, which are ``possible``."""
        bounds = [[p.minimum, p.maximum] for p in self.model.parameters]
        solver = self.solver.identity() if self.solver else None
        how = [
            asdict(self.measured.noise),
            *_noise_of(self.measured),
            solver,
            VERSION,
            [each.name for each in fields(Fitted)],
        ]
        if self.model.law != "tendon":
            how += [few_runs.VERSION]
        if self.solver is not None:
            how += [around.VERSION]
        inputs = digest(self.measured.specimen.identity(), self.model.identity(), bounds, *how, what)
        return Checkpoint(self.folder / f"{file_name(self.name)}.{digest(what)[:12]}.jsonl", inputs, width, possible)

    def _forms(self, effects: Effects) -> list[str]:
        """The name and equation of each effect's form, and where those inside a user's own model are in it."""
        forms = [f"{effect.name}: {effect.equation}" for effect in effects]
        within = tuple(effect for effect in effects if not effect.around)
        if self.model.law == "tendon" or not within or self.solver is None:
            return forms
        where = dict(self.solver.capabilities.constituents)
        at = [f"{name}: {where.get(name)}" for name in sorted(effects_inside.used(within))]
        return [*forms, *at, str(effects_inside.VERSION)]

    def _fits_with(self, kind: str, candidate: Candidate, effects: Effects, *starts: Array) -> Checkpoint:
        """The file of fits of one kind with ``effects``, which begin at ``starts``, each ``[k]``."""
        return self._checkpoint(
            candidate.fitted_width, kind, self._forms(effects), digest(*starts, *candidate.bounds())
        )

    def _fitted(self, checkpoint: Checkpoint, number: int, session: Session, *arguments: Any) -> Fitted:
        """Fit ``number`` of a checkpoint: read back, or computed on a worker by a function and its arguments."""
        if number == len(checkpoint):
            fitted = session.compute(*arguments)
            checkpoint.append(fitted.numbers())
        return Fitted.of(checkpoint.kept[number])

    def bare(self, session: Session, count: int, seed: tuple[int, ...]) -> list[Fitted]:
        """Fits of the model without effects, the best first, from ``count`` starts and, until two agree, some more.

        Raises :class:`BadInput` where the best of them cannot be simulated.
        """
        candidate = self.candidate()
        checkpoint = self._checkpoint(candidate.fitted_width, "bare", seed)
        fits: list[Fitted] = []
        for i, at in enumerate(starts(candidate, np.random.default_rng(seed), MAX_STARTS_RATIO * count)):
            if i >= count and agree(fits):
                break
            fits.append(self._fitted(checkpoint, i, session, fit, candidate, self.measured, at))
            fits.sort(key=lambda one: one.loss)
        if fits[0].loss >= FAR**2:  # some run may have failed
            for curve, words in session.compute(candidate.failures, self.measured, fits[0].at).items():
                problem = f"the model as it is cannot be simulated along {curve} ({shown(words)})"
                raise BadInput(self.name, problem, "a solver and ranges of parameters with which it can")
        return fits

    def alone(self, session: Session, pooled: Fitted) -> list[Fitted]:
        """Fits of the model without effects to each curve alone, from where the fit to all of them ended."""
        candidate = self.candidate()
        checkpoint = self._checkpoint(candidate.fitted_width, "alone", digest(pooled.at))
        return [
            self._fitted(checkpoint, i, session, fit, candidate, self.measured, pooled.at, [curve])
            for i, curve in enumerate(self.measured.curves)
        ]

    def tried(self, session: Session, effects: Effects, bare: Fitted) -> Array:
        """What an effect inside a model of the user's own does, see :func:`sinew.tasks.discover.fit.acting.tried`."""
        candidate = self.candidate(effects)
        what = ("tried", self._forms(effects), digest(bare.at, *candidate.bounds()))
        checkpoint = self._checkpoint(3, *what, possible=acting.possible)
        if not len(checkpoint):
            numbers = session.compute(acting.tried, candidate, self.measured.specimen, bare.at)
            if acting.by_accident(numbers):
                return np.asarray(numbers)
            checkpoint.append(numbers)
        return np.asarray(checkpoint.kept[0])

    def extended(self, session: Session, effects: Effects, base: Fitted) -> Fitted:
        """The best fit with ``effects``, of which all but the last were fitted in ``base``."""
        candidate, before = self.candidate(effects), self.candidate(effects[:-1])
        checkpoint = self._fits_with("extended", candidate, effects, base.at)
        return self._fitted(checkpoint, 0, session, extended, before, base.at, effects[-1], self.measured)

    def refitted(self, session: Session, effects: Effects, before: Fitted, begins: Sequence[Array]) -> Fitted:
        """The better of ``before`` and fits with ``effects`` from ``begins``, each ``[k]``."""
        return min(before, self.fitted_from(session, effects, begins), key=lambda one: one.loss) if begins else before

    def profiled(self, session: Session, effects: Effects, fitted: Fitted) -> Profiled:
        """The fit with ``effects``, or a better one, and 90 % intervals of the effects' parameters."""
        candidate = self.candidate(effects)
        ends = 2 * (candidate.size - len(candidate.varied))

        def possible(numbers: Array) -> bool:
            return in_unit_cube(numbers[:ends]) and Fitted.possible(numbers[ends:])

        what = ("profiled", self._forms(effects), digest(fitted.at, *candidate.bounds()))
        checkpoint = self._checkpoint(ends + candidate.fitted_width, *what, possible=possible)
        if not len(checkpoint):
            profile = session.compute(profiled, candidate, self.measured, fitted)
            checkpoint.append(np.concatenate([profile.ends.ravel(), profile.fitted.numbers()]))
        kept = checkpoint.kept[0]
        return Profiled(Fitted.of(kept[ends:]), kept[:ends].reshape(-1, 2))

    def promise(self, session: Session, effects: Effects, base: Fitted) -> float:
        """The loss that a fit with ``effects`` may reach, predicted from ``base``, which lacks the last of them."""
        candidate, before = self.candidate(effects), self.candidate(effects[:-1])
        what = ("promise", self._forms(effects), digest(base.at, *candidate.bounds()))
        checkpoint = self._checkpoint(1, *what, possible=None)
        if not len(checkpoint):
            ahead = session.compute(look_ahead, before, base.at, effects[-1], self.measured)
            checkpoint.append(np.array([ahead[0]]))
        return float(checkpoint.kept[0][0])

    def beside(self, session: Session, effects: Effects, start: Array, sizes: Array | None = None) -> Beside:
        """The fit with ``effects`` beside a discrepancy, from ``start`` ``[k]`` and log ``sizes`` of the discrepancy.

        Without sizes, those that a fit without a discrepancy left at ``start``.
        """
        candidate, count = self.candidate(effects).stand_in, blocks_of(self.measured)
        begins = [start] if sizes is None else [start, sizes]
        what = ("beside", self._forms(effects), digest(*begins, *candidate.bounds()))
        checkpoint = self._checkpoint(
            1 + count + candidate.fitted_width, *what, possible=lambda numbers: Beside.possible(numbers, count)
        )
        if not len(checkpoint):
            if sizes is None:
                sizes = session.compute(first_sizes, candidate, self.measured, start)
            checkpoint.append(session.compute(fit_beside, candidate, self.measured, start, sizes).numbers())
        return Beside.of(checkpoint.kept[0], count)

    def promise_beside(
        self, session: Session, effects: Effects, before: Beside, known: Array | None
    ) -> tuple[float, Array, Array]:
        """The evidence that ``effects`` promise, of which ``before`` lacks the last; start and sizes of their fit.

        ``known``: where a fit of them without a discrepancy ended ``[k]``; None where there is none.
        """
        candidate, base = self.candidate(effects).stand_in, self.candidate(effects[:-1]).stand_in
        count = before.sizes.size
        begins = [before.fitted.at, before.sizes, *([] if known is None else [known])]
        what = ("promise beside", self._forms(effects), digest(*begins, *candidate.bounds()))
        end = 1 + candidate.size

        def possible(numbers: Array) -> bool:
            return in_unit_cube(numbers[1:end]) and possible_sizes(numbers[end:])

        checkpoint = self._checkpoint(end + count, *what, possible=possible)
        if not len(checkpoint):
            ahead = session.compute(promise_beside, base, before, effects[-1], self.measured, known)
            checkpoint.append(np.concatenate([ahead[:1], *ahead[1:]]))
        kept = checkpoint.kept[0]
        return float(kept[0]), kept[1:end], kept[end:]

    def fitted_from(self, session: Session, effects: Effects, begins: Sequence[Array]) -> Fitted:
        """The best of the fits with ``effects`` from ``begins``, each ``[k]``."""
        candidate = self.candidate(effects)
        checkpoint = self._fits_with("refitted", candidate, effects, *begins)
        fits = [self._fitted(checkpoint, i, session, fit, candidate, self.measured, at) for i, at in enumerate(begins)]
        return min(fits, key=lambda one: one.loss)

    def held_out(self, session: Session, effects: Effects, start: Array) -> dict[str, dict[str, Array]]:
        """By kind of split and curve: squared errors ``[quantities, t]``, whitened, of what a fit of the rest predicts.

        NaN where nothing was measured.
        """
        candidate = self.candidate(effects)
        checkpoint = self._fits_with("held out", candidate, effects, start)
        squares: dict[str, dict[str, Array]] = {}
        for i, split in enumerate(splits(self.measured)):
            fitted = self._fitted(checkpoint, i, session, fit, candidate, split.seen, start)
            for curve in self.measured.curves:
                if curve.name in split.judged:
                    white = session.compute(errors, candidate, self.measured, fitted.at[np.newaxis], [curve])[0]
                    every = self.measured.by_row(curve, white**2)
                    squares.setdefault(split.kind, {})[curve.name] = every[:, split.judged[curve.name] :]
        return squares

    def of_others(self, session: Session, effects: Effects, start: Array, values: Array) -> dict[str, dict[str, Array]]:
        """As :meth:`held_out`, with the effects at ``values`` ``[m]`` (unit cube) fitted to other specimens."""
        candidate = self.candidate(effects)
        begin = np.concatenate([start[: start.size - values.size], values])
        checkpoint = self._fits_with("of others", candidate, effects, begin)
        how = (_fit_beside, candidate, self.measured, begin, values.size)
        fitted = self._fitted(checkpoint, 0, session, *how)
        squares: dict[str, Array] = {}
        for curve in self.measured.curves:
            white = session.compute(errors, candidate, self.measured, fitted.at[np.newaxis], [curve])[0]
            squares[curve.name] = self.measured.by_row(curve, white**2)
        return {SPECIMEN: squares}


def _fit_beside(candidate: Candidate, measured: Measured, start: Array, last: int) -> Fitted:
    """A fit with the ``last`` values fixed."""
    return fit(candidate, measured, start, fixed=range(start.size - last, start.size))


def _noise_of(measured: Measured) -> list[list[Any]]:
    """What is compared beside the force, in order, with its noise; nothing where the force is all."""
    return [[name, asdict(noise)] for name, noise in measured.others.items()]


def fits_of_each(workspace: Workspace, chosen: Sequence[Specimen]) -> list[SpecimenFits]:
    """The fits of each specimen, with the noise of all of its curves together."""
    folder = workspace.out / "discover"
    solver, retries = taking_effects(workspace.simulator), workspace.study.retries
    every = measured_of_each(chosen, workspace.study.force_noise)
    return [SpecimenFits(measured, workspace.model, folder, solver, retries) for measured in every]


def profiled_each(
    workspace: Workspace, cohort: Sequence[SpecimenFits], title: str, effects: Effects, fits: Sequence[Fitted]
) -> list[Profiled]:
    """Fits with intervals by profile likelihood of the parameters of ``effects``, by specimen."""

    def work(i: int, wanted: Effects, session: Session) -> Profiled:
        return cohort[i].profiled(session, wanted, fits[i])

    return each_for_all(workspace, cohort, title, [effects], work)[0]


def each_for_all(
    workspace: Workspace,
    cohort: Sequence[SpecimenFits],
    title: str,
    items: Sequence[Any],
    work: Callable[[int, Any, Session], Any],
) -> list[list[Any]]:
    """Results ``[item][specimen]`` of ``work(number of specimen, item, session)``, many of which run at a time."""
    jobs = [(i, k) for k in range(len(items)) for i in range(len(cohort))]
    results: dict[tuple[int, int], Any] = {}
    lanes = min(len(jobs), MAX_PARALLEL_FITS * len(cohort))
    with workspace.progress(f"discover: {title}", len(jobs), of="fits") as report:
        lock = Lock()

        def lane(number: int, session: Session) -> None:
            for i, k in jobs[number::lanes]:
                done = work(i, items[k], session)
                with lock:
                    results[i, k] = done
                    report(len(results), 0, lanes)

        workspace.run_adaptive([AdaptiveRun([], 0, partial(lane, number)) for number in range(lanes)], title)
    return [[results[i, k] for i in range(len(cohort))] for k in range(len(items))]
