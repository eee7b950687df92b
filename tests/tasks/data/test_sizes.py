"""Sizes in the lines above a table."""

import re
from dataclasses import replace

import pytest

from sinew.tasks.data.sizes import Size, contradiction_of_areas, read_sizes, square_side
from tests.effort import at_most


def sizes(*lines: str) -> dict[str, float | None]:
    return {name: size.mm for name, size in read_sizes([tuple(line.split("|")) for line in lines]).items()}


@pytest.mark.parametrize(
    "lines",
    [
        ("Gauge length (mm)|12", "Width (mm)|8.5", "Thickness (mm)|4"),
        ("Operator: mk", "length_mm: 12", "width_mm: 8,5", "thickness_mm: 4"),
        ("Sample length = 1.2 cm", "Breite [mm]|8.5", "Dicke|4|mm"),
        ("Initial gauge length / mm|12", "Specimen width|8.5|(mm)", "Thickness: 4000 um"),
        ("Specimen properties : Length|12.0|mm", "Width|8.5|mm|cut by hand", "Épaisseur|0.4|CM"),
        ("length|1.2e1|mm", "Width|850e-2|mm", "Thickness|4|mm|"),
    ],
)
def test_lines_that_tell_sizes(lines):
    found = sizes(*lines)
    assert (found["length"], found["width"], found["thickness"]) == pytest.approx((12, 8.5, 4))


@pytest.mark.parametrize(
    "line",
    [
        *(
            "Length at break (mm)|12",
            "Length (mm)|about 12",
            "Length (N)|12",
            "Lengths|12|mm",
            "Parallel length:|30|mm",
        ),
        *("Cross-section after fracture:|8.76|mm²", "Capteur de course|"),
    ],
)
def test_lines_that_tell_no_size(line):
    assert sizes(line) == {}


@pytest.mark.parametrize("line", ["Length|ten|mm", "Length|0|mm", "Length|10.0|fur", "Length|-1|mm", "Length|1e9|mm"])
def test_a_size_that_makes_no_sense_is_kept_as_text(line):
    assert read_sizes([tuple(line.split("|"))])["length"].mm is None


@pytest.mark.parametrize(
    ("line", "name", "size"),
    [
        ("Probenbreite b0|11.4|mm", "width", 11.4),
        ("Largeur éprouvette|5.96|mm", "width", 5.96),
        ("Épaisseur éprouvette|1|mm", "thickness", 1.0),
        ("L0 - course standard|25|mm", "length", 25.0),
        ("Gage length, standard travel|30|mm", "length", 30.0),
        ("Specimen properties : Anvil height|6.08000|mm", "length", 6.08),
        ("Original cross-section:|19.65|mm²", "area", 19.65),
        ("Section|0.0596|cm²", "area", 5.96),
        ("Cross-sectional area: 0.3 cm²", "area", 30.0),
        ("Specimen : Area 3.159e-05 m²", "area", 31.59),
        ("Durchmesser :|100,1", "diameter", 100.1),
    ],
)
def test_labels_of_several_machines(line, name, size):
    assert sizes(line) == {name: pytest.approx(size)}


def test_sizes_in_a_table_of_results():
    labels, below = ("", "Fmax", "d0", "S0", "Le"), ("", "N", "mm", "mm²", "mm")
    found = read_sizes([labels, below, ("", "14839.9", "6", "28.27", "")])
    assert {name: size.mm for name, size in found.items()} == {"diameter": 6.0, "area": 28.27}
    assert read_sizes([labels, ("", "", "", "", ""), ("", "14839.9", "6", "28.27", "")]) == {}


@pytest.mark.parametrize(
    "labels",
    [
        ("Name", "Width (mm)", "Thickness, mm", "length_cm", "Area [mm2]"),
        ("№", "Ширина образца, мм", "Толщина, мм", "Рабочая длина, см", "Площадь сечения, мм2"),
    ],
)
def test_units_of_a_table_of_results_may_stand_in_its_titles(labels):
    numbers = ("A1", "10,02", "2.01", "5", "20.14")
    expected = {"width": 10.02, "thickness": 2.01, "length": 50.0, "area": 20.14}
    for rows in (
        [labels, numbers],
        [labels, numbers, numbers],
        [labels, numbers, ("Time", "Force")],
        [(), labels, numbers],
    ):
        assert {name: size.mm for name, size in read_sizes(rows).items()} == pytest.approx(expected)
    assert read_sizes([labels, numbers, ("A2", "9", "3", "4", "27")]) == {}  # of another specimen
    assert read_sizes([labels, (), numbers]) == {}
    assert read_sizes([tuple(label.split(",")[0].split(" (")[0] for label in labels[:3]), numbers[:3]]) == {}
    assert read_sizes([(f"{'of the ' * 9}Width (mm)",), ("3",)]) == {}


