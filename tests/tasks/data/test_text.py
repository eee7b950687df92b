"""Text files: what is refused unread, encodings, lines, cells and numbers."""

import math
import os
import threading
from contextlib import suppress
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sinew.runner.errors import BadInput
from sinew.tasks.data.sheets import is_sheet
from sinew.tasks.data.text import (
    HUGE,
    cells,
    check_text,
    days_after,
    is_blank,
    is_clock,
    is_number,
    milliseconds_unpadded,
    number,
    read_lines,
    records,
    seconds_of,
)
from tests.effort import at_most


def written(folder: Path, content: bytes, name: str = "test.csv") -> Path:
    path = folder / name
    path.write_bytes(content)
    return path


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "cp1252", "utf-16"])
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_lines_in_every_encoding(tmp_path, encoding, end):
    path = written(tmp_path, end.join(["Prüfzeit [µs]", "", "1,2", ",,", ""]).encode(encoding))
    assert read_lines(path) == ["Prüfzeit [µs]", "", "1,2"]


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "empty"),
        (b"\n ;\n", "holds no text"),
        (b"\0\1\2" * 50, "not a text file"),
        (b"\xff\xfe\0", "not valid UTF-16 text"),
        (b"Time \x81", "neither UTF-8 nor Windows text"),
        (b"a\n" + b"a" * 200_000, "row 2: a line of 200,000 characters"),
        (b"a" * 5000 + b"\n\0b", "row 2: not text"),
    ],
)
def test_what_is_no_text_is_refused(tmp_path, content, words):
    with pytest.raises(BadInput, match="test") as refused:
        read_lines(written(tmp_path, content))
    assert words in str(refused.value)


def test_pickled_files_are_refused_unread(tmp_path):
    with pytest.raises(BadInput, match="never read"):
        read_lines(tmp_path / "test.npy")


@pytest.mark.parametrize(
    ("line", "separator", "expected"),
    [
        ('"b,c",d', ",", ["b,c", "d"]),
        (" 1 \t2  3", " ", ["1", "2", "3"]),
        ("1;;3", ";", ["1", "", "3"]),
        ("", ",", []),
        ("a" * 140_000, ",", ["a" * 140_000]),  # csv refuses such a field
    ],
)
def test_cells(line, separator, expected):
    assert cells(line, separator) == expected


def test_a_quoted_cell_may_hold_line_breaks():
    lines = ['"Time', '(s)","Load', '(N)"', "1,2", 'width 5"', 'a,"open', "1", "2", "3", "4", "5"]
    found = records(lines)
    assert found[0] == (1, '"Time\n(s)","Load\n(N)"')
    assert [at for at, _ in found] == [1, 4, 5, 6, 7, 8, 9, 10, 11], "an open quote does not swallow the file"
    assert cells(found[0][1], ",") == ["Time\n(s)", "Load\n(N)"]


@settings(deadline=None)
@given(st.floats(-1e99, 1e99), st.sampled_from(".,"))
def test_every_float_is_a_number(value, decimal):
    assert number(repr(value).replace(".", decimal), decimal) == value


@pytest.mark.parametrize(
    "cell", ["", "nan", "inf", "1e999", "1_0", "1 2", "1.2.3", "1,234", "12,34.5", "0x10", "--1", "1e100"]
)
def test_what_is_no_finite_number(cell):
    assert number(cell, ".") is None


@pytest.mark.parametrize(("cell", "decimal"), [("1,5", "."), ("1.5", ","), ("1,", "."), (".5", ",")])
def test_a_decimal_mark_is_not_the_other_one(cell, decimal):
    assert not is_number(cell, decimal)
    assert is_number(cell, "," if decimal == "." else ".")


@settings(deadline=None)
@given(st.text(max_size=12), st.sampled_from(".,"))
def test_a_number_is_finite_and_has_one_decimal_mark(cell, decimal):
    value = number(cell, decimal)
    assert value is None or (math.isfinite(value) and abs(value) < HUGE)
    assert value is None or is_number(cell, decimal)
    assert not (is_number(cell, decimal) and ("," if decimal == "." else ".") in cell)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", ": empty; expected a header and numbers"),
        (b"\n ;\n", ": holds no text; expected a header and numbers"),
        (b"\0\1\2" * 50, ": not a text file; expected text in UTF-8"),
        (b"\xff\xfe\0", ": not valid UTF-16 text; expected a text export"),
        (b"Time \x81", ": neither UTF-8 nor Windows text; expected a text export"),
        (b"a\n" + b"a" * 100_001, ": row 2: a line of 100,001 characters; expected a table, row by row"),
        (b"a" * 5000 + b"\n\0b", ": row 2: not text; expected a text export"),
    ],
)
def test_why_a_file_is_no_text_is_said(tmp_path, content, words):
    path = written(tmp_path, content)
    with pytest.raises(BadInput) as refused:
        read_lines(path)
    assert str(refused.value) == f"{path}{words}"


