"""The command ``sinew``: reads arguments, calls a task, prints a summary. Errors are one line and exit code 2."""

import json
import logging
import math
import sys
from collections.abc import Callable, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click

from runner.errors import SinewError, WalltimeReached, of_the_system
from tasks.problems import BadInput, one_line, shown
from tasks.terminal import (
    COMPLETION,
    PROGRAM,
    SHELLS,
    Commands,
    command_line,
    completion_script,
    examples,
    say,
    say_next,
)

_PATH = click.Path(path_type=Path)


def main() -> None:
    """Entry point: one clear line and exit code 2 for whatever the user can mend, 130 for Ctrl-C."""
    logging.getLogger("sinew").addHandler(logging.NullHandler())
    try:
        sinew.main(standalone_mode=False, prog_name=PROGRAM, complete_var=COMPLETION)
    except click.exceptions.Abort:
        _fail("interrupted; run the same command again to go on, finished rows are kept", 130)
    except KeyboardInterrupt:
        _fail("interrupted; run the same command again to go on, finished rows are kept", 130)
    except click.UsageError as error:
        words = " ".join(error.format_message().split()).rstrip(".")
        more = f"`{error.ctx.command_path if error.ctx else PROGRAM} --help` says more"
        _fail(f"{words}{' ' if words.endswith('?') else '; '}{more}", 2)
    except click.ClickException as error:
        _fail(" ".join(error.format_message().split()), 2)
    except WalltimeReached as error:
        _fail(str(error), 75)  # the job script takes this for: once more
    except SinewError as error:
        _fail(str(error), 2)
    except OSError as error:  # a path that the system refuses, of whatever kind
        _fail(f"{error.filename or 'a file'}: {of_the_system(error)}", 2)


def _fail(message: str, code: int) -> None:
    print(f"sinew: {one_line(message)}", file=sys.stderr)
    sys.exit(code)


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
@click.version_option(package_name="sinew")
@click.pass_context
def sinew(context: click.Context) -> None:
    """Finite-element ensembles of soft tissue: resumable, from a laptop to a cluster."""
    if context.invoked_subcommand is None:
        click.echo(context.get_help())


def _study_command(name: str, help: str) -> Callable[[Callable[..., None]], click.Command]:
    """A command over a study, with the options that all of them share."""

    def decorate(function: Callable[..., None]) -> click.Command:
        options = [
            click.argument("study", type=_PATH),
            click.option("--data", type=_PATH, help="Cohort folder, in place of the study's."),
            click.option("--out", type=_PATH, help="Result folder (default: results/NAME)."),
            click.option("--seed", type=click.IntRange(0, 2**32 - 1), help="Seed, in place of the study's."),
            click.option("--workers", type=click.IntRange(1, 1024), help="Local worker processes."),
            click.option("--profile", type=_PATH, help="A cluster's profile: work on SLURM, from inside its job."),
            click.option("--simulator", type=click.Choice(["uniaxial", "febio"]), help="In place of the study's."),
            click.option("--retry-failed", is_flag=True, help="Evaluate failed rows again."),
            click.option("--quiet", is_flag=True, help="Nothing but errors and the last line."),
            click.option("--json", "as_json", is_flag=True, help="For scripts: a JSON object in each line."),
        ]
        for option in reversed(options):
            function = option(function)
        return sinew.command(name, help=help)(function)

    return decorate


@contextmanager
def _open(
    study: Path,
    tasks: Sequence[str] | None,
    *,
    seed: int | None,
    extend: bool = False,
    out: Path | None,
    workers: int | None,
    profile: Path | None,
    **options: Any,
) -> Any:
    """The workspace of a study, once everything about it and its ``tasks`` (default: the study's) is checked."""
    from runner.allocation import Allocation, join_allocation
    from tasks import pipeline, submission
    from tasks.profile import read_profile
    from tasks.study import read_study
    from tasks.workspace import open_workspace

    read = read_study(study, seed=seed)
    out = out or Path("results") / read.name
    pipeline.check(read, out, read.tasks if tasks is None else tasks, data=options.get("data"), extend=extend)
    if profile is None:
        with open_workspace(read, out=out, cluster=read.cluster_spec(workers), **options) as workspace:
            yield workspace
        return
    chosen = read_profile(profile)
    cluster = chosen.cluster(read.name, submission.jobs_folder(out.absolute()))
    if isinstance(cluster, Allocation):
        join_allocation(cluster)
    submission.refuse_a_second(out)
    with submission.leading(out, chosen), open_workspace(read, out=out, cluster=cluster, **options) as workspace:
        yield workspace