def test_a_size_without_a_unit_and_several_of_one_name():
    assert read_sizes([("Length", "12")])["length"] == Size(12.0, False, "12")
    assert sizes("Length|12", "Length|1|cm", "Length|10.05|mm") == {"length": 10.0}
    assert sizes("Length|ten", "Length|12") == {"length": 12.0}


@pytest.mark.parametrize(
    ("rows", "text"),
    [
        (("Length|20|mm", "Length|20|cm"), "20 mm and 20 cm"),
        (("Gauge length (mm)|40", "Operator: me", "Gauge length (mm)|25"), "40 mm and 25 mm"),
        (("Length|20", "Length|21"), "20 and 21"),
        (("Length|20|mm", "Length|20.3|mm"), "20 mm and 20.3 mm"),
    ],
)
def test_rows_that_contradict_each_other_tell_no_size(rows, text):
    found = read_sizes([tuple(row.split("|")) for row in rows])["length"]
    assert (found.mm, found.text) == (None, text)


@pytest.mark.parametrize(
    ("mm", "words"),
    [
        ({"area": 200.0, "width": 2.0, "thickness": 1.0}, "a cross-section of 200 mm2, but 2 x 1 mm is 2 mm2"),
        ({"diameter": 4.0, "width": 2.0, "thickness": 1.0}, "a diameter of 4 mm, but 2 x 1 mm is 2 mm2"),
        ({"diameter": 4.0, "area": 4.0}, "a cross-section of 4 mm2, but a diameter of 4 mm is 12.5664 mm2"),
        ({"diameter": 4.0, "area": 12.6, "length": 3.0}, ""),
        ({"area": 2.09, "width": 2.0, "thickness": 1.0}, ""),
        ({"area": 1.57, "width": 2.0, "thickness": 1.0}, ""),
        ({"diameter": 4.0, "width": 4.0, "thickness": 4.0}, ""),
        ({"area": 200.0, "width": 2.0}, ""),
        ({"area": 0.1, "width": 0.35, "thickness": 0.4}, ""),  # rounded: it may be 0.14
    ],
)
def test_cross_sections_that_contradict_each_other_are_said(mm, words):
    told = {name: Size(value, True, f"{value} mm") for name, value in mm.items()}
    assert contradiction_of_areas(told) == words
    without = {name: replace(size, has_unit=False) for name, size in told.items()}
    assert contradiction_of_areas(without) == "", "what is not taken contradicts nothing"


@pytest.mark.parametrize("row", ["Area (mm2) 12", "Area: 12 mm2", "Cross-sectional area (mm2)|12", "Area [cm2] = 0.12"])
def test_a_cross_section_has_its_unit_before_or_behind(row):
    assert sizes(row) == {"area": pytest.approx(12.0)}
    assert sizes("Area 12") == {}
    assert sizes("Area (mm2): 12 cm2") == {"area": None}


def test_own_cross_sections_go_before_those_of_all_tests():
    rows = [("Area (mm2)", "12"), ("Length", "20", "mm"), ("Width", "5", "mm"), ("Thickness", "1.2", "mm")]
    assert {name: size.mm for name, size in read_sizes(rows, own=2).items()} == {
        "length": 20.0,
        "width": 5.0,
        "thickness": 1.2,
    }
    alike = [("Area (mm2)", "6"), *rows[1:]]
    assert set(read_sizes(alike, own=2)) == {"area", "length", "width", "thickness"}


def test_a_round_bar_becomes_a_square_one_of_equal_area():
    assert square_side(2.0) ** 2 == pytest.approx(3.14159265, rel=1e-8)


def test_a_long_line_costs_no_time():
    with at_most(5):
        assert sizes("length" + " :" * 40_000, "gauge " * 30 + "lengt") == {}


@pytest.mark.parametrize(
    ("row", "name", "size"),
    [
        ("Length|12", "length", Size(12.0, False, "12")),
        ("Length :|12|mm", "length", Size(12.0, True, "12 mm")),
        ("Gauge length|1,2|mm|cut", "length", Size(1.2, True, "1,2 mm")),
        ("Diameter:| 3|cm", "diameter", Size(30.0, True, "3 cm")),
        ("Width|0.5|in", "width", Size(12.7, True, "0.5 in")),
        ("DICKE|2|MM", "thickness", Size(2.0, True, "2 MM")),
        ("Length|9999|mm", "length", Size(9999.0, True, "9999 mm")),
        ("Length|10000|mm", "length", Size(None, True, "10000 mm")),
        ("Length|0|mm", "length", Size(None, True, "0 mm")),
        ("Length|ten|mm|more", "length", Size(None, False, "ten mm")),
        ("Length|10|fur", "length", Size(None, False, "10 fur")),
        ("Length||mm", "length", Size(None, False, "mm")),
        ("Length", "length", Size(None, False, "")),
    ],
)
def test_a_size_is_kept_as_it_is_written(row, name, size):
    found = read_sizes([tuple(row.split("|"))])
    assert list(found) == [name]
    assert found[name].mm == pytest.approx(size.mm)
    assert (found[name].has_unit, found[name].text) == (size.has_unit, size.text)


