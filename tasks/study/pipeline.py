"""Run a study's tasks in order, draw their figures, and print a summary of each."""

import logging
import time
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

from sinew.runner.cluster.local import Local
from sinew.runner.console import Console
from sinew.runner.errors import BadInput, ClusterError, SinewError, StoreError, brief, one_line
from sinew.runner.evaluation.interim import STATES
from sinew.runner.files import remove_folder
from sinew.runner.printing import put
from sinew.runner.store.repair import Repaired
from sinew.runner.store.store import Store, open_store
from sinew.tasks.drawing.blocks import duration
from sinew.tasks.drawing.formats import FORMATS
from sinew.tasks.registry import TASKS
from sinew.tasks.report.status import PAGE, current_page
from sinew.tasks.study import provenance
from sinew.tasks.study.estimate import estimate
from sinew.tasks.study.files import digest, read_json, write_json
from sinew.tasks.study.resources import DISTRIBUTION
from sinew.tasks.study.study import Study
from sinew.tasks.study.work import Given
from sinew.tasks.study.workspace import Workspace, attempts_folder, check_folder

DRAWN = ".drawn.json"  # in the folder of the figures: which results they and the page show
NO_TASK_CAN = (ClusterError, StoreError, OSError)  # no later task would fare better

WORTH_SAYING_S = 10.0  # of an estimate

log = logging.getLogger("sinew")


def check(study: Study, out: Path, tasks: Sequence[str], *, data: Path | None = None, **flags: bool) -> None:
    """Refuse what cannot work before anything is written; ``flags`` are those of the tasks' commands.

    Raises :class:`BadInput`.
    """
    for name in tasks:
        task = TASKS[name]
        if task.measured:
            if study.protocols is not None and data is None:
                raise BadInput(f"{study.path}: cohort", f"missing, and {name} needs measured curves", "a cohort folder")
            if not study.simulator.gives_force:
                expected = "the name of the output that is compared with measured forces"
                raise BadInput(f"{study.path}: simulator.force", f"missing, and {name} needs it", expected)
    check_folder(out)
    for name in tasks:
        if (own := getattr(TASKS[name].module("settings"), "check", None)) is not None:
            own(study, out, **_flags(name, flags))
    for name in tasks:
        before = TASKS[name].needed(study)
        if before is not None and before not in tasks and read_json(out / f"{before}.json") is None:
            raise BadInput(out / f"{before}.json", "is not there", f"`sinew {before}` on this study first")


def run(workspace: Workspace, tasks: Sequence[str], *, figures: bool = True, **flags: bool) -> dict[str, Any]:
    """Run tasks, draw figures, print summaries; what is done already is not done again. Returns results by task.

    A task that fails does not stop those that do not need its result; at the end its error is raised, the first of
    several. An error of the store, the disk or the cluster ends the run at once.
    """
    console = workspace.console
    log.info("run started", extra={"tasks": list(tasks), **provenance.facts(workspace)})
    for remark in workspace.ranges.remarks() if workspace.ranges is not None else ():
        log.warning("ranges", extra={"remark": remark})
        console.print(remark)
    _say_how_long(workspace, tasks)
    results = {}
    errors: dict[str, Exception] = {}
    states = dict.fromkeys(tasks, "waiting")
    for name in tasks:
        if (before := _failed_before(workspace.study, name, errors)) is not None:
            states[name] = "not run"
            log.warning("task not run", extra={"task": name, "needs": before})
            continue
        states[name] = "running"
        workspace.board.put(tasks=dict(states), task=name, task_since=round(time.time(), 1))
        try:
            results[name] = _run_one(workspace, name, console, figures=figures, flags=_flags(name, flags))
        except Exception as error:  # noqa: BLE001 - it is raised again once the other tasks have run
            states[name] = "failed"
            errors[name] = error
            log.error("task failed", extra={"task": name, "reason": one_line(_why(error))})
            if isinstance(error, NO_TASK_CAN):
                break
            _say_what_goes_on(workspace, name, tasks[tasks.index(name) + 1 :], errors)
        else:
            states[name] = "finished"
    workspace.board.put(tasks=dict(states))
    if errors:
        report(workspace.out, console, silent=True)
        _remember(workspace.out, {PAGE: None})  # the page tells of a failure: the next run builds it anew
        raise _to_raise(errors)
    if set(tasks) >= set(workspace.study.tasks):
        remove_folder(attempts_folder(workspace.out) / STATES)  # of rows that no task asks for any more
    where = _page(workspace, console) if figures else None
    page = "" if where is None else f"{where.name} to read, "
    console.print(f"results: {workspace.out}  ({page}figures in {workspace.out / 'figures'}, arrays in store.zarr)")
    return results


