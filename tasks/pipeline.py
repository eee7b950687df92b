"""Run a study's tasks in order, draw their figures, and tell a person what came out."""

import logging
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table as Grid

from runner.errors import SinewError, WalltimeReached
from runner.store import Store, open_store
from tasks import provenance
from tasks.calibrate import calibrate, fitted_curves, often_on_bound
from tasks.discover.discover import discover
from tasks.importance import importance
from tasks.infer import infer
from tasks.model import file_name
from tasks.predict import predict
from tasks.problems import BadInput, one_line
from tasks.report import calibration, discovery, figures, posterior, prediction, site_figures, tables
from tasks.report.blocks import beyond, listed
from tasks.report.figures import FORMATS
from tasks.report.frames import courses
from tasks.sensitivity import base_samples, sobol
from tasks.sites import compare
from tasks.study import NEEDS, Study
from tasks.workspace import Workspace, check_folder, digest, read_result, write_json

DRAWN = ".drawn.json"  # in the folder of the figures: which results they show

log = logging.getLogger("sinew")


@dataclass(frozen=True)
class _Task:
    work: Callable[..., dict[str, Any]]
    draw: Callable[[Workspace, dict[str, Any]], None]
    tell: Callable[[Workspace, dict[str, Any], Console], None]


def check(study: Study, out: Path, tasks: Sequence[str], *, data: Path | None = None, extend: bool = False) -> None:
    """Refuse what cannot work before anything is written. Raises :class:`BadInput`."""
    for task in tasks:
        if task == "discover" and study.templated:
            problem = "discover names effects of sinew's own tissue, which a template is not"
            raise BadInput(f"{study.path}: tasks", problem, "simulator: uniaxial or febio")
        if task in ("calibrate", "infer", "predict", "compare") and study.templated:
            if study.protocols is not None and data is None:
                raise BadInput(f"{study.path}: cohort", f"missing, and {task} needs measured curves", "a cohort folder")
            if study.force is None:
                expected = "the name of the output that is compared with measured forces"
                raise BadInput(f"{study.path}: simulator.force", f"missing, and {task} needs it", expected)
    check_folder(out)
    finished = read_result(out / "sobol.json") is not None
    if "sobol" in tasks and len(study.tendon().free) < 2:
        raise BadInput(f"{study.path}: model.parameters", "one free parameter", "at least two for Sobol indices")
    if extend and not finished:
        raise BadInput(out / "sobol.json", "is not there", "a finished `sinew sobol` to extend")
    for task, before in NEEDS.items():
        if task in tasks and before not in tasks and read_result(out / f"{before}.json") is None:
            raise BadInput(out / f"{before}.json", "is not there", f"`sinew {before}` on this study first")


def run(
    workspace: Workspace, tasks: Sequence[str], *, figures: bool = True, **options: Any
) -> dict[str, dict[str, Any]]:
    """Run tasks, draw figures, print a summary; what is done already is not done again. Returns results by task."""
    console = Console(quiet=workspace.quiet, highlight=False)
    log.info("run started", extra={"tasks": list(tasks), **provenance.facts(workspace)})
    results = {}
    states = dict.fromkeys(tasks, "waiting")
    for name in tasks:
        states[name] = "running"
        workspace.board.put(tasks=dict(states), task=name)
        try:
            results[name] = _run_one(workspace, name, console, figures=figures, **options)
        except WalltimeReached:  # there is no time left for a page
            raise
        except Exception as error:
            why = str(error) if isinstance(error, SinewError) else f"{type(error).__name__}: {error}"
            log.error("task failed", extra={"task": name, "reason": one_line(why)})
            report(workspace.out, console, beside=True)
            raise
        states[name] = "finished"
        workspace.board.put(tasks=dict(states))
    where = report(workspace.out, console) if figures else None
    page = "" if where is None else f"{where.name} to read, "
    console.print(
        f"results: {workspace.out}  ({page}figures in {workspace.out / 'figures'}, arrays in store.zarr)", markup=False
    )
    return results


def _run_one(workspace: Workspace, name: str, console: Console, *, figures: bool, **options: Any) -> dict[str, Any]:
    task = _TASKS[name]
    started = time.monotonic()
    workspace.event("task started", task=name)
    log.info("task started", extra={"task": name})
    if name == "sobol" and not options.get("extend"):
        _say_size(workspace, console)
    simulations = workspace.simulations
    result = task.work(workspace, **options)
    seconds = time.monotonic() - started
    if figures:
        _draw(workspace, name, result)
    new = workspace.simulations - simulations
    told = {"task": name, "seconds": round(seconds, 3), "new_simulations": new}
    workspace.event("task finished", **told, result=str(workspace.out / f"{name}.json"))
    log.info("task finished", extra=told)
    task.tell(workspace, result, console)
    console.print(f"{name}: {new:,} new evaluations in {seconds:.1f} s\n")
    return result


