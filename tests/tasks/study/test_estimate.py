"""The time a study takes, as it is told before any work."""

import json
import shutil
import sys
from dataclasses import replace

import pytest

from sinew.runner.errors import BadInput
from sinew.tasks.cli import main as cli
from sinew.tasks.data.cohort import read_cohort, write_cohort
from sinew.tasks.data.virtual import virtual_cohort
from sinew.tasks.registry import TASKS
from sinew.tasks.report.status import about_left, left_of_run
from sinew.tasks.simulate.uniaxial import Uniaxial
from sinew.tasks.study import estimate as module
from sinew.tasks.study.estimate import estimate, estimate_of
from sinew.tasks.study.model import model_of
from sinew.tasks.study.study import read_study
from sinew.tasks.study.work import Given, Work, points

SETTINGS = {
    "sobol": "sobol: {base_samples: %d}",
    "morris": "morris: {trajectories: %d}",
    "pawn": "pawn: {resamples: %d}",
    "importance": "importance: {trees: %d}",
    "calibrate": "calibrate: {bayesian: {evaluations: %d}}",
    "infer": "infer: {paper: true, population: %d}",
    "predict": "predict: {draws: %d}",
    "compare": "compare: {permutations: %d}",
}


@pytest.fixture(scope="module")
def cohort(tmp_path_factory):
    folder = tmp_path_factory.mktemp("estimate") / "cohort"
    write_cohort(folder, virtual_cohort(per_site=1, rate_hz=10.0, seed=5)[0])
    return folder


def given(cohort, tmp_path, more="") -> Given:
    path = tmp_path / "study.yaml"
    path.write_text(f"name: s\nseed: 1\ncohort: {cohort}\n{more}\n", "utf-8")
    study = read_study(path)
    return Given(study, read_cohort(cohort), model_of(study.model, "tendon"), Uniaxial().capabilities)


def work_of(name, told: Given) -> Work:
    return TASKS[name].module("work").work(told, told.study.section(TASKS[name].settings))


def seconds(work: Work) -> float:
    return work.evaluations * 1e-4 + work.here_s + work.shared_s


@pytest.mark.parametrize("name", SETTINGS)
def test_more_to_do_takes_longer(cohort, tmp_path, name):
    few = work_of(name, given(cohort, tmp_path, SETTINGS[name] % 64))
    many = work_of(name, given(cohort, tmp_path, SETTINGS[name] % 512))
    assert 0 < seconds(few) < seconds(many) < 16 * seconds(few)


def test_the_least_that_an_inference_may_do_is_some_work(cohort, tmp_path):
    assert work_of("infer", given(cohort, tmp_path, "infer: {method: abc, generations: 1}")).evaluations > 0


def test_an_inference_by_likelihood_takes_longer_with_more_points_and_for_specimens_alone(cohort, tmp_path):
    told = given(cohort, tmp_path, "infer: {method: likelihood}")
    thin = [replace(one, curves=one.curves[:1]) for one in told.cohort.specimens]
    together = [replace(one, name=f"one/{number}") for number, one in enumerate(told.cohort.specimens)]
    alone, fewer, site = (
        work_of("infer", replace(told, cohort=replace(told.cohort, specimens=specimens))).shared_s
        for specimens in (told.cohort.specimens, thin, together)
    )
    short = given(cohort, tmp_path, "infer: {method: likelihood, sweeps: 100}")
    assert 2 * work_of("infer", short).shared_s < alone
    first = given(cohort, tmp_path, f"infer: {{method: likelihood, protocols: [{thin[0].curves[0].name}]}}")
    assert work_of("infer", first).shared_s == pytest.approx(fewer)
    assert fewer < alone
    assert 1.5 * site < alone < 6 * site


def test_a_discovery_takes_longer_with_more_candidates(cohort, tmp_path):
    few = work_of("discover", given(cohort, tmp_path, "discover: {effects: [grip-slip]}"))
    every = work_of("discover", given(cohort, tmp_path))
    assert 0 < 5 * few.shared_s < every.shared_s
    told = given(cohort, tmp_path)
    solver = work_of("discover", replace(told, can=replace(told.can, effects="solver")))
    assert solver.evaluations > every.evaluations == 0
    assert every.shared_s > 1.5 * solver.shared_s, "only with the embedded simulator it goes on to several effects"


def test_evaluations_are_those_that_the_tasks_plan(cohort, tmp_path):
    told = given(cohort, tmp_path, "sobol: {base_samples: 64, specimens: [distal/1]}\nmorris: {trajectories: 10}")
    free = len(told.model.free)
    assert work_of("sobol", told).rows == {"distal/1": 64 * (free + 2)}
    assert work_of("morris", told).rows == {one.name: 10 * (free + 1) for one in told.cohort.specimens}
    second = given(cohort, tmp_path, "sobol: {base_samples: 64, second_order: true}")
    assert work_of("sobol", second).evaluations == 3 * 64 * (2 * free + 2)