def _run(study: Path, tasks: Sequence[str] | None, *, extend: bool = False, **options: Any) -> None:
    """Run tasks of a study (None: the study's), and say where to look."""
    from tasks import pipeline

    with _open(study, tasks, extend=extend, **options) as workspace:
        pipeline.run(
            workspace, workspace.study.tasks if tasks is None else tasks, **({"extend": True} if extend else {})
        )
    say_next(_to_see(workspace.out), as_json=options["as_json"])


def _to_see(folder: Path) -> str:
    """What shows the results of a folder: its page, or the command that builds it."""
    from tasks.status import current_page

    page = current_page(folder)
    return command_line("report", folder) if page is None else one_line(f"open {page} in a browser")


@_study_command("run", "Run all tasks of a study, in order.")
def run(study: Path, **options: Any) -> None:
    _run(study, None, **options)


@_study_command("sobol", "Sobol indices with confidence intervals.")
@click.option("--extend", is_flag=True, help="Double the base samples of the last result; pays for new rows only.")
def sobol(study: Path, extend: bool, **options: Any) -> None:
    _run(study, ["sobol"], extend=extend, **options)


def _task_command(task: str, words: str) -> None:
    """A command that runs one task of a study."""

    @_study_command(task, words)
    def command(study: Path, **options: Any) -> None:
        _run(study, [task], **options)


_task_command("importance", "Random forest importance from the rows of the Sobol study.")
_task_command("calibrate", "The parameters of each specimen that bring the model closest to its curves.")
_task_command("infer", "The parameters of each site with their uncertainty (ABC-SMC).")
_task_command("predict", "Bands around the curves of each site, and how much of the data they cover.")
_task_command("compare", "Can the sites be told apart by their parameters?")
_task_command("discover", "Where do model and measurements disagree, and which effect is missing?")


@_study_command("simulate", "Forces of given parameter rows along each measured curve.")
@click.option("--parameters", type=_PATH, required=True, help="CSV, one column for each parameter name.")
def simulate(study: Path, parameters: Path, **options: Any) -> None:
    from tasks.simulations import read_parameters, simulate_rows
    from tasks.study import read_study

    rows = read_parameters(parameters, read_study(study).tendon())
    with _open(study, [], **options) as workspace:
        result = simulate_rows(workspace, rows)
        workspace.event("simulated", **{name: result[name] for name in ("rows", "failed", "files")})
        if not workspace.quiet:
            print(
                f"{result['rows']} rows along {len(result['files'])} curves, {result['failed']} failed: {workspace.out}"
            )
            for failure in result["failures"][:5]:
                reason = f"{failure['status']}: {one_line(failure['message'])}"
                print(f"  row {failure['row']}, {failure['specimen']}: {reason}")
    if result["failed"]:
        say_next(command_line("status", workspace.out), as_json=options["as_json"])
    else:
        say_next(f"the forces are in {workspace.out}", as_json=options["as_json"])


@sinew.command()
@click.argument("files", type=_PATH, nargs=-1)
@click.option("--out", type=_PATH, required=True, help="Folder to write: study.yaml and cohort/.")
@click.option("--length-mm", type=float, help="Gauge length, where files do not say.")
@click.option("--width-mm", type=float, help="Width, where files do not say.")
@click.option("--thickness-mm", type=float, help="Thickness, where files do not say.")
@click.option("--time-unit", metavar="UNIT", help="Of times without a unit: s, ms, min, ...")
@click.option("--displacement-unit", metavar="UNIT", help="Of displacements (mm, um, m, ...) or strains (%, 1).")
@click.option("--force-unit", metavar="UNIT", help="Of forces (N, mN, kN, kgf, ...) or stresses (kPa, MPa, ...).")
@click.option("--time-column", metavar="NAME", help="Name or number (from 1) of a column.")
@click.option("--displacement-column", metavar="NAME", help="The same; displacement, length, strain or stretch.")
@click.option("--force-column", metavar="NAME", help="The same; force or stress.")
@click.option("--json", "as_json", is_flag=True, help="What was made, as a JSON object.")
def init(
    files: tuple[Path, ...],
    out: Path,
    length_mm: float | None,
    width_mm: float | None,
    thickness_mm: float | None,
    as_json: bool,
    **hints: str | None,
) -> None:
    """Make a study of your own files: a cohort and a study.yaml.

    FILES are tables of tests (CSV, TSV, text, exports of testing machines), folders of them, or a cohort that is in
    the layout already. Columns, separators and names are guessed, and said; units are read from the files or given,
    never guessed. On a terminal it asks for what no file tells.
    """
    from tasks.guess import Hints
    from tasks.init import Sizes, summary
    from tasks.init import init as make

    asks = sys.stdin.isatty() and sys.stdout.isatty() and not as_json
    sizes = Sizes(length_mm, width_mm, thickness_mm)
    made = make(files, out, hints=Hints(**hints), sizes=sizes, ask=_ask if asks else None)
    if as_json:
        print(json.dumps(summary(made)))
        return
    for line in made.told:
        print(line)
    for path in made.missing:
        print(f"fill in: {path}")
    print(f"study: {made.study}")
    run_it = command_line("run", made.study)
    say_next(f"fill in what is marked null there, then {run_it}" if made.missing else run_it)


