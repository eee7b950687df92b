"""A file becomes the same recording whatever its separator, marks, titles, units and encoding; and that a curve."""

import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from sinew.runner.errors import BadInput
from sinew.tasks.data.curves import Bar, curve_of
from sinew.tasks.data.exports import Reading
from sinew.tasks.data.hints import Hints
from sinew.tasks.data.inspection import inspect
from sinew.tasks.data.questions import Unclear, UnknownUnit
from sinew.tasks.data.recordings import UNPADDED, Recording, read_recordings
from sinew.tasks.data.remarks import remarks
from sinew.tasks.data.told import as_told
from tests.tasks.data.test_sheets import write_workbook

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
        (PLAIN.replace("1,0.1", "\n1,0.1") + "3,0.3,9\n", "row 3, time_s: an empty cell; expected a finite number"),
        (PLAIN + "3,,9\n", "row 5, displacement_mm"),
        (PLAIN + "3,inf,9\n", "row 5, displacement_mm"),
        (PLAIN + "3,1e999,9\n", "row 5, displacement_mm"),
        (PLAIN + "3,0.1\n", "row 5, force_N: an empty cell"),
        (PLAIN + "\n3,0.3,9\n", "row 5"),
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


# ---- curves


@pytest.mark.parametrize(
    ("title", "values", "displacement"),
    [
        ("strain (%)", "0 1 2", [0, 0.1, 0.2]),
        ("strain (1)", "0 0.01 0.02", [0, 0.1, 0.2]),
        ("Stretch", "1 1.01 1.02", [0, 0.1, 0.2]),
        ("Length (mm)", "10 10.1 10.2", [0, 0.1, 0.2]),
        ("Position (mm)", "5 5.1 5.2", [0, 0.1, 0.2]),
        ("displacement_mm", "1 1.1 1.2", [1, 1.1, 1.2]),
    ],
)
def test_displacements_from_the_reference(tmp_path, title, values, displacement):
    rows = [f"{i + 5},{value},{i}" for i, value in enumerate(values.split())]
    found = read(tmp_path, "\n".join([f"time_s,{title},force_N", *rows]))
    curve = curve_of(found, BAR, "pull")
    np.testing.assert_allclose(curve.protocol.displacement_mm, displacement, atol=1e-12)
    assert curve.protocol.time_s.tolist() == [0, 1, 2]
    assert curve.name == "pull"
    if title == "Stretch":
        curve = curve_of(found, BAR, "pull", reference=0.5)
        np.testing.assert_allclose(curve.protocol.displacement_mm, [10, 10.2, 10.4])
    else:
        with pytest.raises(BadInput, match="which --reference does not apply to; expected a stretch"):
            curve_of(found, BAR, "pull", reference=0.5)


def test_a_stress_becomes_a_force_with_the_cross_section(tmp_path):
    found = read(tmp_path, PLAIN.replace("force_N", "stress (kPa)"))
    assert curve_of(found, BAR, "pull").force_N.tolist() == pytest.approx([0, 0.16, 0.288])


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (PLAIN.replace("\n2,", "\n1,"), "row 4, time: 1 s after 1 s; expected increasing times"),
        (PLAIN.replace("0.1", "-10"), "row 3, displacement: -10 mm leaves nothing of a gauge length of 10 mm"),
        (PLAIN.replace("displacement_mm", "Stretch"), "no unit of the strain can be found"),
        (PLAIN.replace("displacement_mm", "Stretch").replace(",0,0", ",114,0"), "row 2, stretch: 114; expected"),
        (
            PLAIN.replace("displacement_mm", "strain (1)").replace(",0,0", ",-1,0"),
            "row 2, strain: -10 mm leaves nothing",
        ),
    ],
)
def test_curves_that_cannot_be(tmp_path, content, words):
    with pytest.raises(BadInput) as refused:
        curve_of(read(tmp_path, content), BAR, "pull")
    assert words in str(refused.value)


@pytest.mark.parametrize(
    ("title", "motion"),
    [
        ("displacement_mm", (0, -1, -2)),
        ("strain (%)", (0, -10, -30)),
        ("stretch", (1, 0.9, 0.7)),
        ("position (mm)", (37, 36, 35)),
        ("length (mm)", (12, 11, 10)),
    ],
)
def test_a_compression_is_said_to_be_one(tmp_path, title, motion):
    rows = [f"{i},{x},{-i}" for i, x in enumerate(motion)]
    (*_, remark) = remarks(read(tmp_path, "\n".join([f"time_s,{title},force_N", *rows, ""])))
    assert remark.startswith("a compression, unless the machine counts tension as negative: the specimen gets shorter")


