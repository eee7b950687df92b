"""Cohorts drawn from the prior, each inferred blind, and how often posteriors held the truth.

A cohort is written to ``OUT/cohort_0001``, run by `sinew infer` and `sinew compare`, and scored; what stays is
``cohort.json``, so an interrupted benchmark goes on with the cohorts that it still needs. A cohort whose chains do not
converge is counted as refused.
"""

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from sinew.runner.errors import BadInput
from sinew.runner.files import remove_folder
from sinew.tasks.benchmark.blind import refuse_others, refuse_strange, run_blind
from sinew.tasks.benchmark.infer.compared import compared
from sinew.tasks.benchmark.infer.drawn import Conditions, drawn
from sinew.tasks.benchmark.infer.left_out import left_out
from sinew.tasks.benchmark.infer.result import CohortResult, Level, Ranked
from sinew.tasks.benchmark.infer.score import summary
from sinew.tasks.data.cohort import write_cohort
from sinew.tasks.infer.result import AbcResult, LikelihoodResult
from sinew.tasks.infer.settings import Settings, needs
from sinew.tasks.study import streams
from sinew.tasks.study.files import digest, write_json, write_text
from sinew.tasks.study.model import model_of
from sinew.tasks.study.resources import resource
from sinew.tasks.study.result import believed, plain
from sinew.tasks.study.settings_file import as_yaml, from_yaml
from sinew.tasks.study.study import Study, read_study
from sinew.tasks.study.workspace import Workspace, check_folder

STUDY = "configs/infer.yaml"
COHORTS, POINTS = "benchmark of posteriors", "points of TARP"  # random streams

Say = Callable[[str], None]
MADE = ("cohort", "study.yaml", "run", "cohort.json")  # of a cohort


def benchmark(
    out: Path,
    *,
    cohorts: int,
    conditions: Conditions,
    study: Path | None = None,
    workers: int | None = None,
    say: Say = lambda line: None,
) -> dict[str, Any]:
    """Run the cohorts that have no result yet, and score all. Returns ``benchmark.json``.

    ``study``: its model, seed and ``infer`` section are used. Raises :class:`BadInput` before any cohort is run.
    """
    source = study or resource(STUDY)
    read = read_study(source)
    if read.simulator.name != "uniaxial":
        raise BadInput(f"{source}: simulator", read.simulator.name, "uniaxial, which draws the cohorts as well")
    base = from_yaml(source.read_text("utf-8"))
    check_folder(out)
    refuse_strange(out)
    found = []
    for number in range(1, cohorts + 1):
        one = _cohort(out / f"cohort_{number:04d}", number, read, base, conditions, workers)
        found.append(one)
        say(f"{number} of {cohorts}: {_said(one)}")
    with believed(out / "cohort.json"):
        result = {"conditions": plain(conditions), "method": found[0].method, **summary(found)}
    write_json(out / "benchmark.json", result)
    return result


def _said(one: CohortResult) -> str:
    if one.error:
        return f"failed: {one.error}"
    held = sum(each.held for each in one.ranked)
    return f"{held} of {len(one.ranked)} reported intervals hold the truth ({one.seconds:.0f} s)"


def _cohort(
    out: Path, number: int, study: Study, base: dict[str, Any], conditions: Conditions, workers: int | None
) -> CohortResult:
    """The result of a cohort, from before or made now."""
    settings = study.section(Settings)
    method = settings.chosen(quick=True)
    inputs = digest(
        number, study.seed, str(study.model), settings.of(method), vars(conditions), CohortResult.versions(),
        (LikelihoodResult if method == "likelihood" else AbcResult).versions(),
    )  # fmt: skip
    known = CohortResult.read(out)
    if known is not None and known.inputs == inputs and known.number == number:
        return known
    if known is not None:
        raise BadInput(CohortResult.path(out), "is of other settings or another version", "another --out, or delete it")
    refuse_others(out, MADE, "benchmark infer")
    remove_folder(out)
    out.mkdir(parents=True)
    model = model_of(study.model, study.simulator.law)
    rng = streams.generator(study.seed, COHORTS, number)
    specimens, truth = drawn(
        rng, model, conditions, by_likelihood=method == "likelihood", heavy=settings.tails == "heavy"
    )
    write_cohort(out / "cohort", specimens)
    before = needs(study)
    tasks = [*([before] if before else []), "infer", "compare"]
    seed = (study.seed + number) % 2**32
    text = as_yaml({**base, "cohort": str((out / "cohort").resolve()), "tasks": tasks, "seed": seed})
    write_text(out / "study.yaml", text)

    def scored(workspace: Workspace, results: dict[str, Any]) -> CohortResult:
        points = streams.generator(study.seed, POINTS, number)
        ranked: list[Ranked] = []
        tarp: dict[Level, list[float]] = {}
        for one in compared(workspace, results["infer"], truth):
            ranked += one.ranked(number)
            tarp.setdefault(one.level, []).append(one.nearer(points))
        contrasts, inferred = results["compare"].contrasts, results["infer"]
        further = []
        if isinstance(inferred, LikelihoodResult):
            further = left_out(workspace, inferred, truth, specimens, conditions)
        different = sum(one.different for one in contrasts)
        return CohortResult(number, method, ranked, tarp, len(contrasts), different, 0.0, None, inputs, further)

    started = time.monotonic()
    found = run_blind(read_study(out / "study.yaml"), tasks, out / "run", workers, scored, figures=False)
    if isinstance(found, str):
        found = CohortResult(number, method, [], {}, 0, 0, 0.0, found, inputs)
    found = replace(found, seconds=time.monotonic() - started)
    found.write(out)
    for part in ("run", "cohort"):
        remove_folder(out / part)
    return found
