"""One page about two result folders."""

import io
import json
import logging
import shutil
import sys

import pytest

from sinew.runner.errors import BadInput
from sinew.tasks.cli import main as cli
from sinew.tasks.drawing.blocks import number
from sinew.tasks.report import page
from sinew.tasks.report.comparison import compare
from tests.effort import at_most
from tests.tasks.report.conftest import edit
from tests.tasks.report.pages import IMAGE, Reader


def sections(first, second, tmp_path):
    built = compare(first, second, tmp_path / "both.html")
    found = Reader(built.path.read_text()).sections
    return {name: " ".join(text.split()) for name, text in found.items()}, built.trouble


def test_a_folder_is_like_itself(whole_run, tmp_path):
    found, trouble = sections(whole_run, whole_run, tmp_path)
    assert trouble == ()
    assert "the same settings" in found["summary"]
    assert "; 0 of" in found["summary"]
    assert "no index differs beyond its interval" in found["summary"]
    assert "differs" not in found["setup"] + found["sensitivity"]


def test_what_differs_is_told_with_its_size(whole_run, run_folder, tmp_path):
    def changed(told):
        fit = told["specimens"]["distal/1"]
        name = fit["determined"][0]
        place = told["free"].index(name)
        low, high = told["bounds"][place]
        fit["parameters"][name] += 10 * fit["sd_of_range"][name] * (high - low)
        told["bounds"][place] = [low - 10 * (high - low), high + 10 * (high - low)]
        for each in told["specimens"].values():
            each["sd_of_range"][name] /= 21
        told["names"].append("slack_stretch")
        for each in told["specimens"].values():
            each["parameters"]["slack_stretch"] = 1.0
        told["units"].append("1")
        told["meanings"].append("")

    edit(run_folder / "calibrate.json", changed)
    edit(run_folder / "sobol.json", lambda told: told["ST"].__setitem__(0, told["ST"][0] + 5 * told["ST_conf"][0] + 1))
    found, _ = sections(whole_run, run_folder, tmp_path)
    fits = json.loads((whole_run / "calibrate.json").read_text())
    name = fits["specimens"]["distal/1"]["determined"][0]
    assert number(10 / 2**0.5, 2) in found["calibration"].partition(f"distal/1 {name}")[2][:60]
    assert "; 1 of" in found["summary"]
    assert f"Only in {run_folder}: slack_stretch." in found["calibration"]
    first = json.loads((whole_run / "sobol.json").read_text())["names"][0]
    assert f"beyond their intervals: {first}" in found["summary"]


def rewrite_log(folder, **facts):
    """Say otherwise what the runs of a folder were given."""
    log = folder / "log.jsonl"
    events = [json.loads(line) for line in log.read_text().splitlines()]
    changed = [one | facts if one["message"] == "run started" else one for one in events]
    log.write_text("".join(json.dumps(one) + "\n" for one in changed))


def test_settings_that_differ_are_listed_by_their_fields(whole_run, run_folder, tmp_path):
    events = [json.loads(line) for line in (whole_run / "log.jsonl").read_text().splitlines()]
    text = next(one["study_text"] for one in events if one["message"] == "run started")
    text += "\nmodel: {parameters: {E_f: {min: 99.5, max: 400}}}\n" if "\nmodel:" not in text else ""
    rewrite_log(run_folder, study_hash="another", study_text=text.replace("\nname: ", "\nname: other-"))
    found, trouble = sections(whole_run, run_folder, tmp_path)
    assert not trouble
    assert "differ in hash of the study" in found["summary"]
    assert "Settings that differ" in found["setup"]
    assert "model.parameters.E_f.min–99.5" in found["setup"]
    assert "sobol." not in found["setup"]


def test_a_study_that_cannot_be_read_is_said(whole_run, run_folder, tmp_path):
    rewrite_log(run_folder, study_text="a: &b [*b]")
    found, trouble = sections(whole_run, run_folder, tmp_path)
    assert not trouble
    assert "The studies cannot be compared: study: line 1: an anchor or alias" in found["setup"]


@pytest.mark.parametrize(("task", "section"), [("sobol", "sensitivity"), ("calibrate", "calibration")])
def test_results_of_other_ranges_have_a_warning(whole_run, run_folder, tmp_path, task, section):
    edit(run_folder / f"{task}.json", lambda told: told["bounds"].__setitem__(0, [-1.0, 5000.0]))
    found, _ = sections(whole_run, run_folder, tmp_path)
    assert "1 parameter had another range in each study: that alone makes results differ." in found[section]
    assert "-1 to 5000" in found[section].replace("−", "-").replace(",", "")


def test_an_index_without_an_interval_is_not_known_to_be_the_same(whole_run, run_folder, tmp_path):
    edit(run_folder / "sobol.json", lambda told: told.update(ST_conf=[None, *told["ST_conf"][1:]]))
    found, _ = sections(whole_run, run_folder, tmp_path)
    first = json.loads((whole_run / "sobol.json").read_text())["names"][0]
    assert f"no index differs beyond its interval; not known: {first}" in found["summary"]
    assert "not known" in found["sensitivity"]


def test_a_mean_elsewhere_is_told(whole_run, run_folder, tmp_path):
    def moved(told):
        site = next(iter(told["sites"].values()))
        marginal = next(iter(site["parameters"].values()))
        marginal["mean"] += 10 * marginal["sd"]
        marginal["hdi"] = [end + 10 * marginal["sd"] for end in marginal["hdi"]]

    edit(run_folder / "infer.json", moved)
    found, _ = sections(whole_run, run_folder, tmp_path)
    assert "Posterior 1 of" in found["summary"]
    assert number(10 / 2**0.5, 2) in found["posterior"]