def _say_how_long(workspace: Workspace, tasks: Sequence[str]) -> None:
    """Tell what the run will take, where trying the model takes no time and the workers are known.

    A run of a solver is not made for this: `sinew run --dry-run` makes one.
    """
    waiting = [name for name in tasks if not (workspace.out / f"{name}.json").is_file()]
    can, cluster = workspace.simulator.capabilities, workspace.cluster
    if not waiting or not can.quick or not isinstance(cluster, Local):
        return
    given = Given(workspace.study, workspace.cohort, workspace.model, can)
    try:
        found = estimate(given, workspace.simulator, waiting, workspace.out, cluster.workers)
    except BadInput as error:  # the model fails at its reference values; its rows will tell
        log.warning("no estimate", extra={"reason": str(error)})
        return
    expected = {one.task: round(one.wall_s, 1) for one in found.tasks}
    workspace.board.put(expected_s=expected)
    workspace.event("estimate", seconds=round(found.wall_s, 1), tasks=expected)
    if found.wall_s >= WORTH_SAYING_S:
        longest = sorted(found.tasks, key=lambda one: -one.wall_s)[:3]
        parts = ", ".join(f"{one.task} {duration(round(one.wall_s))}" for one in longest)
        workspace.say(f"this will take about {duration(round(found.wall_s))} ({parts}), within a factor of two\n")


def _to_raise(errors: Mapping[str, Exception]) -> Exception:
    """The error that ends the run: what ended it early, else the first one. The others are printed."""
    *_, last = errors.values()
    raised = last if isinstance(last, NO_TASK_CAN) else next(iter(errors.values()))
    for name, error in errors.items():
        if error is not raised:
            put(f"sinew: {name} failed: {brief(_why(error))}", error=True)
    return raised


def _failed_before(study: Study, name: str, errors: Mapping[str, Exception]) -> str | None:
    """The failed task whose result a task needs, directly or through others; None where there is none."""
    before = TASKS[name].needed(study)
    while before is not None and before not in errors:
        before = TASKS[before].needed(study)
    return before


def _why(error: Exception) -> str:
    return str(error) if isinstance(error, SinewError) else f"{type(error).__name__}: {error}"


def _say_what_goes_on(workspace: Workspace, name: str, others: Sequence[str], errors: Mapping[str, Exception]) -> None:
    """Tell of a task that has just failed while others run; its error is also printed at the end."""
    why = one_line(_why(errors[name]))
    workspace.event("task failed", task=name, reason=why)
    later = [other for other in others if _failed_before(workspace.study, other, errors) is None]
    if later and not workspace.quiet:
        put(f"sinew: {name} failed: {brief(why)}; going on with {', '.join(later)}", error=True)


def _flags(name: str, flags: Mapping[str, bool]) -> dict[str, bool]:
    """Those of the flags that a task has."""
    return {flag: value for flag, value in flags.items() if flag in TASKS[name].flags}


