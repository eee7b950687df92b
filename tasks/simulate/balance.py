"""A specimen in a machine that gives way: runs along a displacement until it agrees with the force that it causes.

Each run is followed by the balance of the machine with a linear specimen that answers as the runs so far have shown (a
quasi-Newton method; Fang and Saad 2009).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sinew.runner.evaluation.batch import RETRIED
from sinew.tasks.simulate import Array
from sinew.tasks.simulate.linear_specimens import LinearSpecimens, Response, Run
from sinew.tasks.simulate.machines import Machines
from sinew.tasks.simulate.row_by_row import Failed

RUNS = 60  # of the simulator for one curve, at most
EXACT, LINEAR = 1e-5, 3e-6  # of the largest displacement, which may remain: of a run, and of a step from one
KNOWN, GUESSED = 0.03, 0.3  # relative errors of the answer to a step as runs have shown it, and without them; roughly
NOT_SO_NEAR = ("diverged", "bad_input")  # where a start from another balance may be to blame

Ask = Callable[[Array], Array]
"""Outputs ``[1 + k, t]`` along a displacement ``[t]`` (mm), the force (N) first. Raises :class:`Failed`."""


@dataclass(frozen=True, eq=False)
class Balance:
    """A ``machine`` in balance with a specimen: the outputs ``[1 + k, t]`` as they are read.

    ``last``: the last run on the way to it; ``response``: of the specimen, as far as it is known then.
    """

    machine: Machines
    courses: Array
    last: Run
    response: Response


Start = tuple[Array, Response]
"""A displacement ``[t]`` (mm) to begin with, and how the specimen answers there."""


def balance(machine: Machines, ask: Ask, start: Start | None = None, *, linear: bool = False) -> Balance:
    """The ``machine`` in balance with the specimen that ``ask`` runs.

    ``linear``: a last small step is taken without a run where its answer is known. Raises :class:`Failed`.
    """
    try:
        return _balanced(machine, ask, start, linear=linear)
    except Failed as failed:
        if start is None or failed.status not in NOT_SO_NEAR:
            raise
        return _balanced(machine, ask, None, linear=linear)


def _balanced(machine: Machines, ask: Ask, start: Start | None, *, linear: bool) -> Balance:
    """As :func:`balance`, with a start or without. Raises :class:`Failed`."""
    if not machine.gives_way:
        run = run_along(ask, machine.at_rest()[0])
        return _ended(machine, run, run, Response.first(run, machine.largest_mm))
    largest = machine.largest_mm
    if start is None or machine.asks_rigid:
        run = run_along(ask, machine.at_grips()[0])
        machine, response = machine.with_rigid(run.courses[:1]), Response.first(run, largest)
    if start is not None:
        run, response = run_along(ask, start[0]), start[1]
    residual = _residual(machine, run)
    part, runs = 1.0, 1
    while np.abs(residual).max() > (0.0 if linear else EXACT) * largest:
        specimen = LinearSpecimens.of(run, response)
        to = machine.in_balance(specimen)
        step, there = to[0] - run.displacement_mm, specimen.along(to)
        remains = float(np.abs(machine.left(to, there[:, 0])).max())  # a machine that runs away has no balance
        if linear and remains + _uncertain(response, step) < LINEAR * largest:
            return _ended(machine, Run(to[0], there[0]), run, response)
        if runs == RUNS:
            raise Failed("diverged", f"no balance of force and displacement in {RUNS} runs of the simulator")
        runs += 1
        step = part * step
        try:
            moved = run_along(ask, run.displacement_mm + step)
            left = _residual(machine, moved)
        except Failed as failed:  # a step too far
            if failed.status in RETRIED:
                raise
            nearer = False
        else:
            response = response.after(step, moved.courses - run.courses, largest)
            nearer = bool(np.linalg.norm(left) < np.linalg.norm(residual))
        if nearer:
            run, residual, part = moved, left, min(1.0, 2.0 * part)
        else:
            part = 0.5 * part
    return _ended(machine, run, run, response)


def _uncertain(response: Response, step: Array) -> float:
    """About the largest error of a ``step`` ``[t]`` (mm) that is not run."""
    return float(np.max(KNOWN * np.abs(step) + GUESSED * np.abs(response.to(step[np.newaxis])[1])))


def run_along(ask: Ask, displacement: Array) -> Run:
    """A run of the specimen along a displacement ``[t]`` (mm). Raises :class:`Failed`."""
    if not np.isfinite(displacement).all():
        raise Failed("diverged", "with its effects, the displacement is not a number")
    return Run(displacement, ask(displacement))


def _residual(machine: Machines, run: Run) -> Array:
    """What is left to the specimen, less its displacement ``[t]`` (mm). Raises :class:`Failed`."""
    left = machine.left(run.displacement_mm[np.newaxis], run.courses[:1])[0]
    if not np.isfinite(left).all():
        raise Failed("diverged", "with its effects, the displacement is not a number")
    return left


def _ended(machine: Machines, end: Run, last: Run, response: Response) -> Balance:
    """The balance in which the specimen's outputs are those at the ``end``. Raises :class:`Failed`."""
    read = machine.read(end.displacement_mm[np.newaxis], end.courses[:1])
    if not np.isfinite(read).all():
        raise Failed("diverged", "with its effects, the force is not a number")
    return Balance(machine, np.concatenate([read, end.courses[1:]]), last, response)
