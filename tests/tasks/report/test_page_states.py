"""The page of a result folder in whatever state the folder is."""

import json
import re

import pytest
from rich.console import Console

from sinew.runner.errors import BadInput
from sinew.runner.store.store import Store
from sinew.tasks.report import page
from sinew.tasks.report.folder import read_folder
from sinew.tasks.report.page import build
from sinew.tasks.report.sections import adopted
from sinew.tasks.study import pipeline
from tests.tasks.report.conftest import edit
from tests.tasks.report.pages import SECTIONS, TASKS, keep_only, read
from tests.tasks.study.test_pipeline import sinew

pytestmark = pytest.mark.page


@pytest.mark.usefixtures("no_plots")
def test_sections_without_their_task_say_what_to_run(run_folder):
    for task in TASKS:
        (run_folder / f"{task}.json").unlink()
    log = run_folder / "log.jsonl"
    lines = [line for line in log.read_text().splitlines() if "task" not in json.loads(line)]
    log.write_text("\n".join(lines) + "\n")
    assert build(run_folder).trouble == ()
    seen = read(run_folder)
    told = {name: text for name, text in seen.sections.items() if "Not run yet" in text}
    assert tuple(told) == SECTIONS[1:8]
    commands = [re.search(r"sinew (\w+) \S*study\.yaml", text).group(1) for text in told.values()]
    assert sorted(commands) == sorted(TASKS)
    assert seen.sections["summary"].count("not run") == len(TASKS)
    assert "distal/1" in seen.sections["data"], "measured curves are there"
    page = (run_folder / "report.html").read_text()
    assert page.count('<details class="folded"><summary>Not run: Calibration, ') == 1


@pytest.mark.usefixtures("no_plots")
@pytest.mark.parametrize(
    ("message", "word", "words"),
    [
        ({"message": "task failed", "reason": "ClusterError: no workers came"}, "failed", "no workers came"),
        ({"message": "task started"}, "stopped", "finished rows are kept"),
    ],
)
def test_a_run_that_ended_early_says_so(run_folder, message, word, words):
    keep_only(run_folder, "sobol")
    log = run_folder / "log.jsonl"
    lines = [line for line in log.read_text().splitlines() if json.loads(line).get("task") != "infer"]
    log.write_text("\n".join([*lines, json.dumps({"task": "infer", **message})]) + "\n")
    build(run_folder)
    seen = read(run_folder)
    assert f"infer {word}" in " ".join(seen.sections["summary"].split())
    assert words in seen.sections["posterior"]
    assert f"infer: {word}" in seen.sections["failures"]


@pytest.mark.usefixtures("no_plots")
def test_a_task_that_was_not_run_for_another_that_failed_names_it(run_folder):
    calibration = (run_folder / "calibrate.json").read_bytes()
    keep_only(run_folder, "sobol")
    log = run_folder / "log.jsonl"
    lines = [
        line for line in log.read_text().splitlines() if json.loads(line).get("task") not in ("calibrate", "infer")
    ]
    events = [
        {"task": "calibrate", "message": "task failed", "reason": "no row"},
        {"task": "infer", "message": "task not run", "needs": "calibrate"},
    ]
    log.write_text("\n".join([*lines, *map(json.dumps, events)]) + "\n")
    build(run_folder)
    seen = read(run_folder)
    assert "infer not run" in " ".join(seen.sections["summary"].split())
    assert "Not run: it needs calibrate, which failed. Then sinew infer" in " ".join(seen.sections["posterior"].split())
    assert "calibrate: failed" in seen.sections["failures"]
    (run_folder / "calibrate.json").write_bytes(calibration)  # it ran again, alone
    build(run_folder)
    assert "Not run yet: sinew infer" in " ".join(read(run_folder).sections["posterior"].split())


@pytest.mark.usefixtures("no_plots")
def test_commands_name_the_folder_unless_it_is_the_usual_one(run_folder):
    (run_folder / "infer.json").unlink()
    log = run_folder / "log.jsonl"
    for out, words in (("results/x y", "--out 'results/x y'`"), ("results/small", "study.yaml`")):
        events = [json.loads(line) for line in log.read_text().splitlines()]
        runs = [event | {"out": out} if event["message"] == "run started" else event for event in events]
        kept = [event for event in runs if event.get("task") != "infer"]
        log.write_text("".join(json.dumps(event) + "\n" for event in kept))
        build(run_folder)
        told = (run_folder / "report.html").read_text()
        assert words.replace("'", "&#39;").replace("`", "</code>") in told


