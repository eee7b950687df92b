"""Real batch systems on this machine, for the tests of every package: one set of daemons for each process of pytest.

| fixture | what it gives |
|---|---|
| ``slurm_cluster`` | a SLURM; its commands work in the test and in the processes that it starts |
| ``bed`` | the functions of its testbed, for tests that kill daemons; repairs what they broke |
| ``grid_engine_cluster`` | the same as ``slurm_cluster`` for Grid Engine |

Tests that use one are marked ``slurm``, and start with the longest.
"""

import importlib.util
import os
import subprocess
import sys
from collections.abc import Generator, Iterator
from itertools import zip_longest
from pathlib import Path
from types import ModuleType
from typing import Any

import psutil
import pytest

from tests.batch import grid_engine, places

QUEUES = {  # the command that lists the jobs of each, with those that have ended
    "slurm_cluster": ("squeue", "--states=all", "--format=%i %j %T %r %N %M"),
    "grid_engine_cluster": ("qstat", "-u", "*", "-s", "prsz"),
}
DAEMONS = set(QUEUES)
TAIL = 25  # lines of each log that are shown when a test fails
LONGEST_S = 1200.0  # of a test: for what hangs, as a busy machine needs more walltimes


# ---- which tests these are, and their order


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the tests that use a batch system. The longest come first, each followed by a quick one.

    A worker of pytest-xdist gets the test after the one that it runs, which must not be kept waiting there.
    """
    ours = [item for item in items if _needs_daemons(item)]
    for item in ours:
        item.add_marker(pytest.mark.slurm)
        item.add_marker(pytest.mark.timeout(LONGEST_S))
    long = sorted((item for item in ours if _seconds(item)), key=_seconds, reverse=True)
    quick = [item for item in ours if not _seconds(item)]
    pairs = zip_longest(long, quick)
    items[:] = [item for item in items if item not in ours] + [item for pair in pairs for item in pair if item]


def _needs_daemons(item: pytest.Item) -> bool:
    used = set(getattr(item, "fixturenames", ()))
    return bool(used & DAEMONS) or item.get_closest_marker("slurm") is not None


def _seconds(item: pytest.Item) -> float:
    """How long a test takes on an idle machine, by its mark."""
    mark = item.get_closest_marker("takes")
    return mark.args[0] if mark else 0.0


# ---- SLURM


def load_testbed() -> ModuleType:
    """The module that starts a SLURM on this machine."""
    path = Path(__file__).parents[2] / "slurm" / "testbed" / "testbed.py"
    spec = importlib.util.spec_from_file_location("testbed", path)
    module = importlib.util.module_from_spec(spec)
    sys.modules["testbed"] = module
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="session")
def slurm_for_all(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    module = load_testbed()
    if missing := module.missing():
        pytest.skip(f"SLURM is not installed ({', '.join(missing)})")
    testbed = module.start(tmp_path_factory.mktemp("slurm"), nodes=4, cpus=2)
    try:
        yield testbed
    finally:
        module.stop(testbed)


@pytest.fixture
def slurm_cluster(
    slurm_for_all: Any, tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Any]:
    """A real SLURM of four nodes with two cores each; its commands work here and in processes started from here.

    No job is left when a test ends: a cancelled job stays in the queue for some seconds, where the next test of the
    same daemons would see it.
    """
    from sinew.runner.cluster import slurm
    from tests.tasks.cluster.slurm_studies import live, until

    _set_up(slurm_for_all, tmp_path_factory, monkeypatch)
    yield slurm_for_all
    slurm.cancel([job.job for job in live()])
    until(lambda: not live(), "the end of all jobs")


@pytest.fixture
def bed(slurm_cluster: Any) -> Iterator[ModuleType]:
    """The functions of the testbed. When a test ends, all daemons run, all nodes are up and no process is left."""
    from sinew.runner.cluster import slurm
    from tests.tasks.cluster.slurm_studies import live, processes_of_jobs, until

    module = sys.modules[type(slurm_cluster).__module__]
    yield module
    if not _lives(slurm_cluster, "slurmctld"):
        module.start_controller(slurm_cluster)
    for node in slurm_cluster.names:
        if not _lives(slurm_cluster, f"slurmd.{node}"):
            module.restore_node(slurm_cluster, node)
    slurm.cancel([job.job for job in live()])
    until(lambda: not live() and not processes_of_jobs(), "the end of all jobs")
    for node in slurm_cluster.run("sinfo", "-hN", "-t", "drain", "-p", "work", "-o", "%N").split():
        slurm_cluster.run("scontrol", "update", f"NodeName={node}", "State=RESUME")


def _lives(testbed: Any, daemon: str) -> bool:
    path = testbed.root / f"{daemon}.pid"
    return path.exists() and psutil.pid_exists(int(path.read_text()))


# ---- Grid Engine


@pytest.fixture(scope="session")
def grid_engine_for_all(tmp_path_factory: pytest.TempPathFactory) -> Iterator[grid_engine.Testbed]:
    if missing := grid_engine.missing():
        pytest.skip(f"Grid Engine is not installed ({', '.join(missing)})")
    try:
        testbed = grid_engine.start(tmp_path_factory.mktemp("grid-engine"))
    except RuntimeError:  # another program may have taken a port between its choice and its use
        testbed = grid_engine.start(tmp_path_factory.mktemp("grid-engine"))
    try:
        yield testbed
    finally:
        grid_engine.stop(testbed)


@pytest.fixture
def grid_engine_cluster(
    grid_engine_for_all: grid_engine.Testbed,
    tmp_path_factory: pytest.TempPathFactory,
    monkeypatch: pytest.MonkeyPatch,
) -> grid_engine.Testbed:
    """A real Grid Engine with one node of eight slots; its commands work here and in processes started from here."""
    _set_up(grid_engine_for_all, tmp_path_factory, monkeypatch)
    return grid_engine_for_all


# ---- both


def _set_up(testbed: Any, folders: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    """What commands of a batch system and :mod:`tests.batch.places` need in the environment."""
    for name, value in testbed.environment.items():
        monkeypatch.setenv(name, value)
    base = folders.getbasetemp()
    monkeypatch.setenv(places.FOLDER, str(base.parent if "PYTEST_XDIST_WORKER" in os.environ else base))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """A failed test shows the queue, and the ends of the logs of its studies and of the batch system."""
    report = yield
    values = getattr(item, "funcargs", {})
    for cluster, queue in QUEUES.items():
        if report.failed and cluster in values:
            report.sections.append((queue[0], _queue(values[cluster], queue)))
            for path in _logs(values[cluster].root, values.get("tmp_path")):
                report.sections.append((str(path), "\n".join(path.read_text(errors="replace").splitlines()[-TAIL:])))
    return report


def _queue(testbed: Any, command: tuple[str, ...]) -> str:
    try:
        done = subprocess.run(command, env=os.environ | testbed.environment, capture_output=True, text=True, timeout=60)
    except (subprocess.SubprocessError, OSError) as error:
        return str(error)
    return done.stdout + done.stderr


def _logs(daemons: Path, studies: Path | None) -> list[Path]:
    """The logs of a batch system's daemons, and of the result folders below ``studies``: of jobs and of runs."""
    found = [*sorted(daemons.glob("*.log")), *sorted(daemons.glob("spool/**/messages"))]
    for jobs in [] if studies is None else sorted(studies.rglob("jobs")):
        found += [jobs.with_name("log.jsonl"), *sorted(jobs.glob("*.jsonl")), *sorted(jobs.glob("*.log"))]
    return [path for path in found if path.is_file()]
