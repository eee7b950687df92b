"""Studies as jobs of a batch system: submit the job that leads a study, be that job, and cancel it."""

import re
import shlex
import signal
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Any

from sinew.runner.cluster import drain
from sinew.runner.cluster.batch_system import BatchSystem, JobRequest, QueuedJob, Refused, walltime
from sinew.runner.cluster.batch_systems import BATCH_SYSTEMS, current, current_job, patiently
from sinew.runner.cluster.job_table import COORDINATOR, SLURM, JobRecord, JobTable, noted
from sinew.runner.cluster.jobs import Jobs, worker_job_script
from sinew.runner.errors import BadInput, ClusterError, WalltimeReached, shown
from sinew.runner.evaluation import external
from sinew.runner.evaluation.interim import STATES
from sinew.runner.files import read_input
from sinew.runner.store.schema import PENDING
from sinew.runner.store.store import open_store, refuse_strange_entries
from sinew.runner.temporary import temporary_folder
from sinew.tasks.cluster.profile import AllocationSettings, Profile
from sinew.tasks.registry import TASKS
from sinew.tasks.simulate.build import simulator_of
from sinew.tasks.simulate.febio.renderer import WrongTemplate, job_script
from sinew.tasks.simulate.row_by_row import Failed
from sinew.tasks.simulate.settings import SolverMissing
from sinew.tasks.study.files import write_text
from sinew.tasks.study.resources import resource
from sinew.tasks.study.study import Study
from sinew.tasks.study.workspace import attempts_folder, check_cohort

GO_ON = 75  # the exit code that makes the job script requeue its job
TERMINATED = 143
LAST_CALL_S = 8.0


def jobs_folder(out: Path) -> Path:
    """Where a result folder keeps its table of jobs, their scripts and their output."""
    return out / "jobs"


@dataclass(frozen=True)
class Scripts:
    """The text of the job that leads, and of the worker jobs that it will submit (None in an allocation)."""

    leader: str
    worker: str | None


def job_scripts(study: Study, profile: Profile, out: Path, arguments: Sequence[str]) -> Scripts:
    """The job scripts for a study; ``arguments`` go to ``sinew run``. Raises :class:`BadInput`."""
    folder = jobs_folder(out.absolute())
    if not re.fullmatch(r"[A-Za-z0-9_./+@:,=-]+", str(folder)):
        raise BadInput(
            f"--out {out}",
            f"{profile.system.title}'s scripts cannot hold this path",
            "letters, digits and _ . / + @ : , = -",
        )
    command = [sys.executable, "-P", "-m", "sinew", "run", str(study.path.absolute())]
    command += ["--profile", str(profile.path.absolute()), "--out", str(out.absolute()), *arguments]
    for word in command:
        if not word.isprintable():  # batch systems look for their options in every line of a script
            raise BadInput(shown(word), "has line breaks or other control characters", "a path without them")
    leader = profile.leader
    tasks = leader.tasks if isinstance(leader, AllocationSettings) else 1
    scratch = (
        ()
        if tasks == 1 or profile.scratch is None
        else (external.scratch_line(profile.scratch, profile.system.job_variable),)
    )
    system, name = profile.system, JobTable(folder).job_name(study.name, COORDINATOR)
    output = f"{folder}/sinew-{study.name}-{system.job_in_path}.log"
    request = JobRequest(
        name, output, leader.cores, leader.memory_mb, leader.walltime_s, profile.options(leader), tasks
    )
    text = _rendered(
        profile,
        {
            "name": name,
            "folder": str(folder),
            "walltime": walltime(leader.walltime_s),
            "tasks": tasks,
            "cores": leader.cores,
            "memory": system.memory_option(request),
            "options": request.options,
            "directives": system.leader_directives(request),
            "requeue": system.requeue_lines(),
            "deadline": drain.job_script_lines(leader.walltime_s),
            "prologue": (*scratch, *profile.shell_lines()),
            "command": shlex.join(command if tasks == 1 else [*(system.launcher or ()), *command]),
        },
        shlex.quote(str(study.path.absolute())),
    )
    cluster = profile.cluster(study.name, folder)
    return Scripts(text, worker_job_script(cluster) if isinstance(cluster, Jobs) else None)


