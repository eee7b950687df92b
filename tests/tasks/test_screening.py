"""Morris and PAWN as tasks of a study: what they leave, what they pay for, and what is done again."""

import json

import numpy as np
import pytest

import sinew
from sinew.tasks.data.cohort import write_cohort
from sinew.tasks.data.virtual import virtual_cohort
from sinew.tasks.model import Model
from sinew.tasks.morris.method import trajectories
from sinew.tasks.morris.result import MorrisResult
from sinew.tasks.pawn.result import PawnResult
from sinew.tasks.report.page import build
from sinew.tasks.study import pipeline
from sinew.tasks.study.model import model_of
from tests.tasks.few_parameters import held_but

FREE = ("E_f", "alpha_f", "E_m")
FIXED = held_but(FREE)
STUDY = f"""
name: screened
seed: 4
cohort: cohort
cluster: {{name: local, workers: 1}}
tasks: [sobol, morris, pawn]
sobol: {{base_samples: 16, resamples: 10}}
morris: {{trajectories: 6, resamples: 20}}
pawn: {{slides: 4, resamples: 20}}
store: {{points_per_curve: 16}}
model:
  parameters:
{FIXED}"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory, drawing):
    here = tmp_path_factory.mktemp("screening")
    specimens, _ = virtual_cohort(seed=2, per_site=1, rate_hz=0.5)
    write_cohort(here / "cohort", specimens[:2])
    (here / "study.yaml").write_text(STUDY)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pipeline, "_draw", drawing["_draw"])
        sinew.run(sinew.read_study(here / "study.yaml"), out=here / "out", figures=True)
    return here / "out"


def model_of_study(folder) -> Model:
    study = sinew.read_study(folder.parent / "study.yaml")
    return model_of(study.model, study.simulator.law)


def finished(folder) -> dict[str, int]:
    events = [json.loads(line) for line in (folder / "log.jsonl").read_text().splitlines()]
    return {event["task"]: event["new_simulations"] for event in events if event["message"] == "task finished"}


def test_morris_pays_for_its_trajectories_and_pawn_for_nothing(folder):
    design = trajectories(model_of_study(folder), 6, 4, seed=4)
    points = len(np.unique(design.rows, axis=0))  # trajectories through a coarse grid meet
    assert finished(folder) == {"sobol": 2 * 16 * 5, "morris": 2 * points, "pawn": 0}


def test_results_name_the_strongest_parameter_and_open_as_tables(folder):
    results = sinew.results(folder)
    for task, column in (("morris", "mu_star"), ("pawn", "median")):
        table = getattr(results, task).table
        assert set(table.index.get_level_values("output")) == {"total", "one_step", "two_step", "cyclic"}
        assert table.loc["total", column].idxmax() == results.sobol.table.loc["total", "ST"].idxmax()
        getattr(results, task).plot()
        tree = results.xarray()
        assert tree[task][column].sizes == {"output": 4, "parameter": 3}


def test_results_are_read_back_as_they_were_written(folder):
    for kind in (MorrisResult, PawnResult):
        before = kind.path(folder).read_bytes()
        kind.read(folder).write(folder)
        again = json.loads(kind.path(folder).read_bytes())
        assert again == json.loads(before)
        assert again["version"] == kind.VERSION


def test_each_has_its_section_of_the_page_and_its_figures(folder):
    built = build(folder)
    assert built.trouble == ()
    page = built.path.read_text()
    assert 'id="screening"' in page
    assert 'id="distributions"' in page
    for name in ("morris", "pawn"):
        assert {path.suffix for path in (folder / "figures").glob(f"{name}.*")} == {".png", ".pdf", ".csv"}


def test_what_is_unchanged_is_not_done_again(folder, monkeypatch):
    study = sinew.read_study(folder.parent / "study.yaml")
    for task in ("morris", "pawn"):
        method = f"sinew.tasks.{task}.task.{'elementary_effects' if task == 'morris' else 'pawn_indices'}"
        monkeypatch.setattr(method, lambda *_, **__: pytest.fail("analysed again"))
    sinew.run(study, "morris", "pawn", out=folder)


def test_pawn_needs_the_sobol_study(folder, tmp_path):
    study = sinew.read_study(folder.parent / "study.yaml")
    with pytest.raises(sinew.BadInput, match="`sinew sobol` on this study first"):
        sinew.run(study, "pawn", out=tmp_path)
    assert not list(tmp_path.iterdir())