def report(folder: Path, console: Console, *, beside: bool = False) -> Path | None:
    """Build the page of a result folder; what goes wrong is told in one line and ends nothing.

    ``beside``: an error of its own will be told, to which this would add nothing.
    """
    from tasks.report.page import build  # Bokeh is slow to import, and only this needs it

    try:
        built = build(folder)
    except Exception as error:  # noqa: BLE001 - a run with results must not fail for its page
        why = one_line(str(error) or type(error).__name__)
        log.error("report failed", extra={"reason": why})
        if not beside:
            again = f"`sinew report {folder}` tries again"
            print(f"sinew: the report of {folder} was not built ({why}); {again}", file=sys.stderr)
        return None
    for line in built.trouble:
        console.print(f"report: {line}", markup=False, soft_wrap=True)
    return built.path


def _draw(workspace: Workspace, name: str, result: dict[str, Any]) -> None:
    """The figures of a task, whose names begin with its own, unless they are there and show this very result."""
    folder = workspace.out / "figures"
    shown = digest(version("sinew"), FORMATS, (workspace.out / f"{name}.json").read_text("utf-8"))
    drawn = read_result(folder / DRAWN) or {}

    def there() -> dict[str, Any]:
        return {"shows": shown, "files": sorted(path.name for path in folder.glob(f"{name}*"))}

    if drawn.get(name) != there():
        _TASKS[name].draw(workspace, result)
        write_json(folder / DRAWN, drawn | {name: there()})


def repair(folder: Path) -> int:
    """Make rows in damaged chunks pending; returns how many."""
    study = open_store(folder).study
    with Store.writing(folder, study) as store:
        return store.repair()


def _say_size(workspace: Workspace, console: Console) -> None:
    settings = workspace.study.sobol
    if settings.points is not None:
        count = len(workspace.model.free)
        base = base_samples(settings.points, count, settings.second_order)
        rows = base * ((2 if settings.second_order else 1) * count + 2)
        console.print(
            f"sobol: {settings.points:,} points asked; the next power of two is {base:,} base samples, "
            f"{rows:,} rows for {count} parameters"
        )


def _draw_sobol(workspace: Workspace, result: dict[str, Any]) -> None:
    folder = workspace.out / "figures"
    figures.save(figures.sobol_indices(result), folder, "sobol", tables.sobol(result))
    shown = tables.sobol_convergence(result)
    figures.save(figures.sobol_convergence(result), folder, "sobol_convergence", shown)
    for specimen, output in courses(result).values():
        name = result["tables"][specimen]
        dataset = workspace.store.read_result(f"sobol_time/{name}")
        figure = figures.sobol_along_time(dataset, result["names"], output)
        ending = "" if output is None else f"_{output}"
        figures.save(figure, folder, f"sobol_time_{name}{ending}", tables.sobol_along_time(dataset, output))


def _tell_sobol(workspace: Workspace, result: dict[str, Any], console: Console) -> None:
    grid = Grid("parameter", "S1", "ST", *result["protocols"], title=f"Sobol indices of the {result['objective']}")
    order = np.argsort(-np.nan_to_num(np.array(result["ST"], dtype=float)))
    for j in order:
        cells = [_with_interval(result, key, j) for key in ("S1", "ST")]
        cells += [_with_interval(values, "ST", j) for values in result["protocols"].values()]
        grid.add_row(result["names"][j], *cells)
    console.print(grid)
    console.print(f"{round(100 * result['confidence'])} % intervals; columns of protocols show ST")
    if "outputs" in result:
        _tell_outputs(result, console)
    if result["failed"]:
        failures = result["failures"]
        reported = {key: np.array(result[key], dtype=float) for key in ("S1", "ST")}
        moved = max(
            float(np.max(np.abs(np.array(failures[f"{key}_if_{value}"], dtype=float) - reported[key])))
            for key in reported
            for value in ("smallest", "mean", "largest")
        )
        console.print(
            f"[red]{result['failed']:,} of {result['rows']:,} rows failed[/red]; {failures['rule']} "
            f"({failures['base_samples_left_out']:,} of {result['base_samples']:,}); giving all of them the smallest, "
            f"the mean or the largest outcome moves an index by up to {moved:.3f} (not a bound)"
        )


def _tell_outputs(result: dict[str, Any], console: Console) -> None:
    outputs = result["outputs"]
    heads = [f"{name} ({told['summary']}, {told['unit']})" for name, told in outputs.items()]
    grid = Grid("parameter", *heads, title="Total order Sobol indices of each output, summed over the protocols")
    for j, name in enumerate(result["names"]):
        grid.add_row(name, *(_with_interval(told, "ST", j) for told in outputs.values()))
    console.print(grid)