@pytest.mark.parametrize("encoding", ["utf-16-le", "utf-16-be"])
@pytest.mark.parametrize("text", ["Time,Force\r\n0.5,1.5\r\n", "时间,力\n0.5,1.5\n1.5,2.5\n"])
def test_text_in_utf_16_needs_no_mark(tmp_path, text, encoding):
    path = tmp_path / "test.csv"
    path.write_bytes(text.encode(encoding))
    assert read_lines(path) == text.split()
    path.write_bytes(text.encode(encoding) + b"a")
    with pytest.raises(BadInput, match="not valid UTF-16 text"):
        read_lines(path)
    path.write_bytes(f"{text}\ud800,1\n".encode(encoding, "surrogatepass"))
    with pytest.raises(BadInput, match="not valid UTF-16 text"):
        read_lines(path)


@pytest.mark.parametrize("content", [b"\0\1\2", b"\1\0\2\0\3\0" * 100, b"a\0b\0\x1f\0" * 100])
def test_numbers_of_two_bytes_are_no_text(tmp_path, content):
    path = tmp_path / "test.csv"
    path.write_bytes(content)
    with pytest.raises(BadInput, match="not a text file"):
        read_lines(path)


def test_zeros_that_fill_up_are_nothing_and_others_are_refused(tmp_path):
    path = tmp_path / "test.csv"
    path.write_bytes(b"Time\0\0,Force\0\n0,1\0\0 \r\n1,2\n" + b"\0" * 5000)
    assert read_lines(path) == ["Time,Force", "0,1 ", "1,2"]
    for content in (b"Time,Force\n0,\0\0" + b"1\n", b"\0\0Time,Force\n0,1\n"):
        path.write_bytes(content)
        with pytest.raises(BadInput, match="not a text file"):
            read_lines(path)
    path.write_bytes(b"Time,Force\n" + b"0,1\n" * 2000 + b"\0" * 2_000_000 + b"x")
    with pytest.raises(BadInput, match="row 2002: a line of 2,000,001 characters"):  # and at once
        read_lines(path)


def test_why_a_file_is_not_read_is_said(tmp_path, monkeypatch):
    def said(path: Path, max_bytes: int = 2 * 2**20) -> str:
        with pytest.raises(BadInput) as refused:
            check_text(path, max_bytes)
        return str(refused.value).removeprefix(f"{path}: ")

    assert said(tmp_path / "x.PKL") == "pickled and binary data are never read; expected a CSV file"
    assert said(tmp_path / "x.csv") == "no such file or directory; expected a file"
    assert said(tmp_path) == "not a regular file; expected a text file"
    large = written(tmp_path, b"a" * (2 * 2**20 + 1))
    assert said(large) == "2 MB; expected at most 2 MB"
    check_text(large, 2 * 2**20 + 1)
    assert said(written(tmp_path, "a".encode("utf-16"))) == "not a text file; expected text in UTF-8"
    check_text(tmp_path / "test.csv", 100, export=True)
    check_text(written(tmp_path, b"a" * 4096 + b"\0"), 10_000)
    assert said(written(tmp_path, b"a" * 4095 + b"\0"), 10_000) == "not a text file; expected text in UTF-8"

    def fails(*_args, **_kwargs):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("builtins.open", fails)
    assert said(tmp_path / "test.csv") == "permission denied; expected a readable file"


def test_the_longest_line_is_read(tmp_path):
    assert read_lines(written(tmp_path, b"a" * 100_000)) == ["a" * 100_000]


def test_a_quoted_cell_has_five_lines_at_most():
    five = ['"a', "b", "c", "d", 'e"', "1"]
    assert records(five) == [(1, '"a\nb\nc\nd\ne"'), (6, "1")]
    six = ['"a', "b", "c", "d", "e", 'f"', "1"]
    assert len(records(six)) == 7


def test_a_line_of_separators_is_blank():
    assert is_blank(" \t,;| ")
    assert is_blank("")
    assert not is_blank(" 1 ")
    assert not is_blank("X")


@pytest.mark.parametrize(("cell", "decimal", "value"), [("1e99", ".", 1e99), ("-1e99", ".", -1e99), ("1,5", ",", 1.5)])
def test_numbers_up_to_the_limit(cell, decimal, value):
    assert number(cell, decimal) == value
    assert number("-1e100", decimal) is None