def test_of_several_rows_the_first_with_number_and_unit_counts():
    rows = [("Width", "wide"), ("Width", "1"), ("Width", "2", "mm"), ("Width", "2.01", "mm"), ("Length", "4")]
    found = read_sizes(rows)
    assert found["width"].text == "2 mm"
    assert found["length"].text == "4"
    assert read_sizes(rows[:2])["width"].text == "1"
    assert read_sizes([("Width", "thin"), ("Width", "wide")])["width"].text == "thin"


def test_a_line_of_200_characters_tells_no_size():
    note = "sample " * 26 + "nr "
    assert sizes(f"{note}: Length 12 mm") == {"length": 12.0}
    assert sizes(f"{note}sample: Length 12 mm") == {}
    assert sizes(f"Length|12|mm|{'x' * 200}") == {"length": 12.0}, "what stands behind does not count"


def test_the_side_of_a_square_is_rounded_to_what_can_be_measured():
    assert square_side(2.0) == 1.772453851


def test_a_table_of_results_of_several_specimens_tells_no_size():
    """Nothing says which of its rows is of the test below."""
    labels, below = ("Specimen", "Width", "Length"), ("", "mm", "mm")
    assert read_sizes([labels, below, ("T1", "8.1", "10")])["width"].mm == 8.1
    found = read_sizes([labels, below, ("T1", "8.1", "10"), ("T2", "7.9", "10")])
    assert {name: size.mm for name, size in found.items()} == {"length": 10.0}


@pytest.mark.parametrize(("line", "mm"), [("Length: 0.01", None), ("Length: 0.01 m", 10.0), ("Width: 0.5", 0.5)])
def test_a_small_size_without_a_unit_may_be_in_metres(line, mm):
    (size,) = read_sizes([(line,)]).values()
    assert size.mm == mm


def test_of_very_many_rows_the_first_and_the_last_tell_sizes():
    """Above the last of many tables in one file, all the others stand."""
    others = [("0.1", "2.5")] * 600
    found = read_sizes([("Width: 5 mm",), *others, ("Thickness: 2 mm",), *others, ("Length: 30 mm",)])
    assert {name: size.mm for name, size in found.items()} == {"width": 5.0, "length": 30.0}
    assert read_sizes([("Width: 5 mm", *["x"] * 300)]) == {}


@pytest.mark.parametrize(
    ("line", "decimal", "mm"),
    [
        ("Gauge length|20,000 um", ".", None),
        ("Thickness|1,250|um", ".", None),
        ("Area (mm2)|1,520", ".", None),
        ("Gauge length: 1,000 mm", ".", None),
        ("Dicke|1.250|µm", ",", None),
        ("Gauge length|20.000|mm", ".", 20.0),
        ("Gauge length|20,000|mm", ",", 20.0),
        ("Gauge length|10,13|mm", ".", 10.13),
        ("Gauge length|0,500|mm", ".", 0.5),
        ("Gauge length|20,000 um", "", 0.02),
    ],
)
def test_marks_that_may_be_of_thousands_tell_no_size(line, decimal, mm):
    (found,) = read_sizes([tuple(line.split("|"))], 0, decimal).values()
    assert found.mm == (None if mm is None else pytest.approx(mm))
    assert found.text


def test_marks_of_thousands_in_a_table_of_results_tell_no_size():
    rows = [("", "Width", "Length"), ("", "mm", "mm"), ("1", "4.5", "1,200")]
    assert {name: size.mm for name, size in read_sizes(rows, 0, ".").items()} == {"width": 4.5, "length": None}


@pytest.mark.parametrize(
    "line",
    ["Punch: diameter 10 mm", "Grips: width 50 mm", "Tolerance : Width : 0.1 mm", "Load cell: diameter 20 mm",
     "After test: Length 25 mm", "Extensometer: gauge length 25 mm", "Previous specimen: width 8 mm"],
)  # fmt: skip
def test_sizes_of_other_things_are_none_of_the_specimen(line):
    assert read_sizes([(line,)]) == {}
    label, number, unit = re.fullmatch(r"(.*?):? ([\d.]+) (mm)", line).groups()
    assert read_sizes([(label.replace(": ", " : "), number, unit)]) == {}


