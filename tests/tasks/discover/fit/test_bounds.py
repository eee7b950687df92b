"""Whether data press most parameters of the bare model against the ends of their ranges."""

import numpy as np

from sinew.tasks.discover.fit.bounds import cornered
from sinew.tasks.discover.fit.candidate import BLIND
from sinew.tasks.discover.fit.fit import Fitted
from sinew.tasks.model import Model

VARIED = [parameter for parameter in Model().free if parameter.name != BLIND]


def fitted(at: float, pressed: int) -> Fitted:
    """All parameters ``at`` one place, of which the data press the first so many."""
    pull = np.where(np.arange(len(VARIED)) < pressed, 100.0, 0.0)
    return Fitted(np.full(len(VARIED), at), 1.0, 10, np.zeros(len(VARIED)), pull)


def test_most_parameters_in_most_specimens_count():
    names = tuple(parameter.name for parameter in VARIED)
    half = len(names) // 2
    assert cornered(VARIED, [fitted(1.0, len(names))]) == names
    assert cornered(VARIED, [fitted(1.0, half + 1)]) == names[: half + 1]
    assert cornered(VARIED, [fitted(1.0, half)]) == ()
    assert cornered(VARIED, [fitted(0.5, len(names))]) == (), "on no bound"
    assert cornered(VARIED, [fitted(1.0, len(names)), fitted(0.5, 0)]) == (), "in one of two"


def test_an_end_with_nothing_beyond_does_not_count():
    beyond = tuple(parameter.name for parameter in VARIED if parameter.minimum not in (0.0, parameter.floor))
    expected = beyond if 2 * len(beyond) > len(VARIED) else ()
    assert cornered(VARIED, [fitted(0.0, len(VARIED))]) == expected
    assert len(beyond) < len(VARIED)