def test_a_number_of_hundreds_of_digits_is_none():
    assert number("1." + "0" * 397, ".") == 1.0
    assert number("1." + "0" * 398, ".") is None


@pytest.mark.parametrize(("cell", "decimal"), [("1,367.91", "."), ("1.367,91", ","), ("1,001,367.91", ".")])
def test_thousands_may_be_marked(cell, decimal):
    assert number(cell, decimal) == float(cell.replace("," if decimal == "." else ".", "").replace(",", "."))
    assert number(cell, "," if decimal == "." else ".") is None


def test_no_break_spaces_that_mark_thousands_go_away():
    assert cells("0,1;1\u00a0000,35;-12\u202f345\u202f678,5;a\u00a0123;12\u00a0345a;1\u00a00000", ";") == [
        "0,1", "1000,35", "-12345678,5", "a\u00a0123", "12\u00a0345a", "1\u00a00000",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("encoding", "words"),
    [
        ("cp1252", "Prüfzeit,Standardweg,Kraft"),
        ("cp1252", "Index,Force [ kN ],Déplacement [ mm ]"),
        ("cp1252", "Section,7.335,mm²"),
        ("cp1250", "Godzina;Przemieszczenie;Obciążenie"),
        ("gb18030", "时间,位移,力"),
        ("big5", "時間,位移,載荷"),
        ("shift_jis", "時間,ストローク,試験力"),
        ("cp1251", "Время;Перемещение;Нагрузка"),
        ("koi8_r", "Время;Перемещение;Нагрузка"),
        ("cp1253", "Χρόνος;Μετατόπιση;Δύναμη"),
        ("cp1254", "Zaman;Uzama;Çekme gerilmesi (MPa);Yük;Geçen süre"),
        ("euc_kr", "시간,변위,하중"),
    ],
)
def test_the_encoding_is_that_in_which_words_of_exports_stand(tmp_path, encoding, words):
    path = tmp_path / "export.csv"
    path.write_bytes(f"{words}\n0,0,0\n".encode(encoding))
    assert read_lines(path)[0] == words


@pytest.mark.parametrize(
    ("cell", "seconds"),
    [("00:00:01", 1.0), ("1:02:03.5", 3723.5), ("1:02:03,5", 3723.5), ("02:03.5", 123.5), ("120:00,25", 7200.25),
     ("2024-05-03T00:00:01.5", 1.5), ("3/5/2024 00:01:00", 60.0)],
)  # fmt: skip
def test_clock_times_are_numbers_of_seconds_with_any_decimal_mark(cell, seconds):
    for decimal in ".,":
        assert is_number(cell, decimal)
        assert number(cell, decimal) == pytest.approx(seconds)


@pytest.mark.parametrize(
    "cell", ["10:22", "1:2:3", "10:60:00", "10:00:60", "10:22:33 xm", "-0:00:01", ":", "2024-05-03"]
)
def test_what_is_not_surely_a_clock_time_is_no_number(cell):
    assert not is_clock(cell)
    assert number(cell, ".") is None


@pytest.mark.parametrize(
    ("clocks", "unpadded"),
    [
        (["1:12:57.855", "1:12:58.29", "1:12:58.203", "1:12:59.8"], True),
        (["1:12:57,855", "1:12:58,29", "1:12:58,203"], True),
        (["02:57.855", "02:58.29", "02:58.203"], True),
        (["1:12:57.8", "1:12:58.2", "1:12:58.25", "1:12:58.299"], False),  # they go on as they stand
        (["1:12:57.855", "1:12:58.029", "1:12:58.003"], False),  # they go back
        (["1:12:58.9", "1:12:58.2"], False),  # tenths that go back
        (["1:12:58.203", "1:12:58.29", "1:12:58.2031"], False),  # finer than milliseconds
        (["1:12:57.8551", "1:12:58.29", "1:12:58.203"], False),
        (["1:12:58.203", "1:12:58.29", "1:12:57.100"], False),  # they go back in either way
        (["1:12:57", "1:12:58"], False),
    ],
)
def test_milliseconds_without_leading_zeros(clocks, unpadded):
    assert milliseconds_unpadded(clocks) is unpadded


def test_a_clock_by_milliseconds():
    assert seconds_of("1:00:58.29", milliseconds=True) == pytest.approx(3658.029)
    assert seconds_of("1:00:58", milliseconds=True) == 3658.0
    assert seconds_of("1:00:58.29") == pytest.approx(3658.29)


