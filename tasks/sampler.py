"""A sampler for pyABC whose evaluations are rows of the store.

pyABC gives a sampler one function that draws a proposal, simulates it and judges it. Here its model does not simulate
but takes note of what it is asked, so that the function comes back at once with a particle that is not judged yet. The
runner evaluates the row like any other, and the particle is judged when the outcome is known. One that is accepted is
made by the same function with the same random numbers again, which then has its verdict. What follows:

- A proposal's random numbers come from (run, generation, proposal), so a run does not depend on workers or crashes; one
  that starts anew asks for the same rows, finds them in the store, and goes on where it was.
- Proposals are judged in the order in which they were drawn, so fast simulations are not preferred.
- A failed row is a rejected proposal.
- How many are asked for ahead follows from what has been judged, too: as many as are likely to be needed, at most
  ``pending``, and more while many more will surely be needed, so that workers get several at a time. Those that prove
  superfluous end while the next generation begins; nobody waits for them.
"""

import math
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache, partial
from itertools import groupby
from typing import Any

import numpy as np
import pyabc
from pyabc.model import ModelResult
from pyabc.sampler import Sampler
from scipy.special import nbdtrik

from runner.ensemble import Desk
from tasks.simulate import Array

LIKELY = 0.7  # of being enough, where fewer than ``pending`` are asked for
FORMER = 5  # proposals that the former generation's acceptance rate counts for
# more than ``pending``: parts of what is likely to be needed and of what has been judged, times ``pending`` at the most
SURE, SAFE, DEEP = 2, 2, 8
GROUPS = 8  # in which ``pending`` is asked for: most of what asking costs does not depend on how many there are

_drawing = threading.Lock()  # pyABC draws from numpy's global generator


class StoredModel(pyabc.Model):  # type: ignore[misc]
    """A model whose outcomes are rows of the desk's table number ``table``.

    ``names`` are its parameters as pyABC calls them; ``row`` makes the table's parameters ``[d]`` of their values, and
    ``describe`` the summary statistics of what was stored.
    """

    def __init__(
        self,
        name: str,
        names: Sequence[str],
        *,
        table: int = 0,
        row: Callable[[Array], Array] = lambda values: values,
        describe: Callable[[Mapping[str, Array]], dict[str, Any]] = dict,
    ) -> None:
        super().__init__(name)
        self.names = tuple(names)
        self.table = table
        self.row = row
        self.describe = describe
        self._answer: dict[str, Any] | None = None
        self._verdict: ModelResult | None = None

    def sample(self, pars: Mapping[str, float]) -> dict[str, Any]:
        """The summary statistics, while they are known."""
        assert self._answer is not None, "it is asked for what is known only"
        return self._answer

    def summary_statistics(self, t: int, pars: Mapping[str, float], *others: Any) -> ModelResult:
        """As pyABC's; while there is no answer, the question stands in the place of summary statistics."""
        if self._answer is not None:
            return super().summary_statistics(t, pars, *others)
        return ModelResult(_Wish(self, pars, partial(super().summary_statistics, t, pars, *others)))

    def accept(self, t: int, pars: Mapping[str, float], *others: Any) -> ModelResult:
        """The verdict when there is one; else it counts as rejected, so that pyABC spends no time on its weight."""
        if self._verdict is not None:
            return self._verdict
        return ModelResult(_Wish(self, pars, partial(super().accept, t, pars, *others)), accepted=False)

    def judge(self, wish: "_Wish", values: Mapping[str, Array]) -> ModelResult:
        """What pyABC says to a row's outcome."""
        self._answer = self.describe(values)
        try:
            return wish.judge()
        finally:
            self._answer = None

    @contextmanager
    def judged(self, verdict: ModelResult) -> Iterator[None]:
        """While pyABC makes a particle of what has been accepted."""
        self._verdict = verdict
        try:
            yield
        finally:
            self._verdict = None


@dataclass(frozen=True)
class _Wish:
    """What pyABC wanted to know of a model, and its judgement once that is known."""

    model: StoredModel
    parameters: Mapping[str, float]
    judge: Callable[[], ModelResult]

    def row(self) -> Array:
        return self.model.row(np.array([self.parameters[name] for name in self.model.names]))


@dataclass
class Generation:
    """What a generation took: proposals judged, of which accepted and failed, and how many were asked for."""

    judged: int = 0
    accepted: int = 0
    failed: int = 0
    asked: int = 0
    closest: float = np.inf

    @property
    def surplus(self) -> float:
        """Evaluations that proved superfluous, as a part of those that were needed."""
        return self.asked / self.judged - 1.0 if self.judged else 0.0


@dataclass(frozen=True)
class _Proposed:
    """A particle that is not judged yet."""

    particle: Any
    wish: _Wish
    seed: tuple[int, ...]


