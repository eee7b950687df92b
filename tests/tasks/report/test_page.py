"""The page of a result folder: what is on it, in whatever state the folder is, and that nothing in it can do harm."""

import base64
import html
import json
import re
import sys
import time
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from runner.store import Store
from tasks import cli, pipeline
from tasks.problems import BadInput
from tasks.report import folder, page, plots
from tasks.report.blocks import number, percent
from tasks.report.page import build
from tasks.report.sections import data
from tests.tasks.report.conftest import edit

pytestmark = pytest.mark.page
SECTIONS = ("data", "calibration", "sensitivity", "importance", "posterior", "prediction", "sites", "discovery",
            "failures", "provenance")  # fmt: skip
TASKS = ("sobol", "importance", "calibrate", "infer", "predict", "compare", "discover")
SCRIPT, IMAGE, END = (
    "<script>window.hit=1</script>",
    '"><img src=x onerror="window.hit=1">',
    "</script><script>window.hit=1</script>",
)


class Reader(HTMLParser):
    """Text of each section, elements by name, and what scripts hold, as a browser would see it."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.sections: dict[str, str] = {}
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.scripts: list[tuple[dict[str, str | None], str]] = []
        self._section, self._open = "", ""
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        found = dict(attrs)
        self.elements.append((tag, found))
        self._open = tag
        if tag == "section":
            self._section = found["id"]
            self.sections[self._section] = ""
        if tag == "script":
            self.scripts.append((found, ""))

    def handle_endtag(self, tag):
        self._open = ""
        if tag == "section":
            self._section = ""

    def handle_data(self, data):
        if self._open == "script":
            found, before = self.scripts[-1]
            self.scripts[-1] = (found, before + data)
        elif self._section:
            self.sections[self._section] += data


def read(folder: Path) -> Reader:
    return Reader((folder / "report.html").read_text())


def sinew(*words: object) -> None:
    argv, sys.argv = sys.argv, ["sinew", *map(str, words)]
    try:
        cli.main()
    finally:
        sys.argv = argv


def keep_only(folder: Path, *tasks: str) -> None:
    """Drop the results of all other tasks: plots take time."""
    for task in TASKS:
        if task not in tasks:
            (folder / f"{task}.json").unlink()


# ---- what is on it


def test_a_run_leaves_a_page_with_every_section(whole_run):
    seen = read(whole_run)
    assert tuple(seen.sections) == ("summary", *SECTIONS)
    assert build(whole_run).trouble == ()
    for name in SECTIONS:
        assert "Not run yet" not in seen.sections[name], name
    summary = seen.sections["summary"]
    for word in ("sobol", "done", "found", "how sure", "total order indices", "effective sample size", "AUC"):
        assert word in summary
    sobol = json.loads((whole_run / "sobol.json").read_text())
    strongest = int(np.argmax(sobol["ST"]))
    assert f"{sobol['names'][strongest]} {sobol['ST'][strongest]:.2f}" in summary
    assert json.loads((whole_run / "discover.json").read_text())["verdict"] in summary


def test_the_page_says_how_to_make_it_again(whole_run):
    told = read(whole_run).sections["provenance"]
    events = [json.loads(line) for line in (whole_run / "log.jsonl").read_text().splitlines()]
    run = next(event for event in events if event["message"] == "run started")
    for fact in (run["version"], run["code"], run["cohort_hash"], run["study_hash"], run["packages"]["numpy"]):
        assert fact in told
    assert "sinew run " in told
    assert "--seed 3" in told
    assert run["study_text"].strip() in told
    assert json.loads((whole_run / "sobol.json").read_text())["inputs"] in told
    assert re.search(r"core-hours in evaluations\s*[\d.e-]+", told)


def test_curves_and_numbers_are_those_of_the_store(whole_run):
    """What a picked specimen shows: measured and fitted forces, as far apart as the calibration says."""
    scripts = {found.get("id"): text for found, text in read(whole_run).scripts}
    shown = json.loads(scripts["calibration-curves-data"])["data"]
    fits = json.loads((whole_run / "calibrate.json").read_text())["specimens"]
    assert set(shown) == set(fits)
    for name, told in fits.items():
        for protocol, rmse in told["rmse_N"].items():
            columns = {key: np.array(values) for key, values in shown[name][protocol].items()}
            np.testing.assert_allclose(columns["left"], columns["measured"] - columns["model"], atol=0.2)
            assert np.sqrt(np.mean(columns["left"] ** 2)) == pytest.approx(rmse, rel=1e-3), "all points are drawn"


def test_what_parameters_are_stands_beside_their_values(whole_run):
    sections, fits = read(whole_run).sections, json.loads((whole_run / "calibrate.json").read_text())
    for section in ("calibration", "posterior"):
        assert "fibre modulus in the linear region" in sections[section]
    told = fits["specimens"]["distal/1"]
    width = dict(zip(fits["free"], fits["bounds"], strict=True))["E_f"]
    sd = told["sd_of_range"]["E_f"] * (width[1] - width[0])
    value = number(told["parameters"]["E_f"], 4)
    ends = " (on a bound)" if "E_f" in told["on_bound"] else f" ± {number(sd, 2)}"
    assert value + (ends if "E_f" in told["determined"] else " (not determined)") in sections["calibration"]


def test_a_thinned_curve_keeps_its_largest_force_and_displacement():
    time = np.linspace(0.0, 100.0, 5001)
    moved, force = np.sin(0.31 * time), np.cos(0.17 * time)
    moved[1234], force[4321] = 1.5, -7.0
    columns = {"time_pull": time, "displacement_pull": moved, "measured_pull": force, "protocol": np.array(["pull"])}
    ((name, curve),) = folder._curves(SimpleNamespace(group=columns))
    assert (name, curve.total, curve.time_s.size <= folder.POINTS) == ("pull", 5001, True)
    assert (curve.displacement_mm.max(), curve.force_N.min()) == (1.5, -7.0)


def test_the_largest_stress_and_strain_of_each_specimen(whole_run):
    told = " ".join(read(whole_run).sections["data"].split())
    described = json.loads((whole_run.parent / "cohort" / "distal" / "1" / "specimen.json").read_text())
    curves = [
        np.loadtxt(path, delimiter=",", skiprows=1)
        for path in (whole_run.parent / "cohort" / "distal" / "1").glob("*.csv")
    ]
    peak = max(np.abs(curve[:, 2]).max() for curve in curves)
    stress = peak / (described["width_mm"] * described["thickness_mm"])
    strain = 100 * max(curve[:, 1].max() for curve in curves) / described["length_mm"]
    assert f"{number(peak)}{number(stress)}{number(strain)}" in told, "cells beside each other"


def test_a_specimen_without_sizes_has_no_stress(whole_run, monkeypatch):
    monkeypatch.setattr(data, "_geometry", lambda *_: {"length_mm": 10.0, "width_mm": None, "thickness_mm": None})
    found = data.section(folder.read_folder(whole_run))
    (table,) = (block for block in found.blocks if block.kind == "table")
    assert all((row[2], row[3], row[4], row[-2]) == ("10", "–", "–", "–") for row in table.rows)
    assert all(row[-1] != "–" for row in table.rows)


def test_the_summary_tells_of_few_particles_and_of_all_bands(run_folder):
    keep_only(run_folder, "infer", "predict")
    edit(run_folder / "infer.json", lambda told: told["sites"]["distal"].update(effective_sample_size=3.0))
    edit(run_folder / "infer.json", lambda told: told["sites"]["middle"].update(effective_sample_size=500.0))
    build(run_folder)
    sections = read(run_folder).sections
    assert "worth few particles: distal" in sections["summary"]
    assert "distal: the particles are worth fewer than 10 of equal weight" in sections["posterior"]
    coverage = json.loads((run_folder / "predict.json").read_text())["coverage"]
    shown = [percent(told["all"]) for told in coverage.values() if told["all"] is not None]
    assert len(shown) >= 2
    assert all(f"{part} in the band of" in sections["summary"] for part in shown)


def test_parameters_of_an_effect_are_those_of_the_candidate_that_was_judged(run_folder):
    keep_only(run_folder, "discover")
    found = json.loads((run_folder / "discover.json").read_text())
    judged = found["candidates"][-1]
    edit(run_folder / "discover.json", lambda told: told.update(shown=judged["effects"]))
    build(run_folder)
    told = " ".join(read(run_folder).sections["discovery"].split())
    assert f"Parameters of {' + '.join(judged['effects'])}, with 90 % intervals" in told
    for every in judged["parameters"].values():
        for name, parameter in every.items():
            assert name + number(parameter["value"], 4) + parameter["unit"] in told, "cells beside each other"


@pytest.mark.parametrize(
    ("names", "words"), [(("a/1", "a/2"), "it needs two sites"), (("a/1", "b/1"), "Not run yet: `sinew compare")]
)
def test_one_site_is_told_why_there_is_nothing_to_compare(run_folder, names, words):
    (run_folder / "compare.json").unlink()
    log = run_folder / "log.jsonl"
    lines = [line for line in log.read_text().splitlines() if json.loads(line).get("task") != "compare"]
    log.write_text("\n".join(lines) + "\n")
    found = folder.read_folder(run_folder)
    vars(found)["measured"] = {name: {} for name in names}
    assert words in found.missing("compare")


def test_equal_folders_give_equal_bytes(whole_run):
    build(whole_run)
    first = (whole_run / "report.html").read_bytes()
    build(whole_run)
    assert (whole_run / "report.html").read_bytes() == first


def test_nothing_comes_from_elsewhere(whole_run):
    seen = read(whole_run)
    for tag, attributes in seen.elements:
        for name in ("src", "srcset", "action", "data", "poster", "formaction"):
            assert name not in attributes, tag
        if tag in ("a", "link"):
            assert re.match(r"#|figures/|data:,", attributes["href"])
    policy = next(found["content"] for tag, found in seen.elements if found.get("http-equiv"))
    assert "default-src 'none'" in policy
    assert "unsafe-eval" not in policy
    assert "unsafe-inline" not in policy.partition("script-src")[2].partition(";")[0]
    style = (whole_run / "report.html").read_text().partition("<style>")[2].partition("</style>")[0]
    assert "url(" not in style
    assert "@import" not in style


def test_a_page_of_27_specimens_with_long_curves_stays_small():
    """27 specimens, three protocols: as many points as a section may take of each curve."""
    columns = {
        name: np.linspace(0.0, 1234.5, 500) / 7 for name in ("time", "displacement", "measured", "model", "left")
    }
    data = {f"site/{k}": dict.fromkeys(("one", "two", "cyclic"), columns) for k in range(27)}
    block = plots.picked("curves", "", "Specimen", data, lambda sources: [])
    assert len(page._json({"data": block.data})) < 2_000_000
    assert len(bytes(page._json({"data": block.data}), "utf-8")) + sum(map(len, page.INLINE.js_raw[:1])) < 15_000_000


# ---- whatever state the folder is in


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


def test_a_folder_that_only_just_began_has_a_page(tmp_path):
    with Store.writing(tmp_path / "out", "young"):
        pass
    assert build(tmp_path / "out").trouble == ()
    seen = read(tmp_path / "out")
    assert seen.sections["summary"].count("not run") == len(TASKS)
    assert "Nothing failed" in seen.sections["failures"]


@pytest.mark.parametrize(
    ("task", "content", "words"),
    [
        ("sobol", b'{"names": ["E_f",', "damaged, no JSON"),
        ("importance", b"{}", "cannot be shown"),
        ("calibrate", b"\xff\xfe{}", "damaged, no UTF-8 text"),
        ("infer", b"[" * 100_000, "damaged, nested without end"),
        ("predict", b"", "damaged, no JSON"),
        ("compare", b"{}", "cannot be shown"),
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
    assert tuple(seen.sections) == ("summary", *SECTIONS), "all others are there"
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
    from tasks.cohort import virtual_cohort, write_cohort

    specimens, _ = virtual_cohort(seed=1, per_site=1, rate_hz=1.0)
    write_cohort(tmp_path / "cohort", specimens[:1])
    (tmp_path / "study.yaml").write_text("name: bad\ncohort: cohort\ntasks: [sobol]\n")

    def fail(*_, **__):
        raise BadInput("a file", "is wrong", "another")

    monkeypatch.setattr(pipeline, "_TASKS", {"sobol": pipeline._Task(fail, fail, fail)})
    with pytest.raises(SystemExit) as ended:
        sinew("run", tmp_path / "study.yaml", "--out", tmp_path / "out", "--quiet")
    assert ended.value.code == 2
    seen = read(tmp_path / "out")
    assert "sobol failed" in " ".join(seen.sections["summary"].split())
    assert "a file: is wrong; expected another" in seen.sections["sensitivity"]


# ---- nothing in it can do harm


def hostile(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Names and messages as an attacker would choose them, in results, log, and the store's own words."""
    names = {"distal": SCRIPT, "middle": IMAGE, "cyclic": END, "small": f"{END}$$x$$", "toe-slack": SCRIPT}

    def spoilt(text: str) -> str:
        for name, evil in names.items():
            text = text.replace(name, json.dumps(evil)[1:-1])
        return text

    for path in [*folder.glob("*.json"), folder / "log.jsonl"]:
        path.write_text(spoilt(path.read_text()))
    for path in folder.glob("store.zarr/**/zarr.json"):
        content = json.loads(path.read_text())
        attributes = content.get("attributes", {})
        for key in ("title", "study"):
            if key in attributes:
                attributes[key] = json.loads(f'"{spoilt(attributes[key])}"')
        path.write_text(json.dumps(content))
    edit(
        folder / "infer.json", lambda found: found["names"].__setitem__(1, END) or found["units"].__setitem__(0, IMAGE)
    )
    kept = Store.read_result

    def read_result(self, name):
        for true, evil in names.items():
            name = name.replace(evil.replace("/", "_"), true).replace(evil, true)
        return kept(self, name)

    monkeypatch.setattr(Store, "read_result", read_result)