def test_a_compression_with_forces_above_0_is_remarked_on(tmp_path):
    (remark,) = remarks(read(tmp_path, "time_s,displacement_mm,force_N\n0,0,0\n1,-1,5\n2,-2,9\n"))
    assert remark == (
        "the specimen gets shorter, but forces are above 0; in a compression they should be below 0; "
        "--negate displacement, force or none"
    )


def test_remarks(tmp_path):
    assert remarks(read(tmp_path, PLAIN)) == []
    (remark,) = remarks(read(tmp_path, PLAIN.replace("5", "-5").replace("9", "-9")))
    assert "forces are negative" in remark
    (remark,) = remarks(read(tmp_path, PLAIN.replace("displacement", "position")))
    assert "positions, likely" in remark
    path = tmp_path / "test.csv"
    path.write_text("time_s,disp_mm,Load (N),Load (N)\n0,0,0,1\n1,1,1,1\n2,2,2,1\n")
    (remark,) = remarks(*read_recordings(path, Hints(), first_of_alike=True))
    assert remark == "force from column 3; it may be in another: 'Load (N)'"


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (
            PLAIN + "3,nan,9\n",
            "row 5, displacement_mm: 'nan'; expected a finite number with a point as decimal mark, like those above",
        ),
        (
            PLAIN + "3,0.1\n",
            "row 5, force_N: an empty cell; expected a finite number, like those above; "
            "delete row 5 if it is a summary",
        ),
        (
            PLAIN + "Max,0.2,9\n,0.1,4\n",
            "row 5, time_s: 'Max'; expected a finite number with a point as decimal mark, like those above",
        ),
        (
            PLAIN + ",0.2,9\n,0.1,4\n",
            "row 5, time_s: an empty cell; expected a finite number, like those above; "
            "delete rows 5 to 6 if they are a summary",
        ),
        (
            "time_s;disp_mm;force_N\n0,5;1,5;2,5\n1,5;1,5;2,5\n2,5;1,5;2,5\n3,5;1.234;2,5\n",
            "row 5, disp_mm: '1.234'; expected a finite number with a comma as decimal mark, like those above",
        ),
        (PLAIN.replace("2,0.2,9\n", ""), "2 rows of numbers; expected at least 3"),
        (
            PLAIN.replace("_N", "_kN").replace("9", "9e98"),
            "row 4, force_kN: 9e+101; expected a number below 1e100",
        ),
        (
            PLAIN.replace("_s", "_min").replace("\n2,", "\n-9e99,"),
            "row 4, time_min: -5.4e+101; expected a number below 1e100",
        ),
    ],
)
def test_what_is_wrong_in_a_file_is_said(tmp_path, content, words):
    with pytest.raises(BadInput) as refused:
        read(tmp_path, content)
    assert str(refused.value) == f"{tmp_path / 'test.csv'}: {words}"


def test_a_column_without_a_title_is_called_by_what_it_is(tmp_path):
    content = "0,0,0\n1,0.1,5\n2,0.2,9\n3,x,9\n"
    with pytest.raises(BadInput, match="row 4, displacement: 'x'; expected a finite number"):
        read(
            tmp_path, content, time_column="1", displacement_column="2", force_column="3", time_unit="s",
            displacement_unit="mm", force_unit="N",
        )  # fmt: skip


@pytest.mark.parametrize(
    ("content", "reference", "words"),
    [
        (
            PLAIN.replace("\n2,", "\n1,"), None,
            ": row 4, time: 1 s after 1 s; expected increasing times, or --rate-hz where the clock is coarser than the "
            "rows",
        ),
        (PLAIN.replace("\n1,", "\n3.5,"), None, ": row 4, time: 2 s after 3.5 s; expected increasing times"),
        (
            PLAIN.replace("0.1", "-10"), None,
            ": row 3, displacement: -10 mm leaves nothing of a gauge length of 10 mm; expected another gauge length, "
            "unit or column",
        ),
        (
            PLAIN.replace("displacement_mm", "Stretch").replace(",0,0", ",1,0").replace("0.1", "10.5"), None,
            ": row 3, stretch: 10.5; expected a length over the reference length, above 0 and at most 10",
        ),
        (PLAIN, 0.5, ": holds displacements, which --reference does not apply to; expected a stretch"),
    ],
)  # fmt: skip
def test_why_a_curve_cannot_be_is_said(tmp_path, content, reference, words):
    with pytest.raises(BadInput) as refused:
        curve_of(read(tmp_path, content), BAR, "pull", reference=reference)
    assert str(refused.value) == f"{tmp_path / 'test.csv'}{words}"