def test_what_one_of_them_lacks_is_named(whole_run, run_folder, tmp_path):
    (run_folder / "infer.json").unlink()
    found, _ = sections(whole_run, run_folder, tmp_path)
    assert f"No infer to compare: {run_folder} without a result" in found["posterior"]
    assert "sum of RMSEs" in found["calibration"]


def test_results_that_contradict_themselves_hide_no_others(whole_run, run_folder, tmp_path):
    edit(run_folder / "sobol.json", lambda told: told.update(ST=[]))
    found, trouble = sections(whole_run, run_folder, tmp_path)
    assert len(trouble) == 1
    assert "sobol.json: content: ST: 0 numbers for " in trouble[0]
    assert "sum of RMSEs" in found["calibration"]


def test_what_cannot_be_compared_hides_no_others(whole_run, run_folder, tmp_path, monkeypatch):
    monkeypatch.setattr("sinew.tasks.report.comparison.hypot", lambda *_: {}["of another study"])
    found, trouble = sections(whole_run, run_folder, tmp_path)
    assert "sensitivity cannot be compared" in [line.partition(" (")[0] for line in trouble]
    assert "sensitivity" not in found
    assert {"setup", "discovery"} <= found.keys()


def test_names_from_a_folder_are_words(whole_run, run_folder, tmp_path):
    rewrite_log(run_folder, study_file=IMAGE)
    found, _ = sections(whole_run, run_folder, tmp_path)
    assert "<img" not in (tmp_path / "both.html").read_text()
    assert "onerror" in found["setup"]


def test_half_a_character_is_a_question_mark(whole_run, run_folder, tmp_path):
    edit(run_folder / "discover.json", lambda told: told.update(verdict="AMBIGUOUS", set=["\ud800half"]))
    found, trouble = sections(whole_run, run_folder, tmp_path)
    assert not trouble
    assert "?half" in found["discovery"]


def test_no_folder_is_one_line_and_writes_nothing(whole_run, tmp_path):
    with pytest.raises(BadInput, match="is not there"):
        compare(whole_run, tmp_path / "none", tmp_path / "both.html")
    assert not (tmp_path / "both.html").exists()


@pytest.mark.parametrize(
    ("out", "words"),
    [
        ("sobol.json", "sobol.json: is no name of a page; expected a file that ends in .html"),
        (".", "is no name of a page"),
        ("folder.html", "folder.html: is no name of a page"),
        ("none/both.html", "none is not there; expected a file in a folder that is there"),
    ],
)
def test_a_page_replaces_no_other_file(whole_run, tmp_path, out, words):
    (tmp_path / "folder.html").mkdir()
    (tmp_path / "sobol.json").write_text("precious")
    with pytest.raises(BadInput, match=words):
        compare(whole_run, whole_run, tmp_path / out)
    assert (tmp_path / "sobol.json").read_text() == "precious"


def test_the_command(whole_run, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["sinew", "report", str(whole_run), str(whole_run)])
    cli.main()
    assert capsys.readouterr().out == "comparison.html\n"
    assert (tmp_path / "comparison.html").is_file()
    monkeypatch.setattr(sys, "argv", ["sinew", "report", str(whole_run), "--out", "a.html"])
    with pytest.raises(SystemExit):
        cli.main()
    assert "--out: given with one folder" in capsys.readouterr().err


def test_what_bokeh_says_of_a_damaged_result_is_not_printed(run_folder, monkeypatch):
    """Dask, once it is imported, gives Bokeh's logger a way to the terminal."""
    checked = logging.getLogger("bokeh.core.validation.check")
    build = page.build
    monkeypatch.setattr(page, "build", lambda folder: (checked.error("E-1019 (DUPLICATE_FACTORS)"), build(folder))[1])
    monkeypatch.setattr(sys, "argv", ["sinew", "report", str(run_folder)])
    said = io.StringIO()
    handler = logging.StreamHandler(said)
    logging.getLogger("bokeh").addHandler(handler)
    try:
        cli.main()
    finally:
        logging.getLogger("bokeh").removeHandler(handler)
    assert said.getvalue() == ""


@pytest.mark.thorough
def test_specimens_without_end_are_compared_in_time(whole_run, run_folder, tmp_path):
    """The parameters of both are put side by side once, not once for each specimen."""

    def swollen(told):
        told["free"] = [f"p{number}" for number in range(1_000)]
        told["bounds"] = [[0.0, 1.0]] * len(told["free"])
        told["names"] = told["free"]
        fit = next(iter(told["specimens"].values()))
        small = {**fit, "parameters": {}, "sd_of_range": {}, "determined": [], "on_bound": [], "confounded": []}
        told["specimens"] = {f"s{number}": small for number in range(3000)}

    def disjoint(told):
        swollen(told)
        told["free"] = told["names"] = [f"q{number}" for number in range(1_000)]

    other = tmp_path / "other"
    shutil.copytree(run_folder, other)
    edit(run_folder / "calibrate.json", swollen)
    edit(other / "calibrate.json", disjoint)
    with at_most(30):  # with every parameter beside every other, minutes
        found, _ = sections(run_folder, other, tmp_path)
        assert "000 specimens in both" in found["summary"]