def test_names_are_shown_as_they_are_and_never_run(run_folder, monkeypatch):
    before = read(run_folder)
    hostile(run_folder, monkeypatch)
    trouble = build(run_folder).trouble
    assert all("posterior" in line for line in trouble), "a parameter was renamed, which infer.json alone knows"
    seen = read(run_folder)
    kinds = {tag for tag, _ in seen.elements}
    assert kinds <= {tag for tag, _ in before.elements} | {"code"}
    assert "img" not in kinds
    assert not any(name.startswith("on") for _, attributes in seen.elements for name in attributes)
    executed = [text for found, text in seen.scripts if found.get("type") != "application/json"]
    assert executed == [text for found, text in before.scripts if found.get("type") != "application/json"]
    for found, text in seen.scripts:
        if found.get("type") == "application/json":
            json.loads(text)
            assert not re.search("[<>&]", text)
    assert SCRIPT in seen.sections["summary"]
    assert f"{SCRIPT}/1" in seen.sections["calibration"]
    raw = (run_folder / "report.html").read_text()
    assert html.escape(IMAGE, quote=False) in raw.replace("&#34;", '"')


@given(st.text(), st.lists(st.text(alphabet="</script>!-<&\"'\u2028"), max_size=3))
def test_json_in_a_script_element_is_the_same_and_cannot_end_it(text, more):
    value = {"text": text, "more": more, text: [1.5, None]}
    shown = str(page._json(value))
    assert json.loads(shown) == value
    assert not re.search("[<>&\u2028\u2029]", shown)
    (found,) = Reader(f'<script type="application/json">{shown}</script>').scripts
    assert found[1] == shown


