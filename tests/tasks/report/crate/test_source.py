"""What a crate is made from belongs together, or is refused."""

import json
from pathlib import Path

import pytest
import yaml

from sinew.runner.errors import BadInput
from sinew.tasks.report.crate.source import read_source
from sinew.tasks.study.files import digest
from sinew.tasks.study.study import read_study


def change_log(folder: Path, message: str, **fields: object) -> None:
    """Change fields of the first event with a message."""
    lines = (folder / "log.jsonl").read_text().splitlines()
    at = next(i for i, line in enumerate(lines) if json.loads(line)["message"] == message)
    lines[at] = json.dumps(json.loads(lines[at]) | fields)
    (folder / "log.jsonl").write_text("\n".join(lines) + "\n")


def again(folder: Path, task: str, **fields: object) -> None:
    """Another run of a task in the log."""
    lines = (folder / "log.jsonl").read_text().splitlines()
    run = next(json.loads(line) for line in lines if json.loads(line)["message"] == "run started")
    more = [run | {"tasks": [task]} | fields, {"message": "task finished", "task": task}]
    (folder / "log.jsonl").write_text("\n".join([*lines, *map(json.dumps, more)]) + "\n")


def test_the_study_and_cohort_of_the_results_are_found(whole_run):
    source = read_source(whole_run)
    assert source.study.text == (whole_run.parent / "study.yaml").read_text()
    assert source.cohort_folder == whole_run.parent / "cohort"
    assert source.run["tasks"] == source.study.tasks


@pytest.mark.parametrize("change", [lambda text: text.replace("\n", "\r\n"), lambda text: "\ufeff" + text])
def test_a_study_as_windows_programs_write_it_is_the_one_of_its_results(run_folder, whole_run, tmp_path, change):
    study = tmp_path / "study.yaml"
    study.write_bytes(change((whole_run.parent / "study.yaml").read_text()).encode())
    change_log(run_folder, "run started", study_hash=digest(read_study(study).text))
    source = read_source(run_folder, study, whole_run.parent / "cohort")
    assert yaml.safe_load(source.study.text) == yaml.safe_load((whole_run.parent / "study.yaml").read_text())


def test_another_study_file_is_refused(whole_run, tmp_path):
    other = tmp_path / "study.yaml"
    other.write_text((whole_run.parent / "study.yaml").read_text() + "# a word\n")
    with pytest.raises(BadInput, match="is not the study file of these results"):
        read_source(whole_run, other)


def test_other_curves_are_refused(whole_run, tmp_path):
    specimen = tmp_path / "cohort" / "distal" / "1"
    specimen.mkdir(parents=True)
    for path in (whole_run.parent / "cohort" / "distal" / "1").iterdir():
        (specimen / path.name).write_bytes(path.read_bytes())
    with pytest.raises(BadInput, match="is not the cohort of these results"):
        read_source(whole_run, data=tmp_path / "cohort")


@pytest.mark.parametrize(
    ("field", "value"),
    [("seed", 4), ("simulator", "febio"), *((f"{each}_hash", "0" * 32) for each in ("study", "template", "cohort"))],
)
def test_results_of_two_studies_are_refused(run_folder, field, value):
    again(run_folder, "sobol", **{field: value})
    with pytest.raises(BadInput, match="is of a run with another"):
        read_source(run_folder)


def test_logs_of_before_templates_were_named_are_read(run_folder):
    """Of a study without a template, where one task was run again since."""
    again(run_folder, "sobol", template_hash="")
    change_log(run_folder, "run started", template_hash=None)
    assert read_source(run_folder).run["template_hash"] == ""


def test_a_task_that_is_no_name_is_passed_over(run_folder):
    change_log(run_folder, "task finished", task=["sobol"])
    with pytest.raises(BadInput, match=r"does not say which run made sobol\.json"):
        read_source(run_folder)


@pytest.mark.parametrize(
    ("fields", "told"),
    [
        ({"seed": True}, "seed: True; expected the seed"),
        ({"seed": "1"}, "seed: '1'; expected"),
        ({"simulator": ["x"]}, "simulator: ..x..; expected one of"),
        ({"study_file": 5}, "study_file: missing; expected --study"),
        ({"cohort": "/nowhere"}, "/nowhere: is not there"),
    ],
)
def test_a_log_that_says_something_else_is_refused_in_one_line(run_folder, fields, told):
    change_log(run_folder, "run started", **fields)
    with pytest.raises(BadInput, match=told):
        read_source(run_folder)