class StoreSampler(Sampler):  # type: ignore[misc]
    """See the module. One sampler serves one run of pyABC, in the thread of one talk."""

    def __init__(self, desk: Desk, seed: Sequence[int], pending: int = 64) -> None:
        super().__init__()
        self.desk = desk
        self.seed = tuple(seed)
        self.pending = pending
        self.generations: list[Generation] = []
        self.tell: Callable[[int, Generation], None] = lambda t, took: None  # hears of each proposal that is judged
        self._superfluous = 0

    def sample_until_n_accepted(
        self,
        n: int,
        simulate_one: Callable[[], Any],
        t: int,
        *,
        max_eval: float = np.inf,
        all_accepted: bool = False,
        ana_vars: Any = None,
    ) -> Any:
        """A sample with ``n`` accepted particles; ``ok`` is False when ``max_eval`` proposals did not yield them."""
        skip, self._superfluous = self._superfluous, 0
        sample = self._create_empty_sample()
        number, took = len(self.generations), Generation()
        self.generations.append(took)
        former = self._rate_before(all_accepted)
        proposed: list[_Proposed] = []
        allowed = 0
        while took.accepted < n and took.judged < max_eval:
            rate = (took.accepted + FORMER * former) / (took.judged + FORMER)
            likely = _enough(n - took.accepted, round(max(rate, 0.001), 3))
            more = min(likely // SURE, self.pending + took.judged // SAFE, DEEP * self.pending)
            ahead = max(self.pending, more)
            allowed = int(max(allowed, min(took.judged + min(ahead, likely), max_eval)))
            if allowed - len(proposed) >= ahead / GROUPS or len(proposed) == took.judged:
                proposed += self._propose(simulate_one, number, range(len(proposed), allowed))
            for _ in range(skip):  # answers that the former generation no longer needed
                self.desk.next()
            skip = 0
            particle = self._judge(simulate_one, proposed[took.judged])
            took.judged += 1
            if particle is None:
                took.failed += 1
            else:
                sample.append(particle)
                took.accepted += bool(particle.accepted)
                took.closest = min(took.closest, float(particle.distance))
            self.tell(t, took)
        took.asked = len(proposed)
        self._superfluous = skip + took.asked - took.judged
        self.nr_evaluations_ = took.judged
        sample.ok = took.accepted == n
        return sample

    def _rate_before(self, all_accepted: bool) -> float:
        if all_accepted:
            return 1.0
        former = next((g for g in reversed(self.generations[:-1]) if g.accepted), None)
        return 0.5 if former is None else 0.5 * former.accepted / former.judged  # the threshold has been lowered

    def _propose(self, simulate_one: Callable[[], Any], generation: int, numbers: range) -> list[_Proposed]:
        """Draw proposals and ask for their rows."""
        proposed = []
        with _own_random_numbers() as seeded:
            for number in numbers:
                seed = (*self.seed, generation, number)
                seeded(seed)
                particle = simulate_one()
                if not isinstance(particle.sum_stat, _Wish):
                    raise TypeError("the sampler serves models that are StoredModel only")
                proposed.append(_Proposed(particle, particle.sum_stat, seed))
        for table, group in groupby(proposed, lambda one: one.wish.model.table):
            self.desk.ask(np.array([one.wish.row() for one in group]), table)
        return proposed

    def _judge(self, simulate_one: Callable[[], Any], proposed: _Proposed) -> Any:
        """The particle of a proposal, or None when its simulation failed."""
        told = self.desk.next()
        if told.status > 0:
            return None
        model, particle = proposed.wish.model, proposed.particle
        with _own_random_numbers() as seeded:
            seeded((*proposed.seed, 1))
            verdict = model.judge(proposed.wish, told.values)
            if verdict.accepted:
                seeded(proposed.seed)
                with model.judged(verdict):
                    return simulate_one()
        particle.sum_stat = verdict.sum_stat
        if verdict.accepted is not None:  # else one to learn from, which nobody judges
            particle.distance = verdict.distance
        return particle


@lru_cache(maxsize=10_000)
def _enough(needed: int, rate: float) -> int:
    """Proposals of which ``needed`` are accepted with the probability ``LIKELY``."""
    return needed + (math.ceil(nbdtrik(LIKELY, needed, rate)) if rate < 1.0 else 0)


@contextmanager
def _own_random_numbers() -> Iterator[Callable[[tuple[int, ...]], None]]:
    """Numpy's global generator to this thread only; gives what seeds it."""
    with _drawing:
        before = np.random.get_state()
        try:
            yield lambda seed: np.random.seed(np.random.SeedSequence(seed).generate_state(4))
        finally:
            np.random.set_state(before)
