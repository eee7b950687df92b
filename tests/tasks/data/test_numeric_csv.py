"""CSV files of numbers are read strictly: what is wrong is named with its row and column."""

import numpy as np
import pytest

from sinew.runner.errors import BadInput
from sinew.tasks.data import numeric_csv
from sinew.tasks.data.numeric_csv import LONGEST_HEADER, read_header, read_numbers


def written(folder, content):
    path = folder / "numbers.csv"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


@pytest.mark.parametrize(
    "content",
    [
        "a,b\n1,2\n3,4.5\n",
        "a,b\r\n1,2\r\n3,4.5\r\n\r\n\r\n",
        " a , b\n 1, 2\n3, 4.5",
        "\ufeffa,b\n1,2\n3,4.5\n",
        'a,b\n"1",2\n3,4.5\n',
        "a,b\n1,2\n3,4.5\n , \n",
    ],
)
def test_numbers_below_their_header(tmp_path, content):
    path = written(tmp_path, content)
    assert read_numbers(path, ["a", "b"]).tolist() == [[1.0, 2.0], [3.0, 4.5]]
    assert read_numbers(path, None).tolist() == [[1.0, 2.0], [3.0, 4.5]]
    assert read_header(path) == ["a", "b"]


def test_a_long_header_is_read_whole(tmp_path):
    names = [f"{'a' * 90}_{number:04d}" for number in range(1003)]
    path = written(tmp_path, f"{','.join(names)}\n{','.join('1' * len(names))}\n")
    assert read_header(path) == names
    assert read_numbers(path, names).shape == (1, 1003)
    with pytest.raises(BadInput, match=r"numbers\.csv: row 1: more than 120,000 characters"):
        read_numbers(written(tmp_path, "a" * 120_001 + "\n1\n"), None)


@pytest.mark.parametrize(
    ("content", "where", "words"),
    [
        ("b,a\n1,2\n", ": row 1", "header 'b,a'; expected a,b"),
        ("a,b\n", "", "holds a header but no numbers; expected rows of numbers below the header"),
        ("a,b\n1,2\n1,x\n", ": row 3, b", "'x'; expected a finite number such as 1.25"),
        ("a,b\n1, x \n", ": row 2, b", "'x'; expected a finite number such as 1.25"),
        ("a,b\n1,\n", ": row 2, b", "''; expected a finite number such as 1.25"),
        ("a,b\nNA,1\n", ": row 2, a", "'NA'; expected a finite number such as 1.25"),
        ("a,b\nnan,1\n", ": row 2, a", "'nan'; expected a finite number such as 1.25"),
        ("a,b\n1,2\ninf,1\n", ": row 3, a", "'inf'; expected a finite number such as 1.25"),
        ("a,b\n1_0,1\n", ": row 2, a", "'1_0'; expected a finite number such as 1.25"),
        ("a,b\n1,2,3\n", ": row 2", "3 cells; expected 2, as in the header"),
        ("a,b\n1,2\n1\n", ": row 3", "1 cells; expected 2, as in the header"),
        ("a,b\n1,2\n\n1,2\n", ": row 3", "a blank row between rows of numbers; expected numbers"),
        ("a,b\n1,2\n , \n\n1,2\n", ": row 3", "a blank row between rows of numbers; expected numbers"),
        (b"a,b\n1,\xff\n", ": row 2, b", "'\ufffd'; expected a finite number such as 1.25"),
        ("", "", "empty; expected a header and numbers"),
    ],
)
def test_what_is_wrong_is_named(tmp_path, content, where, words):
    path = written(tmp_path, content)
    with pytest.raises(BadInput) as refused:
        read_numbers(path, ["a", "b"])
    assert str(refused.value) == f"{path}{where}: {words}"


@pytest.mark.parametrize(
    "content", ["a,b\n1,2\n3,4.5\n", " a , b\r\n 1, 2\r\n3, 4.5\r\n", "\ufeffa,b\n1,2\n3,4.5", 'a,b\n"1",2\n3,"4.5"\n']
)
def test_files_without_a_fault_are_read_at_once_and_not_row_by_row(tmp_path, monkeypatch, content):
    monkeypatch.setattr("sinew.tasks.data.numeric_csv._read_carefully", None)
    assert read_numbers(written(tmp_path, content), ["a", "b"]).tolist() == [[1.0, 2.0], [3.0, 4.5]]


