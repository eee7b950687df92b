"""pyABC's own sampler on the study's cluster, for comparison with sinew's: it stores no rows and cannot be resumed.

It gives other particles each time, sends the whole problem with every proposal, waits for ever when there is no worker,
and has no limit of proposals. A failed simulation ends the whole inference.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
import pyabc
from distributed import Client
from pyabc.sampler import DaskDistributedSampler

from sinew.runner.cluster.client import ask_for, wait_for_workers
from sinew.runner.evaluation.batch import Evaluation
from sinew.runner.store.schema import STATUSES
from sinew.tasks.infer.abc.sampler import Generation
from sinew.tasks.simulate import Array

EVERY_SLOT = 2**20  # a cluster that can grow shall grow as far as its profile allows


class SimulationFailed(Exception):
    """A simulation failed; this sampler cannot go on."""


class DirectModel(pyabc.Model):  # type: ignore[misc]
    """Evaluates in the calling process. Arguments as for :class:`sinew.tasks.infer.abc.sampler.StoredModel`."""

    def __init__(
        self,
        name: str,
        names: Sequence[str],
        evaluation: Evaluation,
        row: Callable[[Array], Array],
        describe: Callable[[Mapping[str, Array]], dict[str, Any]],
    ) -> None:
        super().__init__(name)
        self.names = tuple(names)
        self.evaluation = evaluation
        self.row = row
        self.describe = describe

    def sample(self, pars: Mapping[str, float]) -> dict[str, Any]:
        """The summary statistics. Raises :class:`SimulationFailed`."""
        outcome = self.evaluation(self.row(np.array([pars[name] for name in self.names]))[np.newaxis])
        if outcome.status[0] > 0:
            raise SimulationFailed(f"{STATUSES[outcome.status[0]]}: {outcome.messages[0]}")
        return self.describe({name: values[0] for name, values in outcome.values.items()})


class StockSampler(DaskDistributedSampler):  # type: ignore[misc]
    """pyABC's sampler, which also records the counts of its generations."""

    def __init__(self, client: Client) -> None:
        super().__init__(client)
        self.generations: list[Generation] = []
        self.sample_factory.record_rejected()  # superfluous proposals are counted apart

    def sample_until_n_accepted(self, n: int, simulate_one: Any, t: int, **options: Any) -> Any:
        """As pyABC's."""
        sample = super().sample_until_n_accepted(n, simulate_one, t, **options)
        self.generations.append(Generation(t, len(sample.all_particles), n, 0, self.nr_evaluations_))
        return sample


def stock_sampler(client: Client) -> StockSampler:
    """The sampler, once the cluster has a worker."""
    check = partial(ask_for, client, EVERY_SLOT)
    check()
    wait_for_workers(client, check)
    return StockSampler(client)