def test_a_stretch_of_ten_and_nearly_no_length_are_possible(tmp_path):
    stretch = "time_s,Stretch,force_N\n0,1,0\n1,10,5\n2,0.001,9\n"
    assert curve_of(read(tmp_path, stretch), BAR, "pull").protocol.displacement_mm.tolist() == [0.0, 90.0, -9.99]
    assert curve_of(read(tmp_path, PLAIN.replace("0.1", "-9.999")), BAR, "pull").protocol.displacement_mm[1] == -9.999


def test_a_curve_keeps_no_hold_of_its_recording(tmp_path):
    found = read(tmp_path, PLAIN)
    curve_of(found, BAR, "pull").force_N[:] = 0.0
    assert found.numbers[:, 2].tolist() == [0, 5, 9]


def test_what_a_recording_tells_of_its_file(tmp_path):
    found = read(tmp_path, "Length,12,mm\n\n" + PLAIN.replace("force_N", "force_N,,Note"))
    assert found.path == tmp_path / "test.csv"
    assert (found.rows[0], found.left_out) == (4, ("Note",))
    assert found.header == (("Length", "12", "mm"), ())
    assert (found.motion.title, found.load.title) == ("displacement_mm", "force_N")


def test_the_first_missing_column_is_told_of_several_tables(tmp_path):
    with pytest.raises(BadInput, match=r"row 1: no column of time, nor of .* among 'a, b, c'"):
        read(tmp_path, "a,b,c\n1,2,3\n2,3,4\n3,4,5\n\nt_s,b,c\n1,2,3\n2,3,4\n3,4,5\n")


def test_every_remark_in_words(tmp_path):
    pushed = PLAIN.replace("displacement", "position").replace("5", "-5").replace("9", "-9")
    assert remarks(read(tmp_path, pushed)) == [
        "positions, likely to count from the first one",
        "forces are negative, but sinew takes tension as positive; check the sign convention of the machine; "
        "--negate force or none",
    ]
    path = tmp_path / "test.csv"
    path.write_text("time_s,disp_mm,Load (N),Load (N),Load (N)\n0,0,0,1,1\n1,1,1,1,1\n2,2,2,1,1\n")
    assert remarks(*read_recordings(path, Hints(), first_of_alike=True)) == [
        "force from column 3; it may be in another: 'Load (N)', 'Load (N)'"
    ]


@pytest.mark.parametrize(
    ("forces", "told"),
    [
        ("0 -5 -9", True),
        ("0 5 -9", False),
        ("1.8 -5 -9", False),
        ("1.7 -5 -9", True),
        ("-50 0.5 0.6", False),
        ("-9 0 0", False),
    ],
)
def test_forces_are_below_zero_if_most_are_and_by_far(tmp_path, forces, told):
    rows = [f"{i},{i},{force}" for i, force in enumerate(forces.split())]
    assert bool(remarks(read(tmp_path, "\n".join(["time_s,u_mm,force_N", *rows])))) == told


def test_of_columns_alike_none_is_taken_unless_that_is_asked_for(tmp_path):
    (tmp_path / "test.csv").write_text("time_s,disp_mm,F_N,F_N\n0,0,0,1\n1,1,1,1\n2,2,2,1\n")
    with pytest.raises(BadInput, match="may both be the force"):
        read_recordings(tmp_path / "test.csv", Hints())


# ---- several tests in one file

ONE = "Time (s),Extension (mm),Load (N)\n0,0,0\n1,0.1,5\n2,0.2,9\n"


def names_and_loads(folder: Path, content: str, **hints: object) -> list[tuple[str, list[float]]]:
    path = folder / "test.csv"
    path.write_text(content)
    return [(one.test, one.numbers[:, 2].tolist()) for one in read_recordings(path, Hints(**hints))]


def test_tables_with_the_same_titles_are_several_tests(tmp_path):
    other = ONE.replace("5", "6")
    assert names_and_loads(tmp_path, ONE + other) == [("1", [0, 5, 9]), ("2", [0, 6, 9])]
    numbered = [f"{name},{one}".replace("\n", "\n,") for name, one in (("A", ONE), ("B", other))]
    assert names_and_loads(tmp_path, "\n".join(numbered)) == [("A", [0, 5, 9]), ("B", [0, 6, 9])]


