"""Titles and units above a table, and what may stand between them and the numbers."""

import pytest

from sinew.runner.errors import BadInput
from sinew.tasks.data.heads import Head, as_wide, head_of, is_bracketed
from sinew.tasks.data.hints import Hints
from sinew.tasks.data.recordings import read_recordings

TITLES, UNITS = ("Time", "Disp", "Force"), ("s", "mm", "N")


def head(*lines: str) -> Head:
    rows = [tuple(cell.strip() for cell in line.split(",")) for line in lines]
    return head_of(rows, len(rows) - 1)


@pytest.mark.parametrize(
    "lines",
    [
        ("Time,Disp,Force", "s,mm,N"),
        ("Time,Disp,Force", ",,", "s,mm,N"),
        ("Time,Disp,Force", "s,mm,N", "float,float,float"),
        ("Time,Disp,Force", "s,mm,N", "Sensor A,Sensor B,", "double,double,double"),
        ("s,mm,N", "Time,Disp,Force"),
        ("Channel 1,Channel 2,Channel 3", "Time,Disp,Force", "s,mm,N"),
    ],
)
def test_titles_and_units_are_found_above_and_below_each_other(lines):
    found = head("Operator,me", *lines)
    assert (found.titles, found.units) == (TITLES, UNITS)
    assert found.top == 1 + min(lines.index(row) for row in ("Time,Disp,Force", "s,mm,N"))


@pytest.mark.parametrize("units", [("", *UNITS), UNITS, ()])
def test_a_mark_of_a_comment_is_no_title_of_a_column(units):
    rows = [("0", "1", "2"), ("1", "2", "3")]
    assert as_wide(Head(("#", *TITLES), units, 4), rows) == Head(TITLES, units[-3:], 4)
    assert as_wide(Head(("#", *TITLES), units, 4), [*rows, ("1", "2", "3", "4")]).titles == ("#", *TITLES)


def test_numbers_beside_units_do_not_make_them_titles():
    found = head("Time,Disp,Force,,20", "s,mm,N,,10.78")
    assert (found.titles, found.units, found.top) == ((*TITLES, "", "20"), (*UNITS, "", ""), 0)
    strains = head("Time,Disp,Strain,Force,,20", "s,mm,1,N,,10.78")
    assert strains.units == ("s", "mm", "1", "N", "", ""), "a strain may be told in 1"
    assert head("Place,Name,Number,,20", "s,mm,N,,10.78").units == (), "no titles of a test above"
    assert head("Time,Disp,Force,,20", "1,mm,3,,10.78").units == (), "a row of numbers"


def test_one_unit_that_nobody_knows_may_stand_among_others():
    found = head("Axial Displacement,Axial Force,Running Time,Axial Count", "mm,kN,Sec,segments")
    assert found.units == ("mm", "kN", "Sec", "segments")
    assert head("MTS,of,May,Lab", "mm,kN,Sec,segments").titles == ("mm", "kN", "Sec", "segments"), "no title above"
    assert head("Time,Disp,,Count", "mm,kN,Sec,segments").units == (), "one of them has no title"


def test_texts_between_titles_and_numbers_are_passed_over_where_titles_are_known():
    assert head("Time [s],Force [N],Disp [mm]", "T0 = 3,MX 1,MX 2", "10 Hz,U9C,WA20").titles[0] == "Time [s]"
    assert head("a,b,c", "10 Hz,U9C,WA20").titles == ("10 Hz", "U9C", "WA20")
    assert head("Time,Disp,Force", "1,2,3", "x,y,z").titles == ("x", "y", "z"), "those of another table"
    assert head("Time,Disp,", "x,y,z").titles == ("x", "y", "z"), "a column would have no title"


@pytest.mark.parametrize(
    "lines",
    [
        ("ChannelTitle=,Force,Length", "Range=,10 V,10 V", "UnitName=,mN,mm", "TopValue=,100,10"),
        ("Kanalname,Force,Length", "Einheit,mN,mm"),
        ("Units:,mN,mm", "Names:,Force,Length"),
    ],
)
def test_rows_may_say_what_they_hold(lines):
    found = head("Sample=,T1", *lines)
    assert (found.titles, found.units) == (("", "Force", "Length"), ("", "mN", "mm"))
    assert found.top == 1


def test_titles_may_be_listed_one_in_a_row():
    lines = ("Nsig,3", "Sig1,Time (min)", "Sig2,Static Force (N)", "Sig3,Displacement (µm)", "OrgFile,a")
    found = head("Instrument,DMA", *lines, "StartOfData")
    assert found == Head(("Time (min)", "Static Force (N)", "Displacement (µm)"), (), 2)
    assert head("Instrument,DMA", "StartOfData").titles == ("StartOfData",)


def test_a_row_of_names_alone_is_no_label():
    assert head("Name,Time,Force", "T1,s,N").titles == ("Name", "Time", "Force")
    assert head("Name,Time,Force").titles == ("Name", "Time", "Force")


def test_rows_of_nothing_but_a_mark_are_passed_over():
    titles = ("time(s)", "disp(mm)", "force(N)")
    assert head_of([titles, (), ()], 2) == Head(titles, (), 0)
    assert head_of([TITLES, UNITS, ()], 2) == Head(TITLES, UNITS, 0)
    assert head_of([(), ()], 1) == Head()


def test_no_row_is_above():
    assert head_of([], -1) == Head()
    assert head("Time,Disp,Force") == Head(TITLES, (), 0)


def test_text_in_brackets():
    assert is_bracketed("(N)")
    assert is_bracketed("[N)")
    assert is_bracketed("()")
    assert not is_bracketed("(")
    assert not is_bracketed("(N")
    assert not is_bracketed("(X")
    assert not is_bracketed("X)")
    assert not is_bracketed("N)")
    assert not is_bracketed("")


@pytest.mark.parametrize("row", ["x1,x1,x1000", "*1,*1,*0.001", "x 1,x 1,x 1e3", "10^0,10^0,10^3"])
def test_a_row_of_factors_is_refused(tmp_path, row):
    path = tmp_path / "test.csv"
    numbers = "".join(f"{i},{i},{i}\n" for i in range(20))
    path.write_text(f"Time,Extension,Force\ns,mm,N\n{row}\n{numbers}")
    with pytest.raises(BadInput, match=r"row 3: '.*' above the numbers may be factors of the columns"):
        read_recordings(path, Hints())


def test_units_of_other_quantities_are_units():
    for units in ("s,\u00b5N.m,rad", "s,N.m,°", "s,Hz,°C"):
        assert head("Time,Torque,Displacement", units).units == tuple(units.split(","))


def test_a_word_above_a_unit_in_brackets_is_its_title():
    found = head("Point 1,,Strain,Stress", "x [%],y [%],[%],[MPa]")
    assert found.titles == ("x [%]", "y [%]", "Strain [%]", "Stress [MPa]")
    assert head("Point 1,,Strain,Stress", "x [%],y [%],[1],[see below]").titles[2:] == ("Strain [1]", "[see below]")
    assert head("x [%],y [%],[%],[MPa]").titles == ("x [%]", "y [%]", "[%]", "[MPa]")


def test_a_remark_behind_units_needs_no_title():
    assert head("Time,Gap,Force,", "s,µm,N,video") == Head(("Time", "Gap", "Force", ""), ("s", "µm", "N", "video"), 0)
    assert head("Time,Gap,,", "s,µm,N,video").titles == ("s", "µm", "N", "video")