@pytest.mark.parametrize("row", ["1\n", "1\r\n", "1,,,,\n", "1\t\t\t\t\n", "1||||\n", "1  2 3 4   5\n"])
def test_rows_and_cells_without_end_are_refused_before_they_are_split(tmp_path, monkeypatch, row):
    monkeypatch.setattr("sinew.tasks.data.text.MAX_LINES", 1000)
    monkeypatch.setattr("sinew.tasks.data.text.MAX_CELLS", 2000)
    path = tmp_path / "long.txt"
    path.write_text(row * 400, newline="")
    assert len(read_lines(path)) == 400
    path.write_text(row * 2001, newline="")
    with pytest.raises(BadInput, match="too many rows or columns; expected at most 1,000 rows and 2,000 cells"):
        read_lines(path)


def test_ends_of_lines_are_read_once(tmp_path):
    """A pattern that begins anew at each of them took minutes for such a file."""
    path = tmp_path / "ends.txt"
    path.write_bytes(b"a" + b"\r" * 400_000 + b"b\r\r\nc\rd")
    with at_most(10):  # it took 100 s
        lines = read_lines(path)
    assert (len(lines), lines[0], lines[-3:]) == (400_003, "a", ["b", "c", "d"])


@pytest.mark.parametrize(
    ("cell", "seconds"),
    [
        ("10:22:33 AM", 37353.0), ("1:04:08 PM", 47048.0), ("12:00:01 am", 1.0),
        ("00:15:30 AM", 930.0), ("13:04:08 PM", 47048.0), ("12:00:01 p.m.", 43201.0),
        ("2024/05/03 10:22:33.5", 37353.5), ("2024-05-03T10:22:33Z", 37353.0), ("2024-05-03T10:22:33.5+02:00", 30153.5),
        ("2024-05-03T10:22:33-0330", 49953.0),
    ],
)  # fmt: skip
def test_clock_times_as_other_programs_write_them(cell, seconds):
    assert is_clock(cell)
    assert seconds_of(cell) == seconds


def test_days_count_between_dates_with_slashes():
    assert days_after("2024/05/03 23:59:59", "2024/05/04 00:00:01") == 1
    assert days_after("2024-05-03T23:59:59Z", "2024-05-05T00:00:01Z") == 2
    assert days_after("2024-05-03 10:00:00", "10:00:01") is None


@pytest.mark.parametrize(
    "cell", ["2024/05-03 10:22:33", "10:22:33 XM", "13:00:05 AM", "0:00:05 pm", "10:61:33", "10:22:33 AM PM"]
)
def test_what_is_no_clock_time(cell):
    assert not is_clock(cell)


def test_a_binary_file_of_labview_is_told(tmp_path):
    with pytest.raises(BadInput, match=r"a TDMS file of LabVIEW; expected the same saved as text \(\.lvm\) or as a "):
        read_lines(written(tmp_path, b"TDSm\x0e\0\0\0i\x12", "test.tdms"))


def test_letters_that_take_more_memory_leave_room_for_fewer_cells(tmp_path, monkeypatch):
    monkeypatch.setattr("sinew.tasks.data.text.FOREIGN_CELLS", 100)
    path = tmp_path / "many.csv"
    path.write_text("\u00e9,1,2\n" * 100, "utf-8")
    assert len(read_lines(path)) == 100
    path.write_text("\u0436,1,2\n" * 40, "utf-8")
    assert len(read_lines(path)) == 40
    path.write_text("\u0436,1,2\n" * 100, "utf-8")
    with pytest.raises(BadInput, match="cells, with letters beyond Latin-1; expected at most 100 with such letters"):
        read_lines(path)


@pytest.mark.parametrize("name", ["test.csv", "test.xls"])
def test_a_file_that_becomes_a_pipe_is_not_waited_for(tmp_path, monkeypatch, name):
    path = tmp_path / name
    os.mkfifo(path)
    monkeypatch.setattr(Path, "is_file", lambda self: True)  # it was one when it was looked at
    monkeypatch.setattr(os, "stat", lambda path, **options: os.lstat(__file__))

    def write() -> None:
        with suppress(OSError), open(os.open(path, os.O_WRONLY | os.O_NONBLOCK), "w") as file:
            file.write("1,2,3\n")  # for whoever still waits

    writer = threading.Timer(10.0, write)
    writer.start()
    assert is_sheet(path) is (name == "test.xls")
    with pytest.raises(BadInput, match="pipe"):
        check_text(path, 2**20)
    writer.cancel()
