"""LabVIEW measurement files: each segment tells its units and times, and none of its keys is a number of a test."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sinew.runner.errors import BadInput
from sinew.tasks.data.hints import Hints
from sinew.tasks.data.recordings import Recording, read_recordings

FILE_HEADER = """\
LabVIEW Measurement\t
Writer_Version\t2
Reader_Version\t2
Separator\t{separator}
Decimal_Separator\t{decimal}
Multi_Headings\tYes
X_Columns\t{times}
Time_Pref\tRelative
Description\tGauge length 20 mm, force 20 N per volt
Date\t2026/05/11
Time\t14:32:07.5
***End_of_Header***
\t
"""
SEGMENT_HEADER = """\
Channels\t2\t\t
Samples\t{count}\t{count}\t
Date\t2026/05/11\t2026/05/11\t
Time\t14:32:{second:04.1f}\t14:32:{second:04.1f}\t
Y_Unit_Label\t{units[0]}\t{units[1]}\t
X_Dimension\tTime\tTime\t
X0\t0.0000000000000000E+0\t0.0000000000000000E+0\t
Delta_X\t0.050000\t{step}\t
***End_of_Header***
"""
ROWS = [(0.05 * row, 0.1 * row, 0.01 * row) for row in range(12)]  # s, force, displacement


def segment(rows, *, times="One", units=("N", "mm"), second=7.5, step="0.050000") -> str:
    head = SEGMENT_HEADER.format(count=len(rows), units=units, second=second, step=step)
    if times == "Multi":
        head += "X_Value\tForce\tX_Value\tWay\tComment\n"
        return head + "".join(f"{t:.6f}\t{f:.6f}\t{t:.6f}\t{d:.6f}\t\n" for t, f, d in rows)
    head += "X_Value\tForce\tDisplacement\tComment\n"
    return head + "".join(f"{'' if times == 'No' else f'{t:.6f}'}\t{f:.6f}\t{d:.6f}\t\n" for t, f, d in rows)


def file(folder: Path, *segments: str, times="One", separator="\t", decimal=".") -> Path:
    named = {"\t": "Tab", ",": "Comma", ";": "Semicolon"}[separator]
    text = FILE_HEADER.format(separator="{separator}", decimal="{decimal}", times=times) + "\n".join(segments)
    text = text.replace(".", decimal) if decimal != "." else text
    text = text.replace("\t", separator).format(separator=named, decimal=decimal)
    path = folder / "test.lvm"
    path.write_text(text)
    return path


def read(path: Path, **hints) -> Recording:
    (found,) = read_recordings(path, Hints(**hints))
    return found


@pytest.mark.parametrize("times", ["One", "No", "Multi"])
@pytest.mark.parametrize(("separator", "decimal"), [("\t", "."), ("\t", ","), (";", ","), (",", ".")])
def test_times_and_units_are_those_of_the_file(tmp_path, times, separator, decimal):
    titles = {"displacement_column": "Way (mm)"} if times == "Multi" else {}
    path = file(tmp_path, segment(ROWS, times=times), times=times, separator=separator, decimal=decimal)
    found = read(path, **titles)
    np.testing.assert_allclose(found.numbers, [(t, d, f) for t, f, d in ROWS], rtol=1e-9)
    assert [column.unit for column in found.columns] == ["s", "mm", "N"]
    path = file(tmp_path, segment(ROWS, times=times, units=("kgf", "cm")), times=times)
    found = read(path, **({"displacement_column": "Way (cm)"} if times == "Multi" else {}))
    np.testing.assert_allclose(found.numbers[:, 1:], [(10 * d, 9.80665 * f) for _, f, d in ROWS], rtol=1e-9)


@pytest.mark.parametrize("times", ["One", "No"])
def test_segments_are_one_test_and_their_keys_are_no_numbers(tmp_path, times):
    second = [(t + 0.6, f + 2.0, d + 0.12) for t, f, d in ROWS]
    path = file(tmp_path, segment(ROWS, times=times), segment(second, times=times, second=8.1), times=times)
    found = read(path)
    np.testing.assert_allclose(found.numbers, [(t, d, f) for t, f, d in (*ROWS, *second)], rtol=1e-6, atol=1e-9)


def test_units_that_a_person_gives_do_not_replace_those_of_the_file(tmp_path):
    with pytest.raises(BadInput, match="unit 'kgf', but --force-unit says N"):
        read(file(tmp_path, segment(ROWS, units=("kgf", "mm"))), force_unit="N")
    with pytest.raises(BadInput, match="unit 'Volt' is that of a sensor's signal, no force"):
        read(file(tmp_path, segment(ROWS, units=("Volt", "mm"))), force_unit="N")
    with pytest.raises(BadInput, match="no unit of the force"):
        read(file(tmp_path, segment(ROWS, units=("", "mm"))))


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("***End_of_Header***\n\t\n", "\t\n", "row 22: 'X_Value' behind an empty line; expected a segment"),
        ("Separator\tTab", "Separator\tPipe", "'Separator Pipe, .*'; expected a LabVIEW measurement file with"),
        ("X_Columns\tNo", "X_Columns\tAll", "X_Columns All"),
        ("Delta_X\t0.050000\t0.050000", "Delta_X\t0.050000\t0.1", "Delta_X 0.050000, 0.1 and no column of times"),
        ("Delta_X\t0.050000\t0.050000\t\n", "", "Delta_X missing and no column of times"),
    ],
)
def test_files_that_make_no_sense_are_refused_in_one_line(tmp_path, old, new, words):
    path = file(tmp_path, segment(ROWS, times="No"), times="No")
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(BadInput, match=words):
        read(path)


@given(cut=st.integers(0, 1000), length=st.integers(0, 40), odd=st.text(max_size=6))
def test_any_damage_is_read_or_refused_in_one_line(tmp_path_factory, cut, length, odd):
    folder = tmp_path_factory.mktemp("damaged")
    path = file(folder, segment(ROWS, times="No"), times="No")
    text = path.read_text()
    path.write_text(text[:cut] + odd + text[cut + length :], "utf-8", "replace")
    try:
        read_recordings(path, Hints())
    except BadInput as refused:
        assert "\n" not in str(refused)
