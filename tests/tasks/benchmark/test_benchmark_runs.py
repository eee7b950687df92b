"""Runs of the benchmark: its cases, answers and notes."""

import json
import shutil
from pathlib import Path

import pytest

from sinew.runner.errors import BadInput
from sinew.tasks.benchmark import discover
from sinew.tasks.benchmark.answers import SAME_FORM, read_answers
from sinew.tasks.data.cohort import write_cohort
from sinew.tasks.data.virtual import virtual_cohort
from sinew.tasks.model.effects import library
from tests.conftest import SHARED
from tests.hidden.make import Plan, write
from tests.hidden.mesh import study_of
from tests.tasks.study.test_pipeline import sinew


@pytest.fixture
def folder(tmp_path):
    """A folder of one case, with one specimen."""
    specimens, _ = virtual_cohort(seed=1, per_site=1, rate_hz=1.0)
    write_cohort(tmp_path / "hidden" / "case_01", specimens[:1])
    (tmp_path / "hidden" / "answers.json").write_text('{"case_01": {"truth": []}}')
    return tmp_path / "hidden"


@pytest.mark.parametrize(
    ("answers", "words"),
    [
        (None, "answers.json: is not there"),
        ("{", "not valid JSON"),
        ("[]", "holds []"),
        ("{}", "holds no case"),
        ('{"case_01": 3}', "case_01: holds 3"),
        ('{"case_01": {}}', "case_01.truth: missing"),
        ('{"case_01": {"truth": "softening"}}', "case_01.truth: 'softening'"),
        ('{"case_01": {"truth": ["magic"]}}', "'magic' is no effect"),
        ('{"case_01": {"truth": ["OUTSIDE", "softening"]}}', "'OUTSIDE' is no effect"),
        ('{"case_01": {"truth": ["softening", "softening"]}}', "expected each effect once"),
        ('{"case_01": {"truth": [], "magnitude": {"a": "much"}}}', "case_01.magnitude.a: 'much'"),
        ('{"case_01": {"truth": [], "same_form": {"a": 1}}}', "case_01.same_form.a: unknown parameter"),
        ('{"case_01": {"truth": []}, "case_02": {"truth": []}}', "case_02: is not there"),
        ('{"../case_01": {"truth": []}}', "a name that cannot be used"),
    ],
)
def test_answers_that_cannot_be_used_are_one_line(folder, tmp_path, capsys, answers, words):
    (folder / "answers.json").unlink()
    if answers is not None:
        (folder / "answers.json").write_text(answers)
    with pytest.raises(SystemExit) as ended:
        sinew("benchmark", "discover", folder, "--out", tmp_path / "out")
    said = capsys.readouterr().err
    assert ended.value.code == 2
    assert words in said
    assert said.count("\n") == 1
    assert not (tmp_path / "out").exists(), "nothing was run"


def test_folders_and_studies_that_cannot_be_used_are_one_line(folder, tmp_path, capsys):
    study = tmp_path / "study.yaml"
    study.write_text("name: a\nmodel: {effects: [softening]}\n")
    twin = tmp_path / "other" / "hidden"
    twin.mkdir(parents=True)
    for words, expected in [
        ((tmp_path / "nowhere",), "nowhere: is not there"),
        ((folder, twin), "two folders are called 'hidden'"),
        ((folder, "--only", "case_09"), "--only: no case 'case_09'"),
        ((folder, "--study", study), "model.effects: is not empty"),
        ((folder, "--study", tmp_path / "no.yaml"), "no.yaml"),
        ((folder, "--out", folder / "out"), "lies inside"),
        ((), "Missing argument"),
    ]:
        with pytest.raises(SystemExit) as ended:
            sinew("benchmark", "discover", *words)
        said = capsys.readouterr().err
        assert ended.value.code == 2
        assert expected in said
        assert said.count("\n") == 1


def test_true_values_of_the_librarys_own_forms_are_known(folder):
    for slug, names in SAME_FORM.items():
        assert set(names) <= set(library()[slug].names)
    told = {"truth": ["toe-slack", "force-drift"], "magnitude": {"stretch": 0.99, "offset_N": 1.0, "N_per_s": 0.02}}
    (folder / "answers.json").write_text(json.dumps({"case_01": told}))
    assert read_answers(folder)[0].same_form == {"slack_stretch": 0.99, "force_offset": 1.0, "force_slope": 0.02}
    (folder / "answers.json").write_text(json.dumps({"case_01": told | {"same_form": {"slack_stretch": 0.98}}}))
    assert read_answers(folder)[0].same_form == {"slack_stretch": 0.98}


@pytest.mark.shared
def test_the_shared_answers_can_be_read():
    answers = [one for name in ("dev-1", "dev-null") for one in read_answers(SHARED / "hidden" / name)]
    assert len(answers) == 40
    outside = {one.name for one in answers if one.outside}
    assert outside == {"dev-1/case_15"}, "friction, rupture and creep have become effects"


STUDY = """
name: few
seed: 3
tasks: [discover]
discover: {effects: [toe-slack], starts: 2}
"""


