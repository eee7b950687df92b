"""The fits behind a discovery, on the study's cluster.

First the bare model of every specimen from several starts; then with one effect, from there; then with two; then
without what is held out. Fits are kept beside the store, so that a run that was interrupted does not fit again.
"""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, fields
from functools import partial
from pathlib import Path
from threading import Lock
from typing import Any

import numpy as np

from runner.ensemble import Desk, Talk
from tasks.discover.fit import Candidate, Fitted, errors, extended, fit, look_ahead, starts
from tasks.discover.intervals import Profiled, profiled
from tasks.discover.measured import Measured
from tasks.discover.splits import SPECIMEN, splits
from tasks.ledger import Ledger
from tasks.model import Model, file_name
from tasks.model.effect import Effect
from tasks.noise import noise_of_each
from tasks.simulate import Array
from tasks.simulate.effects import VERSION
from tasks.simulate.febio import FEBio
from tasks.workspace import Workspace, digest

MORE = 4  # times the starts, while no two fits of the bare model agree
ALIKE_LOSS = 2.0  # of whitened sums of squares: two fits that differ by less found the same
LANES = 4  # fits of one specimen that may run side by side

Effects = tuple[Effect, ...]


def agree(fits: Sequence[Fitted]) -> bool:
    """Whether the best of fits from different starts, the best first, was found twice."""
    return len(fits) > 1 and fits[1].loss - fits[0].loss < ALIKE_LOSS


@dataclass(frozen=True, eq=False)
class Explorer:
    """One specimen: its measurements, the model, what it is solved with (None: the embedded simulator).

    ``folder`` keeps the fits that are known already.
    """

    measured: Measured
    model: Model
    folder: Path
    solver: FEBio | None = None

    @property
    def name(self) -> str:
        return self.measured.specimen.name

    def candidate(self, effects: Effects = ()) -> Candidate:
        """The model with ``effects``."""
        return Candidate(self.model, effects, self.solver)

    def _ledger(self, *what: Any) -> Ledger:
        """Where what was found of one kind is kept."""
        bounds = [[p.minimum, p.maximum] for p in self.model.parameters]
        solver = self.solver.identity() if self.solver else None
        how = [asdict(self.measured.noise), solver, VERSION, [each.name for each in fields(Fitted)]]
        inputs = digest(self.measured.specimen.identity(), self.model.identity(), bounds, *how, what)
        return Ledger(self.folder / f"{file_name(self.name)}.{digest(what)[:12]}.jsonl", inputs)

    def _fitted(self, ledger: Ledger, number: int, desk: Desk, *arguments: Any) -> Fitted:
        """Fit ``number`` of a ledger: known, or what ``arguments``, a function and what it takes, find on a worker."""
        if number == len(ledger):
            found = desk.compute(*arguments)
            ledger.append(found.numbers())
        return Fitted.of(ledger.kept[number])

    def bare(self, desk: Desk, count: int, seed: tuple[int, ...]) -> list[Fitted]:
        """Fits of the model without effects, the best first, from ``count`` starts and, until two agree, some more."""
        candidate = self.candidate()
        ledger = self._ledger("bare", seed)
        found: list[Fitted] = []
        for i, at in enumerate(starts(candidate, np.random.default_rng(seed), MORE * count)):
            if i >= count and agree(found):
                break
            found.append(self._fitted(ledger, i, desk, fit, candidate, self.measured, at))
            found.sort(key=lambda one: one.loss)
        return found

    def alone(self, desk: Desk, pooled: Fitted) -> list[Fitted]:
        """Fits of the model without effects to each curve alone, from where the fit to all of them ended."""
        candidate = self.candidate()
        ledger = self._ledger("alone", digest(pooled.at))
        return [
            self._fitted(ledger, i, desk, fit, candidate, self.measured, pooled.at, [curve])
            for i, curve in enumerate(self.measured.curves)
        ]

    def extended(self, desk: Desk, effects: Effects, base: Fitted) -> Fitted:
        """The best fit with ``effects``, of which all but the last were fitted in ``base``."""
        candidate, before = self.candidate(effects), self.candidate(effects[:-1])
        ledger = self._ledger("extended", _forms(effects), digest(base.at, *candidate.bounds()))
        return self._fitted(ledger, 0, desk, extended, before, base.at, effects[-1], self.measured)

    def refitted(self, desk: Desk, effects: Effects, before: Fitted, begins: Sequence[Array]) -> Fitted:
        """The better of ``before`` and fits with ``effects`` from ``begins``, each ``[k]``."""
        candidate = self.candidate(effects)
        ledger = self._ledger("refitted", _forms(effects), digest(*begins, *candidate.bounds()))
        found = [self._fitted(ledger, i, desk, fit, candidate, self.measured, at) for i, at in enumerate(begins)]
        return min([before, *found], key=lambda one: one.loss)

    def profiled(self, desk: Desk, effects: Effects, fitted: Fitted) -> Profiled:
        """The fit with ``effects``, or a better one, and 90 % intervals of the effects' parameters."""
        candidate = self.candidate(effects)
        ledger = self._ledger("profiled", _forms(effects), digest(fitted.at, *candidate.bounds()))
        if not len(ledger):
            found = desk.compute(profiled, candidate, self.measured, fitted)
            ledger.append(np.concatenate([found.ends.ravel(), found.fitted.numbers()]))
        kept = ledger.kept[0]
        ends = 2 * (candidate.size - len(candidate.varied))
        return Profiled(Fitted.of(kept[ends:]), kept[:ends].reshape(-1, 2))

    def promise(self, desk: Desk, effects: Effects, base: Fitted) -> float:
        """The loss that a fit with ``effects`` may come to, seen from ``base``, which has all but the last of them."""
        candidate, before = self.candidate(effects), self.candidate(effects[:-1])
        ledger = self._ledger("promise", _forms(effects), digest(base.at, *candidate.bounds()))
        if not len(ledger):
            ahead = desk.compute(look_ahead, before, base.at, effects[-1], self.measured)
            ledger.append(np.array([ahead[0]]))
        return float(ledger.kept[0][0])

    def held_out(self, desk: Desk, effects: Effects, start: Array) -> dict[str, dict[str, Array]]:
        """By kind of split and curve: whitened squared errors ``[t]`` of what a fit of the rest predicts."""
        candidate = self.candidate(effects)
        ledger = self._ledger("held out", _forms(effects), digest(start, *candidate.bounds()))
        told: dict[str, dict[str, Array]] = {}
        for i, split in enumerate(splits(self.measured)):
            found = self._fitted(ledger, i, desk, fit, candidate, split.seen, start)
            for curve in self.measured.curves:
                if curve.name in split.judged:
                    white = errors(candidate, self.measured, found.at[np.newaxis], [curve])[0]
                    told.setdefault(split.kind, {})[curve.name] = white[split.judged[curve.name] :] ** 2
        return told

    def of_others(self, desk: Desk, effects: Effects, start: Array, values: Array) -> dict[str, dict[str, Array]]:
        """As :meth:`held_out`, when the effects have ``values`` ``[m]`` (unit cube) that this specimen did not see."""
        candidate = self.candidate(effects)
        begin = np.concatenate([start[: start.size - values.size], values])
        ledger = self._ledger("of others", _forms(effects), digest(begin, *candidate.bounds()))
        how = (_fit_beside, candidate, self.measured, begin, values.size)
        found = self._fitted(ledger, 0, desk, *how)
        return {
            SPECIMEN: {
                curve.name: errors(candidate, self.measured, found.at[np.newaxis], [curve])[0] ** 2
                for curve in self.measured.curves
            }
        }


