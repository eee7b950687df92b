"""SLURM: its commands, options and environment variables. See :class:`BatchSystem` for what the functions do."""

import os
import re
import shlex
import subprocess
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from sinew.runner.cluster.batch_system import Commands, JobRequest, QueuedJob, Refused, walltime
from sinew.runner.errors import ClusterError, shown

title = "SLURM"
queue_command = "squeue"
submit_command = "sbatch"
job_variable = "SLURM_JOB_ID"
job_in_path = "%j"
unknown_fields: frozenset[str] = frozenset()
launcher: tuple[str, ...] | None = ("srun",)

_LIVE = """PENDING RUNNING CONFIGURING COMPLETING SUSPENDED STOPPED RESIZING SIGNALING STAGE_OUT REQUEUED REQUEUE_HOLD
REQUEUE_FED RESV_DEL_HOLD SPECIAL_EXIT"""
LIVE = frozenset(_LIVE.split())
# a job script that is submitted from inside a job must not see that job's variables
_OF_A_JOB = re.compile(r"^(SBATCH_|SLURM_(?!CONF$)|SLURMD_|SINEW_)")
_AWAY = "unable to contact|connection refused|socket timed out|communication"
_REASONS = (
    (r"invalid partition|partition.*(not available|down|inactive)|use this partition", "partition"),
    (r"invalid account|account.*(not permitted|denied)|AssocMax|AssocGrp", "account"),
    (r"invalid qos|qos.*(not permitted|denied)|QOSMax|QOSGrp", "qos"),
    (r"invalid feature|invalid constraint", "constraint"),
    (r"reservation", "directives"),
    (r"memory specification|memory.*(not available|exceed|per)", "memory"),
    (r"requested time limit|TimeLimit", "walltime"),
    (r"more processors|cpu count|too many (cpus|tasks)|node configuration is not available", "cores"),
)
_OPTION = re.compile(r"--[a-z][a-z-]*(=[^\x00-\x1f]{0,200})?")
_OWN_OPTIONS = {"--array", "--job-name", "--time", "--output", "--ntasks", "--wrap"}
_REQUEUE = """\
while [ "${SLURM_RESTART_COUNT:-0}" -lt 1000 ]; do
    if scontrol requeue "$SLURM_JOB_ID"; then
        sleep 600 # SLURM ends this run of the job in a moment
        break
    fi
    sleep 5 # its controller is away for a while
done"""


# ---- on the login node


def _message(finished: subprocess.CompletedProcess[str]) -> str:
    """The error message of a command, on one line."""
    lines = [re.sub(r"^\w+: (error: )?", "", line).strip() for line in finished.stderr.splitlines()]
    return "; ".join(dict.fromkeys(line for line in lines if line)) or f"exit code {finished.returncode}"


commands = Commands(
    title, "controller", "slurmctld", submit_command, of_a_job=_OF_A_JOB, message=_message, away=_AWAY, reasons=_REASONS
)


def version() -> str:
    finished = commands.call("sbatch", "--version")
    if finished.returncode != 0:
        raise commands.error(finished)
    return finished.stdout.strip()


def check_script(script: Path) -> None:
    finished = commands.call("sbatch", "--test-only", str(script))
    if finished.returncode != 0:
        failed = commands.error(finished)
        if isinstance(failed, Refused) and failed.field == "cores":  # or memory: the message is the same
            with_less = commands.call("sbatch", "--test-only", "--mem=1", str(script))
            failed.field = "memory" if with_less.returncode == 0 else "cores"
        raise failed


def submit(script: Path) -> str:
    finished = commands.call("sbatch", "--parsable", str(script))
    job = finished.stdout.strip().rpartition("\n")[2].partition(";")[0]  # wrappers of sites may print more, before
    if finished.returncode != 0:
        raise commands.error(finished)
    if not job.isdigit():
        answer = job[:80] or "nothing"
        raise ClusterError(f"sbatch took the job but printed no job number ({answer}); look at `squeue --me`")
    return job


def queue(jobs: Iterable[str] | None = None) -> dict[str, QueuedJob]:
    wanted = None if jobs is None else set(jobs)
    if wanted is not None and not wanted:
        return {}
    finished = commands.call("squeue", "--me", "--noheader", "--states=all", "--format=%A|%T|%r|%N|%j")
    if finished.returncode != 0:
        raise commands.error(finished)
    found = {}
    for line in finished.stdout.splitlines():
        parts = line.strip().split("|", 4)
        if len(parts) == 5 and (wanted is None or parts[0] in wanted):
            job, state, reason, nodes, name = parts
            found[job] = QueuedJob(job, state, reason, nodes, name, live=state in LIVE, running=state == "RUNNING")
    return found


def cancel(jobs: Sequence[str]) -> None:
    if jobs:
        finished = commands.call("scancel", "--quiet", *jobs)
        words = _message(finished)
        if finished.returncode != 0 and not re.search(r"invalid job id|already (completing|completed)", words, re.I):
            raise commands.error(finished)


# ---- job scripts


def memory_option(request: JobRequest) -> str:
    return f"--mem={request.memory_mb}M" if request.tasks == 1 else f"--mem-per-cpu={request.memory_mb}M"


def options(fields: Mapping[str, str]) -> tuple[str, ...]:
    return tuple(f"--{name}={value}" for name, value in fields.items())


def option_problem(option: str) -> tuple[str, str] | None:
    try:
        words = shlex.split(option)
    except ValueError:
        words = []
    if not _OPTION.fullmatch(option) or len(words) != 1:
        return shown(option), "one option of sbatch, in quotes where it holds blanks"
    if option.partition("=")[0] in _OWN_OPTIONS:
        return f"{shown(option)} is for sinew to say", "an option besides"
    return None


def leader_directives(request: JobRequest) -> list[str]:
    asked = [
        f"--job-name={request.name}",
        f"--output={request.output}",
        "--open-mode=append",
        "--requeue",
        f"--time={walltime(request.walltime_s)}",
        f"--ntasks={request.tasks}",
        f"--cpus-per-task={request.cores}",
        memory_option(request),
        *request.options,
    ]
    return [f"#SBATCH {option}" for option in asked]


def requeue_lines() -> list[str]:
    return _REQUEUE.splitlines()


def worker_options(request: JobRequest) -> dict[str, Any]:
    return {
        "job_cpu": request.cores,
        "job_mem": f"{request.memory_mb}M",
        "walltime": walltime(request.walltime_s),
        "job_extra_directives": ["--no-requeue", f"--output={request.output}", *request.options],
    }


def dask_module() -> str:
    return "dask_jobqueue.slurm"


def dask_classes(module: Any) -> tuple[Any, Any]:
    return module.SLURMJob, module.SLURMCluster


def allocation_runner(module: Any) -> Any:
    return module.SLURMRunner


# ---- inside a job


def job() -> str | None:
    return os.environ.get(job_variable)


def node() -> str:
    return os.environ.get("SLURMD_NODENAME", "")


def restarts() -> int:
    return int(os.environ.get("SLURM_RESTART_COUNT", 0))


def cpus() -> int | None:
    given = os.environ.get("SLURM_CPUS_PER_TASK")
    return int(given) if given else None


def task() -> int | None:
    number = os.environ.get("SLURM_PROCID")
    return None if number is None else int(number)
