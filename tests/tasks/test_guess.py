"""Tables that nobody described: the same numbers come out whatever separator, marks, titles, units and encoding."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from tasks.guess import DISPLACEMENT, FORCE, LENGTH, POSITION, STRAIN, STRESS, STRETCH, Guess, Hints, UnitUnknown, guess
from tasks.problems import BadInput

TIME_S = np.array([0.0, 0.5, 1.0, 1.5, 2.0])
MOTION = np.array([0.0, 0.125, 0.25, 0.25, 0.2])
LOAD = np.array([0.0, 5.5, 9.75, 8.5, 7.25])
PLAIN = "time_s,displacement_mm,force_N\n0,0,0\n1,0.1,5\n2,0.2,9\n"
SECONDS = {"s": 1.0, "sec": 1.0, "ms": 1e-3, "min": 60.0}
MILLIMETRES = {"mm": 1.0, "um": 1e-3, "µm": 1e-3, "m": 1e3, "cm": 10.0}
NEWTONS = {"N": 1.0, "mN": 1e-3, "kN": 1e3, "kgf": 9.80665, "gf": 9.80665e-3}


def read(folder: Path, content: str | bytes, **hints: str) -> Guess:
    path = folder / "test.csv"
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return guess(path, Hints(**hints))


@st.composite
def tables(draw: st.DrawFn) -> bytes:
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
    form = draw(st.sampled_from(["{0} ({1})", "{0} [{1}]", "{0}_{1}", "{0}/{1}", "below", "below in brackets"]))
    if separator == " ":
        names = [name.replace(" ", "") if name != "Elapsed Time" else "Time" for name in names]
        form = draw(st.sampled_from(["{0}({1})", "{0}_{1}"]))
    factors = [SECONDS[units[0]], MILLIMETRES[units[1]], NEWTONS[units[2]]]
    columns = [np.asarray(each) / factor for each, factor in zip((TIME_S, MOTION, LOAD), factors, strict=True)]
    order = draw(st.permutations(range(3)))
    extra = draw(st.booleans()) and separator != " "
    titles = [form.format(n, u) if "{" in form else n for n, u in zip(names, units, strict=True)]
    lines = draw(
        st.lists(st.sampled_from(["Test report", "Specimen properties : Length,10,mm", "", "Operator: me"]), max_size=3)
    )
    lines = [line.replace(",", separator) for line in lines]
    lines.append(separator.join([*(titles[i] for i in order), *(["Cycle"] if extra else [])]))
    if form.startswith("below"):
        wrap = "({})" if "brackets" in form else "{}"
        lines.append(separator.join([*(wrap.format(units[i]) for i in order), *([""] if extra else [])]))
    for row in zip(*columns, strict=True):
        cells = [repr(float(row[i])).replace(".", decimal) for i in order] + (["1"] if extra else [])
        lines.append(separator.join(cells))
    end = draw(st.sampled_from(["\n", "\r\n"]))
    text = end.join(lines) + draw(st.sampled_from(["", end, end * 3]))
    encoding = draw(st.sampled_from(["utf-8", "utf-8-sig", "cp1252", "utf-16"]))
    return text.encode(encoding)


@settings(
    max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow]
)
@given(tables())
def test_the_same_numbers_come_out(tmp_path, content):
    found = read(tmp_path, content)
    np.testing.assert_allclose(found.numbers, np.stack([TIME_S, MOTION, LOAD], axis=1), rtol=1e-12)
    assert [column.kind.what for column in found.columns] == ["time", "displacement", "force"]


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
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


@settings(max_examples=100, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(missing=st.integers(0, 2), spelling=st.sampled_from(["{0}", "{0} ()", "{0} [?]"]))
def test_a_unit_is_never_assumed(tmp_path, missing, spelling):
    titles = ["time (s)", "displacement (mm)", "force (N)"]
    titles[missing] = spelling.format(titles[missing].split()[0])
    content = ",".join(titles) + "\n0,0,0\n1,0.1,5\n2,0.2,9\n"
    with pytest.raises(BadInput) as refused:
        read(tmp_path, content)
    option = ["--time-unit", "--displacement-unit", "--force-unit"][missing]
    assume("?" not in spelling)
    assert option in str(refused.value)
    assert isinstance(refused.value, UnitUnknown)


def test_a_unit_that_is_given_is_used_and_must_not_contradict(tmp_path):
    bare = PLAIN.replace("force_N", "force")
    assert read(tmp_path, bare, force_unit="kN").numbers[-1, 2] == 9000
    assert read(tmp_path, PLAIN, force_unit="N").numbers[-1, 2] == 9
    with pytest.raises(BadInput, match="says kN; expected one and the same unit"):
        read(tmp_path, PLAIN, force_unit="kN")
    with pytest.raises(BadInput, match="says 'stone'"):
        read(tmp_path, bare, force_unit="stone")


@pytest.mark.parametrize(
    ("title", "kind", "factor"),
    [
        ("Strain (%)", STRAIN, 0.01),
        ("strain [mm/mm]", STRAIN, 1.0),
        ("Tensile strain (1)", STRAIN, 1.0),
        ("L/L0", STRETCH, 1.0),
        ("Stretch", STRETCH, 1.0),
        ("Position (mm)", POSITION, 1.0),
        ("Length (m)", LENGTH, 1000.0),
        ("Crosshead displacement, mm", DISPLACEMENT, 1.0),
        ("displacement in mm", DISPLACEMENT, 1.0),
        ("ΔL (µm)", DISPLACEMENT, 1e-3),
    ],
)
def test_kinds_of_motion(tmp_path, title, kind, factor):
    found = read(tmp_path, f'time_s,"{title}",force_N\n0,0.5,0\n1,0.6,5\n2,0.7,9\n')
    assert found.columns[1].kind is kind
    assert found.numbers[0, 1] == pytest.approx(0.5 * factor)


def test_a_strain_without_a_unit_may_be_percent(tmp_path):
    content = PLAIN.replace("displacement_mm", "strain")
    with pytest.raises(UnitUnknown, match="--displacement-unit, one of %"):
        read(tmp_path, content)
    assert read(tmp_path, content, displacement_unit="%").numbers[-1, 1] == pytest.approx(0.002)


@pytest.mark.parametrize(("unit", "factor"), [("kPa", 1e-3), ("MPa", 1.0), ("N/mm2", 1.0), ("mpa", 1.0)])
def test_a_stress(tmp_path, unit, factor):
    found = read(tmp_path, PLAIN.replace("force_N", f"stress ({unit})"))
    assert found.columns[2].kind is STRESS
    assert found.numbers[-1, 2] == pytest.approx(9 * factor)


@pytest.mark.parametrize("unit", ["mn", "MN"])
def test_millinewton_or_meganewton_is_asked(tmp_path, unit):
    with pytest.raises(UnitUnknown, match="two things"):
        read(tmp_path, PLAIN.replace("force_N", f"force ({unit})"))


def test_millipascals_are_no_megapascals(tmp_path):
    with pytest.raises(BadInput, match="mPa"):
        read(tmp_path, PLAIN.replace("force_N", "stress (mPa)"))


def test_displacement_goes_before_strain_and_force_before_stress_and_the_rest_is_told(tmp_path):
    content = "Stress (MPa),Strain (%),Time (s),Load (N),Extension (mm)\n9,8,0,7,6\n9,8,1,7,6\n9,8,2,7,6\n"
    found = read(tmp_path, content)
    assert found.numbers[0].tolist() == [0, 6, 7]
    assert found.left_out == ("Stress (MPa)", "Strain (%)")


def test_two_columns_alike_are_asked(tmp_path):
    content = "time_s,Force (N),displacement_mm,Force (N)\n0,1,2,3\n1,1,2,3\n2,1,2,3\n"
    with pytest.raises(BadInput, match=r"may both be the force; expected --force-column NUMBER"):
        read(tmp_path, content)
    assert read(tmp_path, content, force_column="4").numbers[0, 2] == 3


def test_no_titles_at_all(tmp_path):
    content = "0 0 0\n1 0.1 5\n2 0.2 9\n"
    with pytest.raises(BadInput, match="--time-column NAME or NUMBER"):
        read(tmp_path, content)
    units = {"time_unit": "s", "displacement_unit": "mm", "force_unit": "N"}
    found = read(tmp_path, content, time_column="1", displacement_column="2", force_column="3", **units)
    assert found.columns[2].kind is FORCE
    assert found.numbers[2].tolist() == [2, 0.2, 9]


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "empty"),
        (b"\n\n", "holds no text"),
        (b"\0\1\2" * 50, "not a text file"),
        (b"\xff\xfe\0", "UTF-16"),
        (b"a" * 200_000, "a line of 200,000 characters"),
        (PLAIN + "3,nan,9\n", "row 5, displacement_mm: 'nan'"),
        (PLAIN.replace("0,0,0", "0,NaN,0") + "3,0.3,9\n", "row 2: 'NaN' among numbers"),
        (PLAIN + "3,,9\n", "row 5, displacement_mm"),
        (PLAIN + "3,inf,9\n", "row 5, displacement_mm"),
        (PLAIN + "3,1e999,9\n", "row 5, displacement_mm"),
        (PLAIN + "\n3,0.3,9\n", "row 5"),
        (PLAIN + "the end\n", "row 5"),
        ("time_s;disp_mm;force_N\n0,5;1,5;2,5\n1,5;1,5;2,5\n2,5;1,5;2,5\n3,5;1.234;2,5\n", "row 5"),
        ("time_s,disp_mm,force_N\n0,5,1,5,2,5\n1,5,1,5,2,5\n2,5,1,5,2,5\n", "3 names above 6 columns"),
        ("time_s,force_N\n0,1\n1,2\n2,3\n", "three columns"),
        ("12:00:00,1,2\n12:00:01,1,2\n12:00:02,1,2\n", "no table of numbers"),
        ("time (h:m),disp (mm),force (N)\n0,1,2\n1,1,2\n2,1,2\n", "h:m"),
    ],
)
def test_hostile_files_are_refused_in_one_line(tmp_path, content, words):
    with pytest.raises(BadInput) as refused:
        read(tmp_path, content)
    assert words in str(refused.value)
    assert str(refused.value).isprintable()