def _rendered(profile: Profile, values: Mapping[str, Any], study: str) -> str:
    """The job script; ``study`` is the path of the study as its command holds it."""
    path = resource("templates/job.sh.j2")
    if profile.job_script is not None:
        path = profile.path.parent / profile.job_script
    try:
        template = read_input(path, 2**20, "a template of a job script of at most 1 MB").decode("utf-8")
        text = job_script(path.name, template, values)
    except WrongTemplate as wrong:
        where, problem, expected = wrong.parts
        raise BadInput(path.parent / where, problem, expected) from None
    except Failed as failed:
        raise BadInput(path, failed.words, "a Jinja2 template of a job script") from None
    except (OSError, ValueError) as error:
        raise BadInput(path, f"cannot be read ({error})", "a template of a job script") from None
    if study not in text:  # in whatever way a site runs it
        raise BadInput(path, "makes a job script that does not run the study", "{{ command }} on a line of its own")
    return text


def check(study: Study, profile: Profile, out: Path, *, data: Path | None, simulator: str | None) -> None:
    """Refuse now what would fail in the queue. Raises :class:`BadInput`."""
    check_cohort(study, data, out)
    try:
        simulator_of(study, simulator, attempts_folder(out))
    except SolverMissing:
        if not profile.shell_lines():  # else they may well bring the solver, on the node
            raise


def submit(study: Study, profile: Profile, out: Path, scripts: Scripts) -> str:
    """Submit the job that leads a study; returns its number. Raises ``ClusterError`` when it is refused."""
    folder = jobs_folder(out)
    refuse_a_second(out)
    check_scripts(profile, scripts)
    folder.mkdir(parents=True, exist_ok=True)
    leader, _ = _written(scripts, folder)
    with _field_named(profile, _section(profile)):
        job = profile.system.submit(leader)
    cores = profile.leader.cores
    if isinstance(profile.leader, AllocationSettings):
        cores *= profile.leader.tasks
    table, facts = JobTable(folder), noted(profile.batch_system)
    table.note(job, "submitted", role=COORDINATOR, name=table.job_name(study.name, COORDINATOR), cores=cores, **facts)
    return job


def check_scripts(profile: Profile, scripts: Scripts) -> None:
    """Ask whether the jobs would be taken. Raises ``ClusterError`` that names the field of the profile to change."""
    with temporary_folder() as folder:
        leader, worker = _written(scripts, folder)
        if worker is not None:
            with _field_named(profile, "workers"):
                profile.system.check_script(worker)
        with _field_named(profile, _section(profile)):
            profile.system.check_script(leader)


def _written(scripts: Scripts, folder: Path) -> tuple[Path, Path | None]:
    leader, worker = folder / "job.sh", folder / "worker.sh"
    write_text(leader, scripts.leader)
    if scripts.worker is None:
        return leader, None
    write_text(worker, scripts.worker)
    return leader, worker


def _section(profile: Profile) -> str:
    """The part of a profile that says what the job that leads asks for."""
    return "coordinator" if profile.mode == "jobs" else "allocation"


@contextmanager
def _field_named(profile: Profile, section: str) -> Iterator[None]:
    """Name the field of the profile in the error for a refused job."""
    try:
        yield
    except Refused as refused:
        field = refused.field
        if field in ("memory", "walltime", "cores"):
            field = f"{section}.{field}"
        elif field == "partition" and getattr(profile, section).partition is not None:
            field = f"{section}.partition"
        where = f"{profile.path}: {field or section}"
        raise ClusterError(
            f"{where}: {profile.system.title} refuses the job ({refused.words}); nothing was submitted"
        ) from None


def _system_of(records: Mapping[str, JobRecord]) -> BatchSystem:
    """The batch system of a result folder's latest jobs."""
    names = [record.batch_system for record in records.values() if record.batch_system in BATCH_SYSTEMS]
    return BATCH_SYSTEMS[names[-1] if names else SLURM]