def test_numbers_that_are_none_become_null():
    assert str(page._json([float("nan")])) == "[null]"


@pytest.mark.parametrize("text", ["$$x$$", r"\(x\)", r"\[x\]", "a $$ b"])
def test_no_name_is_taken_for_a_formula(text):
    assert not re.search(r"\$\$|\\\(|\\\[", plots.plain(text))
    assert plots.plain(text).replace("\u200b", "") == text


# ---- in a browser


def opened(browser, path: Path) -> None:
    """Open a page and wait for its plots."""
    browser.get_log("browser")
    browser.get_log("performance")
    browser.get(path.as_uri())
    deadline = time.monotonic() + 120
    while not browser.execute_script("return document.body.dataset.drawn"):
        assert time.monotonic() < deadline, browser.get_log("browser")
        time.sleep(0.1)


def quiet(browser, path: Path, levels: tuple[str, ...] = ("SEVERE", "WARNING")) -> None:
    """No error, no warning, and nothing asked of anybody but the page itself."""
    wrong = [entry for entry in browser.get_log("browser") if entry["level"] in levels]
    assert not wrong, wrong
    asked = set()
    for entry in browser.get_log("performance"):
        message = json.loads(entry["message"])["message"]
        if message["method"] in ("Network.requestWillBeSent", "Network.webSocketCreated"):
            asked.add(message["params"].get("request", message["params"])["url"])
    assert {url for url in asked if not url.startswith("data:")} <= {path.as_uri()}


