"""Grid Engine (Son of Grid Engine, Univa and Altair): its commands, options and environment variables.

See :class:`BatchSystem` for what the functions do. Tested with 8.1.9. Differences from SLURM:

- A job whose script exits with 99 goes back into the queue.
- Several cores need a parallel environment, whose name each site chooses: ``smp`` unless ``directives`` name another.
- Memory is asked for per core as ``h_vmem``, unless ``directives`` name another resource for it.
- There is no start of one program as many tasks, so a profile's mode is ``jobs``.
- A job that has ended is not in the queue any more.
"""

import getpass
import os
import re
import shlex
import subprocess
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import defusedxml.ElementTree as ElementTree

from sinew.runner.cluster.batch_system import Away, Commands, JobRequest, QueuedJob, walltime
from sinew.runner.errors import ClusterError, shown

title = "Grid Engine"
queue_command = "qstat"
submit_command = "qsub"
job_variable = "JOB_ID"
job_in_path = "$JOB_ID"
unknown_fields = frozenset({"qos"})
launcher: tuple[str, ...] | None = None

# a job script that is submitted from inside a job must not see that job's variables
_OF_A_JOB = re.compile(r"^(SGE_(JOB|TASK|O|ACCOUNT|CWD|STD)|JOB_(ID|NAME|SCRIPT)$|RESTARTED$|NSLOTS$|PE$|PE_|SINEW_)")
_AWAY = r"unable to (contact|send message)|got (send|select|read) error|can't (connect|contact)|commlib"
_REASONS = (
    (r"unknown queue|h?qname", "partition"),
    (r"project|access (denied|list)", "account"),
    (r"parallel environment|cannot run in PE|slots", "cores"),
    (r"h_vmem|s_vmem|mem_free|virtual_free|memory", "memory"),
    (r"h_rt|s_rt|time value", "walltime"),
    (r"unknown resource|invalid option|hostname", "directives"),
)
_OPTION = re.compile(r"-[A-Za-z]+( [^\x00-\x1f\"'`$;&|<>\\]{1,200})?")
_OWN_OPTIONS = {
    *("-N", "-o", "-e", "-j", "-S", "-t", "-r", "-b", "-cwd", "-wd", "-terse", "-sync", "-now", "-C", "-notify"),
}
_MEMORY = re.compile(r"\b(h_vmem|s_vmem|mem_free|virtual_free|h_rss|mem|memory|m_mem_free)=")
_RUNNING, _DELETED, _ERROR = "r", "d", "E"


# ---- on the login node


def _message(finished: subprocess.CompletedProcess[str]) -> str:
    """The error message of a command, on one line."""
    lines = [re.sub(r"^(Unable to run job|error|denied|qsub): ", "", line.strip()) for line in
             (finished.stderr + "\n" + finished.stdout).splitlines()]  # fmt: skip
    kept = [line for line in dict.fromkeys(lines) if line and not re.match(r"Exiting\.|verification: no suit", line)]
    return "; ".join(kept) or f"exit code {finished.returncode}"


commands = Commands(
    title, "master", "sge_qmaster", submit_command, of_a_job=_OF_A_JOB, message=_message, away=_AWAY, reasons=_REASONS
)


def version() -> str:
    finished = commands.call("qstat", "-help")
    first = finished.stdout.strip().partition("\n")[0]
    if not first:
        raise commands.error(finished)
    return first


def check_script(script: Path) -> None:
    finished = commands.call("qsub", "-w", "v", "-terse", str(script))
    if finished.returncode != 0:
        raise commands.error(finished)


def submit(script: Path) -> str:
    finished = commands.call("qsub", "-terse", str(script))
    job = finished.stdout.strip().rpartition("\n")[2]
    if finished.returncode != 0:
        raise commands.error(finished)
    if not job.isdigit():
        raise ClusterError(f"qsub took the job but printed no job number ({job[:80] or 'nothing'}); look at `qstat`")
    return job


def queue(jobs: Iterable[str] | None = None) -> dict[str, QueuedJob]:
    wanted = None if jobs is None else set(jobs)
    if wanted is not None and not wanted:
        return {}
    finished = commands.call("qstat", "-xml", "-u", getpass.getuser())
    if finished.returncode != 0:
        raise commands.error(finished)
    try:
        listed = ElementTree.fromstring(finished.stdout).iter("job_list")
    except (ElementTree.ParseError, ValueError) as error:  # defusedxml raises the second
        raise Away(f"qstat's answer is not XML ({error})") from None
    found = {}
    for entry in listed:
        text = {child.tag: (child.text or "").strip() for child in entry}
        job, state = text.get("JB_job_number", ""), text.get("state", "")
        if job.isascii() and job.isdigit() and (wanted is None or job in wanted):
            live = _DELETED not in state and _ERROR not in state
            node = text.get("queue_name", "").partition("@")[2]
            running = live and _RUNNING in state
            found[job] = QueuedJob(job, state, "", node, text.get("JB_name", ""), live=live, running=running)
    return found


def cancel(jobs: Sequence[str]) -> None:
    if jobs:
        finished = commands.call("qdel", *jobs)
        words = _message(finished)
        if finished.returncode != 0 and not re.search(r"does not exist|already", words):
            raise commands.error(finished)


# ---- job scripts


def memory_option(request: JobRequest) -> str:
    return f"-l h_vmem={max(1, request.memory_mb // request.cores)}M"


def options(fields: Mapping[str, str]) -> tuple[str, ...]:
    words = {"account": "-P {}", "constraint": "-l {}", "partition": "-q {}"}
    return tuple(words[name].format(value) for name, value in fields.items())


def option_problem(option: str) -> tuple[str, str] | None:
    if not _OPTION.fullmatch(option) or len(shlex.split(option)) not in (1, 2, 3):
        return shown(option), "one option of qsub, such as '-l gpu=1' or '-pe openmp 4'"
    if option.split()[0] in _OWN_OPTIONS:
        return f"{shown(option)} is for sinew to say", "an option besides"
    return None


def _asked(request: JobRequest) -> list[str]:
    """Options of every job."""
    asked = [f"-o {request.output}", "-S /bin/bash", f"-l h_rt={walltime(request.walltime_s)}"]
    if not any(_MEMORY.search(option) for option in request.options):
        asked.append(memory_option(request))
    if request.cores > 1 and not any(option.startswith("-pe ") for option in request.options):
        asked.append(f"-pe smp {request.cores}")
    return [*asked, *request.options]


def leader_directives(request: JobRequest) -> list[str]:
    return [f"#$ {option}" for option in (f"-N {request.name}", "-cwd", "-j y", "-r y", *_asked(request))]


def requeue_lines() -> list[str]:
    return ["exit 99 # Grid Engine puts the job back into the queue"]


def worker_options(request: JobRequest) -> dict[str, Any]:
    return {"job_extra_directives": ["-r n", *_asked(request)]}


def dask_module() -> str:
    return "dask_jobqueue.sge"


def dask_classes(module: Any) -> tuple[Any, Any]:
    return module.SGEJob, module.SGECluster


def allocation_runner(module: Any) -> Any:
    raise ClusterError("Grid Engine: allocations are not offered")


# ---- inside a job


def job() -> str | None:
    return os.environ.get("JOB_ID") if "SGE_JOB_SPOOL_DIR" in os.environ else None


def node() -> str:
    return os.environ.get("HOSTNAME", "") if job() is not None else ""


def restarts() -> int:
    return int(os.environ.get("RESTARTED", 0))


def cpus() -> int | None:
    given = os.environ.get("NSLOTS")
    return int(given) if given and job() is not None else None


def task() -> int | None:
    return None