def test_tables_of_another_kind_are_passed_over(tmp_path):
    assert names_and_loads(tmp_path, "a,b,c\n1,2,3\n2,3,4\n3,4,5\n" + ONE) == [("", [0, 5, 9])]


def test_tables_whose_times_go_on_are_one_test(tmp_path):
    later = ONE.replace("\n0,", "\n3,").replace("\n1,", "\n4,").replace("\n2,", "\n5,")
    path = tmp_path / "test.csv"
    path.write_text(ONE + later)
    (found,) = read_recordings(path, Hints())
    assert found.numbers[:, 0].tolist() == [0, 1, 2, 3, 4, 5]
    assert found.rows == (2, 3, 4, 6, 7, 8)
    assert remarks(found) == ["2 tables whose times go on: read as one test"]
    path.write_text(ONE + later.replace("\n4,", "\n3,"))
    with pytest.raises(BadInput, match="row 7, time: 3 s after 3 s"):
        curve_of(*read_recordings(path, Hints()), BAR, "pull")
    named = ["A," + ONE.replace("\n", "\n,"), "B," + later.replace("\n", "\n,")]
    assert [name for name, _ in names_and_loads(tmp_path, "\n".join(named))] == ["A", "B"], "they have names"


OWN = "{}\nLength: {} mm\nWidth,{},mm\n" + ONE


def sizes(one: Recording) -> dict[str, float | None]:
    return {name: size.mm for name, size in one.sizes.items()}


@pytest.mark.parametrize("name", ["", "Specimen B"])
def test_each_of_several_tests_has_the_sizes_above_it(tmp_path, name):
    path = tmp_path / "test.csv"
    path.write_text(f"Diameter (mm): 3\n{OWN.format('', 10, 2)}\n{OWN.format(name, 20, 4)}\n{ONE}")
    first, second, third = read_recordings(path, Hints())
    assert sizes(first) == {"diameter": 3.0, "length": 10.0, "width": 2.0}
    assert sizes(second) == {"length": 20.0, "width": 4.0}, "the diameter may be that of the first"
    assert sizes(third) == sizes(first), "those above the first test"
    assert [one.numbers.shape for one in (first, second, third)] == [(3, 3)] * 3


def test_each_sheet_has_its_own_sizes(tmp_path):
    table = [["Time (s)", "Extension (mm)", "Load (N)"], *([i, i / 10, 5 * i] for i in range(4))]
    sheets = {name: [["Length", length, "mm"], *table] for name, length in (("one", 10), ("two", 20))}
    both = read_recordings(write_workbook(tmp_path / "test.xlsx", **sheets), Hints())
    assert [sizes(one) for one in both] == [{"length": 10.0}, {"length": 20.0}]


def test_tests_with_something_between_them_are_not_joined(tmp_path):
    later = ONE.replace("\n0,", "\n3,").replace("\n1,", "\n4,").replace("\n2,", "\n5,")
    assert [name for name, _ in names_and_loads(tmp_path, f"{ONE}Specimen B\n{later}")] == ["1", "2"]
    pause = later.replace("\n3,", "\n30,").replace("\n4,", "\n31,").replace("\n5,", "\n32,")
    assert [name for name, _ in names_and_loads(tmp_path, ONE + pause)] == ["1", "2"]


def test_many_tests_in_a_file_take_no_time_of_the_square_of_their_number(tmp_path):
    path = tmp_path / "test.csv"
    path.write_text(("Time (s),Extension (mm),Load (N)\n" + "".join(f"{i},{i},{i}\n" for i in range(50))) * 100)
    tracemalloc.start()
    found = read_recordings(path, Hints())
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert len(found) == 100
    assert max(len(one.header) for one in found) == 0
    assert most < 20 * 2**20


def test_a_test_that_was_broken_off_is_left_out_with_a_remark(tmp_path):
    path = tmp_path / "test.csv"
    path.write_text(ONE + "Time (s),Extension (mm),Load (N)\n0,0,0\n")
    (found,) = read_recordings(path, Hints())
    assert remarks(found) == ["1 further tables with fewer than 3 rows are left out"]
    path.write_text("Time (s),Extension (mm),Load (N),Extension (mm),Load (N)\n0,0,0,,\n1,0.1,5,,\n2,0.2,9,,\n")
    (found,) = read_recordings(path, Hints())
    assert found.numbers[:, 2].tolist() == [0, 5, 9]


