"""Which program works on which data, where: what has to be known to make a result again."""

import os
import platform
import re
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path
from typing import Any

import psutil

import runner
import tasks
from runner.cluster import Local
from tasks.workspace import Workspace, digest


def facts(workspace: Workspace) -> dict[str, Any]:
    """Versions, machine, seed, study and data of a run, as plain values for the log."""
    study = workspace.study
    text = study.path.read_text("utf-8")
    specimens = {specimen.name: specimen.identity() for specimen in workspace.cohort.specimens}
    cluster = workspace.cluster
    workers = f", {cluster.workers} workers" if isinstance(cluster, Local) else ""
    return {
        "version": version("sinew"),
        "code": code(),
        "python": platform.python_version(),
        "packages": packages(),
        "machine": platform.node(),
        "system": platform.platform(),
        "processor": _processor(),
        "cores": os.cpu_count(),
        "memory_GB": round(psutil.virtual_memory().total / 1e9, 1),
        "slurm_job": os.environ.get("SLURM_JOB_ID", ""),
        "cluster": f"{type(cluster).__name__.lower()}{workers}",
        "simulator": workspace.simulator.name,
        "seed": workspace.seed,
        "study_file": str(study.path),
        "study_hash": digest(text),
        "study_text": text,
        "cohort": "" if workspace.cohort.folder == study.path else str(workspace.cohort.folder),
        "cohort_hash": digest(specimens),
        "specimens": specimens,
    }


def packages() -> dict[str, str]:
    """Versions of the packages that sinew asks for, by name."""
    found = {}
    for line in requires("sinew") or ():
        name = re.split(r"[^A-Za-z0-9_.-]", line, maxsplit=1)[0]
        try:
            found[name] = version(name)
        except PackageNotFoundError:  # an optional one
            continue
    return dict(sorted(found.items(), key=lambda each: each[0].lower()))


def code() -> str:
    """Names the program's own files, which may differ between two checkouts of one version."""
    folders = [Path(str(package.__file__)).parent for package in (runner, tasks)]
    files = sorted(path for folder in folders for path in folder.rglob("*.py"))
    return digest(*(path.read_text("utf-8") for path in files))


def _processor() -> str:
    """The processor's name where the system tells it, else its architecture."""
    told = Path("/proc/cpuinfo")
    if told.is_file():
        found = re.search(r"^model name\s*:\s*(.+)$", told.read_text("utf-8", errors="replace"), re.MULTILINE)
        if found:
            return found.group(1)
    return platform.processor() or platform.machine()
