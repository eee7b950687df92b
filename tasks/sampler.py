"""A sampler for pyABC whose evaluations are rows of the store.

pyABC gives a sampler one function that draws a proposal, simulates it and judges it. Here it draws only, and its model
does not simulate but takes note of what it is asked. The runner evaluates the row like any other, and pyABC judges the
proposal when the outcome is known, as it does with those that its own sampler for Redis simulates ahead. What follows:

- A proposal's random numbers come from (run, generation, proposal), so a run does not depend on workers or crashes; one
  that starts anew asks for the same rows, finds them in the store, and goes on where it was.
- Proposals are judged in the order in which they were drawn, so fast simulations are not preferred.
- A failed row is a rejected proposal.
- How many are asked for ahead follows from what has been judged, too: ``pending`` of them, fewer when a generation as a
  whole is likely to need fewer, or the last one does, and more while many more will surely be needed, so that workers
  get several at a time.
- Those that a generation did not need are the first ones of the next, so that workers go on while it is prepared and no
  evaluation is lost. They keep the weight that they were drawn with, prior over proposal density, which holds for any
  threshold: a generation is a sample from several proposal densities (Alamoudi et al. 2024, PLoS ONE 19, e0294015).
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
from pyabc.inference_util import evaluate_preliminary_particle
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

    def summary_statistics(self, t: int, pars: Mapping[str, float], calculator: Callable[[Any], Any]) -> ModelResult:
        """The question, in the place of summary statistics that nobody knows yet."""
        return ModelResult(sum_stat=_Wish(self, pars, calculator))


@dataclass(frozen=True)
class _Wish:
    """What pyABC wanted to know of a model."""

    model: StoredModel
    parameters: Mapping[str, float]
    calculator: Callable[[Any], Any]  # of summary statistics

    def row(self) -> Array:
        return self.model.row(np.array([self.parameters[name] for name in self.model.names]))

    def answer(self, values: Mapping[str, Array]) -> Any:
        return self.calculator(self.model.describe(values))


@dataclass
class Generation:
    """What generation ``t`` took: proposals judged, of which accepted and failed, and those asked for meanwhile.

    As pyABC counts: from 0, and what was drawn before to learn from is -1.
    """

    t: int
    judged: int = 0
    accepted: int = 0
    failed: int = 0
    asked: int = 0
    closest: float = np.inf


@dataclass(frozen=True)
class _Proposed:
    """A particle that is not judged yet, and what its random numbers come from."""

    particle: Any
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
        self._left: list[_Proposed] = []  # asked for, and not judged

    def sample_until_n_accepted(
        self,
        n: int,
        simulate_one: Callable[..., Any],
        t: int,
        *,
        max_eval: float = np.inf,
        all_accepted: bool = False,
        ana_vars: Any = None,
    ) -> Any:
        """A sample with ``n`` accepted particles; ``ok`` is False when ``max_eval`` proposals did not yield them."""
        sample = self._create_empty_sample()
        number, took = len(self.generations), Generation(t)
        self.generations.append(took)
        former = self._rate_before(all_accepted)
        if all_accepted:
            draw, judge = simulate_one, _as_it_is
        else:
            draw = partial(simulate_one, evaluate=False)
            judge = partial(evaluate_preliminary_particle, t=t, ana_vars=ana_vars)
        last = all_accepted or t >= ana_vars.max_t or ana_vars.eps(t) <= ana_vars.min_eps
        least = 0 if last else min(self.pending, _enough(n, max(former, 0.001)))
        proposed, first = self._left, len(self._left)
        allowed = first
        while took.accepted < n and took.judged < max_eval:
            rate = (took.accepted + FORMER * former) / (took.judged + FORMER)
            likely = _enough(n - took.accepted, round(max(rate, 0.001), 3))
            more = min(likely // SURE, self.pending + took.judged // SAFE, DEEP * self.pending)
            ahead = max(self.pending, more)
            allowed = max(allowed, math.ceil(min(took.judged + min(ahead, max(likely, least)), max_eval)))
            if allowed - len(proposed) >= ahead / GROUPS or len(proposed) == took.judged:
                proposed += self._propose(draw, number, range(len(proposed), allowed))
            particle = self._judge(judge, proposed[took.judged])
            took.judged += 1
            if particle is None:
                took.failed += 1
            else:
                sample.append(particle)
                took.accepted += bool(particle.accepted)
                took.closest = min(took.closest, float(particle.distance))
            self.tell(t, took)
        took.asked = len(proposed) - first
        self._left = proposed[took.judged :]
        self.nr_evaluations_ = took.judged
        sample.ok = took.accepted == n
        return sample

    def _rate_before(self, all_accepted: bool) -> float:
        if all_accepted:
            return 1.0
        former = next((g for g in reversed(self.generations[:-1]) if g.accepted), None)
        return 0.5 if former is None else 0.5 * former.accepted / former.judged  # the threshold has been lowered

    def _propose(self, draw: Callable[[], Any], generation: int, numbers: range) -> list[_Proposed]:
        """Draw proposals and ask for their rows."""
        proposed = []
        with _own_random_numbers() as seeded:
            for number in numbers:
                seed = (*self.seed, generation, number)
                seeded(seed)
                particle = draw()
                if not isinstance(particle.sum_stat, _Wish):
                    raise TypeError("the sampler serves models that are StoredModel only")
                particle.preliminary = True  # even one to learn from: what is left of these is for the first generation
                proposed.append(_Proposed(particle, seed))
        wishes = [one.particle.sum_stat for one in proposed]
        for table, group in groupby(wishes, lambda wish: wish.model.table):
            self.desk.ask(np.array([wish.row() for wish in group]), table)
        return proposed

    def _judge(self, judge: Callable[[Any], Any], proposed: _Proposed) -> Any:
        """The particle of a proposal, or None when its simulation failed."""
        told = self.desk.next()
        if told.status > 0:
            return None
        particle = proposed.particle
        with _own_random_numbers() as seeded:
            seeded((*proposed.seed, 1))
            particle.sum_stat = particle.sum_stat.answer(told.values)
            return judge(particle)


def _as_it_is(particle: Any) -> Any:
    """One to learn from, which nobody judges."""
    particle.preliminary = False
    return particle


@lru_cache(maxsize=10_000)
def _enough(needed: int, rate: float) -> int:
    """Proposals of which ``needed`` are accepted with the probability ``LIKELY``."""
    return needed + (math.ceil(nbdtrik(LIKELY, needed, rate)) if rate < 1.0 else 0)


@contextmanager
def _own_random_numbers() -> Iterator[Callable[[tuple[int, ...]], None]]:
    """Numpy's global generator to this thread only; gives what seeds it."""
    with _drawing:
        before = np.random.get_bit_generator()  # type: ignore[attr-defined] # numpy documents both, and types neither
        use = np.random.set_bit_generator  # type: ignore[attr-defined]
        try:
            yield lambda seed: use(np.random.PCG64(seed))
        finally:
            use(before)