DRAWN = """
return [...document.querySelectorAll(".plot")].map((place) => {
  const inside = [];
  const walk = (node) => { if (node.shadowRoot) node = node.shadowRoot;
    for (const child of node.children) { if (child.tagName === "CANVAS") inside.push(child); walk(child); } };
  walk(place);
  const inked = inside.some((canvas) => {
    if (!canvas.width || !canvas.height) return false;
    const data = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
    const colours = new Set();
    for (let i = 0; i < data.length; i += 16) colours.add(`${data[i]},${data[i + 1]},${data[i + 2]},${data[i + 3]}`);
    return colours.size > 8;
  });
  return [place.id, inked];
});
"""


@pytest.mark.browser
def test_every_section_is_drawn_without_errors_or_requests(chromium, whole_run):
    path = whole_run / "report.html"
    opened(chromium, path)
    drawn = dict(chromium.execute_script(DRAWN))
    assert len(drawn) >= 20
    assert all(drawn.values()), [name for name, inked in drawn.items() if not inked]
    for name in SECTIONS:
        assert chromium.find_element("id", name).is_displayed()
    for name in SECTIONS[:8]:
        assert any(plot.startswith(name) for plot in drawn), name
    quiet(chromium, path)


@pytest.mark.browser
def test_a_picked_specimen_changes_its_plots(chromium, whole_run):
    from selenium.webdriver.support.ui import Select

    opened(chromium, whole_run / "report.html")
    values = "return Bokeh.documents.map((d) => d.get_model_by_name('cyclic')).find((s) => s?.data.model).data"
    place = chromium.find_element("id", "calibration-fit-0")
    before, picture = chromium.execute_script(f"{values}.model[20]"), place.screenshot_as_png
    told = chromium.find_element("css selector", "#calibration-curves .told").text
    Select(chromium.find_element("id", "calibration-curves-pick")).select_by_value("middle/1")
    data = json.loads(chromium.find_element("id", "calibration-curves-data").get_attribute("textContent"))
    after = chromium.execute_script(f"{values}.model[20]")
    assert after == data["data"]["middle/1"]["cyclic"]["model"][20] != before
    time.sleep(0.5)
    assert place.screenshot_as_png != picture
    assert chromium.find_element("css selector", "#calibration-curves .told").text not in ("", told)
    quiet(chromium, whole_run / "report.html")


