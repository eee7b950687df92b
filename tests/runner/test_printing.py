"""What the files of others hold does not steer the terminal."""

import io

import pytest
from rich.progress import Progress, TextColumn
from rich.style import Style
from rich.table import Table
from rich.text import Text

from sinew.runner.console import Console
from sinew.runner.printing import printable, put

EVIL = "\x1b]0;title\x07\x1b[2J\x9b31m\r\u202e"


def test_lines_are_printed_without_control_characters(capsys):
    put(f"a{EVIL}\tb\nc")
    put(f"d{EVIL}", error=True)
    out, err = capsys.readouterr()
    assert out == "a\\x1b]0;title\\x07\\x1b[2J\\x9b31m\\r\\u202e\tb\nc\n"
    assert err == "d\\x1b]0;title\\x07\\x1b[2J\\x9b31m\\r\\u202e\n"


def test_printable_text_stays():
    for text in ("", "µ ± é", "a\nb\n", "1\t2"):
        assert printable(text) == text


@pytest.mark.parametrize("terminal", [True, False])
def test_tables_and_bars_are_shown_without_control_characters(terminal):
    file = io.StringIO()
    console = Console(file=file, force_terminal=terminal, width=200, color_system="standard" if terminal else None)
    grid = Table(EVIL, title=f"{EVIL}")
    grid.add_row(EVIL)
    grid.add_row(Text(EVIL, "bold"))
    console.print(grid)
    console.print(f"words {EVIL}", markup=False)
    with Progress(TextColumn("{task.description}"), console=console, auto_refresh=False) as bars:
        bars.add_task(EVIL)
    shown = file.getvalue()
    assert "\\x1b]0;title" in shown
    for evil in ("\x1b]", "\x07", "\x1b[2J", "\x9b", "\u202e"):
        assert evil not in shown, repr(evil)
    assert ("\x1b[1m" in shown) == terminal, "bold is Rich's own"


@pytest.mark.parametrize("terminal", [True, False])
def test_markup_in_names_is_text_and_nothing_is_a_link(terminal):
    """The address of a link would reach the terminal as it is, with whatever is in it."""
    file = io.StringIO()
    console = Console(file=file, force_terminal=terminal, width=200, color_system="standard" if terminal else None)
    evil = "[link=x\x1b\\\x1bc][conceal]E_f[/conceal][/link] :skull:"
    grid = Table(evil, title=evil)
    grid.add_row(evil)
    console.print(grid)
    console.print(evil)
    console.print(Text("here", Style(link="x\x1bc")), Text("there", "link file:///etc"))
    assert "[link=x\\x1b\\\\x1bc][conceal]E_f[/conceal][/link] :skull:" in file.getvalue()
    for gone in ("\x1bc", "\x1b]", "file:"):
        assert gone not in file.getvalue(), repr(gone)
