"""Nothing on the page of a result folder can do harm."""

import html
import json
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sinew.tasks.drawing import plots
from sinew.tasks.report import page
from sinew.tasks.report.page import build
from tests.tasks.report.pages import IMAGE, SCRIPT, Reader, hostile, read

pytestmark = pytest.mark.page


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