@pytest.mark.usefixtures("no_plots")
@pytest.mark.parametrize("verdict", ["NAMED", "OUTSIDE"])
def test_results_of_a_model_that_lacks_a_named_effect_say_so(run_folder, verdict):
    path = run_folder / "discover.json"
    content = json.loads(path.read_text()) | {"verdict": verdict, "effects": ["toe-slack"] * (verdict == "NAMED")}
    path.write_text(json.dumps(content))
    build(run_folder)
    seen = read(run_folder)
    marked = [name for name, text in seen.sections.items() if "of the model without toe-slack" in text]
    assert marked == (["calibration", "posterior", "prediction", "sites"] if verdict == "NAMED" else [])
    if verdict == "NAMED":
        assert "--adopt adds the results with it" in " ".join(seen.sections["posterior"].split())
        (run_folder / "adopted").mkdir()
        (run_folder / "adopted" / "report.html").touch()
        build(run_folder)
        seen = " ".join(read(run_folder).sections["posterior"].split())
        assert "The results with it are in adopted/report.html" in seen
    path = run_folder / "calibrate.json"  # as that of the study with the effect
    content = json.loads(path.read_text())
    path.write_text(json.dumps(content | {"names": [*content["names"], "slack_stretch"]}))
    build(run_folder)
    assert "of the model without toe-slack" not in read(run_folder).sections["posterior"]


@pytest.mark.usefixtures("no_plots")
def test_results_of_the_model_with_the_named_effect_come_first(run_folder):
    path = run_folder / "discover.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {"verdict": "NAMED", "effects": ["toe-slack"]}))
    there = run_folder / "adopted"
    with Store.writing(there, "having"):
        pass
    (there / "report.html").touch()
    section = adopted.section(read_folder(run_folder), read_folder(there))
    assert section.blocks[-1].text == "It has no calibration yet."
    calibration = json.loads((run_folder / "calibrate.json").read_text())
    for fit in calibration["specimens"].values():
        fit["rmse_N"] = {protocol: 0.01 * peak for protocol, peak in fit["peak_N"].items()}
    (there / "calibrate.json").write_text(json.dumps(calibration))
    build(run_folder)
    assert "adopted" not in read(run_folder).sections, "fits of a model without the effect that is named now"
    for name, more in (("names", "slack_stretch"), ("units", "1"), ("meanings", "slack")):
        calibration[name].append(more)
    (there / "calibrate.json").write_text(json.dumps(calibration))
    assert build(run_folder).trouble == ()
    seen = read(run_folder)
    assert list(seen.sections).index("adopted") < list(seen.sections).index("data")
    assert "The model with toe-slack" in seen.sections["adopted"]
    assert "largest error of a fit 1 % of the peak force, without toe-slack" in " ".join(
        seen.sections["summary"].split()
    )


def test_a_folder_that_only_just_began_has_a_page(tmp_path):
    with Store.writing(tmp_path / "out", "young"):
        pass
    assert build(tmp_path / "out").trouble == ()
    seen = read(tmp_path / "out")
    assert seen.sections["summary"].count("not run") == len(TASKS)
    assert "Nothing failed" in seen.sections["failures"]


@pytest.mark.usefixtures("no_plots")
@pytest.mark.parametrize(
    ("task", "content", "words"),
    [
        ("sobol", b'{"names": ["E_f",', "damaged, no JSON"),
        ("importance", b"{}", "names: missing; expected what this version's"),
        ("calibrate", b"\xff\xfe{}", "damaged, no UTF-8 text"),
        ("infer", b"[" * 100_000, "damaged, nested without end"),
        ("predict", b"", "damaged, no JSON"),
        ("compare", b"{}", "names: missing; expected what this version's"),
        ("discover", b"[1, 2]", "holds [1, 2]"),
    ],
    ids=TASKS,
)
def test_a_damaged_result_is_one_clear_line(run_folder, capsys, task, content, words):
    keep_only(run_folder, task, "compare")
    (run_folder / f"{task}.json").write_bytes(content)
    with pytest.raises(SystemExit) as ended:
        sinew("report", run_folder)
    assert ended.value.code == 2
    said = capsys.readouterr()
    assert said.out == f"{run_folder / 'report.html'}\n"
    assert said.err.count("\n") == 1
    assert f"{task}.json" in said.err
    assert words in said.err
    seen = read(run_folder)
    assert sorted(seen.sections) == sorted(("summary", *SECTIONS)), "all others are there"
    assert words in seen.sections["summary"]