@pytest.mark.browser
def test_hovering_shows_values(chromium, whole_run):
    from selenium.webdriver import ActionChains

    opened(chromium, whole_run / "report.html")
    place = chromium.find_element("id", "sensitivity-indices")
    chromium.execute_script("arguments[0].scrollIntoView({block: 'center', behavior: 'instant'})", place)
    spot = chromium.execute_script(
        """
        const view = [...Bokeh.index].find((v) => v.el.closest("#sensitivity-indices"));
        const { data } = view.model.document.get_model_by_name("indices");
        const best = data.ST.indexOf(Math.max(...data.ST));
        const box = view.el.getBoundingClientRect();
        const x = view.frame.x_scale.compute(data.ST[best]);
        const y = view.frame.y_scale.compute([data.parameter[best], -0.17]);
        return [box.left + x, box.top + y, data.parameter[best]];
        """
    )
    ActionChains(chromium).move_by_offset(0, 0).perform()
    actions = ActionChains(chromium)
    actions.w3c_actions.pointer_action.move_to_location(round(spot[0]), round(spot[1]))
    actions.perform()
    seen = """
    const texts = [];
    const walk = (node) => { texts.push(node.textContent ?? "");
      for (const child of [...(node.shadowRoot?.children ?? []), ...node.children]) walk(child); };
    walk(document.getElementById("sensitivity-indices"));
    for (const child of document.body.children) if (child.className.includes?.("bk")) walk(child);
    return texts.join(" ");
    """
    deadline = time.monotonic() + 10
    while "±" not in (told := chromium.execute_script(seen)):
        assert time.monotonic() < deadline, told[-500:]
        time.sleep(0.1)
    assert spot[2] in told


