"""Rows that are simulated one by one, each of which may fail with a status and a reason."""

from collections.abc import Callable

import numpy as np

from sinew.runner.store.schema import STATUSES
from sinew.tasks.model import Model
from sinew.tasks.simulate import Array, impossible


class Failed(Exception):
    """A run that gave no curve: ``status`` as in :data:`sinew.runner.store.schema.STATUSES`; the solver's ``words``."""

    def __init__(self, status: str, words: str) -> None:
        super().__init__(status, words)
        self.status = status
        self.words = " ".join(words.split())[:500]


def row_by_row(
    model: Model, parameters: Array, solve: Callable[[Array], Array], found: Array
) -> tuple[Array, tuple[str, ...]]:
    """Write what ``solve`` makes of each parameter set ``[d]`` into ``found`` ``[n, ...]``; rows that fail stay as is.

    Returns status ``[n]`` and messages.
    """
    status = np.zeros(len(parameters), dtype=np.int8)
    messages = [""] * len(parameters)
    wrong = impossible(model, parameters)
    for row, values in enumerate(parameters):
        try:
            if row in wrong:
                raise Failed("bad_input", wrong[row])
            found[row] = solve(values)
        except Failed as failed:
            status[row] = STATUSES.index(failed.status)
            messages[row] = failed.words
    return status, tuple(messages)