def test_values_of_a_wrong_kind_are_one_line(run_folder):
    edit(run_folder / "sobol.json", lambda sobol: sobol.update(names=5, ST="much"))
    edit(run_folder / "discover.json", lambda found: found.update(cells=7))
    edit(run_folder / "calibrate.json", lambda found: found["specimens"].update({"distal/1": None}))
    trouble = build(run_folder).trouble
    assert sorted(line.split(": ")[0].rpartition("/")[2] for line in trouble) == [
        "calibrate.json", "discover.json", "sobol.json",
    ]  # fmt: skip
    assert all("\n" not in line for line in trouble)


@pytest.mark.usefixtures("no_plots")
def test_lines_of_the_log_that_cannot_be_read_are_counted(run_folder):
    keep_only(run_folder)
    with (run_folder / "log.jsonl").open("a") as file:
        file.write('{"message": \nnonsense\n{"message": "task started", "task": "sob')
    (line,) = build(run_folder).trouble
    assert re.search(r"log\.jsonl: 2 of \d+ lines cannot be read", line)


def test_a_store_that_is_gone_leaves_what_the_results_tell(run_folder):
    keep_only(run_folder, "importance")
    (run_folder / "store.zarr").rename(run_folder / "elsewhere")
    (line,) = build(run_folder).trouble
    assert "holds no store.zarr" in line
    assert "loss of R²" in read(run_folder).sections["summary"]


def test_where_the_only_result_cannot_be_read_the_reason_is_told(run_folder, capsys):
    keep_only(run_folder, "importance")
    (run_folder / "store.zarr").rename(run_folder / "elsewhere")
    (run_folder / "importance.json").write_text("{}")
    for path in run_folder.glob("log.jsonl*"):
        path.unlink()
    with pytest.raises(SystemExit) as ended:
        sinew("report", run_folder)
    assert ended.value.code == 2
    assert "importance.json: " in capsys.readouterr().err


@pytest.mark.parametrize("kind", ["nothing", "empty", "file"])
def test_what_is_no_result_folder_is_one_line(tmp_path, capsys, kind):
    folder = tmp_path / "out"
    if kind == "empty":
        folder.mkdir()
    if kind == "file":
        folder.write_text("")
    with pytest.raises(SystemExit) as ended:
        sinew("report", folder)
    assert ended.value.code == 2
    assert "expected a result folder, as given to --out" in capsys.readouterr().err
    assert not (folder / "report.html").exists()


def test_a_page_that_cannot_be_built_ends_no_run(run_folder, monkeypatch, capsys):
    def fail(_):
        raise ZeroDivisionError("of nothing")

    monkeypatch.setattr(page, "build", fail)
    assert pipeline.report(run_folder, Console(quiet=True)) is None
    said = capsys.readouterr().err
    assert (
        said
        == f"sinew: the report of {run_folder} was not built (of nothing); `sinew report {run_folder}` tries again\n"
    )


def test_a_task_that_fails_is_logged_and_on_the_page(tmp_path, monkeypatch):
    from sinew.tasks.data.cohort import write_cohort
    from sinew.tasks.data.virtual import virtual_cohort

    specimens, _ = virtual_cohort(seed=1, per_site=1, rate_hz=1.0)
    write_cohort(tmp_path / "cohort", specimens[:1])
    (tmp_path / "study.yaml").write_text("name: bad\ncohort: cohort\ntasks: [sobol]\n")

    def fail(*_, **__):
        raise BadInput("a file", "is wrong", "another")

    monkeypatch.setattr("sinew.tasks.sobol.task.run", fail)
    with pytest.raises(SystemExit) as ended:
        sinew("run", tmp_path / "study.yaml", "--out", tmp_path / "out", "--quiet")
    assert ended.value.code == 2
    seen = read(tmp_path / "out")
    assert "sobol failed" in " ".join(seen.sections["summary"].split())
    assert "a file: is wrong; expected another" in seen.sections["sensitivity"]