def _ask(question: str, choices: Sequence[str]) -> str:
    kind = click.Choice(list(choices)) if choices else None
    return str(click.prompt(question, type=kind, default=None if choices else "", show_default=False))


@sinew.command()
@click.option("--out", type=_PATH, required=True, help="Folder to write.")
@click.option("--seed", type=click.IntRange(0, 2**32 - 1), default=0, show_default=True)
@click.option("--per-site", type=click.IntRange(1, 9), default=9, show_default=True, help="Specimens of each site.")
@click.option("--rate", type=click.FloatRange(0.5, 1000), default=100.0, show_default=True, help="Samples per second.")
@click.option(
    "--noise", type=click.FloatRange(0, 1), default=0.003, show_default=True, help="Fraction of the peak force."
)
@click.option(
    "--ar1", type=click.FloatRange(0, 0.999), default=0.3, show_default=True, help="Correlation of neighbours."
)
@click.option("--effect", help="Hide an effect of the library in all specimens, at its typical size.")
def cohort(out: Path, seed: int, per_site: int, rate: float, noise: float, ar1: float, effect: str | None) -> None:
    """Make a virtual cohort from the 27 published specimens; its truth is known."""
    from tasks.cohort import virtual_cohort, write_cohort
    from tasks.model.effects import named
    from tasks.workspace import check_folder

    for name, value in (("--rate", rate), ("--noise", noise), ("--ar1", ar1)):
        if not math.isfinite(value):
            raise BadInput(name, str(value), "a finite number")
    check_folder(out)
    if effect is not None and effect not in named():
        raise BadInput("--effect", f"{shown(effect)} is no effect", f"one of {', '.join(named())}")
    hidden = () if effect is None else (named()[effect],)
    specimens, truth = virtual_cohort(seed=seed, per_site=per_site, rate_hz=rate, noise=noise, ar1=ar1, effects=hidden)
    write_cohort(out, specimens, truth)
    curves = sum(len(specimen.curves) for specimen in specimens)
    print(f"{len(specimens)} specimens, {curves} curves, truth.json: {out}")
    say_next(command_line("init", out, "--out", f"{out.name}-study"))


@sinew.command("import")
@click.argument("files", type=_PATH, nargs=-1, required=True)
@click.option("--out", type=_PATH, required=True, help="Cohort folder to write.")
@click.option("--protocol", help="Name of the protocol (default: from the export).")
@click.option("--specimen", help="All files are protocols of one specimen of this name, each named after its file.")
@click.option("--tare", is_flag=True, help="Subtract the first force of each test.")
@click.option("--time", type=click.Choice(["s", "ms", "min"]), help="Unit of the time, where an export names none.")
@click.option("--stress", type=click.Choice(["Pa", "kPa", "MPa"]), help="The load is a stress of this unit.")
@click.option("--reference", type=float, help="Length ratio at zero displacement (default: 1).")
@click.option("--length-mm", type=float, help="Gauge length at the reference, in place of the export's.")
@click.option("--area-mm2", type=float, help="Cross-section, in place of the export's.")
def import_(files: tuple[Path, ...], out: Path, protocol: str | None, specimen: str | None, **options: Any) -> None:
    """Read exported tests (CSV) into a cohort, each file a specimen.

    Columns are Time, Extension (or a length ratio: Stretch, L, L/L0) and Load (or, with --stress, a stress). A length
    ratio without a gauge length is that of a bar of 1 mm, a stress without a cross-section that of one of 1 mm2:
    forces in N are mean stresses in MPa then.
    """
    from tasks.bench_exports import Reading, read_exports
    from tasks.cohort import write_cohort
    from tasks.workspace import check_folder

    found = read_exports(files, protocol=protocol, specimen=specimen, reading=Reading(**options))
    check_folder(out)
    write_cohort(out, list(found.specimens))
    for one in found.specimens:
        for curve in one.curves:
            stretch = one.stretch(curve.protocol)
            print(
                f"{one.name}: {curve.name}, {curve.force_N.size:,} points, "
                f"{one.length_mm:g} x {one.width_mm:.4g} x {one.thickness_mm:.4g} mm, "
                f"stretch {stretch.min():.4g} to {stretch.max():.4g}, peak {curve.force_N.max():.4g} N"
            )
    for where, names in found.spreads.items():
        print(f"{where}: {', '.join(names)} left out; a cohort holds curves, and noise is told from them")
    say_next(command_line("init", out, "--out", f"{out.name}-study"))