def live_jobs(out: Path) -> list[QueuedJob]:
    """Jobs of a result folder that wait or run, the one that leads first. Raises ``ClusterError``."""
    table = JobTable(jobs_folder(out))
    records = table.read()
    unfinished = [record for record in records.values() if record.ended is None or record.role == COORDINATOR]
    queued = _system_of(records).queue(record.job for record in unfinished)
    found = [queued[r.job] for r in unfinished if r.job in queued and table.is_job(r, queued[r.job].name)]
    leads = {record.job for record in unfinished if record.role == COORDINATOR}
    return sorted((job for job in found if job.live), key=lambda job: job.job not in leads)


def refuse_a_second(out: Path) -> None:
    """Raise ``ClusterError`` when another job leads a study on this result folder."""
    records = JobTable(jobs_folder(out)).read()
    for job in patiently(lambda: live_jobs(out)) if records else []:
        if records[job.job].role == COORDINATOR and job.job != current_job():
            where = f" on {job.nodes}" if job.nodes else ""
            raise ClusterError(
                f"{out}: {_system_of(records).title} job {job.job} ({job.state}{where}) works on it already; "
                f"wait for it, or `sinew cancel {out}`"
            )


def cancel(out: Path) -> list[QueuedJob]:
    """End all jobs of a result folder; returns those that were ended. What is finished is kept."""
    if not (JobTable(jobs_folder(out)).path.exists() or (out / "store.zarr").is_dir()):
        raise ClusterError(f"{out}: holds no jobs; name a result folder, as given to --out")
    refuse_strange_entries(out)
    jobs = live_jobs(out)
    if jobs:
        _system_of(JobTable(jobs_folder(out)).read()).cancel([job.job for job in jobs])
    return jobs


@contextmanager
def leading(out: Path, profile: Profile) -> Iterator[None]:
    """Be the job that leads a study: note when, stop in time, and in a way that leaves nothing behind.

    Raises ``WalltimeReached`` shortly before the job's deadline, wherever the program is, and ``ClusterError`` when
    the deadline came without anything finished, so that the job does not go round in circles.
    """
    system, job = current(), current_job()
    if system is None or job is None:  # led from a shell
        yield
        return
    table = JobTable(jobs_folder(out))
    table.note(job, "started", role=COORDINATOR, nodes=system.node())
    before = _finished(out)
    end = "done"
    try:
        with _signals():
            yield
    except WalltimeReached as reached:
        end = "its walltime was near"
        if reached.worked and _finished(out) == before:
            end = "nothing finished within its walltime"
            where = f"{profile.path}: {_section(profile)}.walltime"
            raise ClusterError(f"{where}: {end} ({profile.leader.walltime}); ask for more") from None
        raise
    except BaseException as error:
        end = "terminated" if isinstance(error, SystemExit) else (str(error) or type(error).__name__)[:200]
        raise
    finally:
        with suppress(OSError):  # on a full disk, the error that is on its way says more
            table.note(job, "ended", end=end)


@contextmanager
def _signals() -> Iterator[None]:
    """The deadline and SIGTERM as exceptions, so that everything that is open is closed."""

    def deadline(number: int, frame: FrameType | None) -> None:
        raise WalltimeReached("the walltime is near; run the same command again to go on")

    def terminate(number: int, frame: FrameType | None) -> None:
        raise SystemExit(TERMINATED)

    before = signal.signal(signal.SIGALRM, deadline), signal.signal(signal.SIGTERM, terminate)
    left = drain.seconds_left() - LAST_CALL_S
    if left < float("inf"):
        signal.setitimer(signal.ITIMER_REAL, max(left, 0.1))
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before[0])
        signal.signal(signal.SIGTERM, before[1])


def _finished(out: Path) -> tuple[int, tuple[tuple[int, int], ...]]:
    """How many rows of a result folder have outcomes, and when its other files were written, and their sizes.

    These are results and checkpoints of tasks, and states of runs that go on later.
    """
    rows = 0
    if (out / "store.zarr").is_dir():
        for table in open_store(out).tables():
            rows += int((table.status != PENDING).sum()) + table.waiting()
    kept = [path for task in TASKS for path in (out / f"{task}.json", *(out / task).rglob("*")) if path.is_file()]
    kept += (attempts_folder(out) / STATES).glob("*.state")
    found = []
    for path in kept:
        with suppress(FileNotFoundError):  # a worker has just removed it
            found.append((path.lstat().st_mtime_ns, path.lstat().st_size))
    return rows, tuple(sorted(found))
