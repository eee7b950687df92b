"""A sampler for pyABC whose evaluations are rows of the store.

pyABC gives a sampler one function that draws a proposal, simulates it and judges it. Here that function only draws: the
model records which row it needs instead of simulating. The runner evaluates this row like any other, and pyABC judges
the proposal when the outcome is known, as it does for the look-ahead proposals of its own Redis sampler. As a result:

- A proposal's random numbers come from (run, generation, proposal), so a run does not depend on workers or crashes. A
  run that starts anew asks for the same rows, finds them in the store, and continues where it stopped.
- Proposals are judged in the order in which they were drawn, so fast simulations are not preferred.
- A failed row is a rejected proposal.
- The number of proposals under way follows from the judged ones alone: ``pending``; fewer when the generation, or the
  last one, is likely to need fewer; more while many more will surely be needed, so that workers get several at a time.
- Proposals that a generation did not need become the first ones of the next, so that workers stay busy while it is
  prepared and no evaluation is lost. They keep the weight that they were drawn with, prior over proposal density, which
  holds for any threshold: a generation is a sample from several proposal densities (Alamoudi et al. 2024, PLoS ONE 19,
  e0294015).
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

from sinew.runner.evaluation.adaptive import Session
from sinew.tasks.simulate import Array

LIKELY = 0.7  # probability that the proposals asked for are enough, where fewer than ``pending`` are
FORMER = 5  # proposals that the acceptance rate of the former generation counts for
# limits of more than ``pending``: shares of the likely need and of the judged proposals, and a multiple of ``pending``
SURE, SAFE, DEEP = 2, 2, 8
JUDGING = 1  # the part of a proposal's stream that its judgement draws from
GROUPS = 8  # ``pending`` proposals are asked for in so many groups: a request costs much the same for any number

_drawing = threading.Lock()  # pyABC draws from numpy's global generator


class StoredModel(pyabc.Model):  # type: ignore[misc]
    """A model whose outcomes are rows of the session's table number ``table``.

    ``names`` are its parameters as pyABC calls them; ``row`` turns their values into the table's parameters
    ``[d]``, and ``describe`` turns a stored outcome into summary statistics.
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
        """A request in place of summary statistics, which are not known yet."""
        return ModelResult(sum_stat=_Request(self, pars, calculator))


@dataclass(frozen=True)
class _Request:
    """The evaluation of a model that pyABC asks for."""

    model: StoredModel
    parameters: Mapping[str, float]
    calculator: Callable[[Any], Any]  # of summary statistics

    def row(self) -> Array:
        return self.model.row(np.array([self.parameters[name] for name in self.model.names]))

    def answer(self, values: Mapping[str, Array]) -> Any:
        return self.calculator(self.model.describe(values))


@dataclass
class Generation:
    """Counts of generation ``t``: proposals judged, of which accepted and failed, and those asked for meanwhile.

    pyABC's numbers: the first generation is 0, the sample from which a distance is learned is -1.
    """

    t: int
    judged: int = 0
    accepted: int = 0
    failed: int = 0
    asked: int = 0
    closest: float = np.inf


@dataclass(frozen=True)
class _Proposed:
    """A particle that is not judged yet, and the seed of its random numbers."""

    particle: Any
    seed: tuple[int, ...]


class StoreSampler(Sampler):  # type: ignore[misc]
    """The sampler that the module describes, for one run of pyABC in the thread of one adaptive run.

    ``on_judged`` is called with the generation's counts after each judged proposal.
    """

    def __init__(self, session: Session, seed: Sequence[int], pending: int = 64) -> None:
        super().__init__()
        self.session = session
        self.seed = tuple(seed)
        self.pending = pending
        self.generations: list[Generation] = []
        self.on_judged: Callable[[Generation], None] = lambda generation: None
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
        number, counts = len(self.generations), Generation(t)
        self.generations.append(counts)
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
        while counts.accepted < n and counts.judged < max_eval:
            rate = (counts.accepted + FORMER * former) / (counts.judged + FORMER)
            likely = _enough(n - counts.accepted, round(max(rate, 0.001), 3))
            more = min(likely // SURE, self.pending + counts.judged // SAFE, DEEP * self.pending)
            ahead = max(self.pending, more)
            allowed = max(allowed, math.ceil(min(counts.judged + min(ahead, max(likely, least)), max_eval)))
            if allowed - len(proposed) >= ahead / GROUPS or len(proposed) == counts.judged:
                proposed += self._propose(draw, number, range(len(proposed), allowed))
            particle = self._judge(judge, proposed[counts.judged])
            counts.judged += 1
            if particle is None:
                counts.failed += 1
            else:
                sample.append(particle)
                counts.accepted += bool(particle.accepted)
                counts.closest = min(counts.closest, float(particle.distance))
            self.on_judged(counts)
        counts.asked = len(proposed) - first
        self._left = proposed[counts.judged :]
        self.nr_evaluations_ = counts.judged
        sample.ok = counts.accepted == n
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
                if not isinstance(particle.sum_stat, _Request):
                    raise TypeError("the sampler serves models that are StoredModel only")
                particle.preliminary = True  # also before the first generation, which takes over those that are left
                proposed.append(_Proposed(particle, seed))
        requests = [one.particle.sum_stat for one in proposed]
        for table, group in groupby(requests, lambda request: request.model.table):
            self.session.ask(np.array([request.row() for request in group]), table)
        return proposed

    def _judge(self, judge: Callable[[Any], Any], proposed: _Proposed) -> Any:
        """The particle of a proposal, or None when its simulation failed."""
        result = self.session.next()
        if result.status > 0:
            return None
        particle = proposed.particle
        with _own_random_numbers() as seeded:
            seeded((*proposed.seed, JUDGING))
            particle.sum_stat = particle.sum_stat.answer(result.values)
            return judge(particle)


def _as_it_is(particle: Any) -> Any:
    """A particle of the sample from which a distance is learned; it is not judged."""
    particle.preliminary = False
    return particle


@lru_cache(maxsize=10_000)
def _enough(needed: int, rate: float) -> int:
    """The number of proposals of which ``needed`` are accepted with probability ``LIKELY``."""
    return needed + (math.ceil(nbdtrik(LIKELY, needed, rate)) if rate < 1.0 else 0)


@contextmanager
def _own_random_numbers() -> Iterator[Callable[[tuple[int, ...]], None]]:
    """Reserve numpy's global generator for this thread; yields the function that seeds it."""
    with _drawing:
        before = np.random.get_bit_generator()  # type: ignore[attr-defined] # numpy documents both, and types neither
        use = np.random.set_bit_generator  # type: ignore[attr-defined]
        try:
            yield lambda seed: use(np.random.PCG64(seed))
        finally:
            use(before)