def test_cases_are_run_blind_scored_and_not_run_again(tmp_path, capsys, monkeypatch):
    folder, out, study = tmp_path / "hidden", tmp_path / "out", tmp_path / "study.yaml"
    write(folder, [Plan(("slack-gauss",)), Plan(())], seed=2, rate_hz=2.0)
    for case_folder in (folder / "case_01", folder / "case_02"):
        shutil.rmtree(case_folder / "s02")  # one specimen with two curves is enough here
        (case_folder / "s01" / "two_step.csv").unlink()
    study.write_text(STUDY)
    command = ("benchmark", "discover", folder, "--out", out, "--study", study, "--workers", 1)
    sinew(*command)
    said = capsys.readouterr().out
    assert "1 of 2  hidden/case_01: " in said
    result = json.loads((out / "benchmark.json").read_text())
    first, second = result["cases"]
    assert (first["truth"], first["class"], first["error"]) == (["toe-slack"], "detectable", None)
    assert (second["truth"], second["class"], second["verdict"]) == ([], "null", "NONE")
    assert first["seconds"] > 0
    assert result["mixed"] == 0
    assert "| false alarm on nulls | 0 % |" in (out / "benchmark.md").read_text()
    written = (out / "hidden" / "case_01" / "study.yaml").read_text()
    assert "truth" not in written
    assert "laws: false" in written, "they change no verdict, and take time"

    def never(*_):
        raise AssertionError("it was run again")

    monkeypatch.setattr(discover, "run_blind", never)
    sinew(*command, "--quiet")
    assert capsys.readouterr().out == f"next: read {out / 'benchmark.md'}\n"
    assert json.loads((out / "benchmark.json").read_text()) == result
    monkeypatch.undo()

    (folder / "case_02" / "s01" / "cyclic.csv").write_text("broken")
    sinew(*command)
    said = capsys.readouterr().out
    assert "2 of 2  hidden/case_02: failed: BadInput: " in said
    broken = json.loads((out / "benchmark.json").read_text())["cases"]
    assert broken[0] == first
    assert (broken[1]["class"], broken[1]["outcome"]) == ("failed", "failed")


def case_folder(tmp_path) -> Path:
    folder = tmp_path / "hidden"
    write(folder, [Plan(("slack-gauss",))], seed=2, rate_hz=2.0)
    (tmp_path / "study.yaml").write_text(STUDY)
    return folder


@pytest.mark.parametrize("place", ["hidden/case_01/link", "out/hidden"])
def test_links_in_cases_and_results_are_refused(tmp_path, place):
    folder = case_folder(tmp_path)
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "out").mkdir()
    (tmp_path / place).symlink_to(tmp_path / "elsewhere")
    with pytest.raises(BadInput, match="is a link; expected files and folders only"):
        discover.benchmark([folder], tmp_path / "out", study=tmp_path / "study.yaml")
    assert not list((tmp_path / "elsewhere").iterdir())


def test_large_and_deep_files_of_a_case_are_refused_unread(tmp_path):
    folder = case_folder(tmp_path)
    with (folder / "case_01" / "notes.bin").open("wb") as file:
        file.truncate(200 * 2**30)
    with pytest.raises(BadInput, match=r"notes.bin: 204,800 MB; expected files of at most 256 MB in a case"):
        discover.benchmark([folder], tmp_path / "out", study=tmp_path / "study.yaml")
    (folder / "case_01" / "notes.bin").unlink()
    (folder / "case_01" / Path(*["d"] * 50)).mkdir(parents=True)
    with pytest.raises(BadInput, match=r"case_01/d/d/.* is a chain of nested folders, more than 32 deep"):
        discover.benchmark([folder], tmp_path / "out", study=tmp_path / "study.yaml")


@pytest.mark.parametrize("seconds", ['"abc"', "[1]", "null", "-1", "NaN", "1e12", f"1{'0' * 400}"])
def test_what_another_run_noted_is_not_believed(tmp_path, seconds, monkeypatch):
    folder = case_folder(tmp_path)
    monkeypatch.setattr(discover, "run_blind", lambda *_: None)
    base, template = discover._base(tmp_path / "study.yaml")
    assert template == {}
    out = tmp_path / "out"
    discover.run_case(folder / "case_01", out, base, {}, 1)
    (out / "verdict.json").write_text("{}")
    noted = json.loads((out / "case.json").read_text())
    (out / "case.json").write_text(json.dumps(noted | {"seconds": json.loads(seconds)}))
    assert discover.run_case(folder / "case_01", out, base, {}, 1).seconds is None
    (out / "case.json").write_text(json.dumps(noted | {"codes": 7}))
    assert discover.run_case(folder / "case_01", out, base, {}, 1).error is None


def test_a_studys_own_template_goes_with_it(tmp_path, monkeypatch):
    folder = case_folder(tmp_path)
    monkeypatch.setattr(discover, "run_blind", lambda *_: None)
    noted = []
    for words in ("<!-- one -->", "<!-- two -->"):
        template = study_of(tmp_path / "own").parent / "dogbone" / "dogbone.feb.j2"
        template.write_text(template.read_text() + words)
        base, texts = discover._base(tmp_path / "own" / "study.yaml")
        discover.run_case(folder / "case_01", tmp_path / "out", base, texts, 1)
        assert (tmp_path / "out" / "dogbone" / "dogbone.feb.j2").read_text().endswith(words)
        noted.append(json.loads((tmp_path / "out" / "case.json").read_text())["inputs"])
    assert noted[0] != noted[1]