def _fit_beside(candidate: Candidate, measured: Measured, start: Array, last: int) -> Fitted:
    """With the ``last`` values fixed."""
    return fit(candidate, measured, start, fixed=range(start.size - last, start.size))


def _forms(effects: Effects) -> list[str]:
    """Names effects in whatever form."""
    return [f"{effect.name}: {effect.equation}" for effect in effects]


def explorers(workspace: Workspace) -> list[Explorer]:
    """One for each specimen of the study, with the noise of all of its curves together."""
    chosen = workspace.specimens(workspace.study.discover.specimens, "discover.specimens")
    folder = workspace.out / "discover"
    noise = noise_of_each([one.curves for one in chosen])
    solver = workspace.simulator if isinstance(workspace.simulator, FEBio) else None
    return [
        Explorer(Measured(one, its), workspace.model, folder, solver) for one, its in zip(chosen, noise, strict=True)
    ]


def each_for_all(
    workspace: Workspace,
    explored: Sequence[Explorer],
    title: str,
    items: Sequence[Any],
    work: Callable[[int, Any, Desk], Any],
) -> list[list[Any]]:
    """``work(number of specimen, item, desk)`` for every item and specimen, many at a time: ``[item][specimen]``."""
    jobs = [(i, k) for k in range(len(items)) for i in range(len(explored))]
    found: dict[tuple[int, int], Any] = {}
    lanes = min(len(jobs), LANES * len(explored))
    with workspace.progress(f"discover: {title}", len(jobs), of="fits") as report:
        told = Lock()

        def lane(number: int, desk: Desk) -> None:
            for i, k in jobs[number::lanes]:
                done = work(i, items[k], desk)
                with told:
                    found[i, k] = done
                    report(len(found), 0, lanes)

        workspace.converse([Talk([], 0, partial(lane, number)) for number in range(lanes)], title)
    return [[found[i, k] for i in range(len(explored))] for k in range(len(items))]
