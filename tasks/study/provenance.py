"""Which program works on which data, where: what has to be known to make a result again."""

import json
import os
import platform
import re
import shlex
from collections.abc import Iterable
from functools import cache
from importlib.metadata import PackageNotFoundError, distribution, requires, version
from pathlib import Path
from typing import Any

import psutil

import sinew
from sinew.runner.cluster.batch_systems import current_job
from sinew.runner.cluster.local import Local
from sinew.tasks.model import Specimen
from sinew.tasks.study.files import digest, last_events
from sinew.tasks.study.own_template import template_hash
from sinew.tasks.study.resources import DISTRIBUTION
from sinew.tasks.study.workspace import Workspace

LOG_BYTES = 2**22  # of the end of a log


def facts(workspace: Workspace) -> dict[str, Any]:
    """Versions, machine, seed, study and data of a run, as plain values for the log."""
    study = workspace.study
    specimens = identities(workspace.cohort.specimens)
    cluster = workspace.cluster
    workers = f", {cluster.workers} workers" if isinstance(cluster, Local) else ""
    return {
        "version": version(DISTRIBUTION),
        "code": code(),
        "install": install_command(),
        "python": platform.python_version(),
        "packages": packages(),
        "machine": platform.node(),
        "system": platform.platform(),
        "processor": _processor(),
        "cores": os.cpu_count(),
        "memory_GB": round(psutil.virtual_memory().total / 1e9, 1),
        "slurm_job": current_job() or "",
        "cluster": f"{type(cluster).__name__.lower()}{workers}",
        "simulator": workspace.simulator.name,
        "seed": workspace.seed,
        "study_file": str(study.path),
        "out": str(workspace.out),
        "study_hash": digest(study.text),
        "study_text": study.text,
        "template_hash": template_hash(study, workspace.simulator.name),
        "cohort": "" if workspace.cohort.folder == study.path else str(workspace.cohort.folder),
        "cohort_hash": digest(specimens),
        "specimens": specimens,
    }


def identities(specimens: Iterable[Specimen]) -> dict[str, Any]:
    """What results depend on of each specimen, by its name. The digest of this is the cohort's hash."""
    return {specimen.name: specimen.identity() for specimen in specimens}


def made_for(folder: Path) -> str | None:
    """The hash of the specimens of the last run on a result folder, by its log; None where that does not tell it."""
    runs = [event for event in last_events(folder, LOG_BYTES) if event.get("message") == "run started"]
    found = runs[-1].get("cohort_hash") if runs else None
    return None if found is None else str(found)


def install_command() -> str:
    """The command that installs this very program elsewhere, by where it was installed from (PEP 610)."""
    found = distribution(DISTRIBUTION)
    text = found.read_text("direct_url.json")
    origin = json.loads(text) if text else None
    if origin is None:  # a package index
        return f"pip install {DISTRIBUTION}=={found.version}"
    if "vcs_info" in origin:
        vcs = origin["vcs_info"]
        return "pip install " + shlex.quote(f"{vcs['vcs']}+{origin['url']}@{vcs['commit_id']}")
    wheel = f"{DISTRIBUTION.replace('-', '_')}-{found.version}-py3-none-any.whl"
    return f"make wheel && pip install dist/{wheel}    # in a checkout of sinew; its code: {code()}"


def packages() -> dict[str, str]:
    """Versions of the packages that sinew asks for, by name."""
    found = {}
    for line in requires(DISTRIBUTION) or ():
        name = re.split(r"[^A-Za-z0-9_.-]", line, maxsplit=1)[0]
        try:
            found[name] = version(name)
        except PackageNotFoundError:  # an optional one
            continue
    return dict(sorted(found.items(), key=lambda each: each[0].lower()))


@cache
def code() -> str:
    """Names the program's own files, which may differ between two checkouts of one version."""
    root = Path(sinew.__path__[0])
    files = sorted(path for room in ("runner", "tasks") for path in (root / room).rglob("*.py"))
    return digest(*(path.read_text("utf-8") for path in files))


def _processor() -> str:
    """The processor's name where the system tells it, else its architecture."""
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.is_file():
        found = re.search(r"^model name\s*:\s*(.+)$", cpuinfo.read_text("utf-8", errors="replace"), re.MULTILINE)
        if found:
            return found.group(1)
    return platform.processor() or platform.machine()
