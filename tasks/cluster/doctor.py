"""Would a study run on this cluster? Looks at the login node, then at a worker, and evaluates one row there."""

import dataclasses
import math
import os
import platform
import shutil
import socket
import ssl
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import psutil
from distributed import Client

from sinew.runner.cluster import drain
from sinew.runner.cluster.batch_systems import current, current_job, this_node
from sinew.runner.cluster.client import ClusterSpec, ask_for, open_client, wait_for_workers
from sinew.runner.cluster.jobs import Jobs
from sinew.runner.errors import BadInput, ClusterError, SinewError, one_line
from sinew.runner.evaluation import external
from sinew.runner.store.schema import STATUSES
from sinew.tasks.cluster.profile import Profile
from sinew.tasks.cluster.submission import check_scripts, job_scripts
from sinew.tasks.data.cohort import Cohort
from sinew.tasks.drawing.blocks import plural, span
from sinew.tasks.model import FORCE, Specimen
from sinew.tasks.simulate import Array, Capabilities
from sinew.tasks.simulate.build import simulator_of
from sinew.tasks.simulate.evaluation import SpecimenEvaluation
from sinew.tasks.study.estimate import work_of
from sinew.tasks.study.model import model_of
from sinew.tasks.study.range_check import look
from sinew.tasks.study.study import Study
from sinew.tasks.study.work import Given, points_kept
from sinew.tasks.study.workspace import attempts_folder, check_cohort

GIB = 2**30
CLOCK_S = 5.0
ALLOCATED_AT_MOST = GIB
SCRATCH = GIB  # that a worker should have for the solver's files
FILES_AT_MOST = 500
OTHER_NUMBERS = 32  # of a row, beside its curves
FAR = 10.0  # between measured and simulated forces, which no reference values should be apart


@dataclass(frozen=True)
class Finding:
    """What was looked at, whether it will do, and what was seen, with what to do about it."""

    name: str
    good: bool
    words: str


Tell = Callable[[Finding], None]


def examine(
    study: Study,
    profile: Profile | None,
    cluster: ClusterSpec,
    out: Path,
    tell: Tell,
    *,
    data: Path | None = None,
    simulator: str | None = None,
    wait_s: float = 600.0,
) -> list[Finding]:
    """Look at everything that a run needs; ``tell`` hears of each finding at once. Nothing of it is left behind."""
    findings: list[Finding] = []

    def note(name: str, good: bool, words: str) -> None:
        findings.append(Finding(name, good, one_line(words)))
        tell(findings[-1])

    cohort = check_cohort(study, data, out)
    specimens = cohort.specimens
    note("study and cohort", True, f"{plural(len(specimens), 'specimen')}{_compared(specimens)}")
    _look_at_the_ranges(study, cohort, out, note)
    with _temporary_folder(out) as folder:
        rows = _rows(study, cohort, simulator, folder)
        _look_at_the_disk(_numbers(study, cohort, rows), rows.total(), folder, note)
        if profile is not None:
            _look_at_the_batch_system(study, profile, out, note)
        if isinstance(cluster, Jobs):
            cluster = dataclasses.replace(cluster, folder=folder, maximum=1, minimum=0, poll_s=min(cluster.poll_s, 2.0))
        try:
            with open_client(cluster) as client:
                _look_at_a_worker(client, study, specimens, cluster, folder, note, simulator, wait_s, rows.total())
        except ClusterError as error:
            note("worker", False, str(error))
    return findings


@contextmanager
def _temporary_folder(out: Path) -> Iterator[Path]:
    """A folder in the result folder, which all nodes must see. What was not there before is gone afterwards."""
    missing = [folder for folder in (out, *out.absolute().parents) if not folder.exists()]
    out.mkdir(parents=True, exist_ok=True)
    try:
        with tempfile.TemporaryDirectory(prefix="doctor-", dir=out.absolute()) as folder:
            yield Path(folder)
    finally:
        for folder_made in missing:
            folder_made.rmdir()


