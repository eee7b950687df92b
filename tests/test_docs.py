"""What README and docs say is true: commands run, links lead somewhere, examples are valid."""

import json
import re
import shlex
import sys
from itertools import groupby
from pathlib import Path

import click
import pytest

from sinew.tasks.cli import main as cli
from sinew.tasks.model.effects import library
from sinew.tasks.study.study import read_study
from tests import files_page
from tests.docs_pages import LANGUAGES, NOT_RUN, PAGES, ROOT, bare, blocks, commands, ended, prepared, run

WITH_COMMANDS = [page for page in PAGES if any(block.language in ("sh", "python") for block in blocks(page))]


@pytest.mark.timeout(900)
@pytest.mark.parametrize("page", WITH_COMMANDS, ids=lambda page: page.stem)
def test_what_a_page_says_runs(page, tmp_path):
    work = [
        block for block in blocks(page) if block.language in ("sh", "python") and "EFFECT = Effect(" not in block.text
    ]
    todo = [command for command in commands(page) if bare(command) not in NOT_RUN]
    if not todo and all(block.language == "sh" for block in work):
        return  # all of them are listed
    prepared(page, tmp_path)
    for language, following in groupby(work, lambda block: block.language):
        some = list(following)
        if language == "python":
            text = "\n".join(block.text for block in some)
            ended(tmp_path, [sys.executable, "-c", text], f"{page.name}: line {some[0].line}")
            continue
        for line in (line for block in some for line in block.text.replace("\\\n", " ").splitlines()):
            if line.split("#")[0].strip() and bare(line) not in NOT_RUN:
                run(tmp_path, line)


def test_a_page_without_what_it_needs_fails(tmp_path):
    page = tmp_path / "page.md"
    page.write_text("```sh\nsinew status nowhere\n```\n")
    (tmp_path / "here").mkdir()
    with pytest.raises(AssertionError, match="holds no store"):
        test_what_a_page_says_runs(page, tmp_path / "here")


def test_every_command_that_is_not_run_is_in_the_pages():
    there = {bare(command) for page in PAGES for command in commands(page)}
    assert set(NOT_RUN) <= there, f"no page says {sorted(set(NOT_RUN) - there)}: take it off the list"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_every_block_says_what_it_is(page):
    for block in blocks(page):
        assert block.language in LANGUAGES, (
            f"{block.page}: line {block.line}: a block of {block.language or 'nothing'}; "
            f"expected one of {', '.join(sorted(LANGUAGES))} (commands: sh)"
        )


@pytest.mark.parametrize(
    "command",
    sorted({bare(c) for page in PAGES for c in commands(page) if bare(c).startswith("sinew ")}),
)
def test_the_command_line_has_what_pages_use(command):
    parsed = cli.sinew
    words = shlex.split(command.partition(" > ")[0])[1:]
    while isinstance(parsed, click.Group):
        assert words[0] in parsed.commands, f"there is no command {words[0]}"
        parsed = parsed.commands[words.pop(0)]
    parsed.make_context(parsed.name, words).close()


def options(group: click.Group) -> set[str]:
    """All options of a command and of those below it."""
    found = {"--help", "--version"}
    for one in group.commands.values():
        found |= options(one) if isinstance(one, click.Group) else set()
        found |= {name for parameter in one.params for name in (*parameter.opts, *parameter.secondary_opts)}
    return found


FOREIGN = {
    "--form",
    "--cases",
    "--points",
    "--times",
    "--lifetime",
    "--from",
    "--minutes",
}  # of tests.hidden, tests.fuzz, tests.chaos, and Dask


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_options_in_the_texts_exist(page):
    text = re.sub(r"<!--.*?-->", "", page.read_text("utf-8"), flags=re.DOTALL)
    used = {
        option for span in re.findall(r"`([^`\n]+)`", text) for option in re.findall(r"(?<!\S)--[a-z][a-z0-9-]*", span)
    }
    assert used <= options(cli.sinew) | FOREIGN, f"{page.name}: {sorted(used - options(cli.sinew) - FOREIGN)}"


def test_links_between_pages_lead_somewhere():
    for page in PAGES:
        for target in re.findall(r"(?:\]\(|<img src=\")(?!https?://)([^)\"#\s]+)", page.read_text("utf-8")):
            assert (page.parent / target).exists(), f"{page.name}: {target} is not there"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_files_of_the_project_that_texts_name_exist(page):
    """Code spans such as ``tasks/registry.py``; what is written in capitals stands for a name."""
    folders = "runner|tasks|templates|configs|slurm|packaging|tests|docs|sinew"
    for span in re.findall(rf"`((?:{folders})/[a-z0-9_./-]*)`", page.read_text("utf-8")):
        assert (ROOT / span).exists() or span.startswith("docs/_build"), f"{page.name}: {span} is not there"


def test_the_example_of_an_effect_is_the_one_that_the_notebook_runs():
    (example,) = (b.text for b in blocks(ROOT / "docs" / "effects.md") if "EFFECT = Effect(" in b.text)
    assert example in _source(ROOT / "docs" / "tutorials" / "own_effect.ipynb")
    assert "crimp-friction" not in library()


def test_the_page_of_all_files_is_that_of_the_files():
    assert files_page.PAGE.read_text("utf-8") == files_page.text(), "write it anew: python -m tests.files_page"


def test_the_example_of_a_study_is_valid(tmp_path):
    first, *_ = (block.text for block in blocks(ROOT / "docs" / "study-file.md") if block.language == "yaml")
    (tmp_path / "study.yaml").write_text(first)
    assert read_study(tmp_path / "study.yaml").name == "demo"


def _source(path: Path) -> str:
    return "\n".join("".join(cell["source"]) for cell in json.loads(path.read_text("utf-8"))["cells"])


@pytest.mark.parametrize("path", sorted((ROOT / "docs" / "tutorials").glob("*.ipynb")), ids=lambda path: path.stem)
def test_notebooks_are_kept_without_outputs(path):
    for cell in json.loads(path.read_text("utf-8"))["cells"]:
        assert not cell.get("outputs") and cell.get("execution_count") is None, f"{path.name}: strip its outputs"