@_study_command("submit", "Submit a study to SLURM: a job that leads, and its worker jobs.")
@click.option("--dry-run", is_flag=True, help="Print the job scripts, submit nothing.")
def submit(study: Path, dry_run: bool, profile: Path | None, out: Path | None, as_json: bool, **options: Any) -> None:
    from tasks import pipeline, submission
    from tasks.profile import read_profile
    from tasks.study import read_study

    if profile is None:
        raise BadInput("--profile", "missing", "the profile of a cluster, such as slurm/generic.yaml")
    read, chosen = read_study(study, seed=options["seed"]), read_profile(profile)
    out = out or Path("results") / read.name
    pipeline.check(read, out, read.tasks, data=options["data"])
    submission.check(read, chosen, out, data=options["data"], simulator=options["simulator"])
    scripts = submission.job_scripts(read, chosen, out, _arguments(options))
    if dry_run:
        print(scripts.leader)
        if scripts.worker is not None:
            print(f"# ---- each worker job; the scheduler's address and the certificate are made up\n{scripts.worker}")
        return
    job = submission.submit(read, chosen, out, scripts)
    if as_json or not options["quiet"]:
        words = f"job {job} leads '{read.name}'; its output: {submission.jobs_folder(out)}"
        say(as_json, words, event="submitted", job=job, folder=str(out))
    if not (as_json or options["quiet"]):
        print(f"follow it by `sinew status {out}`, end it by `sinew cancel {out}`")
    say_next(command_line("watch", out), as_json=as_json)


def _arguments(options: dict[str, Any]) -> list[str]:
    """Options of a command as arguments for another."""
    arguments: list[str] = []
    for name, value in options.items():
        if value is True:
            arguments.append(f"--{name.replace('_', '-')}")
        elif value is not None and value is not False:
            value = value.absolute() if isinstance(value, Path) else value
            arguments += [f"--{name.replace('_', '-')}", str(value)]
    return arguments


@_study_command("doctor", "Would this study run here? Looks at disk, SLURM, a worker and the solver.")
@click.option("--wait", type=click.FloatRange(1, 86_400), default=600.0, show_default=True, help="For a worker (s).")
def doctor(
    study: Path,
    wait: float,
    profile: Path | None,
    out: Path | None,
    data: Path | None,
    simulator: str | None,
    workers: int | None,
    seed: int | None,
    quiet: bool,
    as_json: bool,
    retry_failed: bool,
) -> None:
    from tasks.doctor import Finding, examine
    from tasks.profile import read_profile
    from tasks.study import read_study

    read = read_study(study, seed=seed)
    out = out or Path("results") / read.name
    chosen = None if profile is None else read_profile(profile)
    cluster = read.cluster_spec(workers) if chosen is None else chosen.one_job(read.name, out.absolute())

    def tell(finding: Finding) -> None:
        if as_json or not (quiet and finding.good):
            words = f"{'ok  ' if finding.good else 'BAD '} {finding.name}: {finding.words}"
            say(as_json, words, event="checked", name=finding.name, good=finding.good, words=finding.words)

    findings = examine(read, chosen, cluster, out, tell, data=data, simulator=simulator, wait_s=wait)
    bad = [finding.name for finding in findings if not finding.good]
    if bad:
        raise SinewError(f"{len(bad)} of {len(findings)} checks failed: {', '.join(bad)}")
    how = ("run", study) if profile is None else ("submit", study, "--profile", profile)
    say_next(command_line(*how, "--out", out), as_json=as_json)


@sinew.group("benchmark")
def benchmark_() -> None:
    """How often is sinew right where the answer is known?"""


