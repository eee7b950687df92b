"""Sobol indices of a study: plan and evaluate a design, analyse it, commit.

The indices are of the objectives (or outputs) in total, by protocol and by specimen, and along time of the force and of
a template's other outputs. The store keeps ``sobol`` (indices and convergence) and ``sobol_time/SPECIMEN``.
"""

import logging
from dataclasses import replace

from sinew.runner.errors import BadInput
from sinew.tasks.simulate.saltelli import saltelli, scrambles_of
from sinew.tasks.sobol.analysed import analysed, known, ran
from sinew.tasks.sobol.by_runs import by_surrogate
from sinew.tasks.sobol.estimate import estimator
from sinew.tasks.sobol.evaluated import Evaluated
from sinew.tasks.sobol.method import Intervals
from sinew.tasks.sobol.result import SobolResult
from sinew.tasks.sobol.settings import Settings
from sinew.tasks.sobol.work import base_of
from sinew.tasks.study.files import digest
from sinew.tasks.study.workspace import Workspace

log = logging.getLogger("sinew")


def run(workspace: Workspace, settings: Settings, *, extend: bool = False) -> SobolResult:
    """Sobol indices of the study; ``extend`` doubles the base samples of the last result."""
    if settings.method != "saltelli":
        return by_surrogate(workspace, settings)
    previous = _extended(workspace) if extend else None
    base = base_of(settings, settings.count(workspace.model)) if previous is None else 2 * previous.base_samples
    if not extend and settings.points is not None:
        _say_size(workspace, settings, base)
    scrambles = scrambles_of(base, settings.scrambles) if previous is None else previous.scrambles
    design = saltelli(workspace.model, base, settings.second_order, workspace.seed, scrambles, settings.inputs)
    drawn = digest(design.rows)
    specimens = workspace.specimens(settings.specimens, "sobol.specimens")
    log.info("sobol", extra={"rows": len(design.rows), "base_samples": base, "specimens": len(specimens)})
    planned = [Evaluated(one, *workspace.plan(one, design.rows)) for one in map(workspace.evaluation, specimens)]
    features = design.features()
    design = replace(design, rows=design.rows[:0])  # they are in the store now; a large design need not stay in memory
    for one in planned:
        workspace.evaluate(one.evaluation, one.table, one.at, f"sobol {one.specimen.name}")
    inputs, last = known(workspace, settings, drawn, planned)
    if last is not None:
        return last
    intervals = Intervals(settings.resamples, settings.confidence, workspace.seed)
    return analysed(workspace, settings, estimator(design, features, ran(planned), intervals), planned, inputs)


def _extended(workspace: Workspace) -> SobolResult:
    """The result that is extended; its sequences are kept.

    Raises :class:`BadInput` for a design that this program does not draw.
    """
    previous = SobolResult.read(workspace.out)
    assert previous is not None, "checked before the store was opened"
    if not previous.has_design:
        problem = f"{previous.base_samples:,} base samples of {previous.scrambles:,} scrambles"
        raise BadInput(SobolResult.path(workspace.out), problem, "what `sinew sobol` writes; run it again")
    return previous


def _say_size(workspace: Workspace, settings: Settings, base: int) -> None:
    count = settings.count(workspace.model)
    rows = base * settings.block(count)
    workspace.say(
        f"sobol: {settings.points:,} points asked; the next power of two is {base:,} base samples, "
        f"{rows:,} rows for {count} {'groups' if settings.groups else 'parameters'}"
    )
