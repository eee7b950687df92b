"""An error is one printable line that is not too long."""

import pytest

from sinew.runner.errors import LONGEST, WalltimeReached, brief, shown


def test_a_long_error_keeps_its_beginning_and_its_end():
    line = brief("study.yaml: name: " + 10**6 * "x\n" + "; expected a name")
    assert len(line) == LONGEST
    assert line.startswith("study.yaml: name: x\\nx\\n")
    assert line.endswith("\\n; expected a name")
    assert " ... " in line


def test_a_short_error_stays():
    assert brief("a: b; expected c") == "a: b; expected c"
    assert brief("x" * LONGEST) == "x" * LONGEST
    assert len(brief("\x00" * LONGEST)) == LONGEST
    assert brief("x" * 2 * LONGEST).count(" ... ") == 1


def test_lists_in_lists_without_end_are_shown_in_words():
    value: list[object] = []
    for _ in range(100_000):
        value = [value]
    assert shown(value) == "lists in lists without end"
    while value:  # else Python would call itself as often to remove them
        (value,) = value  # type: ignore[assignment]


def test_an_alarm_that_comes_again_knows_what_the_first_one_knew():
    """It may come while the cluster is closed, on a busy machine, and would blame workers that came late."""
    for worked in (False, True):
        with pytest.raises(WalltimeReached) as reached:
            try:
                raise WalltimeReached("of the run", worked=worked)
            except WalltimeReached:
                try:
                    raise OSError("a worker is gone")
                except OSError:
                    raise WalltimeReached("of the alarm") from None
        assert str(reached.value) == "of the alarm"
        assert reached.value.worked == worked
    assert WalltimeReached("of the alarm").worked