def test_a_column_of_tests_is_remarked_on_where_times_go_on(tmp_path):
    rows = "".join(f"{'AB'[i // 6]},{i},{i % 6},{i % 6}\n" for i in range(12))
    found = read(tmp_path, f"Specimen,Time (s),Extension (mm),Load (N)\n{rows}")
    assert remarks(found) == ["2 values of 'Specimen': --test-column, if each is a test of its own"]


def test_tests_on_several_sheets_have_the_names_of_their_sheets(tmp_path):
    rows = [["Time (s)", "Extension (mm)", "Load (N)"], *([i, i / 10, 5 * i] for i in range(4))]
    path = write_workbook(tmp_path / "test.xlsx", dermis=rows, belly=rows)
    assert [one.test for one in read_recordings(path, Hints())] == ["dermis", "belly"]


def test_tests_beside_each_other_have_units_of_their_own(tmp_path):
    text = "A,,,B\nTime,Extension,Load,Time,Extension,Load\ns,mm,N,ms,um,kN\n"
    text += "0,0,1,0,0,0.001\n1,0.1,5,1000,100,0.005\n2,0.2,9,2000,200,0.009\n"
    path = tmp_path / "a.csv"
    path.write_text(text)
    one, other = read_recordings(path, Hints())
    assert other.numbers == pytest.approx(one.numbers)
    assert [column.unit for column in other.columns] == ["ms", "um", "kN"]
    path.write_text(text.replace("kN", "V"))
    with pytest.raises(BadInput, match="unit 'V' is that of a sensor's signal, no force"):
        read_recordings(path, Hints())


