"""A file becomes the same recording whatever its separator, marks, titles, units and encoding; and that a curve."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from sinew.runner.errors import BadInput
from sinew.tasks.data.curves import Bar
from sinew.tasks.data.hints import Hints
from sinew.tasks.data.inspection import inspect
from sinew.tasks.data.questions import UnknownUnit
from sinew.tasks.data.recording import Recording
from sinew.tasks.data.recordings import read_recordings
from sinew.tasks.data.told import as_told

TIME_S = np.array([0.0, 0.5, 1.0, 1.5, 2.0])
MOTION = np.array([0.0, 0.125, 0.25, 0.25, 0.2])
LOAD = np.array([0.0, 5.5, 9.75, 8.5, 7.25])
PLAIN = "time_s,displacement_mm,force_N\n0,0,0\n1,0.1,5\n2,0.2,9\n"
BAR = Bar(10.0, 8.0, 4.0)
SECONDS = {"s": 1.0, "sec": 1.0, "ms": 1e-3, "min": 60.0}
MILLIMETRES = {"mm": 1.0, "um": 1e-3, "µm": 1e-3, "m": 1e3, "cm": 10.0}
NEWTONS = {"N": 1.0, "mN": 1e-3, "kN": 1e3, "kgf": 9.80665, "gf": 9.80665e-3}
many = settings(
    max_examples=100, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow]
)


def read(folder: Path, content: str | bytes, **hints: object) -> Recording:
    path = folder / "test.csv"
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    (found,) = read_recordings(path, Hints(**hints))
    return as_told(found, Hints(**hints))


@st.composite
def header(draw: st.DrawFn, separator: str) -> list[str]:
    lines = ["Test report", "Specimen properties : Length,10,mm", "", "Operator: me", '"Results Table 1",,,']
    return [line.replace(",", separator) for line in draw(st.lists(st.sampled_from(lines), max_size=3))]


@st.composite
def files(draw: st.DrawFn) -> bytes:
    """The same test in one of very many forms."""
    separator, decimal = draw(
        st.sampled_from([(",", "."), (";", ","), (";", "."), ("\t", "."), ("\t", ","), (" ", "."), ("|", ",")])
    )
    units = [draw(st.sampled_from(list(each))) for each in (SECONDS, MILLIMETRES, NEWTONS)]
    names = [draw(st.sampled_from(each)) for each in (
        ["Time", "time", "Zeit", "t", "Elapsed Time"],
        ["Displacement", "Extension", "disp", "Standardweg"],
        ["Force", "Load", "Kraft", "F"],
    )]  # fmt: skip
    form = draw(st.sampled_from(["{0} ({1})", "{0} [{1}]", "{0}_{1}", "{0}/{1}", '"{0}\n({1})"', "{1}", "({1})"]))
    if separator == " ":
        names = [name.replace("Elapsed Time", "Time") for name in names]
        form = draw(st.sampled_from(["{0}({1})", "{0}_{1}"]))
    factors = [SECONDS[units[0]], MILLIMETRES[units[1]], NEWTONS[units[2]]]
    columns = [
        [repr(float(value)).replace(".", decimal) for value in np.asarray(each) / factor]
        for each, factor in zip((TIME_S, MOTION, LOAD), factors, strict=True)
    ]
    below = "{0}" not in form
    titles = [name if below else form.format(name, unit) for name, unit in zip(names, units, strict=True)]
    table = [[title, form.format("", unit), *cells] for title, unit, cells in zip(titles, units, columns, strict=True)]
    if separator != " ":
        more = [[], ["Cycle", "", *"11111"], ["", "", *[""] * 5], ["Note", "", *"abcde"], ["SD", "(N)", *"12345"]]
        table += draw(st.lists(st.sampled_from(more[1:]), max_size=2))
    table = draw(st.permutations(table))
    rows = [separator.join(cells) for cells in zip(*table, strict=True)]
    lines = [*draw(header(separator)), rows[0], *(rows[1:2] if below else []), *rows[2:]]
    end = draw(st.sampled_from(["\n", "\r\n", "\r"]))
    text = end.join(lines) + draw(st.sampled_from(["", end, end * 3, end + separator * 3]))
    return text.encode(draw(st.sampled_from(["utf-8", "utf-8-sig", "cp1252", "utf-16"])))


@many
@given(files())
def test_the_same_numbers_come_out(tmp_path, content):
    found = read(tmp_path, content)
    np.testing.assert_allclose(found.numbers, np.stack([TIME_S, MOTION, LOAD], axis=1), rtol=1e-12)
    assert [column.quantity.name for column in found.columns] == ["time", "displacement", "force"]


@many
@given(
    st.binary(max_size=400)
    | st.text(max_size=400).map(str.encode)
    | st.text("0123456789.,;\t -+eE\nNaN", max_size=300).map(str.encode)
)
def test_whatever_a_file_holds_it_is_understood_or_refused_in_a_line(tmp_path, content):
    try:
        found = read(tmp_path, content)
    except BadInput as refused:
        assert "test.csv" in str(refused)
        assert str(refused).isprintable()
    else:
        assert np.isfinite(found.numbers).all()


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (PLAIN + "3,nan,9\n", "row 5, displacement_mm: 'nan'"),
        (PLAIN.replace("0,0,0", "0,NaN,0") + "3,0.3,9\n", "row 2, displacement_mm: 'NaN'; expected a finite number"),
        (PLAIN.replace("0.1", "0.1 mm") + "3,0.3,9\n4,0.3,9\n", "row 3, displacement_mm: '0.1 mm'; expected a finite"),
        (PLAIN.replace("1,0.1", "\n1,0.1") + "1,0.3,9\n", "row 3: an empty row among the numbers"),
        (PLAIN + "3,,9\n", "row 5, displacement_mm"),
        (PLAIN + "3,inf,9\n", "row 5, displacement_mm"),
        (PLAIN + "3,1e999,9\n", "row 5, displacement_mm"),
        (PLAIN + "3,0.1\n", "row 5, force_N: an empty cell"),
        (PLAIN + "\n2,0.3,9\n", "row 5"),
        (PLAIN.replace("2,0.2,9\n", ""), "2 rows of numbers; expected at least 3"),
        (PLAIN.replace("_N", "_kN").replace("9", "9e98"), "row 4, force_kN: 9e+101; expected a number below 1e100"),
        ("time_s;disp_mm;force_N\n0,5;1,5;2,5\n1,5;1,5;2,5\n2,5;1,5;2,5\n3,5;1.234;2,5\n", "row 5"),
        ("time_s,disp_mm,force_N\n0,5,1,5,2,5\n1,5,1,5,2,5\n2,5,1,5,2,5\n", "3 names above 6 columns"),
        ("time_s,disp_mm,\n0,5,1\n1,5,1\n2,5,1\n", "no column of force"),
    ],
)
def test_broken_files_are_refused_in_one_line(tmp_path, content, words):
    with pytest.raises(BadInput) as refused:
        read(tmp_path, content)
    assert words in str(refused.value)
    assert str(refused.value).isprintable()


def test_the_first_table_with_all_columns_counts(tmp_path):
    summary = (
        "Results Table 1,,,\n,Maximum (N),Rate,Time at break\n1,9,5,2\n2,8,5,2\n3,7,5,2\n,,,\nResults Table 2,,,\n"
    )
    found = read(tmp_path, summary + "1,Time,Displacement,Force\n,(s),(mm),(N)\n,0,0,0\n,1,0.1,5\n,2,0.2,9\n")
    assert found.numbers[:, 2].tolist() == [0, 5, 9]
    assert found.rows[0] == 10
    with pytest.raises(BadInput, match=r"row 5: no column of time, nor of .* among 'n, Maximum"):
        read(tmp_path, "Results\n\n\n\nn,Maximum (N),Rate\n1,9,5\n2,8,5\n3,7,5\n")


def test_tests_have_the_sizes_of_their_rows_in_a_table_of_results(tmp_path):
    path = tmp_path / "several.csv"
    results = "Results Table 1,,,\n,Length,Width,Force\n,(mm),(mm),(N)\n1,9.5,4,9\n2,9.75,4,8\n,,,\n"
    test = "{},Time,Displacement,Force\n,(s),(mm),(N)\n,0,0,0\n,1,0.1,5\n,2,0.2,9\n"
    path.write_text(results + test.format(1) + "\n" + test.format(2))
    found = read_recordings(path, Hints())
    assert [(one.test, one.sizes["length"].mm, one.sizes["width"].mm) for one in found] == [
        ("1", 9.5, 4),
        ("2", 9.75, 4),
    ]
    assert inspect(path).sizes["length"] == 9.5
    path.write_text("Gauge length: 7 mm\n" + results + test.format(1) + "\n" + test.format(2))
    assert [one.sizes["length"].mm for one in read_recordings(path, Hints())] == [9.5, 9.75], "their own go first"
    path.write_text(results.replace("2,9.75,4,", "2,9.5,4,").replace(",4,8\n", ",4,8\n3,9.5,3,7\n") + test.format(1) +
                    "\n" + test.format(2) + "\n" + test.format(3))  # fmt: skip
    assert [one.sizes["width"].mm for one in read_recordings(path, Hints())] == [4, 4, 3], "the third is another"
    assert inspect(path).sizes["area"] is None, "it has no thickness"
    path.write_text(path.read_text().replace("Force\n,(mm),(mm),(N)", "Thickness\n,(mm),(mm),(mm)"))
    assert inspect(path).sizes["area"] == 36


def test_what_is_left_out_is_told(tmp_path):
    found = read(tmp_path, "time_s,strain (%),SD,force_N,disp_mm\n0,1,1,0,0\n1,1,1,5,1\n2,1,1,9,2\n")
    assert found.left_out == ("strain (%)", "SD")
    assert found.spreads == ("SD",)


def test_sizes_come_from_the_lines_above_the_table(tmp_path):
    found = read(tmp_path, "Length,12,mm\nWidth: 5.1 mm\n" + PLAIN)
    assert {name: size.mm for name, size in found.sizes.items()} == {"length": 12, "width": 5.1}


def test_a_unit_that_is_missing_can_be_answered(tmp_path):
    with pytest.raises(UnknownUnit) as asked:
        read(tmp_path, PLAIN.replace("_N", ""))
    assert asked.value.option == "--force-unit"
    assert read(tmp_path, PLAIN.replace("_N", ""), force_unit="kN").numbers[-1, 2] == 9000


@pytest.mark.parametrize(
    ("empty", "note"),
    [
        (1, "row 2 has an empty cell, and is left out"),
        (3, "the first 3 rows have an empty cell, and are left out"),
        (4, None),
    ],
)
def test_few_rows_at_the_start_with_an_empty_cell_are_left_out(tmp_path, empty, note):
    path = tmp_path / "a.csv"
    rows = [f"{i},{i},{'' if i < empty else 2 * i},7" for i in range(20)]
    path.write_text("Time (s),Extension (mm),Force (N),more\n" + "\n".join(rows))
    if note is None:
        with pytest.raises(BadInput, match=r"row 2, Force \(N\): an empty cell"):
            read_recordings(path, Hints())
    else:
        (found,) = read_recordings(path, Hints())
        assert found.notes == (note,)
        assert (found.rows[0], found.numbers[0].tolist()) == (2 + empty, [empty, empty, 2.0 * empty])
        assert inspect(path).content()["ask"][0].startswith("length: ")


def test_few_rows_at_the_start_with_another_decimal_mark_are_left_out(tmp_path):
    """As a program writes its first numbers before it knows the settings of the machine."""
    path = tmp_path / "a.txt"
    rows = "".join(f"{i}\t{i},5\t{2 * i},25\n" for i in range(20))
    path.write_text(f"0.0\t0.00\t-4.0\n{rows}")
    chosen = {"time_column": "1", "time_unit": "s", "displacement_column": "2", "displacement_unit": "mm"}
    (found,) = read_recordings(path, Hints(**chosen, force_column="3", force_unit="N"))
    assert found.notes == ("row 1 has a point as decimal mark, unlike those below, and is left out",)
    assert (found.rows[0], found.numbers[0].tolist()) == (2, [0.0, 0.5, 0.25])
    path.write_text("0.0\t0.00\t-4.0\n\n" + rows.replace("\n", "\n\n"))
    (found,) = read_recordings(path, Hints(**chosen, force_column="3", force_unit="N"))
    assert len(found.rows) == 20
    told = "19 empty rows among the numbers are passed over, the first above row 5: times go on there"
    assert found.notes[0] == told
    path.write_text("t\tu\tF\n" + rows.replace("7,5", "7.5"))
    with pytest.raises(BadInput, match=r"row 9, u: '7\.5'; expected a finite number with a comma"):
        read_recordings(path, Hints(**chosen, force_column="3", force_unit="N"))
