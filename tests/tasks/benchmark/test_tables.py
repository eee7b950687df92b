"""Tables of a benchmark: what they hold comes from files of others."""

from io import StringIO

from sinew.runner.console import Console
from sinew.tasks.benchmark.tables import as_markdown, printed

HOSTILE = "<img src=x onerror=alert(1)> | x\n# a heading [a](javascript:b)"


def test_no_text_becomes_an_element_a_link_or_a_heading():
    text = as_markdown([("Cases", ["case"], [[HOSTILE], ["# b"]])], [f"cohort 1: {HOSTILE}", "# c"])
    assert text == (
        "cohort 1: &lt;img src=x onerror=alert(1)> | x\\n# a heading [a]\\(javascript:b)\n\n\\# c\n\n"
        "**Cases**\n\n| case |\n| --- |\n"
        "| &lt;img src=x onerror=alert(1)> \\| x\\n# a heading [a]\\(javascript:b) |\n| \\# b |\n"
    )


def test_a_line_stays_one_line():
    said = StringIO()
    printed([], [HOSTILE], Console(file=said, width=200))
    assert said.getvalue() == HOSTILE.replace("\n", "\\n") + "\n"
