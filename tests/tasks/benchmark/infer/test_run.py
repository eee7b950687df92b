"""`sinew benchmark infer`, from drawn cohorts to the table."""

import json

import pytest

from sinew.runner.errors import BadInput
from sinew.tasks.benchmark.infer.drawn import Conditions
from sinew.tasks.benchmark.infer.result import CohortResult, Ranked
from sinew.tasks.benchmark.infer.run import benchmark
from tests.tasks.study.test_pipeline import sinew

STUDY = """
name: little
seed: 5
model:
  parameters:
{fixed}
tasks: [infer]
infer: {{method: likelihood, discrepancy: false, ess: 100, rhat: 1.1}}
"""
FREE = ("E_f", "E_m")
RANKED = {"cohort": 1, "level": "mean", "of": "a", "parameter": "E_f", "rank": 0.5, "held": True, "determined": True}


@pytest.fixture
def study(tmp_path):
    from sinew.tasks.model.parameters import TENDON

    fixed = [f"    {p.name}: {{fixed: {p.reference:g}}}" for p in TENDON if p.name not in FREE]
    path = tmp_path / "study.yaml"
    path.write_text(STUDY.format(fixed="\n".join(fixed)))
    return path


@pytest.mark.thorough
def test_two_cohorts_are_run_scored_and_not_run_again(tmp_path, study, capsys):
    out = tmp_path / "out"
    options = ["--study", study, "--specimens", "2", "--protocol", "one_step", "--rate-hz", "2", "--workers", "1"]
    sinew("benchmark", "infer", "--out", out, "--cohorts", "1", *options, "--quiet")
    kept = out / "cohort_0001" / "cohort.json"
    before = kept.stat().st_mtime_ns
    sinew("benchmark", "infer", "--out", out, "--cohorts", "2", *options)
    assert kept.stat().st_mtime_ns == before, "what is done is not done again"
    result = json.loads((out / "benchmark.json").read_text())
    assert result["refused"] == [] and result["cohorts"] == 2
    levels = {row["level"]: row["of"] for row in result["coverage"] if row["parameter"] == "all"}
    assert levels["mean"] == levels["spread"] == 2 * 2 * len(FREE)
    assert sum(count for level, count in levels.items() if level.startswith("specimen")) == 2 * 2 * 2 * len(FREE)
    every = next(row for row in result["coverage"] if row["parameter"] == "all" and row["level"] == "mean")
    assert every["shares"]["95 %"]["share"] > 0.5
    assert result["contrasts"]["of"] == 2 * len(FREE)
    assert (result["left_out"]["cohorts"], result["left_out"]["curves"]) == (2, 4)
    assert 0.5 < result["left_out"]["points"]["share"] <= 1.0
    assert "differences of zero between two sites" in capsys.readouterr().out
    assert "| population mean | E_f | 4 |" in (out / "benchmark.md").read_text()
    assert (out / "ranks.png").stat().st_size > 5000
    assert not (out / "cohort_0002" / "run").exists()
    capsys.readouterr()
    sinew("benchmark", "infer", "--out", out, "--cohorts", "2", *options, "--quiet")
    assert capsys.readouterr().out == f"next: read {out / 'benchmark.md'}\n"
    assert {**json.loads((out / "benchmark.json").read_text()), "seconds": 0} == {**result, "seconds": 0}


def test_a_cohort_without_posterior_is_told(tmp_path, study):
    study.write_text(study.read_text().replace("ess: 100", "ess: 10000, sweeps: 100"))
    said = []
    conditions = Conditions(per_site=2, tests=("one_step",), rate_hz=5.0)
    result = benchmark(tmp_path / "out", cohorts=1, conditions=conditions, study=study, workers=2, say=said.append)
    assert "have not converged" in said[0]
    assert len(result["refused"]) == 1 and result["coverage"] == []


def test_other_simulators_are_refused(tmp_path, study):
    study.write_text(study.read_text() + "simulator: febio\n")
    with pytest.raises(BadInput, match=r"simulator: febio; expected uniaxial, which draws the cohorts"):
        benchmark(tmp_path / "out", cohorts=1, conditions=Conditions(), study=study)


def test_what_was_not_made_here_is_refused_and_left_as_it_is(tmp_path, study):
    mine = tmp_path / "out" / "cohort_0001" / "measured.csv"
    mine.parent.mkdir(parents=True)
    mine.write_text("mine")
    with pytest.raises(BadInput, match=r"cohort_0001: holds 'measured\.csv'; expected an empty folder, or one of"):
        benchmark(tmp_path / "out", cohorts=1, conditions=Conditions(), study=study)
    assert mine.read_text() == "mine"


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ({"different": 9}, "content: 9 of 2 contrasts are different"),
        ({"seconds": -1e300}, "seconds: -1e.300: expected at least 0"),
        ({"tarp": {"mean": [9]}}, r"tarp\.mean\.0: 9: expected 0 to 1"),
        ({"tarp": {"all": [0.5]}}, r"tarp\.all"),
        ({"left_out": [{"site": "a", "protocol": "b", "points": 55, "whole": False}]}, "points: 55: expected 0 to 1"),
        ({"ranked": [{**RANKED, "rank": -40.0}]}, r"ranked\.0\.rank: -40.0: expected 0 to 1"),
        ({"ranked": [{**RANKED, "cohort": 7}]}, "content: ranks of another cohort than 1"),
    ],
)
def test_numbers_that_cannot_be_are_refused(tmp_path, change, problem):
    CohortResult(1, "likelihood", [Ranked(**RANKED)], {}, 2, 1, 1.0, None, "inputs").write(tmp_path)
    assert CohortResult.read(tmp_path).contrasts == 2
    path = tmp_path / "cohort.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | change))
    with pytest.raises(BadInput, match=rf"cohort\.json: .*{problem}" if "content" not in problem else problem):
        CohortResult.read(tmp_path)


def test_results_of_other_settings_are_not_removed(tmp_path, study):
    other = CohortResult(1, "likelihood", [], {}, 0, 0, 1.0, None, "other inputs")
    (tmp_path / "out" / "cohort_0001").mkdir(parents=True)
    other.write(tmp_path / "out" / "cohort_0001")
    with pytest.raises(
        BadInput, match=r"cohort\.json: is of other settings or another version; expected another --out"
    ):
        benchmark(tmp_path / "out", cohorts=1, conditions=Conditions(), study=study)
    assert CohortResult.read(tmp_path / "out" / "cohort_0001").inputs == "other inputs"
