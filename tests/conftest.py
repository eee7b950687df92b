"""What all tests share: reference curves, a specimen, and the rule that nothing which must run in CI is skipped."""

import atexit
import os
import shutil
import signal
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import hypothesis
import pytest

from sinew.runner.one_thread import use_one_thread

use_one_thread()  # as the command does

import numpy as np  # noqa: E402

from sinew.runner.cluster.client import open_client  # noqa: E402
from sinew.tasks.model import Curve, Model, Protocol, Specimen  # noqa: E402
from tests.shared_folders import made_once  # noqa: E402
from tests.small_disk import unmount_below  # noqa: E402
from tests.warm_workers import WarmWorkers  # noqa: E402

pytest_plugins = ("tests.batch.plugin",)

DATA = Path(__file__).parent / "data"
SHARED = Path(__file__).resolve().parents[2] / "shared"


def pytest_configure() -> None:
    """What a person's own machine must not change, and tests must not leave there; a busy machine fails no example.

    A shell that starts the tests in the background has them ignore two signals, and so would every process they start.
    """
    state = tempfile.mkdtemp(prefix="sinew-tests-")
    atexit.register(shutil.rmtree, state, ignore_errors=True)
    os.environ["XDG_STATE_HOME"] = state
    hypothesis.settings.register_profile("busy machine", deadline=None)
    hypothesis.settings.load_profile("busy machine")
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
    # pytest deletes these at its end, and fails where a session that was killed left something mounted
    for garbage in Path(tempfile.gettempdir()).glob("pytest-of-*/garbage-*"):
        unmount_below(garbage)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if item.get_closest_marker("febio") and shutil.which("febio4") is None:
            item.add_marker(pytest.mark.skip(reason="febio4 is not on the PATH"))
        if item.get_closest_marker("shared") and not SHARED.is_dir():
            item.add_marker(pytest.mark.skip(reason="the reference data of ../shared are not there"))


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    for report in terminalreporter.stats.get("skipped", []):
        if _must_run(report):
            terminalreporter.write_line(f"must run in CI, but was skipped: {report.nodeid}", red=True)


def pytest_sessionfinish(session: pytest.Session, exitstatus: int) -> None:
    reporter = session.config.pluginmanager.get_plugin("terminalreporter")
    if reporter is not None and exitstatus == 0 and any(map(_must_run, reporter.stats.get("skipped", []))):
        session.exitstatus = pytest.ExitCode.TESTS_FAILED


def _must_run(report: pytest.TestReport) -> bool:
    """In CI, only what needs a solver or data that are not there may be skipped."""
    allowed = "febio" in report.keywords or ("shared" in report.keywords and not SHARED.is_dir())
    return os.environ.get("CI") == "true" and not allowed


LEFT_OUT = {"page": "report", "figures": "_draw", "estimate": "_say_how_long"}  # marks, and what they are about


@pytest.fixture(scope="session", autouse=True)
def drawing() -> Iterator[dict[str, Callable[..., Any]]]:
    """Figures and page take longer than all the rest: runs within this process have none, see :func:`_drawn`.

    Nor do they estimate how long they will take. What is yielded draws figures and page all the same.
    """
    from sinew.tasks.study import pipeline

    real = {name: getattr(pipeline, name) for name in LEFT_OUT.values()}
    with pytest.MonkeyPatch.context() as patch:
        for name in real:
            patch.setattr(pipeline, name, lambda *_, **__: None)
        yield real


@pytest.fixture(scope="session", autouse=True)
def _warm_workers() -> Iterator[None]:
    """Studies that run in this process share local workers, see :mod:`tests.warm_workers`."""
    workers = WarmWorkers()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sinew.tasks.study.workspace.open_client", workers.open_client)
        yield
    workers.close()


@pytest.fixture(autouse=True)
def _own_workers(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where workers are what a test is about, its runs start their own."""
    if request.node.get_closest_marker("own_workers"):
        monkeypatch.setattr("sinew.tasks.study.workspace.open_client", open_client)


@pytest.fixture(autouse=True)
def _drawn(
    request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch, drawing: dict[str, Callable[..., Any]]
) -> None:
    """Where a figure or the page is what a test is about, its runs draw them."""
    for mark, name in LEFT_OUT.items():
        if request.node.get_closest_marker(mark):
            monkeypatch.setattr(f"sinew.tasks.study.pipeline.{name}", drawing[name])


@pytest.fixture(scope="session")
def golden_run(tmp_path_factory: pytest.TempPathFactory, drawing: object) -> Path:
    """The result folder of the golden study, to be read only; the study and its cohort are beside it."""
    from tests.golden.study import make

    return made_once(tmp_path_factory, "golden", make) / "out"


@pytest.fixture(autouse=True)
def _environment(monkeypatch: pytest.MonkeyPatch) -> None:
    """What a command in this process sets for its own processes does not reach those of the next test."""
    monkeypatch.setenv("PYTHONSAFEPATH", "")


@pytest.fixture(scope="session", autouse=True)
def _zarr_without_threads() -> Iterator[None]:
    """Zarr reads each file in a thread of its own; the same calls in the thread of its loop take a quarter less."""

    async def here(function: Callable[..., Any], *arguments: Any, **named: Any) -> Any:
        return function(*arguments, **named)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("zarr.storage._local.asyncio", SimpleNamespace(to_thread=here))
        yield


@pytest.fixture(autouse=True)
def _no_waiting_for_the_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    """No test needs its files after a loss of power; on a busy disk, each of many calls would take 10 ms and more."""
    monkeypatch.setattr(os, "fsync", lambda descriptor: None)


@pytest.fixture
def model() -> Model:
    return Model()


@pytest.fixture
def specimen() -> Specimen:
    """A bar whose curves are short and smooth."""
    time_s = np.linspace(0.0, 20.0, 81)
    displacement = 0.4 * np.minimum(time_s / 6.0, 1.0)
    force = 900.0 * displacement * np.exp(-time_s / 60.0)
    curves = (Curve(Protocol("pull", time_s, displacement), force),)
    return Specimen("s01", 10.0, 8.0, 4.0, curves)


def reference(protocol: str) -> tuple[Protocol, np.ndarray]:
    """A protocol of the reference and the forces ``[40, t]`` (N) of its parameter sets."""
    table = np.loadtxt(DATA / "reference" / f"baseline.{protocol}.csv", delimiter=",", skiprows=1)
    return Protocol(protocol, table[:, 0], table[:, 1]), 2.0 * table[:, 2:].T


def reference_parameters(model: Model) -> np.ndarray:
    """Parameter sets ``[40, 16]`` of the reference."""
    path = DATA / "reference" / "baseline.parameters.csv"
    names = path.read_text().splitlines()[0].split(",")
    table = np.loadtxt(path, delimiter=",", skiprows=1)
    return table[:, [names.index(name) for name in model.names]]