@pytest.mark.browser
def test_a_phone_has_no_horizontal_scroll(chromium, whole_run):
    size = {"width": 375, "height": 740, "deviceScaleFactor": 2, "mobile": True}
    chromium.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    try:
        opened(chromium, whole_run / "report.html")
        widths = "return [document.documentElement.scrollWidth, document.body.scrollWidth, innerWidth]"
        document, body, window = chromium.execute_script(widths)
        assert window == 375
        assert max(document, body) <= window
        assert all(dict(chromium.execute_script(DRAWN)).values())
    finally:
        chromium.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})


@pytest.mark.browser
def test_printing_gives_whole_plots(chromium, whole_run):
    opened(chromium, whole_run / "report.html")
    count = chromium.execute_script(
        "dispatchEvent(new Event('beforeprint')); return document.querySelectorAll('.plot > svg.paper').length"
    )
    assert count == int(chromium.execute_script("return document.body.dataset.drawn"))
    ragged = chromium.execute_script(
        "return [...document.querySelectorAll('svg.paper')].filter((s) => !s.viewBox.baseVal.width).length"
    )
    assert ragged == 0
    chromium.execute_script("dispatchEvent(new Event('afterprint'))")
    assert not chromium.find_elements("css selector", "svg.paper")
    printed = chromium.execute_cdp_cmd("Page.printToPDF", {"preferCSSPageSize": True, "printBackground": True})
    pdf = base64.b64decode(printed["data"])
    assert pdf.startswith(b"%PDF")
    assert len(pdf) > 50_000
    assert len(re.findall(rb"/Type\s*/Page\b", pdf)) >= 4
    quiet(chromium, whole_run / "report.html")


@pytest.mark.browser
def test_hostile_names_do_nothing_in_a_browser(chromium, run_folder, monkeypatch):
    hostile(run_folder, monkeypatch)
    build(run_folder)
    path = run_folder / "report.html"
    opened(chromium, path)
    for select in chromium.find_elements("tag name", "select"):
        chromium.execute_script(
            "arguments[0].selectedIndex = 1; arguments[0].dispatchEvent(new Event('change'))", select
        )
    time.sleep(1)
    assert chromium.execute_script("return window.hit ?? null") is None
    assert not chromium.find_elements("tag name", "img")
    assert SCRIPT in chromium.find_element("id", "summary").text
    quiet(chromium, path, levels=("SEVERE",))  # Bokeh warns of plots without points, of a protocol that is gone
