"""What the files of others hold does not steer the terminal."""

import io

import pytest
from rich.progress import Progress, TextColumn
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
