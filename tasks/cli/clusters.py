"""Commands for a study on a cluster: submit, doctor, cancel."""

from pathlib import Path
from typing import Any

import click

from sinew.runner.errors import BadInput, SinewError
from sinew.runner.printing import put
from sinew.tasks.cli.group import PATH, own_folder, sinew, study_command
from sinew.tasks.cli.terminal import command_line, say, say_next


@study_command("submit", "Submit a study to the batch system: a leading job, which submits worker jobs.")
@click.option("--dry-run", is_flag=True, help="Print the job scripts, submit nothing.")
def submit(study: Path, dry_run: bool, profile: Path | None, out: Path | None, as_json: bool, **options: Any) -> None:
    from sinew.tasks.cluster import submission
    from sinew.tasks.cluster.profile import read_profile
    from sinew.tasks.study import pipeline
    from sinew.tasks.study.study import read_study

    if profile is None:
        raise BadInput("--profile", "missing", "the profile of a cluster, such as slurm/generic.yaml")
    read, chosen = read_study(study, seed=options["seed"], solver=options["solver"]), read_profile(profile)
    out = out or own_folder(read.name)
    pipeline.check(read, out, read.tasks, data=options["data"])
    submission.check(read, chosen, out, data=options["data"], simulator=options["simulator"])
    scripts = submission.job_scripts(read, chosen, out, _arguments(options))
    if dry_run:
        put(scripts.leader)
        if scripts.worker is not None:
            put(f"# ---- each worker job; the scheduler's address and the certificate are made up\n{scripts.worker}")
        return
    job = submission.submit(read, chosen, out, scripts)
    if as_json or not options["quiet"]:
        words = f"job {job} leads '{read.name}'; its output: {submission.jobs_folder(out)}"
        say(as_json, words, event="submitted", job=job, folder=str(out))
    if not (as_json or options["quiet"]):
        put(f"follow it by `sinew status {out}`, end it by `sinew cancel {out}`")
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


@study_command("doctor", "Would this study run here? Checks disk, batch system, a worker and the solver.")
@click.option(
    "--wait", type=click.FloatRange(1, 86_400), default=600.0, show_default=True, help="Longest wait for a worker (s)."
)
def doctor(
    study: Path,
    wait: float,
    profile: Path | None,
    out: Path | None,
    data: Path | None,
    simulator: str | None,
    workers: int | None,
    scheduler: str | None,
    solver: str | None,
    seed: int | None,
    quiet: bool,
    as_json: bool,
    retry_failed: bool,
) -> None:
    from sinew.tasks.cluster.doctor import Finding, examine
    from sinew.tasks.cluster.profile import read_profile
    from sinew.tasks.cluster.spec import cluster_of
    from sinew.tasks.study.study import read_study

    read = read_study(study, seed=seed, solver=solver)
    out = out or own_folder(read.name)
    chosen = None if profile is None else read_profile(profile)
    cluster = cluster_of(read, workers, scheduler) if chosen is None else chosen.one_job(read.name, out.absolute())

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


@sinew.command()
@click.argument("folder", type=PATH)
def cancel(folder: Path) -> None:
    """Cancel all jobs of a result folder; finished rows are kept."""
    from sinew.tasks.cluster.submission import cancel as cancel_jobs

    jobs = cancel_jobs(folder)
    for job in jobs:
        put(f"job {job.job} ({job.name}, {job.state}) is cancelled")
    put(f"{len(jobs)} jobs cancelled; `sinew submit` goes on with what is left: {folder}")
