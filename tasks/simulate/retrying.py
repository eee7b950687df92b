"""A simulator whose rows are simulated again when they failed by accident, as the rows of the store are.

What the fits of a discovery and the stresses of a prediction simulate are no rows of the store. A solver that somebody
killed must not change their results either.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from sinew.runner.evaluation.batch import RETRIED
from sinew.runner.store.schema import STATUSES
from sinew.tasks.model import Model, Protocol, Specimen
from sinew.tasks.simulate import Array, Simulated, Simulator

_ACCIDENTS = [STATUSES.index(name) for name in RETRIED]


def simulate_patiently(
    simulator: Simulator,
    model: Model,
    specimen: Specimen,
    protocol: Protocol,
    parameters: Array,
    *,
    retries: int,
    stresses: bool = False,
) -> Simulated:
    """As ``simulator.simulate``; rows that failed by accident are simulated up to ``retries`` times more."""
    done = simulator.simulate(model, specimen, protocol, parameters, stresses=stresses)
    for _ in range(retries):
        again = np.flatnonzero(np.isin(done.status, _ACCIDENTS))
        if not again.size:
            break
        new = simulator.simulate(model, specimen, protocol, parameters[again], stresses=stresses)
        done = _merged(done, again, new)
    return done


def _merged(done: Simulated, at: Array, new: Simulated) -> Simulated:
    """``done`` with the rows ``at`` replaced by those of ``new``."""
    messages = list(done.messages)
    for row, message in zip(at.tolist(), new.messages, strict=True):
        messages[row] = message
    changed: dict[str, Any] = {"messages": tuple(messages)}
    for name in ("force_N", "status", "matrix_MPa", "fibre_MPa"):
        if (values := getattr(done, name)) is not None:
            changed[name] = values.copy()
            changed[name][at] = getattr(new, name)
    changed["outputs"] = {name: values.copy() for name, values in done.outputs.items()}
    for name, values in changed["outputs"].items():
        values[at] = new.outputs[name]
    return replace(done, **changed)
