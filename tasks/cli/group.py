"""The command ``sinew`` itself, and what its commands over a study share."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.shell_completion import CompletionItem

from sinew.runner.errors import BadInput, one_line
from sinew.tasks.cli.terminal import Commands, command_line, examples
from sinew.tasks.study.resources import DISTRIBUTION

if TYPE_CHECKING:
    from sinew.tasks.study.study import Study


class NamedPath(click.Path):
    """A path; an empty one would mean the current folder, which nobody names by nothing."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """As click's."""
        if value == "":
            self.fail("an empty path; expected a name", param, ctx)
        return super().convert(value, param, ctx)


PATH = NamedPath(path_type=Path)
RESULTS = Path("results")  # in the folder where a command is started


@click.group(
    cls=Commands,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110},
    invoke_without_command=True,
    epilog=examples(
        "sinew init bench/*.csv --out study --length-mm 20 --width-mm 5 --thickness-mm 1.5",
        "sinew run study/study.yaml --out results/study",
        "sinew watch results/study",
        "sinew run --help                # every command has examples",
    ),
)
@click.version_option(package_name=DISTRIBUTION)
@click.pass_context
def sinew(context: click.Context) -> None:
    """Finite-element ensembles of soft tissue: resumable, from a laptop to a cluster."""
    if context.invoked_subcommand is None:
        click.echo(context.get_help())


class SimulatorName(click.ParamType[str]):
    """A simulator of sinew's own tissue. The registry takes long to import, and is read when a name is given."""

    name = "name"  # as the help of a command shows it: that must not wait for the registry either

    @cached_property
    def _choice(self) -> "click.Choice[str]":
        from sinew.tasks.simulate.registry import of_the_tissue

        return click.Choice(of_the_tissue())

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        return self._choice.convert(value, param, ctx)

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        return self._choice.shell_complete(ctx, param, incomplete)


def study_command(name: str, help: str) -> Callable[[Callable[..., None]], click.Command]:
    """A command over a study, with the options that all of them share."""

    def decorate(function: Callable[..., None]) -> click.Command:
        options = [
            click.argument("study", type=PATH),
            click.option("--data", type=PATH, help="Cohort folder, in place of the study's."),
            click.option("--out", type=PATH, help="Result folder (default: results/NAME)."),
            click.option("--seed", type=click.IntRange(0, 2**32 - 1), help="Seed, in place of the study's."),
            click.option("--workers", type=click.IntRange(1, 1024), help="Local worker processes."),
            click.option(
                "--scheduler", envvar="SINEW_SCHEDULER", help="A Dask scheduler that runs, such as tls://host:8786."
            ),
            click.option("--profile", type=PATH, help="Work on this cluster; for use inside its jobs."),
            click.option("--simulator", type=SimulatorName(), help="Simulator, in place of the study's."),
            click.option(
                "--solver",
                callback=_program,
                envvar="SINEW_SOLVER",
                help="Solver, by name or path, in place of febio4.",
            ),
            click.option("--retry-failed", is_flag=True, help="Evaluate failed rows again."),
            click.option("--quiet", is_flag=True, help="Nothing but errors and the last line."),
            click.option("--json", "as_json", is_flag=True, help="For scripts: a JSON object in each line."),
        ]
        for option in reversed(options):
            function = option(function)
        return sinew.command(name, help=help)(function)

    return decorate


def _program(context: click.Context, parameter: click.Parameter, value: str | None) -> str | None:
    """A program's name, or its path from anywhere: jobs start in other folders."""
    return str(Path(value).absolute()) if value and "/" in value else value or None


def checked_study(
    study: Path,
    tasks: Sequence[str] | None,
    out: Path | None,
    *,
    seed: int | None,
    solver: str | None,
    data: Path | None,
    flags: Mapping[str, bool],
) -> "tuple[Study, Path]":
    """A study and its result folder, once its ``tasks`` (None: the study's) are checked. Raises ``BadInput``."""
    from sinew.tasks.study import pipeline
    from sinew.tasks.study.study import read_study

    read = read_study(study, seed=seed, solver=solver)
    out = out or own_folder(read.name)
    pipeline.check(read, out, read.tasks if tasks is None else tasks, data=data, **flags)
    return read, out


def own_folder(name: str) -> Path:
    """The result folder of this ``name``, for a command without ``--out``.

    Raises ``BadInput`` for a link: whoever wrote the study may have put it there.
    """
    _refuse_links(RESULTS, RESULTS / name)
    return RESULTS / name


def folder_of_all() -> Path:
    """The folder of several studies and their results, for a command without ``--out``.

    Raises ``BadInput`` for a link in its place or in it.
    """
    _refuse_links(RESULTS)
    _refuse_links(*(RESULTS.iterdir() if RESULTS.is_dir() else ()))
    return RESULTS


def _refuse_links(*places: Path) -> None:
    for place in places:
        if place.is_symlink():
            raise BadInput(place, "is a link, and nobody named it", "a folder, or --out with the folder that is meant")


@contextmanager
def open_study(
    study: Path,
    tasks: Sequence[str] | None,
    *,
    seed: int | None,
    flags: Mapping[str, bool] | None = None,
    out: Path | None,
    workers: int | None,
    scheduler: str | None,
    profile: Path | None,
    solver: str | None,
    **options: Any,
) -> Any:
    """The workspace of a study, once everything about it and its ``tasks`` (default: the study's) is checked."""
    from sinew.runner.cluster.allocation import Allocation, join_allocation
    from sinew.tasks.cluster import submission
    from sinew.tasks.cluster.profile import read_profile
    from sinew.tasks.cluster.spec import cluster_of
    from sinew.tasks.study.workspace import open_workspace

    read, out = checked_study(study, tasks, out, seed=seed, solver=solver, data=options.get("data"), flags=flags or {})
    if profile is None:
        with open_workspace(read, out=out, cluster=cluster_of(read, workers, scheduler), **options) as workspace:
            yield workspace
        return
    chosen = read_profile(profile)
    cluster = chosen.cluster(read.name, submission.jobs_folder(out.absolute()))
    if isinstance(cluster, Allocation):
        join_allocation(cluster)
    submission.refuse_a_second(out)
    with submission.leading(out, chosen), open_workspace(read, out=out, cluster=cluster, **options) as workspace:
        yield workspace


def to_see(folder: Path) -> str:
    """What shows the results of a folder: its page, or the command that builds it."""
    from sinew.tasks.report.status import current_page

    page = current_page(folder)
    return command_line("report", folder) if page is None else one_line(f"open {page} in a browser")
