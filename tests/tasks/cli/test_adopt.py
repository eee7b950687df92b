"""Going on with the model that has the effect which a discovery named."""

import shutil
import sys

import pytest

from sinew.tasks.cli import main as cli
from sinew.tasks.data.cohort import write_cohort
from sinew.tasks.data.virtual import virtual_cohort
from sinew.tasks.discover.result import ADOPTED, WITH_EFFECTS, named_study
from sinew.tasks.study import pipeline
from tests.tasks.discover.results import MODEL, candidate, discovery

STUDY = "name: small\ncohort: {cohort}\ntasks: [{tasks}]\nmodel: {{effects: [{effects}]}}\n"


@pytest.fixture
def ran(tmp_path, monkeypatch, capsys):
    """Runs `sinew run` with a discovery that names toe-slack, or nothing; returns the runs made and what was said."""
    write_cohort(tmp_path / "cohort", virtual_cohort(seed=3, per_site=1, rate_hz=1)[0][:1])
    runs = []

    def run(verdict="NAMED", tasks="sobol, discover", options=()):
        (tmp_path / "study.yaml").write_text(STUDY.format(cohort="cohort", tasks=tasks, effects=""))
        slack = candidate("toe-slack", loss=1010.0)
        named = {"effects": ("toe-slack",), "shown": ("toe-slack",), "model": MODEL, "candidates": (slack,)}

        def instead(workspace, tasks, **_):
            runs.append((workspace.out, list(tasks), list(workspace.study.model.effects), workspace.seed))
            if "discover" in tasks:
                discovery(verdict, **(named if verdict == "NAMED" else {})).write(workspace.out)
                (workspace.out / WITH_EFFECTS).parent.mkdir(exist_ok=True)
                cohort = tmp_path / "cohort"
                text = STUDY.format(cohort=cohort, tasks="sobol, discover", effects="toe-slack")
                (workspace.out / WITH_EFFECTS).write_text(text)

        monkeypatch.setattr(pipeline, "run", instead)
        words = ["sinew", "run", tmp_path / "study.yaml", "--out", tmp_path / "out", *options]
        monkeypatch.setattr(sys, "argv", [*map(str, words)])
        runs.clear()
        cli.main()
        return list(runs), capsys.readouterr().out

    return run


def test_the_other_tasks_run_with_the_effect(ran, tmp_path):
    runs, said = ran(options=("--adopt", "--seed", "7"))
    out = tmp_path / "out"
    assert runs == [(out, ["sobol", "discover"], [], 7), (out / ADOPTED, ["sobol"], ["toe-slack"], 7)]
    assert str(out / ADOPTED) in said.splitlines()[-1]


def test_without_the_option_it_is_offered(ran, tmp_path):
    runs, said = ran()
    assert len(runs) == 1
    assert said.splitlines()[-1].endswith(f"sinew run {tmp_path}/study.yaml --adopt --out {tmp_path}/out")


@pytest.mark.parametrize(("verdict", "tasks"), [("NONE", "sobol, discover"), ("NAMED", "discover"), ("NAMED", "sobol")])
def test_nothing_to_go_on_with(ran, verdict, tasks):
    runs, said = ran(verdict, tasks, ("--adopt",))
    assert len(runs) == 1
    assert "adopt" not in said


def test_in_a_job_it_is_refused_before_anything_is_done(ran, tmp_path, capsys):
    with pytest.raises(SystemExit) as stopped:
        ran(options=("--adopt", "--profile", str(tmp_path / "site.yaml")))
    assert stopped.value.code == 2
    assert "sinew submit OUT/discover/model.yaml" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_named_study_is_there_and_named(ran, tmp_path):
    ran()
    assert named_study(tmp_path / "out") == tmp_path / "out" / "discover" / "model.yaml"
    shutil.rmtree(tmp_path / "out" / "discover")
    assert named_study(tmp_path / "out") is None
    assert named_study(tmp_path) is None
