"""Commands that run a study: all of it, one task, or given rows."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from sinew.runner.console import Console
from sinew.runner.errors import BadInput, one_line
from sinew.runner.printing import put
from sinew.tasks.cli.group import PATH, checked_study, folder_of_all, open_study, sinew, study_command, to_see
from sinew.tasks.cli.terminal import command_line, say_next
from sinew.tasks.registry import TASKS, Task

if TYPE_CHECKING:
    from sinew.tasks.study.workspace import Workspace


def _run(study: Path, tasks: Sequence[str] | None, flags: Mapping[str, bool], **options: Any) -> "Workspace":
    """Run tasks of a study (None: the study's); returns its workspace, which is closed."""
    from sinew.tasks.study import pipeline

    workspace: Workspace
    with open_study(study, tasks, flags=flags, **options) as workspace:
        pipeline.run(workspace, workspace.study.tasks if tasks is None else tasks, **flags)
    return workspace


@study_command("run", "Run all tasks of a study, in order.")
@click.option("--dry-run", is_flag=True, help="Say what would be done and how long it takes; write nothing.")
@click.option("--adopt", is_flag=True, help="If discover names an effect, run the other tasks with it as well.")
def run(study: Path, dry_run: bool, adopt: bool, **options: Any) -> None:
    if adopt and options["profile"] is not None:
        raise BadInput("--adopt", "given with --profile", "`sinew submit OUT/discover/model.yaml` after this run")
    if dry_run:
        _say_how_long(study, **options)
        return
    from sinew.tasks.discover.result import ADOPTED, named_study
    from sinew.tasks.study import pipeline

    workspace = _run(study, None, {}, **options)
    others = [task for task in workspace.study.tasks if task != "discover"]
    found = named_study(workspace.out) if "discover" in workspace.study.tasks and others else None
    if found is None or options["profile"] is not None:
        say_next(to_see(workspace.out), as_json=options["as_json"])
    elif adopt:
        adopted = _run(found, others, {}, **options | {"out": workspace.out / ADOPTED})
        pipeline.report(workspace.out, workspace.console)  # its page names the other one from now on
        say_next(to_see(adopted.out), to_see(workspace.out), as_json=options["as_json"])
    else:
        again = [study, "--adopt", *(("--out", options["out"]) if options["out"] else ())]
        say_next(to_see(workspace.out), command_line("run", *again), as_json=options["as_json"])


def _say_how_long(
    study: Path,
    *,
    data: Path | None,
    out: Path | None,
    seed: int | None,
    solver: str | None,
    workers: int | None,
    scheduler: str | None,
    profile: Path | None,
    simulator: str | None,
    as_json: bool,
    **_: Any,
) -> None:
    """Check a study as a run of it would, and print what it would take."""
    from sinew.runner.cluster.local import Local
    from sinew.tasks.cli.watch_screen import estimate_table
    from sinew.tasks.cluster.profile import read_profile
    from sinew.tasks.cluster.spec import cluster_of
    from sinew.tasks.study.estimate import estimate_of

    read, out = checked_study(study, None, out, seed=seed, solver=solver, data=data, flags={})
    cluster = cluster_of(read, workers, scheduler) if profile is None else read_profile(profile)
    slots = cluster.workers if isinstance(cluster, Local) else None
    found = estimate_of(read, read.tasks, out, slots, data=data, simulator=simulator)
    if as_json:
        facts = {"seconds": found.wall_s, "workers": slots, "seconds_per_evaluation": found.row_s}
        put(json.dumps({"event": "estimate", **facts, "tasks": [asdict(one) for one in found.tasks]}))
    else:
        Console(highlight=False).print(estimate_table(found))
        if profile is None:
            say_next(command_line("run", study))


@sinew.command("demo")
@click.option("--out", type=PATH, show_default="results", help="Folder of its studies and results.")
@click.option("--workers", type=click.IntRange(1, 1024), help="Local worker processes.")
@click.option("--quiet", is_flag=True, help="Nothing but errors and the last line.")
def demo(out: Path | None, workers: int | None, quiet: bool) -> None:
    """Try sinew on virtual tendons: which parameters matter, what is missing, and how much is left?"""
    from sinew.tasks.data.demo import demo_studies
    from sinew.tasks.study import pipeline

    options = {"seed": None, "scheduler": None, "profile": None, "solver": None}
    pages = []
    out = out or folder_of_all()
    for study in demo_studies(out):
        with open_study(study, None, out=out / study.stem, workers=workers, quiet=quiet, **options) as workspace:
            pipeline.run(workspace, workspace.study.tasks)
        pages.append(to_see(workspace.out))
    say_next(", then ".join(pages))


def _task_command(task: Task) -> None:
    """A command that runs one task of a study."""

    def command(study: Path, **options: Any) -> None:
        flags = {flag: options.pop(flag) for flag in task.flags}
        workspace = _run(study, [task.name], flags, **options)
        say_next(to_see(workspace.out), as_json=options["as_json"])

    for flag, words in task.flags.items():
        command = click.option(f"--{flag}", is_flag=True, help=words)(command)
    study_command(task.name, task.summary)(command)


for _task in TASKS.values():
    _task_command(_task)


@study_command("simulate", "Forces of given parameter rows along each measured curve.")
@click.option("--parameters", type=PATH, required=True, help="CSV, one column for each parameter name.")
def simulate(study: Path, parameters: Path, **options: Any) -> None:
    from sinew.tasks.simulate.rows import read_parameters, simulate_rows
    from sinew.tasks.study.model import model_of
    from sinew.tasks.study.study import read_study

    read = read_study(study)
    rows = read_parameters(parameters, model_of(read.model, read.simulator.law))
    with open_study(study, [], judge_ranges=False, **options) as workspace:
        result = simulate_rows(workspace, rows)
        workspace.event("simulated", **{name: result[name] for name in ("rows", "failed", "files")})
        if not workspace.quiet:
            put(
                f"{result['rows']} rows along {len(result['files'])} curves, {result['failed']} failed: {workspace.out}"
            )
            for failure in result["failures"][:5]:
                reason = f"{failure['status']}: {one_line(failure['message'])}"
                put(f"  row {failure['row']}, {failure['specimen']}: {reason}")
    if result["failed"]:
        say_next(command_line("status", workspace.out), as_json=options["as_json"])
    else:
        say_next(f"the forces are in {workspace.out}", as_json=options["as_json"])