def test_workers_share_evaluations_and_done_tasks_cost_nothing(cohort, tmp_path, monkeypatch):
    monkeypatch.setattr(module, "_row_s", lambda *_: 1.0)
    monkeypatch.setattr(module, "_slower", lambda: 1.0)
    told = given(cohort, tmp_path, "sobol: {base_samples: 64}")
    one, four = (estimate(told, Uniaxial(), ["sobol", "morris"], tmp_path, workers) for workers in (1, 4))
    rows = 64 * (len(told.model.free) + 2) * 3
    assert one.tasks[0].wall_s == pytest.approx(rows / module.SENT_QUICK, rel=0.1)
    assert one.wall_s / four.wall_s == pytest.approx(4, rel=0.05)
    (tmp_path / "sobol.json").write_text("{}")
    again = estimate(told, Uniaxial(), ["sobol"], tmp_path, 1)
    assert again.tasks[0].done
    assert again.wall_s == 0


def test_a_longer_curve_takes_longer(cohort, tmp_path, monkeypatch):
    monkeypatch.setattr(module, "_slower", lambda: 1.0)
    monkeypatch.setattr(module, "_row_s", lambda given, simulator, specimen: 1e-3 * points(specimen))
    told = given(cohort, tmp_path, "sobol: {base_samples: 64, specimens: [distal/1]}")
    alone = estimate(told, Uniaxial(), ["sobol"], tmp_path, 1).tasks[0]
    expected = alone.evaluations * 1e-3 * points(told.specimens(["distal/1"])[0]) / module.SENT_QUICK
    assert alone.wall_s == pytest.approx(expected, rel=0.01)


def test_nothing_is_written_and_a_row_is_measured(cohort, tmp_path):
    told = given(cohort, tmp_path)
    before = sorted(tmp_path.rglob("*"))
    found = estimate_of(told.study, ["sobol"], tmp_path / "out", 2, data=None, simulator=None)
    assert sorted(tmp_path.rglob("*")) == before
    assert 1e-7 < found.row_s < 0.1
    assert found.tasks[0].evaluations > 100_000


def test_a_model_that_fails_at_its_reference_is_one_line(cohort, tmp_path, monkeypatch):
    told = given(cohort, tmp_path)
    compare = Uniaxial.compare

    def fails(*arguments, **options):
        done = compare(*arguments, **options)
        return replace(done, status=done.status + 1, messages=["no force"] * len(done.status))

    monkeypatch.setattr(Uniaxial, "compare", fails)
    with pytest.raises(BadInput, match=r"fails at its reference values: .*no force"):
        estimate(told, Uniaxial(), ["sobol"], tmp_path, 1)


@pytest.mark.parametrize(
    ("facts", "left"),
    [
        ({}, None),
        ({"expected_s": [], "tasks": {}, "task": "sobol"}, None),
        ({"expected_s": {"sobol": "x", "infer": -1}, "tasks": {"infer": "waiting"}, "task": "sobol"}, 0.0),
        ({"expected_s": {"sobol": 30.0, "infer": 60.0}, "tasks": {"sobol": "running", "infer": "waiting"},
          "task": "sobol", "task_since": 90.0}, 80.0),
        ({"expected_s": {"sobol": 5.0, "infer": 60.0}, "tasks": {"sobol": "running", "infer": "waiting"},
          "task": "sobol", "task_since": 90.0, "eta_s": 7.0}, 67.0),
        ({"expected_s": {"sobol": 5.0}, "tasks": {"sobol": "finished"}, "task": "sobol", "task_since": 0.0}, 0.0),
        ({"expected_s": {"sobol": 5.0}, "tasks": {}, "task": "sobol", "task_since": float("inf")}, 5.0),
        ({"expected_s": {"sobol": 5.0, "infer": float("nan")}, "tasks": {"infer": "waiting"}, "task": "sobol",
          "task_since": float("nan")}, 5.0),
    ],
)  # fmt: skip
def test_what_is_left_of_the_run(facts, left):
    assert left_of_run({"time": 100.0, "eta_s": None, **facts}) == left


def test_what_is_left_is_said_where_it_is_known():
    assert about_left(None) == ""
    assert about_left(300.0) == ", about 5.0 min left of the run"


@pytest.mark.estimate
def test_a_run_tells_what_it_expects(cohort, tmp_path, capsys, monkeypatch):
    def run_sinew(*words):
        monkeypatch.setattr(sys, "argv", ["sinew", *map(str, words)])
        cli.main()

    path = tmp_path / "study.yaml"
    path.write_text(f"name: s\nseed: 1\ncohort: {cohort}\nsobol: {{base_samples: 8}}\ntasks: [sobol]\n", "utf-8")
    run_sinew("run", path, "--dry-run", "--json", "--out", tmp_path / "r")
    told = json.loads(capsys.readouterr().out)
    assert told["event"] == "estimate"
    assert [one["task"] for one in told["tasks"]] == ["sobol"]
    assert not (tmp_path / "r").exists()
    run_sinew("run", path, "--json", "--out", tmp_path / "r")
    events = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [set(one["tasks"]) for one in events if one["event"] == "estimate"] == [{"sobol"}]
    assert set(json.loads((tmp_path / "r" / "progress.json").read_text())["expected_s"]) == {"sobol"}
    run_sinew("run", path, "--out", tmp_path / "r", "--dry-run")
    assert "done already" in capsys.readouterr().out
    shutil.copytree(cohort, tmp_path / "other")
    for sizes in (tmp_path / "other").rglob("specimen.json"):
        sizes.write_text(json.dumps(json.loads(sizes.read_text()) | {"length_mm": 12.5}))
    run_sinew("run", path, "--out", tmp_path / "r", "--dry-run", "--data", tmp_path / "other")
    assert "done already" not in capsys.readouterr().out, "of other specimens"
