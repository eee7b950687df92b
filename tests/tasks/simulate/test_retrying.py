"""Rows that failed by accident are simulated again; rows that the model cannot have are not."""

from dataclasses import dataclass, field

import numpy as np
import pytest

from sinew.runner.evaluation.batch import RETRIED
from sinew.runner.store.schema import STATUSES
from sinew.tasks.model import Model, Protocol, Specimen
from sinew.tasks.model.effect import Effect
from sinew.tasks.simulate import Simulated
from sinew.tasks.simulate.retrying import simulate_patiently

PROTOCOL = Protocol("pull", np.arange(3.0), np.arange(3.0))
BAR = Specimen("a", 10.0, 5.0, 2.0)


@dataclass
class Fragile:
    """The force is the first parameter. ``accidents``: how often each row fails first, and by which status."""

    accidents: dict[float, list[str]]
    stresses: bool = False
    asked: list[list[float]] = field(default_factory=list)

    def simulate(self, model, specimen, protocol, parameters, *, stresses=False):
        self.asked.append(parameters[:, 0].tolist())
        failing = [self.accidents.get(value, []) for value in parameters[:, 0]]
        status = np.array([STATUSES.index(each.pop(0)) if each else 0 for each in failing], dtype=np.int8)
        force = np.where(status[:, np.newaxis] > 0, np.nan, parameters[:, :1] * np.ones(3))
        messages = tuple("an accident" if one else "" for one in status)
        width = {"width": -force}
        return Simulated(force, status, messages, force if stresses else None, force if stresses else None, width)

    def with_effects(self, effects: tuple[Effect, ...]):
        return self


def simulated(fragile, retries, **how):
    rows = np.array([[1.0], [2.0], [3.0]])
    return simulate_patiently(fragile, Model(), BAR, PROTOCOL, rows, retries=retries, **how)


@pytest.mark.parametrize("status", RETRIED)
def test_accidents_are_repaired_row_by_row(status):
    fragile = Fragile({2.0: [status, status], 3.0: [status]})
    done = simulated(fragile, 5)
    assert done.force_N[:, 0].tolist() == [1.0, 2.0, 3.0]
    assert done.outputs["width"][:, 0].tolist() == [-1.0, -2.0, -3.0]
    assert done.status.tolist() == [0, 0, 0]
    assert done.messages == ("", "", "")
    assert fragile.asked == [[1.0, 2.0, 3.0], [2.0, 3.0], [2.0]]


def test_stresses_are_repaired_too():
    done = simulated(Fragile({1.0: ["crashed"]}), 1, stresses=True)
    assert done.matrix_MPa[:, 0].tolist() == done.fibre_MPa[:, 0].tolist() == [1.0, 2.0, 3.0]


def test_what_stays_broken_is_told_after_so_many_tries():
    fragile = Fragile({2.0: ["crashed"] * 9})
    done = simulated(fragile, 2)
    assert done.status.tolist() == [0, STATUSES.index("crashed"), 0]
    assert done.messages[1] == "an accident"
    assert len(fragile.asked) == 3


@pytest.mark.parametrize("status", [name for name in STATUSES[1:] if name not in RETRIED])
def test_other_failures_are_answers(status):
    fragile = Fragile({2.0: [status]})
    assert simulated(fragile, 3).status.tolist() == [0, STATUSES.index(status), 0]
    assert len(fragile.asked) == 1