def test_units_that_contradict_each_other_are_refused_until_a_person_decides(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("Time (s),Extension (mm),Force (N)\ns,mm,kN\n0,0,1\n1,0.1,5\n2,0.2,9\n")
    with pytest.raises(UnknownUnit, match="the force has two units: 'N' and 'kN'"):
        read_recordings(path, Hints())
    (told,) = read_recordings(path, Hints(force_unit="kN"))
    assert told.numbers[:, 2] == pytest.approx([1000, 5000, 9000])


def test_the_second_of_two_tests_may_be_the_first_with_a_number(tmp_path):
    titles = ["Time (s)", "Extension (mm)", "Load (N)", "Time 2 (s)", "Extension 2 (mm)", "Load 2 (N)"]
    rows = [",".join(f"{(place + 1) * row / 7:.5f}" for place in range(6)) for row in range(30)]
    (tmp_path / "two.csv").write_text("\n".join([",".join(titles), *rows]) + "\n")
    found = read_recordings(tmp_path / "two.csv", Hints(), first_of_alike=True)
    assert [[column.place for column in one.columns] for one in found] == [[0, 1, 2], [3, 4, 5]]


@pytest.mark.parametrize(
    ("titles", "motion", "load", "left"),
    [
        (["Time (s)", "Extension (mm)", "Load (N)", "Time (s)", "Crosshead (mm)", "Force (kN)"], 1, 2, "4 to 6"),
        (["Extension (mm)", "Load (N)", "Time (s)", "Crosshead (mm)", "Force (kN)", "Time (s)"], 0, 1, "4 to 6"),
        (["Time (s)", "Extension (mm)", "Load (N)", "", "Time (s)", "Crosshead (mm)", "Force"], 1, 2, "5 to 7"),
        (["Time (s)", "Load (N)", "Time (s)", "Extension (mm)"], 3, 1, None),
        (["Time (s)", "Extension (mm)", "Load (N)", "Clock (s)", "Crosshead (mm)"], 1, 2, None),
    ],
)
def test_columns_of_two_tests_with_other_titles_are_never_taken_together(tmp_path, titles, motion, load, left):
    path = tmp_path / "two.csv"
    rows = [",".join(f"{(place + 1) * row / 7:.5f}" if title else "" for place, title in enumerate(titles))
            for row in range(30)]  # fmt: skip
    path.write_text("\n".join([",".join(titles), *rows]) + "\n")
    (test,) = read_recordings(path, Hints(), first_of_alike=True)
    assert [column.place for column in test.columns[1:]] == [motion, load]
    told = [note for note in test.notes if "may be another test" in note]
    assert told == (
        [] if left is None else [f"columns {left} may be another test and are left out; it needs a file of its own"]
    )


def test_tests_beside_each_other(tmp_path):
    beside = "A,,,B\nTime (s),Extension (mm),Load (N),Time (s),Extension (mm),Load (N)\n"
    beside += "0,0,0,0,0,1\n1,0.1,5,1,0.1,6\n2,0.2,9,2,0.2,7\n,,,3,0.3,8\n"
    assert names_and_loads(tmp_path, beside) == [("A", [0, 5, 9]), ("B", [1, 6, 7, 8])]
    (first,) = names_and_loads(tmp_path, beside, time_column="1", displacement_column="2", force_column="3")
    assert first == ("", [0, 5, 9]), "who names columns means one test"
    empty = beside.replace("2,0.2,9,", ",,,").replace("1,0.1,5,", ",,,")
    assert names_and_loads(tmp_path, empty) == [("B", [1, 6, 7, 8])], "the first was not made"


def test_further_columns_of_tests_beside_and_under_each_other_are_their_own(tmp_path):
    titles = "Time (s),Displacement (mm),Force (N),Lateral strain (%)"
    rows = [f"{i % 4},{i},{i},{i},{i % 4},{i},{2 * i},{2 * i},{'ab'[i // 4]}" for i in range(8)]
    path = tmp_path / "a.csv"
    path.write_text("\n".join([f"{titles},{titles},run", *rows, ""]))
    found = read_recordings(path, Hints(test_column="run", keep_column=("Lateral strain=lateral_strain",)))
    kept = [100 * one.further.values["lateral_strain"] for one in found]
    assert [each.round(9).tolist() for each in kept] == [[0, 1, 2, 3], [4, 5, 6, 7], [0, 2, 4, 6], [8, 10, 12, 14]]


BELOW = "id,Time (s),Extension (mm),Load (N)\n" + "".join(
    f"{name},{i},{i / 10},{i * force}\n" for name, force in (("a", 5), ("b", 6)) for i in range(4)
)


def test_tests_one_under_another_by_a_column(tmp_path):
    found = names_and_loads(tmp_path, BELOW, test_column="id")
    assert found == [("a", [0, 5, 10, 15]), ("b", [0, 6, 12, 18])]
    with pytest.raises(BadInput) as refused:
        curve_of(read(tmp_path, BELOW), BAR, "pull")
    assert str(refused.value).endswith(
        "row 6, time: 0 s after 3 s; expected increasing times, or --test-column 'id', which changes there"
    )
    with pytest.raises(BadInput, match="2 rows of numbers of test 'c'; expected at least 3"):
        read(tmp_path, BELOW + "c,0,0,0\nc,1,1,1\n", test_column="id")


def test_cycles_whose_times_start_again_are_one_test(tmp_path):
    cycles = BELOW.replace("id,", "Cycle,")
    with pytest.raises(BadInput, match="or --cycle-column 'Cycle', which changes there"):
        curve_of(read(tmp_path, cycles), BAR, "pull")
    found = read(tmp_path, cycles + "b,4,0.4,24\n", cycle_column="Cycle")
    assert found.numbers[:, 0].tolist() == list(range(9))
    assert remarks(found)[-1] == "times go on over 2 cycles, which 'Cycle' tells apart"


STEPS = "".join(
    "<Stress Relaxation>\nTime, s\tPosition (z), mm\tFz, gf\n"
    + "".join(f"{i}\t{begin + 0.1 * min(i, 5):g}\t{100 * begin + 8 * min(i, 5) + i:g}\n" for i in range(8))
    for begin in (5.0, 5.5, 6.0)
)


def test_tables_that_begin_where_the_one_before_ends_are_asked_about(tmp_path):
    """Steps of one relaxation, each with times of its own: as tests of their own, their strains would be wrong."""
    path = tmp_path / "steps.txt"
    path.write_text(STEPS)
    with pytest.raises(Unclear) as unclear:
        read_recordings(path, Hints(force_column="3"), first_of_alike=True)
    assert "a test begins where the table before ends, at 5.5 mm and 5.3" in str(unclear.value)
    assert unclear.value.choices == ("join", "apart")
    apart = read_recordings(path, Hints(tables="apart"), first_of_alike=True)
    assert [test.test for test in apart] == ["1", "2", "3"]
    (one,) = read_recordings(path, Hints(tables="join"), first_of_alike=True)
    assert one.numbers[:, 0].tolist() == list(range(24))
    assert one.numbers[[0, 8, 23], 1].tolist() == [5.0, 5.5, 6.5]
    assert "3 tables that go on from each other, as --tables says: read as one test" in one.notes
    assert inspect(path, Reading(hints=Hints(tables="join"))).specimens == 1


# ---- times that a person tells

TIMELESS = "Extension (mm),Load (N)\n0,0\n0.1,5\n0.3,9\n"


def test_times_by_a_rate_or_a_speed(tmp_path):
    found = read(tmp_path, TIMELESS, rate_hz=10.0)
    assert found.numbers.tolist() == [[0, 0, 0], [0.1, 0.1, 5], [0.2, 0.3, 9]]
    assert remarks(found) == ["times by --rate-hz 10"]
    assert found.columns[0].title == "--rate-hz 10"
    found = read(tmp_path, TIMELESS, speed=0.1)
    assert found.numbers[:, 0] == pytest.approx([0.0, 1.0, 3.0])
    with pytest.raises(BadInput, match=r"no column of time among .*--rate-hz, --speed or --speed-column"):
        read(tmp_path, TIMELESS)


def test_a_column_of_times_counts_unless_it_stands_still(tmp_path):
    found = read(tmp_path, PLAIN, rate_hz=10.0)
    assert found.numbers[:, 0].tolist() == [0, 1, 2]
    assert remarks(found) == ["its own times count, not --rate-hz 10"]
    found = read(tmp_path, PLAIN.replace("\n1,", "\n0.1,").replace("\n2,", "\n0.2,"), rate_hz=100.0)
    assert found.numbers[:, 0].tolist() == [0, 0.1, 0.2], "a quick test, too"
    still = PLAIN.replace("\n1,", "\n0,").replace("\n2,", "\n0,")
    assert read(tmp_path, still, rate_hz=10.0).numbers[:, 0].tolist() == [0, 0.1, 0.2]


def test_a_speed_tells_no_times_of_a_motion_that_rests_or_is_noisy(tmp_path):
    with pytest.raises(BadInput, match=r"row 4: the same motion as in the row before.*--rate-hz"):
        read(tmp_path, TIMELESS.replace("0.3", "0.1"), speed=0.1)
    noisy = "".join(f"{i / 10 + 0.2 * (-1) ** i},{i}\n" for i in range(30))
    with pytest.raises(BadInput, match="the motion turns 28 times in 30 rows"):
        read(tmp_path, "Extension (mm),Load (N)\n" + noisy, speed=0.1)


def test_a_rate_and_a_column_of_times_contradict_each_other():
    with pytest.raises(BadInput, match="--rate-hz 10: given together with --time-column"):
        Hints(rate_hz=10.0, time_column="t")


def test_a_column_of_current_lengths_tells_the_gauge_length_of_each_test(tmp_path):
    rows = "".join(f"{i},{12.5 + 0.1 * i:g},{0.1 * i:g},{i}\n" for i in range(5))
    path = tmp_path / "lengths.csv"
    path.write_text("Time_S,Size_mm,Displacement_mm,Force_N\n" + rows)
    (one,) = read_recordings(path, Hints())
    assert (one.sizes["length"].mm, one.sizes["length"].has_unit) == (pytest.approx(12.5), True)
    assert one.left_out == ()
    path.write_text("Time_S,Size_mm,Displacement_mm,Force_N\n" + rows + "5,17,0,9\n6,17.1,0.1,6\n")
    (other,) = read_recordings(path, Hints())
    assert other.left_out == ("Size_mm",)
    assert "length" not in other.sizes


def test_a_file_of_very_many_tests_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("sinew.tasks.data.tables.MOST_TABLES", 3)
    part = "Time (s),Displacement (mm),Force (N)\n" + "".join(f"{i},{i},{i}\n" for i in range(4)) + "\n"
    (tmp_path / "a.csv").write_text(part * 3)
    assert len(read_recordings(tmp_path / "a.csv", Hints())) == 3
    (tmp_path / "a.csv").write_text(part * 4)
    with pytest.raises(BadInput, match=r"a\.csv: more than 3 tables"):
        read_recordings(tmp_path / "a.csv", Hints())


def test_clock_times_of_milliseconds_without_leading_zeros_are_told(tmp_path):
    rows = ["1:12:57.855", "1:12:58.29", "1:12:58.203"]
    content = "time,disp_mm,force_N\n" + "".join(f"{clock},{i},{i}\n" for i, clock in enumerate(rows))
    found = read(tmp_path, content)
    assert np.diff(found.numbers[:, 0]).tolist() == pytest.approx([0.174, 0.174])
    assert found.notes == (UNPADDED,)
    assert read(tmp_path, content.replace("58.29", "58.029")).notes == ()


MARKS = "Zeit (s);Weg (mm);Kraft (N)\n" + "".join(f"{i};{i};{220 * i}\n" for i in range(5))


@pytest.mark.parametrize("mark", [".", ","])
@pytest.mark.parametrize("separator", [";", "\t"])
@pytest.mark.parametrize("beside", [(), ("5;5;880",), ("12;1234;880",)])
def test_numbers_that_may_have_marked_thousands_are_refused(tmp_path, mark, separator, beside):
    rows = "\n".join(("6;6;1.100", "7;7;1.320", *beside)).replace(".", mark)
    content = (MARKS + rows + "\n").replace(";", separator)
    with pytest.raises(BadInput) as refused:
        read(tmp_path, content)
    problem = f"row 7, Kraft (N): '1{mark}100' may be 1.100 or 1100, and no number beside it tells which; expected the"
    assert problem in str(refused.value)


@pytest.mark.parametrize("row", ["5;0.500;880", "5;5.5;880", "5;5;1.1000", "5;5;.125", "5;-0.125;1", "5;5;1.100e0"])
def test_one_number_tells_what_the_marks_are(tmp_path, row):
    found = read(tmp_path, f"{MARKS}{row}\n6;6;1.100\n")
    assert found.numbers[-1, 2] == 1.1


def test_a_further_table_that_may_be_a_test_is_not_left_out_without_a_word(tmp_path):
    other = [["Time (s)", "Load (N)", "Extension (mm)"], *([i, 2 * i, i] for i in range(4))]
    test = [["Time (s)", "Displacement (mm)", "Force (N)"], *([i, i, 3 * i] for i in range(4))]
    none = [["Point", "Load (N)", "Slope"], *([i, 2 * i, i] for i in range(4))]
    short = other[:3]
    path = write_workbook(tmp_path / "a.xlsx", one=test, two=other, three=none, four=short, five=other)
    with pytest.raises(Unclear) as unclear:
        read_recordings(path, Hints())
    assert "the table in sheet 'two', row 1 has other titles than the first one, and is a test" in str(unclear.value)
    assert (unclear.value.option, unclear.value.choices) == ("--tables", ("first",))
    (found,) = read_recordings(path, Hints(tables="first"))
    words = "the table in sheet '{}', row 1 has other titles and is left out; a test needs a file of its own"
    others = (
        "2 tables, the first in sheet 'two', row 1, have other titles and are left out; a test needs a file of its own"
    )
    assert remarks(found) == [others]
    unknown = [["Time (s)", "Load (N)", "Extension (furlong)"], *([i, 2 * i, i] for i in range(4))]
    path = write_workbook(tmp_path / "b.xlsx", one=test, two=unknown)
    assert remarks(*read_recordings(path, Hints())) == [words.format("two")]


def test_an_empty_cell_of_a_sheet_may_be_that_of_a_formula(tmp_path):
    rows = [["Time (s)", "Displacement (mm)", "Force (N)"], *([i, i, 3 * i] for i in range(4)), [4, 4, None]]
    path = write_workbook(tmp_path / "a.xlsx", one=[*rows, [5, 5, 5]])
    with pytest.raises(
        BadInput, match=r"row 6, Force \(N\): an empty cell; expected .*; a formula needs the value that"
    ):
        read_recordings(path, Hints())


def test_one_table_tells_what_the_marks_of_another_are(tmp_path):
    titles = "Time (s),Extension (mm),Load (N)\n"
    rows = "0.000,0.250,1\n1.000,0.5,2\n2.000,1.5,3\n"
    (tmp_path / "a.csv").write_text(f"{titles}{rows}{titles}8.000,2.000,9\n9.000,3.000,9\n")
    first, *others = read_recordings(tmp_path / "a.csv", Hints())
    assert (first.numbers[-1].tolist(), others) == ([2.0, 1.5, 3.0], [])


def test_a_time_of_another_day_without_a_clear_date_is_said(tmp_path):
    rows = "03.05.2024 23:59:58,0,0\n03.05.2024 23:59:59,1,1\n03.05.2024 23:59:59.5,2,2\n04.05.2024 00:00:01,3,3\n"
    (tmp_path / "a.csv").write_text(f"Time,Extension (mm),Load (N)\n{rows}")
    words = r"row 5, Time: '04.05.2024 00:00:01'; expected a time of the same day as those above, or dates such as"
    with pytest.raises(BadInput, match=words):
        read_recordings(tmp_path / "a.csv", Hints())