@pytest.mark.parametrize("allowed", [True, False])
def test_a_row_is_as_long_as_allowed_or_refused(tmp_path, allowed):
    row = "1," + "2".rjust(LONGEST_HEADER - 3 + (not allowed))  # with the end of the line
    path = written(tmp_path, f"a,b\n{row}\n")
    if allowed:
        assert read_numbers(path, ["a", "b"]).tolist() == [[1.0, 2.0]]
        return
    with pytest.raises(BadInput, match="row 2: 120,001 characters; expected at most 120,000"):
        read_numbers(path, ["a", "b"])


@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_a_cell_that_never_ends_is_refused(tmp_path, end):
    path = written(tmp_path, f"a,b{end}1,2{end}1," + "1" * 200_000 + end)
    with pytest.raises(BadInput, match=r"numbers\.csv: row 3: 200,00. characters; expected at most 120,000"):
        read_numbers(path, ["a", "b"])


def test_a_quote_that_never_ends_is_no_csv(tmp_path):
    path = written(tmp_path, 'a,b\n1,"' + "1\n" * 100_000)
    with pytest.raises(BadInput) as refused:
        read_numbers(path, ["a", "b"])
    assert str(refused.value).startswith(f"{path}: not a CSV file (field larger than field limit")
    assert str(refused.value).endswith("; expected comma-separated numbers")


def test_a_file_has_at_most_as_many_bytes_as_asked(tmp_path):
    path = written(tmp_path, "a,b\n1,2\n")
    assert np.array_equal(read_numbers(path, None, max_bytes=8), [[1.0, 2.0]])
    with pytest.raises(BadInput, match="MB; expected at most"):
        read_numbers(path, None, max_bytes=7)


def test_rows_have_a_limit_before_they_take_memory(tmp_path, monkeypatch):
    path = written(tmp_path, "a,b\n" + "1,2\n" * 50)
    monkeypatch.setattr(numeric_csv, "MAX_ROWS", 50)
    with pytest.raises(
        BadInput, match=r"numbers\.csv: 51 rows; expected at most 50; every second or tenth row will do"
    ):
        read_numbers(path, ["a", "b"])


def test_short_rows_are_not_filled_up(tmp_path, monkeypatch):
    """pandas would make as many columns as the header has, in each of very many short rows."""
    names = ",".join(f"a{i}" for i in range(1000))
    path = written(tmp_path, f"a,b,{names}\n1{',1' * 1001}\n" + "2,1\n" * 20_000)
    monkeypatch.setattr(numeric_csv.pd, "read_csv", lambda *_, **__: pytest.fail("fills them up"))
    with pytest.raises(BadInput, match="row 3: 2 cells; expected 1002, as in the header"):
        read_numbers(path, None)


@pytest.mark.parametrize("rows", ["0,0,9\n1,5,9\n2,9", "0,0,9\r1,5\n2,2,9\r3,0\r", "0,0,9\n1,1\n\n2,1,2,3\n"])
def test_a_cell_that_is_missing_is_never_an_empty_one(tmp_path, rows):
    """What ends a row, or a longer row, must not make up for it: numbers would stand in other columns."""
    path = tmp_path / "numbers.csv"
    path.write_bytes(f"a,b,c\n{rows}".encode())
    with pytest.raises(BadInput, match=r"row [34]: (2 cells|a blank row)|row 3"):
        read_numbers(path, ["a", "b"], further=["c"])


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("last", ["", "\n"])
def test_rows_are_read_at_once_whatever_ends_them(tmp_path, monkeypatch, end, last):
    monkeypatch.setattr(numeric_csv, "_read_carefully", lambda *_: pytest.fail("was read row by row"))
    path = tmp_path / "numbers.csv"
    path.write_bytes(f"a,b\n1,2\n3,4{last}".replace("\n", end).encode())
    assert read_numbers(path, ["a", "b"]).tolist() == [[1, 2], [3, 4]]


def test_a_quoted_cell_makes_no_wider_table(tmp_path):
    """pandas would go on with the row behind the quotation mark."""
    path = written(tmp_path, 'a,b\n1, "2\n1",1,1,1\n')
    with pytest.raises(BadInput, match=r"row [23]"):
        read_numbers(path, ["a", "b"])


@pytest.mark.parametrize("word", ["True", "FALSE", "true"])
@pytest.mark.parametrize("rows", [1, 3])
def test_words_that_pandas_takes_for_numbers_are_refused(tmp_path, word, rows):
    path = written(tmp_path, "a,b\n" + f"{word},1\n" * rows)
    with pytest.raises(BadInput, match=rf"row 2, a: '{word}'; expected a finite number such as 1\.25"):
        read_numbers(path, None)