def _with_interval(values: dict[str, Any], key: str, j: int) -> str:
    value, conf = values[key][j], values[f"{key}_conf"][j]
    return "does not vary" if value is None or not np.isfinite(value) else f"{value:.3f} ± {conf:.3f}"


def _draw_importance(workspace: Workspace, result: dict[str, Any]) -> None:
    folder = workspace.out / "figures"
    figures.save(figures.forest_importance(result), folder, "importance", tables.importance(result))


def _tell_importance(workspace: Workspace, result: dict[str, Any], console: Console) -> None:
    grid = Grid("parameter", "impurity (%)", "permutation", title=f"Random forest importance, {result['objective']}")
    for j in np.argsort(-np.array(result["permutation"])):
        grid.add_row(
            result["names"][j],
            f"{result['impurity_percent'][j]:.1f} ± {result['impurity_sd'][j]:.1f}",
            f"{result['permutation'][j]:.4f} ± {result['permutation_sd'][j]:.4f}",
        )
    console.print(grid)
    console.print(f"R2 on unseen base samples {result['r2_on_unseen']:.3f}; no new simulations")


def _draw_calibrate(workspace: Workspace, result: dict[str, Any]) -> None:
    folder = workspace.out / "figures"
    shown = tables.calibration_convergence(result)
    figures.save(figures.calibration_convergence(result), folder, "calibrate_convergence", shown)
    for specimen in workspace.cohort.specimens:
        told = result["specimens"].get(specimen.name)
        if told is not None:
            forces = fitted_curves(workspace, specimen, told["parameters"])
            figure = figures.fitted_curves(specimen, forces, told["rmse_N"])
            shown = tables.fitted_curves(specimen, forces)
            figures.save(figure, folder, f"calibrate_{file_name(specimen.name)}", shown)
    calibration.draw(workspace, result)


def _draw_infer(workspace: Workspace, result: dict[str, Any]) -> None:
    folder = workspace.out / "figures"
    for site in result["sites"]:
        particles = workspace.store.read_result(f"infer/{site}")
        shown = tables.posterior(particles, result, site)
        for name, figure in posterior.figures_of(particles, result, site).items():
            figures.save(figure, folder, f"infer_{site}_{name}", shown[name])


def _tell_infer(workspace: Workspace, result: dict[str, Any], console: Console) -> None:
    sites = result["sites"]
    percent = round(100 * result["interval"])
    grid = Grid("parameter", *sites, title=f"Posterior: mean ± sd ({percent} % HDI)")
    for name in result["names"]:
        cells = []
        for told in sites.values():
            found = told["parameters"][name]
            low, high = found["hdi"]
            cells.append(f"{found['mean']:.4g} ± {found['sd']:.3g} ({low:.4g}, {high:.4g})")
        grid.add_row(name, *cells)
    console.print(grid)
    for site, told in sites.items():
        last, judged = told["epsilon"][-1], sum(g["judged"] for g in told["generations"])
        console.print(
            f"{site}: {len(told['generations'])} generations, {judged:,} proposals, threshold {last:.3g}, "
            f"effective sample size {told['effective_sample_size']:.0f} of {result['population']}"
        )


def _tell_calibrate(workspace: Workspace, result: dict[str, Any], console: Console) -> None:
    grid = Grid(
        "specimen", "RMSEs together (N)", "noise (N)", "above", "on a bound", "not determined", title="Calibration"
    )
    for name, told in result["specimens"].items():
        noise = "unknown" if told["noise_N"] is None else f"{told['noise_N']:.4g}"
        free = [parameter for parameter in result["free"] if parameter not in told["determined"]]
        cells = (
            f"{told['total_N']:.4g}",
            noise,
            beyond(told["above_noise"]),
            listed(told["on_bound"], 3),
            listed(free, 3),
        )
        grid.add_row(name, *cells)
    console.print(grid)
    console.print("RMSEs and noise are sums over protocols; above: how far a fit stopped above the noise of its curves")
    if told := often_on_bound(result):
        console.print(told, markup=False)


_TASKS = {
    "sobol": _Task(sobol, _draw_sobol, _tell_sobol),
    "importance": _Task(lambda workspace, **_: importance(workspace), _draw_importance, _tell_importance),
    "calibrate": _Task(lambda workspace, **_: calibrate(workspace), _draw_calibrate, _tell_calibrate),
    "infer": _Task(lambda workspace, **_: infer(workspace), _draw_infer, _tell_infer),
    "predict": _Task(lambda workspace, **_: predict(workspace), prediction.draw, prediction.tell),
    "compare": _Task(lambda workspace, **_: compare(workspace), site_figures.draw, site_figures.tell),
    "discover": _Task(lambda workspace, **_: discover(workspace), discovery.draw, discovery.tell),
}
