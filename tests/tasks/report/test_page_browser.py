"""The page of a result folder in a browser: drawn, picked, hovered, narrow, printed."""

import base64
import json
import re
import time
from pathlib import Path

import pytest

from sinew.tasks.drawing import plots
from sinew.tasks.drawing.blocks import Facts, Section
from sinew.tasks.report.page import build, render
from tests.tasks.report.pages import SCRIPT, SECTIONS, hostile

pytestmark = pytest.mark.page


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


PICTURES = """
const found = [];
const walk = (node) => { if (node.shadowRoot) node = node.shadowRoot;
  for (const child of node.children) { if (child.tagName === "CANVAS") found.push(child.toDataURL()); walk(child); } };
walk(arguments[0]);
return found;
"""  # what the canvases of a place show; a screenshot of a long page takes ten seconds and more


@pytest.fixture
def page(chromium, whole_run) -> Path:
    """The page of a whole run, open in the browser; drawing all of its plots takes seconds, so it stays open."""
    path = whole_run / "report.html"
    if chromium.current_url != path.as_uri():
        opened(chromium, path)
    return path


@pytest.mark.browser
def test_every_section_is_drawn_without_errors_or_requests(chromium, page):
    drawn = dict(chromium.execute_script(DRAWN))
    assert len(drawn) >= 20
    assert all(drawn.values()), [name for name, inked in drawn.items() if not inked]
    for name in SECTIONS:
        assert chromium.find_element("id", name).is_displayed()
    for name in SECTIONS[:8]:
        assert any(plot.startswith(name) for plot in drawn), name
    quiet(chromium, page)


@pytest.mark.browser
def test_a_picked_specimen_changes_its_plots(chromium, page):
    from selenium.webdriver.support.ui import Select

    values = "return Bokeh.documents.map((d) => d.get_model_by_name('cyclic')).find((s) => s?.data.model).data"
    place = chromium.find_element("id", "calibration-fit-0")
    before, pictures = chromium.execute_script(f"{values}.model[20]"), chromium.execute_script(PICTURES, place)
    assert any(len(picture) > 5000 for picture in pictures)
    note = chromium.find_element("css selector", "#calibration-curves .picked-note").text
    Select(chromium.find_element("id", "calibration-curves-pick")).select_by_value("middle/1")
    data = json.loads(chromium.find_element("id", "calibration-curves-data").get_attribute("textContent"))
    after = chromium.execute_script(f"{values}.model[20]")
    assert after == data["data"]["middle/1"]["cyclic"]["model"][20] != before
    deadline = time.monotonic() + 10
    while chromium.execute_script(PICTURES, place) == pictures:
        assert time.monotonic() < deadline, "the plot shows the former specimen"
        time.sleep(0.1)
    assert chromium.find_element("css selector", "#calibration-curves .picked-note").text not in ("", note)
    quiet(chromium, page)


@pytest.mark.browser
def test_hovering_shows_values(chromium, whole_run):
    from selenium.webdriver import ActionChains

    opened(chromium, whole_run / "report.html")  # anew: a page that still scrolls smoothly moves below the pointer
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
        chromium.get("about:blank")  # what is drawn for a phone is for no other test


@pytest.mark.browser
def test_printing_gives_whole_plots(chromium, page):
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
    quiet(chromium, page)


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


def test_what_a_picked_specimen_does_not_have_is_not_shown(chromium, tmp_path):
    """A specimen without a protocol has no empty plot of it, first or picked later."""

    def draw(sources):
        found = []
        for protocol in ("pull", "cycles"):
            plot = plots.figure("time (s)", "force (N)")
            plot.line("time", "force", source=sources[protocol])
            found.append(plots.plot(f"curves-{protocol}", plot, protocol))
        return found

    curve, nothing = {"time": [0.0, 1.0], "force": [0.0, 2.0]}, {"time": [], "force": []}
    data = {"a": {"pull": curve, "cycles": nothing}, "b": {"pull": curve, "cycles": curve}}
    section = Section("data", "Data", "?", [plots.picked("curves", "Curves", "Specimen", data, draw)])
    path = tmp_path / "page.html"
    path.write_text(render("page", Facts([]), [section], []))
    opened(chromium, path)
    hidden = "return [...document.querySelectorAll('.plot')].map((place) => place.offsetHeight === 0)"
    assert chromium.execute_script(hidden) == [False, True]
    for value, expected in (("b", [False, False]), ("a", [False, True])):
        chromium.execute_script(
            "const s = document.getElementById('curves-pick'); s.value = arguments[0]; "
            "s.dispatchEvent(new Event('change'))",
            value,
        )
        assert chromium.execute_script(hidden) == expected
    assert dict(chromium.execute_script(DRAWN))["curves-pull"]
    quiet(chromium, path, levels=("SEVERE",))  # Bokeh warns of a plot that begins empty
