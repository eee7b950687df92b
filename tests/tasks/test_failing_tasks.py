"""What a task that fails does to the other tasks of a run."""

import logging
from types import SimpleNamespace

import pytest
from rich.console import Console

from sinew.runner.errors import BadInput, ClusterError, StoreError, WalltimeReached
from sinew.tasks.infer.settings import Settings as InferSettings
from sinew.tasks.registry import TASKS
from sinew.tasks.study import pipeline, provenance

ALL = ("sobol", "importance", "calibrate", "infer", "predict", "compare", "discover")


class Run:
    """A run of tasks that do nothing, or raise what ``errors`` holds for them."""

    def __init__(self, folder, monkeypatch, errors):
        self.did, self.states, self.events, self.built = [], {}, [], []
        board = SimpleNamespace(put=lambda **facts: self.states.update(facts.get("tasks", {})))
        paper = InferSettings(paper=True)  # of which `infer` needs `calibrate`
        study = SimpleNamespace(simulator=SimpleNamespace(name="uniaxial"), section=lambda kind: paper)
        self.workspace = SimpleNamespace(
            study=study, out=folder, console=Console(quiet=True), board=board, ranges=None, quiet=False,
            event=lambda event, **facts: self.events.append((event, facts.get("task"))),
        )  # fmt: skip

        def one(workspace, name, *_, **__):
            if name in errors:
                raise errors[name]
            self.did.append(name)
            return name

        monkeypatch.setattr(pipeline, "_run_one", one)
        monkeypatch.setattr(pipeline, "report", lambda *_, **__: self.built.append("page"))
        monkeypatch.setattr(provenance, "facts", lambda _: {})

    def __call__(self, *tasks):
        return pipeline.run(self.workspace, tasks)


@pytest.mark.parametrize(
    ("failing", "did", "not_run"),
    [
        ("sobol", ("calibrate", "infer", "predict", "compare", "discover"), ("importance",)),
        ("importance", ("sobol", "calibrate", "infer", "predict", "compare", "discover"), ()),
        ("calibrate", ("sobol", "importance", "discover"), ("infer", "predict", "compare")),
        ("infer", ("sobol", "importance", "calibrate", "discover"), ("predict", "compare")),
        ("discover", ("sobol", "importance", "calibrate", "infer", "predict", "compare"), ()),
    ],
)
def test_only_tasks_that_need_the_result_are_not_run(tmp_path, monkeypatch, caplog, failing, did, not_run):
    error = BadInput("study.yaml", "no particle was accepted", "other ranges")
    run = Run(tmp_path, monkeypatch, {failing: error})
    with pytest.raises(BadInput, match="no particle was accepted"), caplog.at_level(logging.INFO, "sinew"):
        run(*ALL)
    assert tuple(run.did) == did
    assert run.built == ["page"]
    words = dict.fromkeys(not_run, "not run") | {failing: "failed"} | dict.fromkeys(did, "finished")
    assert run.states == words
    logged = [(one.message, one.task) for one in caplog.records if "task" in vars(one)]
    assert logged[0] == ("task failed", failing)
    assert [task for message, task in logged if message == "task not run"] == list(not_run)


def test_a_person_reads_of_it_at_once_and_of_every_error_at_the_end(tmp_path, monkeypatch, capsys):
    run = Run(tmp_path, monkeypatch, {"infer": BadInput("a.yaml", "first", "x"), "discover": ValueError("second")})
    with pytest.raises(BadInput, match="first"):
        run("calibrate", "infer", "predict", "discover", "sobol")
    said = capsys.readouterr().err.splitlines()
    assert said == [
        "sinew: infer failed: a.yaml: first; expected x; going on with discover, sobol",
        "sinew: discover failed: ValueError: second; going on with sobol",
        "sinew: discover failed: ValueError: second",
    ]
    assert run.events == [("task failed", "infer"), ("task failed", "discover")]
    assert run.states["predict"] == "not run"


@pytest.mark.parametrize("quiet", [False, True])
def test_the_last_task_may_fail_too(tmp_path, monkeypatch, capsys, quiet):
    run = Run(tmp_path, monkeypatch, {"sobol": BadInput("a", "first", "x"), "discover": ValueError("second")})
    run.workspace.quiet = quiet
    with pytest.raises(BadInput, match="first"):
        run("sobol", "discover")
    assert capsys.readouterr().err.splitlines()[-1] == "sinew: discover failed: ValueError: second"
    assert run.states == {"sobol": "failed", "discover": "failed"}


def test_what_ends_a_run_is_raised_and_what_failed_before_is_printed(tmp_path, monkeypatch, capsys):
    errors = {"sobol": BadInput("a", "first", "x"), "calibrate": OSError(28, "No space left")}
    run = Run(tmp_path, monkeypatch, errors)
    with pytest.raises(OSError, match="No space left"):
        run("sobol", "calibrate", "discover")
    assert run.did == []
    assert capsys.readouterr().err.splitlines()[-1] == "sinew: sobol failed: a: first; expected x"


@pytest.mark.parametrize("error", [StoreError("damaged"), ClusterError("no workers"), OSError(28, "No space left")])
def test_what_no_task_can_do_without_ends_the_run(tmp_path, monkeypatch, capsys, error):
    run = Run(tmp_path, monkeypatch, {"sobol": error})
    with pytest.raises(type(error)):
        run("sobol", "calibrate", "discover")
    assert run.did == []
    assert capsys.readouterr().err == ""


def test_a_job_that_must_end_builds_no_page(tmp_path, monkeypatch):
    run = Run(tmp_path, monkeypatch, {"sobol": WalltimeReached("time is up")})
    with pytest.raises(WalltimeReached):
        run("sobol", "calibrate")
    assert (run.did, run.built) == ([], [])


@pytest.mark.figures
def test_a_figure_that_cannot_be_drawn_is_one_line(tmp_path, monkeypatch):
    """Matplotlib takes what stands between two $ for a formula, and names may come from anywhere."""

    def draw(*_: object) -> None:
        raise ValueError("Expected \\frac{num}{den}\nand much more")

    (tmp_path / "sobol.json").write_text("{}")
    monkeypatch.setattr(TASKS["sobol"].module("figures"), "draw", draw)
    with pytest.raises(BadInput, match=r"sobol\.json: its figures cannot be drawn \(ValueError: Expected") as error:
        pipeline._draw(SimpleNamespace(out=tmp_path), "sobol", None)
    assert "\n" not in str(error.value)