def _run_one(workspace: Workspace, name: str, console: Console, *, figures: bool, flags: Mapping[str, bool]) -> Any:
    task = TASKS[name]
    started = time.monotonic()
    workspace.event("task started", task=name)
    log.info("task started", extra={"task": name})
    simulations, counted = workspace.simulations, dict(workspace.counted)
    result = task.module("task").run(workspace, workspace.study.section(task.settings), **flags)
    seconds = time.monotonic() - started
    if figures:
        _draw(workspace, name, result)
    new = workspace.simulations - simulations
    facts = {"task": name, "seconds": round(seconds, 3), "new_simulations": new}
    workspace.event("task finished", **facts, result=str(workspace.out / f"{name}.json"))
    log.info("task finished", extra=facts)
    task.module("show").summary(result, workspace.out, console)
    other = {what: count - counted.get(what, 0) for what, count in workspace.counted.items()}
    done = [f"{count:,} {what}" for what, count in other.items() if count]
    if new or not done:
        done.insert(0, f"{new:,} new evaluations")
    console.print(f"{name}: {', '.join(done)} in {seconds:.1f} s\n")
    return result


def _page(workspace: Workspace, console: Console) -> Path | None:
    """The page of the results; it is built anew unless it shows these very results already."""
    program, page = provenance.code(), current_page(workspace.out)
    if page is not None and not workspace.simulations and _remembered(workspace.out).get(PAGE) == program:
        return page
    page = report(workspace.out, console)
    _remember(workspace.out, {PAGE: program if page else None})
    return page


def report(folder: Path, console: Console, *, silent: bool = False) -> Path | None:
    """Build the page of a result folder; a page that cannot be built is one line and ends nothing.

    ``silent``: another error will be shown, to which this one would add nothing.
    """
    from sinew.tasks.report.page import build  # Bokeh is slow to import, and only this needs it

    try:
        built = build(folder)
    except Exception as error:  # noqa: BLE001 - a run with results must not fail for its page
        why = one_line(str(error) or type(error).__name__)
        log.error("report failed", extra={"reason": why})
        if not silent:
            again = f"`sinew report {folder}` tries again"
            put(f"sinew: the report of {folder} was not built ({why}); {again}", error=True)
        return None
    for line in built.trouble:
        console.print(f"report: {line}", soft_wrap=True)
    return built.path


def _draw(workspace: Workspace, name: str, result: Any) -> None:
    """The figures of a task, whose names begin with its own, unless they are there and show this very result."""
    folder = workspace.out / "figures"
    shown = digest(version(DISTRIBUTION), FORMATS, (workspace.out / f"{name}.json").read_text("utf-8"))
    drawn = _remembered(workspace.out)

    def there() -> dict[str, Any]:
        return {"shows": shown, "files": sorted(path.name for path in folder.glob(f"{name}*"))}

    if drawn.get(name) != there():
        try:
            TASKS[name].module("figures").draw(workspace, result)
        except (SinewError, OSError):
            raise
        except Exception as error:  # what is raised for numbers and names that nobody expects is no closed list
            words = brief(f"its figures cannot be drawn ({type(error).__name__}: {error})", 200)
            expected = "numbers as sinew writes them, names without $; delete it, and it is made again"
            raise BadInput(workspace.out / f"{name}.json", words, expected) from error
        _remember(workspace.out, {name: there()})


def _remembered(out: Path) -> dict[str, Any]:
    """Which results the figures of each task show, and which program built the page."""
    return read_json(out / "figures" / DRAWN) or {}


def _remember(out: Path, shown: Mapping[str, Any]) -> None:
    (out / "figures").mkdir(exist_ok=True)
    remembered = _remembered(out) | dict(shown)
    write_json(out / "figures" / DRAWN, dict(sorted(remembered.items())))  # an interrupted run remembers in other order


def repair(folder: Path) -> Repaired:
    """Make rows in damaged chunks pending."""
    study = open_store(folder).study
    with Store.writing(folder, study) as store:
        return store.repair()