@pytest.mark.parametrize(
    "line", ["Specimen properties : Length 14.33 mm", "Dimensions: Length 14.33 mm", "Length 14.33 mm"]
)
def test_sizes_of_the_specimen_may_say_so(line):
    assert read_sizes([(line,)])["length"].mm == 14.33


def test_two_numbers_in_a_row_tell_no_size():
    assert read_sizes([("Width", "5", "mm", "6", "mm")])["width"].mm is None
    assert read_sizes([("Width", "5", "mm")])["width"].mm == 5.0


def test_a_long_line_of_digits_takes_no_time():
    with at_most(5):
        read_sizes([("1" * 190,), ("1 " * 95,), ("test " * 38,)])


def test_sizes_in_polish():
    rows = [("Właściwości próbki : Długość", "25,0", "mm"), ("Odkształcenie : Odkształcenie 1 długość", "10,0", "mm")]
    assert {name: size.mm for name, size in read_sizes(rows, decimal=",").items()} == {"length": 25.0}


def test_the_height_of_a_round_specimen_is_its_length():
    assert sizes("Durchmesser [mm]:|100", "Höhe [mm]:|98,6") == {"length": 98.6, "diameter": 100.0}
    assert sizes("Specimen height|4|mm", "Diameter (mm)|8") == {"length": 4.0, "diameter": 8.0}
    for rows in (
        ("Height (mm)|4", "Width (mm)|8", "Diameter (mm)|8"),  # perhaps a side of the cross-section
        ("Height (mm)|4", "Diameter (mm)|0"),
        ("Height|4", "Diameter (mm)|8"),
        ("Probe height|30|mm", "Diameter (mm)|8"),  # of the machine
        ("Height: 10 mm|||Height: 12 mm", "Diameter (mm)|8"),
        ("Height (mm)|4", "Diameter (mm)|8", "Height (mm)|5"),
    ):
        assert "length" not in sizes(*rows), rows
    assert sizes("Height (mm)|4", "Diameter (mm)|8", "Length (mm)|5") == {"length": 5.0, "diameter": 8.0}
    own = [("Diameter: 8 mm",), ("Operator: me",), ("Height: 12 mm",)]
    assert {name: size.mm for name, size in read_sizes(own, 2).items()} == {"length": 12.0, "diameter": 8.0}


def test_the_length_of_strains_by_the_displacement_is_the_gauge_length():
    line = "Strain : Tensile strain ({}) gauge length|100.00000|mm"
    assert sizes(line.format("Extension")) == sizes(line.format("Displacement")) == {"length": 100.0}
    assert sizes(line.format("Strain 1")) == {}, "that of an extensometer"
    assert sizes("Strain : Tensile strain (Extension) gauge length (in)|4") == {"length": pytest.approx(101.6)}


def test_sizes_in_german():
    assert sizes("Abmessung : Querschnitt|3,45000|mm^2") == {"area": 3.45}


GEOMETRY = ("Geometry", "Rectangular (Length, Width, Thickness)")


def test_sizes_of_ta_instruments_have_their_names_in_another_row():
    found = read_sizes([GEOMETRY, ("Size", "10.3336", "5.51", "0.03", "mm")])
    assert {name: size.mm for name, size in found.items()} == {"length": 10.3336, "width": 5.51, "thickness": 0.03}
    assert all(size.has_unit for size in found.values())
    for shape, size in (
        (GEOMETRY, ("Size", "10.3336", "5.51")),
        (("Geometry", "Rectangular (Length, Span, Thickness)"), ("Size", "10.3336", "5.51", "0.03", "mm")),
        (("Sample", "foil"), ("Size", "10.3336", "5.51", "0.03", "mm")),
    ):
        assert not read_sizes([shape, size])


@pytest.mark.parametrize(("area", "length"), [("4200", 150.0), ("4210", 150.0), ("22500", None), ("", None)])
def test_a_height_beside_a_cross_section_is_the_length(area, length):
    labels = ("Height", "Thickness", "Width", "Area")
    header = [labels, ("(mm)", "(mm)", "(mm)", "(mm^2)"), ("150.00", "28.00", "150.00", area)]
    found = read_sizes(header)
    assert (found["length"].mm if "length" in found else None) == length


def test_a_label_in_front_of_units_is_none_of_a_size():
    rows = [("Name:", "Thickness", "Width", "Gauge Length"), ("Size Unit:", "mm", "mm", "mm"), ("a", "4", "7", "30.99")]
    found = {name: size.mm for name, size in read_sizes([*rows, ("b", "4", "7", "30.99")]).items()}
    assert found == {"thickness": 4.0, "width": 7.0, "length": 30.99}
