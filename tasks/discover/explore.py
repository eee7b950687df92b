"""The fits behind a discovery, specimen by specimen, on the study's cluster.

First the bare model from several starts, then with each effect, from where the bare model ended; then pairs with the
effect that fits best; then, without each curve in turn, the bare model and the best candidates, which then predict that
curve. Fits are kept beside the store, so that a run that was interrupted does not fit again.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from runner.ensemble import Desk, Talk
from tasks.discover.fit import Candidate, Fitted, errors, fit, gentle, starts
from tasks.discover.measured import Measured
from tasks.ledger import Ledger
from tasks.model import Curve, Model
from tasks.model.effect import Effect
from tasks.noise import noise_of_each
from tasks.simulate import Array
from tasks.workspace import Workspace, digest

SHARES = (0.1, 0.6)  # of an effect's typical size, where its fits begin
MORE = 4  # times the starts, while no two fits of the bare model agree
ALIKE_LOSS = 2.0  # of whitened sums of squares: two fits that differ by less found the same

Effects = tuple[Effect, ...]


def agree(fits: Sequence[Fitted]) -> bool:
    """Whether the best of fits from different starts, the best first, was found twice."""
    return len(fits) > 1 and fits[1].loss - fits[0].loss < ALIKE_LOSS


def slugs(effects: Effects) -> tuple[str, ...]:
    return tuple(effect.slug for effect in effects)


@dataclass(frozen=True, eq=False)
class Explorer:
    """One specimen: its measurements, and the fits of it that are known already."""

    measured: Measured
    model: Model
    folder: Path

    def ledger(self, *what: Any) -> Ledger:
        """Where fits of one kind are kept."""
        noise = self.measured.noise
        inputs = digest(
            self.measured.specimen.identity(), self.model.identity(), [noise.sd_N, noise.ar1], [p.maximum for p in
            self.model.parameters], [p.minimum for p in self.model.parameters], what,
        )  # fmt: skip
        name = f"{self.measured.specimen.name.replace('/', '_')}.{digest(what)[:12]}.jsonl"
        return Ledger(self.folder / name, inputs)

    def _fit(
        self,
        ledger: Ledger,
        number: int,
        desk: Desk,
        candidate: Candidate,
        start: Array,
        curves: Sequence[Curve] | None = None,
    ) -> Fitted:
        """Fit ``number`` of a ledger, known or found now on a worker."""
        if number == len(ledger):
            found = desk.compute(fit, candidate, self.measured, start, curves)
            ledger.append(np.concatenate([[found.loss, found.points], found.at, found.uncertainty]))
        kept = ledger.kept[number]
        ends = 2 + candidate.size
        return Fitted(kept[2:ends], float(kept[0]), int(kept[1]), kept[ends:])

    def bare(self, desk: Desk, count: int, seed: tuple[int, ...]) -> list[Fitted]:
        """Fits of the model without effects, the best first, from ``count`` starts and, until two agree, some more."""
        candidate = Candidate(self.model)
        ledger = self.ledger("bare", seed)
        found: list[Fitted] = []
        for i, at in enumerate(starts(candidate, np.random.default_rng(seed), MORE * count)):
            if i >= count and agree(found):
                break
            found.append(self._fit(ledger, i, desk, candidate, at))
            found.sort(key=lambda one: one.loss)
        return found

    def bare_from(self, desk: Desk, start: Array) -> Fitted:
        """A fit of the model without effects from where a fit with some ended."""
        candidate = Candidate(self.model)
        ledger = self.ledger("bare from", digest(start))
        return self._fit(ledger, 0, desk, candidate, start[: candidate.size])

    def having(self, desk: Desk, effects: Effects, bare: Fitted, others: Array | None = None) -> Fitted:
        """The best fit with effects, from where the bare model ended; ``others``: values to begin with as well."""
        candidate = Candidate(self.model, effects)
        null, typical = candidate.null(), candidate.typical()
        begins = [np.concatenate([bare.at, null + share * (typical - null)]) for share in SHARES]
        begins.append(np.concatenate([gentle(candidate), typical]))  # the bare model may have led astray
        if others is not None:
            begins.append(np.concatenate([bare.at, others]))
        ledger = self.ledger("having", slugs(effects), digest(*begins, *candidate.bounds()))
        found = [self._fit(ledger, i, desk, candidate, at) for i, at in enumerate(begins)]
        return min(found, key=lambda one: one.loss)

    def held_out(self, desk: Desk, effects: Effects, start: Array) -> dict[str, Array]:
        """Whitened squared errors ``[t]`` of each curve, predicted by a fit to all others; none of a single curve."""
        candidate = Candidate(self.model, effects)
        curves = self.measured.curves
        ledger = self.ledger("held out", slugs(effects), digest(start, *candidate.bounds()))
        told = {}
        for i, curve in enumerate(curves if len(curves) > 1 else ()):
            seen = [one for one in curves if one is not curve]
            found = self._fit(ledger, i, desk, candidate, start, seen)
            told[curve.name] = errors(candidate, self.measured, found.at[np.newaxis], [curve])[0] ** 2
        return told


def explorers(workspace: Workspace) -> list[Explorer]:
    """One for each specimen of the study, with the noise of all of its curves together."""
    chosen = workspace.specimens(workspace.study.discover.specimens, "discover.specimens")
    folder = workspace.out / "discover"
    noise = noise_of_each([one.curves for one in chosen])
    return [Explorer(Measured(one, its), workspace.model, folder) for one, its in zip(chosen, noise, strict=True)]


def together(
    workspace: Workspace, explored: Sequence[Explorer], title: str, work: Callable[[int, Desk], Any]
) -> list[Any]:
    """Let all specimens be worked on at the same time; returns what ``work(number, desk)`` returned for each."""
    talks = []
    for number, one in enumerate(explored):
        evaluation = workspace.evaluation(one.measured.specimen)
        table, _ = workspace.plan(evaluation, np.empty((0, len(workspace.model.names))))
        talks.append(Talk([(table, evaluation)], 0, lambda desk, number=number: work(number, desk)))  # type: ignore[misc]
    if not workspace.quiet:
        print(f"discover: {title}", flush=True)
    return workspace.converse(talks, f"discover: {title}")
