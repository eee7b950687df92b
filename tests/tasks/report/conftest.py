"""One small study with all tasks for all tests of the page, and a browser to read pages with."""

import json
import os
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from bokeh.models import Range1d

from sinew.tasks.calibrate.task import fitted_curves
from sinew.tasks.cluster.spec import cluster_of
from sinew.tasks.data.cohort import write_cohort
from sinew.tasks.data.virtual import virtual_cohort
from sinew.tasks.drawing import plots
from sinew.tasks.report.page import build
from sinew.tasks.study import pipeline
from sinew.tasks.study.study import read_study
from sinew.tasks.study.workspace import Workspace, open_workspace
from tests.shared_folders import made_once

STUDY = """
name: small
seed: 3
cohort: cohort
cluster: {name: local, workers: 1}
tasks: [sobol, importance, calibrate, infer, predict, compare, discover]
store: {points_per_curve: 16}
sobol: {base_samples: 16, resamples: 10}
importance: {trees: 10, repeats: 2}
calibrate: {methods: [bayesian, least_squares], evaluations: 40, starts: 1, bayesian: {evaluations: 12}}
infer: {paper: true, population: 8, generations: 2, epsilon: 1.0, pending: 16}
predict: {draws: 4}
compare: {permutations: 20}
discover: {effects: [toe-slack, time-lag], starts: 1}
"""


@pytest.fixture(scope="session")
def whole_run(tmp_path_factory: pytest.TempPathFactory, drawing: object) -> Path:
    """The result folder of a study with all tasks, to be read only; without figures, as they take longer than all.

    Each process has its own copy: a test moves it away for a while.
    """
    made, folder = made_once(tmp_path_factory, "report", _whole_run), tmp_path_factory.mktemp("report")
    shutil.copytree(made, folder, dirs_exist_ok=True)
    log = folder / "out" / "log.jsonl"
    log.write_text(log.read_text().replace(str(made), str(folder)))  # it says where the study is
    build(folder / "out")
    return folder / "out"


def _whole_run(folder: Path) -> None:
    specimens, truth = virtual_cohort(seed=1, per_site=1, rate_hz=1.0)
    write_cohort(folder / "cohort", specimens[:2], truth)
    (folder / "study.yaml").write_text(STUDY)
    study = read_study(folder / "study.yaml")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Workspace, "client", lambda self: None)  # evaluates in this process
        cluster = cluster_of(study)
        with open_workspace(study, out=folder / "out", cluster=cluster, quiet=True) as workspace:
            results = pipeline.run(workspace, study.tasks)
            for specimen in workspace.cohort.specimens:
                fitted_curves(workspace, specimen, results["calibrate"].specimens[specimen.name].parameters)


@pytest.fixture
def run_folder(whole_run: Path, tmp_path: Path) -> Path:
    """A copy of that result folder, to be spoilt."""
    return Path(shutil.copytree(whole_run, tmp_path / "out"))


@pytest.fixture
def no_plots(monkeypatch: pytest.MonkeyPatch) -> None:
    """For tests of texts: plots stay empty, which takes a fifth of the time that a page takes."""
    for name in ("figure", "column"):
        monkeypatch.setattr(plots, name, lambda *_, **options: Nothing())
    for name in ("hover", "legend"):
        monkeypatch.setattr(plots, name, lambda *_, **options: None)
    monkeypatch.setattr(plots, "item", lambda _: {})


class Nothing:
    """A plot without anything; whatever is done to it gives nothing."""

    x_range = y_range = Range1d()

    def __getattr__(self, name: str) -> Any:
        return self

    def __call__(self, *_: Any, **options: Any) -> Any:
        return self

    def __add__(self, other: Any) -> Any:
        return self

    def __int__(self) -> int:
        return 0


@pytest.fixture(scope="session")
def chromium() -> Iterator[Any]:
    """A headless Chromium. Its profile is its own, and it must not ask anybody for anything."""
    binary, driver = (shutil.which(name) for name in ("chromium", "chromedriver"))
    if binary is None or driver is None:
        pytest.skip("chromium and chromium-driver are not installed")
    from selenium import webdriver
    from selenium.webdriver.chrome.service import Service

    options = webdriver.ChromeOptions()
    options.binary_location = binary
    for argument in ("headless=new", "disable-gpu", "disable-dev-shm-usage", "no-first-run",
                     "disable-background-networking", "disable-component-update"):  # fmt: skip
        options.add_argument(f"--{argument}")
    if os.geteuid() == 0:  # Chromium's sandbox does not work for root
        options.add_argument("--no-sandbox")
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    browser = webdriver.Chrome(options=options, service=Service(driver))
    browser.set_script_timeout(60)
    try:
        yield browser
    finally:
        browser.quit()


def edit(path: Path, change: Any) -> None:
    """Change a JSON file in place."""
    content = json.loads(path.read_text())
    change(content)
    path.write_text(json.dumps(content))
