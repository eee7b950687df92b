"""The curves that an inference uses."""

import numpy as np
import pytest

from sinew.tasks.infer.observations import first_cycle
from sinew.tasks.model import Curve, Protocol
from sinew.tasks.model.protocols import cyclic


@pytest.mark.parametrize("noise", [0.0, 0.002])
def test_the_first_cycle_ends_where_the_second_begins(noise):
    protocol = cyclic(10.0, 20.0)
    moved = protocol.displacement_mm + noise * np.random.default_rng(1).standard_normal(protocol.time_s.size)
    curve = Curve(Protocol("cyclic", protocol.time_s, moved), np.zeros(moved.size))
    cut = first_cycle(curve)
    assert cut.protocol.time_s[-1] == pytest.approx(2 * 0.02 / 0.006, abs=0.4)
    assert cut.protocol.displacement_mm.max() == pytest.approx(0.2, abs=0.01)
    hold = Curve(Protocol("hold", np.arange(10.0), np.minimum(np.arange(10.0), 3.0)), np.zeros(10))
    assert first_cycle(hold) is hold
