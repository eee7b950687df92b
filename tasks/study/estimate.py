"""How long a study will take, before its first evaluation: what each task has to do, times what was just measured."""

import statistics
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from sinew.runner.errors import BadInput, one_line
from sinew.runner.evaluation.batch import Evaluation
from sinew.tasks.model import Specimen
from sinew.tasks.registry import TASKS
from sinew.tasks.simulate import Simulator
from sinew.tasks.simulate.build import simulator_of
from sinew.tasks.simulate.evaluation import SpecimenEvaluation
from sinew.tasks.study.files import digest
from sinew.tasks.study.model import model_of
from sinew.tasks.study.provenance import identities, made_for
from sinew.tasks.study.study import Study
from sinew.tasks.study.work import Given, Work, points
from sinew.tasks.study.workspace import check_cohort, check_ranges

START_S = 2.0  # a local cluster starts
TASK_S = 0.5  # figures and tables of a task
PAGE_S = 3.0  # the page of all results, at the end
SENT, SENT_QUICK = 0.95, 0.85  # share of the workers' time in which they evaluate: solvers, embedded simulator
PILOT_ROWS, PILOT_ROUNDS = 256, 5
PILOT_POINTS = 10**7  # of all rows of a round, at most
REFERENCE_S = 0.0092  # what `_fixed_work` takes on the machine of docs/benchmarks.md


@dataclass(frozen=True)
class TaskEstimate:
    """What a task takes: ``evaluations`` by the simulator, ``wall_s`` seconds; ``done``: its result is there."""

    task: str
    evaluations: int
    wall_s: float
    done: bool


@dataclass(frozen=True)
class Estimate:
    """What a study takes with ``workers`` local workers (None: on a cluster, for one slot), to a factor of two.

    ``row_s``: seconds of an evaluation of the specimen that was tried.
    """

    tasks: tuple[TaskEstimate, ...]
    workers: int | None
    row_s: float

    @property
    def wall_s(self) -> float:
        """Seconds of all that is not done yet."""
        waiting = [one.wall_s for one in self.tasks if not one.done]
        return START_S + sum(waiting) + PAGE_S if waiting else 0.0


def estimate_of(
    study: Study, tasks: Sequence[str], out: Path, workers: int | None, *, data: Path | None, simulator: str | None
) -> Estimate:
    """The estimate of a study that is not open; the model is evaluated, in a folder that is removed again.

    Raises :class:`BadInput` for what `run` would refuse, and when the model fails at its reference values.
    """
    cohort = check_cohort(study, data, out)
    model = model_of(study.model, study.simulator.law)
    with TemporaryDirectory(prefix="sinew-") as scratch:
        chosen = simulator_of(study, simulator, Path(scratch))
        check_ranges(study, cohort, out)
        return estimate(Given(study, cohort, model, chosen.capabilities), chosen, tasks, out, workers)


def estimate(given: Given, simulator: Simulator, tasks: Sequence[str], out: Path, workers: int | None) -> Estimate:
    """The estimate of ``tasks``; those whose result is in ``out`` are taken as done, if it is of these specimens."""
    tried = sorted(given.cohort.specimens, key=points)[len(given.cohort.specimens) // 2]
    row_s = _row_s(given, simulator, tried)
    slower = _slower()
    by_name = {one.name: row_s * points(one) / points(tried) for one in given.cohort.specimens}

    def wall_s(work: Work) -> float:
        share = SENT_QUICK if given.can.quick else SENT
        rows_s = sum(count * by_name[name] for name, count in work.rows.items()) / share
        return TASK_S + work.here_s * slower + (rows_s + work.shared_s * slower) / (workers or 1)

    found = []
    others = made_for(out) not in (None, digest(identities(given.cohort.specimens)))
    for name in tasks:
        work = work_of(given, name)
        done = not others and (out / f"{name}.json").is_file()
        found.append(TaskEstimate(name, work.evaluations, wall_s(work), done))
    return Estimate(tuple(found), workers, row_s)


def work_of(given: Given, name: str) -> Work:
    """What a task will have to do."""
    task = TASKS[name]
    found: Work = task.module("work").work(given, given.study.section(task.settings))
    return found


def _row_s(given: Given, simulator: Simulator, specimen: Specimen) -> float:
    """Seconds that an evaluation of a specimen takes in one process: measured."""
    model = given.model
    evaluation = SpecimenEvaluation(model, specimen, simulator, given.study.store.points_per_curve)
    reference = np.array([[parameter.reference for parameter in model.parameters]])
    if not given.can.quick:
        return _seconds(evaluation, reference, given)
    count = max(1, min(PILOT_ROWS, PILOT_POINTS // points(specimen)))
    rows = np.repeat(reference, count, axis=0)
    _seconds(evaluation, rows[:64], given)  # the compiled kernel is loaded
    return statistics.median(_seconds(evaluation, rows, given) for _ in range(PILOT_ROUNDS)) / count


def _seconds(evaluation: Evaluation, rows: np.ndarray, given: Given) -> float:
    started = time.perf_counter()
    outcome = evaluation(rows)
    seconds = time.perf_counter() - started
    if outcome.status.any():
        why = one_line(next(message for message in outcome.messages if message))
        problem = f"the model fails at its reference values: {why}"
        raise BadInput(given.study.path, problem, "`sinew doctor` on this study, or other reference values")
    return seconds


def _slower() -> float:
    """How many times slower this machine is than that of docs/benchmarks.md, now."""
    return statistics.median(_fixed_work() for _ in range(PILOT_ROUNDS)) / REFERENCE_S


def _fixed_work() -> float:
    """Seconds of a fixed work of both kinds, Python's own and numpy's, on one core."""
    started = time.perf_counter()
    total = 0
    for i in range(200_000):
        total += i % 7
    values = np.sin(np.arange(200_000.0))
    for _ in range(2):
        np.sort(values)
    return time.perf_counter() - started