Note = Callable[[str, bool, str], None]


def _compared(specimens: tuple[Specimen, ...]) -> str:
    """What is compared, where that is more than the force: how noisy it is, and at how many points of a specimen."""
    parts = []
    for name in dict.fromkeys(name for one in specimens for name in one.noise):
        levels = span([one.noise[name] for one in specimens if name in one.noise])
        points = [
            sum(int(np.isfinite(curve.force_N if name == FORCE else curve.others[name]).sum()) for curve in one.curves)
            for one in specimens
            if name in one.noise
        ]
        parts.append(f"{name} ({span(points)} points, noise {levels})")
    return f"; compared: {', '.join(parts)}" if parts else ""


def _look_at_the_ranges(study: Study, cohort: Cohort, out: Path, note: Note) -> None:
    """Whether the ranges of the parameters can reach the measured forces, and which parameters no test sees."""
    ranges = look(study, cohort, out)
    if ranges is None:
        return
    try:
        ranges.refuse(study.path)
        note("ranges", not ranges.out_of_reach, "; ".join(ranges.remarks()) or "they reach every measured force")
    except BadInput as error:
        note("ranges", False, str(error))


def _look_at_the_disk(numbers: int, rows: int, folder: Path, note: Note) -> None:
    """Room for so many ``numbers`` of ``rows``, in bytes and in files, and whether a quota allows it."""
    needed = 8 * numbers
    files = min(FILES_AT_MOST, 20 + rows // 100)
    place = os.statvfs(folder)
    free, inodes = place.f_bavail * place.f_frsize, place.f_favail
    room = f"the study writes up to {_size_of(needed)}, {_size_of(free)} are free"
    note("disk", free > needed, room)
    try:
        with open(folder / "allocated", "wb") as file:
            os.posix_fallocate(file.fileno(), 0, max(1, min(needed, ALLOCATED_AT_MOST)))
        for number in range(files):
            (folder / f"file-{number}").touch()
        note("quota", True, f"{_size_of(min(needed, ALLOCATED_AT_MOST))} and {files} files could be made")
    except OSError as error:
        note("quota", False, f"{error.strerror}; {inodes:,} files are free: make room, or take another --out")
    finally:
        (folder / "allocated").unlink(missing_ok=True)
        for path in folder.glob("file-*"):
            path.unlink()
    (folder / "clock").touch()
    apart = abs((folder / "clock").stat().st_mtime - time.time())
    note("clock of the disk", apart < CLOCK_S, f"{apart:.1f} s apart from that of {socket.gethostname()}")


def _size_of(count: float) -> str:
    return f"{count / GIB:,.1f} GiB" if count >= GIB else f"{count / 2**20:,.1f} MiB"


def _rows(study: Study, cohort: Cohort, simulator: str | None, folder: Path) -> Counter[str]:
    """How many evaluations the study's tasks ask for, at most, by specimen."""
    try:
        can = simulator_of(study, simulator, folder).capabilities
    except BadInput:  # workers may have the solver, where this machine has none
        can = Capabilities(effects="solver")
    given = Given(study, cohort, model_of(study.model, study.simulator.law), can)
    rows: Counter[str] = Counter()
    for name in study.tasks:
        rows.update(work_of(given, name).rows)
    return rows


def _numbers(study: Study, cohort: Cohort, rows: Counter[str]) -> int:
    """How many numbers the store keeps of these rows."""
    kept = {one.name: points_kept(one, study.store.points_per_curve) for one in cohort.specimens}
    return sum(count * (kept.get(name, 0) + OTHER_NUMBERS) for name, count in rows.items())


def _look_at_the_batch_system(study: Study, profile: Profile, out: Path, note: Note) -> None:
    try:
        note(profile.system.title, True, profile.system.version())
        check_scripts(profile, job_scripts(study, profile, out, ()))
        note("profile", True, f"{profile.system.title} takes the jobs of {profile.path}")
    except SinewError as error:
        note("profile", False, str(error))


def _look_at_a_worker(
    client: Client,
    study: Study,
    specimens: tuple[Specimen, ...],
    cluster: ClusterSpec,
    folder: Path,
    note: Note,
    simulator: str | None,
    wait_s: float,
    rows: int,
) -> None:
    ask_for(client, 1)
    until = time.monotonic() + wait_s

    def check() -> None:
        ask_for(client, 1)
        if time.monotonic() > until:
            raise ClusterError(f"no worker came within {wait_s:g} s; wait for longer by --wait, or ask for less")

    wait_for_workers(client, check)
    address = str(client.scheduler_info()["address"])
    encrypted = address.startswith("tls://")
    refused = encrypted and _is_refused(address)
    words = "a stranger is refused" if refused else "a stranger can connect: set tls: true in the profile"
    note("TLS", refused, f"{address}: {words}")

    worker = next(iter(client.scheduler_info()["workers"]))
    before = time.time()
    seen = client.run(_seen_on_a_worker, folder, workers=[worker])[worker]
    apart = max(before - seen["time"], seen["time"] - time.time(), 0.0)
    job = f", job {seen['job']}" if seen["job"] else ""
    note("worker", True, f"{seen['node']}{job}, Python {seen['python']}")
    note("clock of the worker", apart < CLOCK_S, f"{apart:.1f} s apart from that of {socket.gethostname()}")
    sees = "sees it" if seen["shared"] else "does not see it: put --out on a disk that all nodes share"
    note("result folder", seen["shared"], f"the worker {sees}")
    given = seen["cpus_per_task"]
    enough = given is None or not isinstance(cluster, Jobs) or given >= cluster.cores
    workers = cluster.cores if isinstance(cluster, Jobs) else 1
    threads = seen["threads"]
    words = f"{workers} workers with {threads or '?'} thread each on {given or seen['cores']} CPUs"
    note("threads", enough and threads == "1", words)
    note("network interface", True, f"{address.rpartition(':')[0]}; the worker has {', '.join(seen['interfaces'])}")
    free = f"{seen['scratch']}, {_size_of(seen['scratch_free'])} free"
    enough = seen["scratch_free"] > SCRATCH
    note("scratch", enough, free if enough else f"{free}; expected {_size_of(SCRATCH)}")
    outcome = client.submit(_canary, study, specimens[0], simulator, folder, workers=[worker], pure=False).result()
    _note_canary(outcome, study, specimens, cluster, note, rows)


def _seen_on_a_worker(folder: Path) -> dict[str, Any]:
    scratch = external.scratch(attempts_folder(folder.parent))
    existing = next(place for place in (scratch, *scratch.parents) if place.exists())
    try:
        (folder / "seen").touch()
        shared = (folder / "clock").exists()
    except OSError:
        shared = False
    system = current()
    return {
        "time": time.time(),
        "node": this_node(),
        "job": current_job(),
        "python": platform.python_version(),
        "shared": shared,
        "cpus_per_task": None if system is None else system.cpus(),
        "cores": len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count(),
        "threads": os.environ.get("OMP_NUM_THREADS"),
        "interfaces": sorted(psutil.net_if_addrs()),
        "scratch": str(scratch),
        "scratch_free": shutil.disk_usage(existing).free if os.access(existing, os.W_OK) else 0,
        "walltime_s": drain.walltime_s(),
    }


def _canary(study: Study, specimen: Specimen, simulator: str | None, folder: Path) -> dict[str, Any]:
    """On a worker: find the solver, and evaluate the reference parameters of the first specimen."""
    try:
        chosen = simulator_of(study, simulator, folder / "attempts")
        model = model_of(study.model, study.simulator.law)
        reference = np.array([[parameter.reference for parameter in model.parameters]])
        evaluation = SpecimenEvaluation(model, specimen, chosen, study.store.points_per_curve)
        started = time.perf_counter()
        outcome = evaluation(reference)
    except (SinewError, OSError) as error:
        return {"error": str(error)}
    status = STATUSES[int(outcome.status[0])]
    return {
        "solver": getattr(chosen, "executable", chosen.name),
        "version": getattr(chosen, "version", "with sinew"),
        "confinement": getattr(chosen, "confinement", ""),
        "batched": chosen.capabilities.batch_multiple > 1,
        "seconds": time.perf_counter() - started,
        "status": status,
        "message": outcome.messages[0] if outcome.messages else "",
        "peaks_N": _peaks(specimen, outcome.values) if evaluation.scored else {},
        "walltime_s": drain.walltime_s(),
    }


def _peaks(specimen: Specimen, values: Mapping[str, Array]) -> dict[str, tuple[float, float]]:
    """The largest measured and simulated force (N) of each curve."""
    peaks = {}
    for curve in specimen.curves:
        both = (curve.force_N, values[f"force_{curve.name}"][0])
        measured, simulated = (float(force[np.abs(force).argmax()]) for force in both)
        peaks[curve.name] = (measured, simulated)
    return peaks


def _note_peaks(peaks: Mapping[str, tuple[float, float]], note: Note) -> None:
    """Nobody knows what the ranges of a template can reach; its reference values should be somewhere near."""
    apart = {name: _apart(*both) for name, both in peaks.items() if both[0]}
    if not apart:
        return
    worst = max(apart, key=apart.__getitem__)
    measured, simulated = peaks[worst]
    words = f"{worst}: largest force {measured:.3g} N measured, {simulated:.3g} N at the reference values"
    good = apart[worst] <= math.log(FAR)
    note("forces", good, words if good else f"{words}: look at the sign, the units and the ranges")


def _apart(measured: float, simulated: float) -> float:
    """The logarithm of the factor between two forces; infinite where one pulls and the other pushes."""
    if not math.copysign(1.0, measured) * simulated > 0:
        return math.inf
    return abs(math.log(abs(measured)) - math.log(abs(simulated)))


def _note_canary(
    outcome: dict[str, Any], study: Study, specimens: tuple[Specimen, ...], cluster: ClusterSpec, note: Note, rows: int
) -> None:
    if "error" in outcome:
        note("solver", False, outcome["error"])
        return
    confinement = f"; {outcome['confinement']}" if outcome["confinement"] else ""
    note("solver", True, f"{outcome['solver']}, version {outcome['version']}{confinement}")
    seconds = outcome["seconds"]
    fits = math.isinf(outcome["walltime_s"]) or seconds * drain.SAFETY + 2 * drain.CLOSING_S < outcome["walltime_s"]
    words = f"{specimens[0].name}: {outcome['status']} in {seconds:.3g} s"
    if outcome["message"]:
        words += f" ({outcome['message']})"
    note("canary", outcome["status"] == "ok", words)
    if study.simulator.law == "template" and outcome["status"] == "ok":
        _note_peaks(outcome["peaks_N"], note)
    if not fits:
        note("walltime", False, f"{outcome['walltime_s']:.0f} s are too short for an evaluation of {seconds:.3g} s")
    slots = cluster.maximum * cluster.cores if isinstance(cluster, Jobs) else getattr(cluster, "workers", 1)
    hours = rows * seconds / 3600
    if not outcome["batched"]:
        words = f"{rows:,} rows, about {hours:.3g} core-hours, {hours / slots:.3g} h on {slots} workers"
        note("size", True, words)


def _is_refused(address: str) -> bool:
    """Whether somebody without the run's certificate is turned away."""
    context = ssl.create_default_context()
    context.check_hostname = False
    context.verify_mode = ssl.CERT_NONE
    host, _, port = address.removeprefix("tls://").rpartition(":")
    try:
        with (
            socket.create_connection((host.strip("[]"), int(port)), timeout=10) as plain,
            context.wrap_socket(plain) as stranger,
        ):
            stranger.settimeout(5)
            return stranger.recv(1) == b""  # in TLS 1.3 the refusal comes with the first bytes
    except (ssl.SSLError, ConnectionError):
        return True
    except OSError:
        return False
