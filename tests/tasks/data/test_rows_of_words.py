"""Rows of words are left out or refused, and so is a last number that is cut off."""

import pytest

from sinew.runner.errors import BadInput
from sinew.tasks.data.hints import Hints
from sinew.tasks.data.recordings import read_recordings
from tests.tasks.data.one_test_file import FORCE, TIME, TITLES, WAY, read


def test_rows_of_words_are_left_out_with_a_remark(tmp_path):
    path = tmp_path / "test.csv"
    rows = [f"{t:.3f},{u:.4f},{f:.2f}" for t, u, f in zip(TIME, WAY, FORCE, strict=True)]
    lines = [TITLES, *rows[:20], "# Event: target reached, hold", *rows[20:]]
    path.write_text("\n".join(lines))
    (found,) = read_recordings(path, Hints())
    assert len(found.numbers) == 40
    assert found.notes == ("row 22 holds no number: '# Event: target reached hold'; left out",)
    path.write_text("\n".join([*lines, "", "Stop,Operator,"]))
    (found,) = read_recordings(path, Hints())
    assert len(found.numbers) == 40
    assert found.notes == ("2 rows hold no number, the first is row 22: '# Event: target reached hold'; left out",)
    path.write_text("\n".join([*lines[:20], "2.000,,", *lines[20:]]))
    with pytest.raises(BadInput, match=r"row 21, Extension .*an empty cell"):
        read_recordings(path, Hints())


def test_a_word_below_the_first_row_of_numbers_is_left_out_too(tmp_path):
    path = tmp_path / "test.csv"
    rows = [f"{t:.3f},{u:.4f},{f:.2f}" for t, u, f in zip(TIME, WAY, FORCE, strict=True)]
    for word in ("eoh", "eoh,,"):
        path.write_text("\n".join([TITLES, rows[0], word, *rows[1:]]))
        (found,) = read_recordings(path, Hints())
        assert (len(found.numbers), found.rows[0]) == (40, 2)
        assert found.notes == ("row 3 holds no number: 'eoh'; left out",)
    for words in ("eoh,eoh", "Specimen 2"):  # titles, or the name of another test
        path.write_text("\n".join([TITLES, rows[0], words, *rows[1:]]))
        with pytest.raises(BadInput, match=r"no column of time|may begin another test"):
            read_recordings(path, Hints())


def test_a_last_number_that_is_cut_off_is_left_out(tmp_path):
    path = tmp_path / "test.csv"
    read(tmp_path)
    whole = path.read_text()
    path.write_text(whole[:-3])
    (found,) = read_recordings(path, Hints())
    assert (len(found.numbers), found.notes) == (39, ("row 41 ends within a number, '50.', and is left out",))
    path.write_text(whole[:-1])
    (found,) = read_recordings(path, Hints())
    assert (len(found.numbers), found.notes) == (40, ())
    rows = [line.rstrip("0") for line in whole.splitlines()]
    path.write_text("\n".join(rows))
    assert len(read_recordings(path, Hints())[0].numbers) == 40, "numbers without zeros at their end"


LINES = [TITLES, *(f"{t:.3f},{u:.4f},{f:.2f}" for t, u, f in zip(TIME, WAY, FORCE, strict=True))]


def with_rows(folder, at, *rows, hints=None, lines=LINES, end="\n"):
    path = folder / "test.csv"
    path.write_text("\n".join([*lines[:at], *rows, *lines[at:]]) + end)
    return read_recordings(path, hints or Hints())


@pytest.mark.parametrize(
    ("rows", "problem"),
    [
        (["Force unit: kN"], "'Force unit: kN' below numbers"),
        (["Force scale factor: 1000"], "'Force scale factor: 1000' below numbers"),
        (["Width: 8 mm"], "'Width: 8 mm' below numbers"),
        (["# s,mm,kN"], "'s mm kN' below numbers"),
        (["Specimen B,,"], "'Specimen B' may begin another test"),
        (["NaN,NaN,NaN"], "'NaN'; expected a finite number"),
        (["OVERLOAD,OVERLOAD,OVERLOAD"], "'OVERLOAD'; expected a finite number"),
        (["2.0 s,1.0 mm,6.2 N"], "'2.0 s'; expected a finite number"),
        (["\u22120.5,\u22120.1,\u22120.2"], "expected a finite number"),
    ],
)
def test_words_that_change_what_numbers_mean_are_refused(tmp_path, rows, problem):
    with pytest.raises(BadInput, match=problem):
        with_rows(tmp_path, 21, *rows)


@pytest.mark.parametrize("words", ["Maximum", "Average,,"])
def test_few_numbers_behind_words_are_no_measurements(tmp_path, words):
    with pytest.raises(BadInput, match="and behind it 1 row of numbers, which may be results"):
        with_rows(tmp_path, 41, words, "3.95,0.975,30.0")


def test_names_of_tests_in_a_column_are_no_words(tmp_path):
    lines = ["Specimen," + TITLES, *(f",{line}" for line in LINES[1:])]
    with pytest.raises(BadInput, match=r"row 23, Specimen: '' again, after another value"):
        with_rows(tmp_path, 21, "B,,,", lines=lines, hints=Hints(test_column="Specimen"))


@pytest.mark.parametrize("units", ["s,mm,N", "(s),(mm),(N)", "s,mm,kN"])
@pytest.mark.parametrize("before", [[], ["Pause,,"]])
def test_units_among_the_numbers_lose_none_without_a_word(tmp_path, units, before):
    """A machine may print its units again for each segment."""
    lines = ["Time,Extension,Force", "s,mm,N", *LINES[1:]]
    try:
        (found,) = with_rows(tmp_path, 22, *before, units, lines=lines)
    except BadInput:
        return
    assert before and "has other titles and is left out" in found.notes[0]


def test_a_last_row_that_ends_its_line_is_whole(tmp_path):
    lines = [TITLES, *(f"{t:.3f},{u:.4f},{f:.2f}" for t, u, f in zip(TIME, WAY, FORCE, strict=True))]
    lines[-1] = lines[-1].removesuffix(".00")
    for end, count in (("\n", 40), ("\r\n", 40), ("", 39)):
        (found,) = with_rows(tmp_path, 41, lines=lines, end=end)
        assert len(found.numbers) == count
