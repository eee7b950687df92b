"""The curve of a recording: from what its columns mean, and why there is none."""

import numpy as np
import pytest

from sinew.runner.errors import BadInput
from sinew.tasks.data.curves import curve_of
from sinew.tasks.data.hints import Hints
from sinew.tasks.data.recordings import read_recordings
from sinew.tasks.data.remarks import remarks
from tests.tasks.data.test_recordings import BAR, PLAIN, read


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
        (PLAIN.replace("\n2,", "\n1,"), "times repeat in 1 of 3 rows, first in row 4; expected --same-times"),
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
            ": times repeat in 1 of 3 rows, first in row 4; expected --same-times spread where the clock is coarser "
            "than the rows, or --rate-hz",
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
        "positions, likely to count from the first one, 0 mm; --zero-displacement none if they are displacements",
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
