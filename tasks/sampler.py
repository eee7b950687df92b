"""A sampler for pyABC whose evaluations are rows of the store.

pyABC gives a sampler one function that draws a proposal, simulates it and judges it. Here it is called twice for each
proposal, both times with the same random numbers: the first time the model stops it and says what it wants to know,
the second time the model has the answer. In between, the runner evaluates the row like any other. What follows:

- A proposal's random numbers come from (run, generation, proposal), so a run does not depend on workers or crashes; one
  that starts anew asks for the same rows, finds them in the store, and goes on where it was.
- Proposals are judged in the order in which they were drawn, so fast simulations are not preferred.
- A failed row is a rejected proposal.
- How many are asked for ahead follows from what has been judged, too: as many as are likely to be needed, at most
  ``pending``. Those that prove superfluous end while the next generation begins; nobody waits for them.
"""

import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import pyabc
from pyabc.sampler import Sampler
from scipy.stats import nbinom

from runner.ensemble import Desk
from tasks.simulate import Array

LIKELY = 0.7  # of being enough, where fewer than ``pending`` are asked for
FORMER = 5  # proposals that the former generation's acceptance rate counts for

_drawing = threading.Lock()  # pyABC draws from numpy's global generator


class _Wanted(Exception):
    def __init__(self, model: "StoredModel", parameters: Mapping[str, float]) -> None:
        self.model = model
        self.parameters = parameters


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
        self.answer: dict[str, Any] | None = None

    def sample(self, pars: Mapping[str, float]) -> dict[str, Any]:
        """The summary statistics, when they are known."""
        if self.answer is None:
            raise _Wanted(self, pars)
        return self.answer


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


@dataclass
class _Proposed:
    model: StoredModel
    seed: tuple[int, ...]


class StoreSampler(Sampler):  # type: ignore[misc]
    """See the module. One sampler serves one run of pyABC, in the thread of one talk."""

    def __init__(self, desk: Desk, seed: Sequence[int], pending: int = 64) -> None:
        super().__init__()
        self.desk = desk
        self.seed = tuple(seed)
        self.pending = pending
        self.generations: list[Generation] = []
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
            allowed = int(max(allowed, min(took.judged + min(self.pending, likely), max_eval)))
            while len(proposed) < allowed:
                proposed.append(self._propose(simulate_one, (*self.seed, number, len(proposed))))
            for _ in range(skip):  # answers that the former generation no longer needed
                self.desk.next()
            skip = 0
            particle = self._judge(simulate_one, proposed[took.judged])
            took.judged += 1
            if particle is None:
                took.failed += 1
                continue
            sample.append(particle)
            took.accepted += bool(particle.accepted)
            took.closest = min(took.closest, float(particle.distance))
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

    def _propose(self, simulate_one: Callable[[], Any], seed: tuple[int, ...]) -> _Proposed:
        try:
            with _seeded(seed):
                simulate_one()
        except _Wanted as wanted:
            values = np.array([wanted.parameters[name] for name in wanted.model.names])
            self.desk.ask(wanted.model.row(values)[np.newaxis], wanted.model.table)
            return _Proposed(wanted.model, seed)
        raise TypeError("the sampler serves models that are StoredModel only")

    def _judge(self, simulate_one: Callable[[], Any], proposed: _Proposed) -> Any:
        """The particle of a proposal, or None when its simulation failed."""
        told = self.desk.next()
        if told.status > 0:
            return None
        proposed.model.answer = proposed.model.describe(told.values)
        try:
            with _seeded(proposed.seed):
                return simulate_one()
        finally:
            proposed.model.answer = None


@lru_cache(maxsize=10_000)
def _enough(needed: int, rate: float) -> int:
    """Proposals of which ``needed`` are accepted with the probability ``LIKELY``."""
    return needed + int(nbinom.ppf(LIKELY, needed, min(rate, 1.0)))


@contextmanager
def _seeded(seed: tuple[int, ...]) -> Iterator[None]:
    """Numpy's global generator with a seed of our own, to this thread only."""
    with _drawing:
        before = np.random.get_state()
        np.random.seed(np.random.SeedSequence(seed).generate_state(4))
        try:
            yield
        finally:
            np.random.set_state(before)