@benchmark_.command("discover")
@click.argument("folders", metavar="FOLDER...", type=_PATH, nargs=-1, required=True)
@click.option("--out", type=_PATH, default=Path("results/benchmark"), show_default=True, help="Result folder.")
@click.option("--study", type=_PATH, help="Settings of every case (default: configs/discover.yaml).")
@click.option("--workers", type=click.IntRange(1, 1024), help="Local worker processes.")
@click.option("--only", multiple=True, metavar="CASE", help="Case to run; may be given several times.")
@click.option("--quiet", is_flag=True, help="No progress and no table.")
def benchmark_discover(
    folders: tuple[Path, ...], out: Path, study: Path | None, workers: int | None, only: tuple[str, ...], quiet: bool
) -> None:
    """Run `sinew discover` blind on cohorts whose truth is known, and score its verdicts."""
    from rich.console import Console

    from tasks.benchmark.discover import benchmark
    from tasks.report.benchmark import markdown, tell
    from tasks.workspace import write_text

    def say(line: str) -> None:
        if not quiet:
            print(line, flush=True)

    result = benchmark(folders, out, study=study, workers=workers, only=only, say=say)
    write_text(out / "benchmark.md", markdown(result))
    tell(result, Console(quiet=quiet, highlight=False))
    if not quiet:
        print(f"results: {out / 'benchmark.json'}, {out / 'benchmark.md'}")
    say_next(f"read {out / 'benchmark.md'}")


@sinew.command()
@click.argument("folder", type=_PATH)
def cancel(folder: Path) -> None:
    """End all SLURM jobs of a result folder; what is finished is kept."""
    from tasks.submission import cancel as cancel_jobs

    jobs = cancel_jobs(folder)
    for job in jobs:
        print(f"job {job.job} ({job.name}, {job.state}) is cancelled")
    print(f"{len(jobs)} jobs cancelled; `sinew submit` goes on with what is left: {folder}")


@sinew.command()
@click.argument("folder", type=_PATH)
@click.option("--json", "as_json", is_flag=True, help="Machine-readable.")
@click.option("--rows", is_flag=True, help="CSV: which node and job evaluated which row.")
def status(folder: Path, as_json: bool, rows: bool) -> None:
    """Rows done, failed, running and left; rate, cost, jobs, and why rows failed."""
    from tasks.status import print_status, read_status, rows_as_csv

    if rows:
        for line in rows_as_csv(folder):
            print(line)
        return
    found = read_status(folder)
    if as_json:
        print(json.dumps(found, indent=1))
        return
    print_status(found)
    alive = found["now"] is not None and found["now"]["alive"]
    say_next(command_line("watch", folder) if alive else _to_see(folder))


@sinew.command()
@click.argument("folder", type=_PATH)
@click.option("--once", is_flag=True, help="Show one picture and leave.")
@click.option("--json", "as_json", is_flag=True, help="A JSON object in a line for every change.")
@click.option(
    "--every", type=click.FloatRange(0.1, 3600), default=1.0, show_default=True, help="Look that often (seconds)."
)
def watch(folder: Path, once: bool, as_json: bool, every: float) -> None:
    """A live view of a result folder, wherever its run is.

    Shows tasks, progress and time left, the best fit or threshold so far, workers and jobs, and the last failures.
    It reads files only and never writes. It waits for a folder that is not there yet, and leaves when the run is over;
    q or Ctrl-C leaves sooner, and whatever runs goes on.
    """
    from tasks.watch import watch as watch_folder

    try:
        found = watch_folder(folder, form="json" if as_json else "picture", once=once, every_s=every)
    except KeyboardInterrupt:
        found = None
    if as_json:
        return
    if found is not None and found["state"] == "finished":
        say_next(_to_see(folder))
    elif found is not None and found["state"] in ("failed", "interrupted"):
        say_next(command_line("status", folder))
    else:
        say_next(command_line("watch", folder))


@sinew.command()
@click.argument("shell", type=click.Choice(SHELLS))
def completion(shell: str) -> None:
    """Print what makes a shell complete commands, options and files."""
    print(completion_script(sinew, shell))


@sinew.command()
@click.argument("folder", type=_PATH)
def report(folder: Path) -> None:
    """Write report.html: one page with the results of a folder, whatever state it is in."""
    from tasks.report.page import build

    built = build(folder)
    print(built.path)
    if built.trouble:
        more = f" (and {len(built.trouble) - 1} more on the page)" if len(built.trouble) > 1 else ""
        raise SinewError(f"{built.trouble[0]}{more}")


@sinew.command()
@click.argument("folder", type=_PATH)
def repair(folder: Path) -> None:
    """Make rows in damaged chunks pending; the next run computes them again, all others stay."""
    from tasks.pipeline import repair as repair_store

    print(f"{repair_store(folder)} rows are pending now: {folder}")
    say_next("run the same study again; it computes these rows and no other")


if __name__ == "__main__":
    main()
