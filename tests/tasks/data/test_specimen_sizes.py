"""Sizes of new specimens: given, told by files, or asked for."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sinew.runner.errors import BadInput
from sinew.tasks.data.curves import Bar, curve_of
from sinew.tasks.data.hints import Hints
from sinew.tasks.data.recording import Recording
from sinew.tasks.data.recordings import read_recordings
from sinew.tasks.data.sizes import square_side
from sinew.tasks.data.specimen_sizes import Known, Sizes, ask_for_sizes, known_sizes


def recording(folder: Path, *lines: str, name: str = "a.csv") -> Recording:
    path = folder / name
    path.write_text("\n".join([*lines, "Time (s),Stroke (mm),Load (N)", "0,0,1", "1,1,2", "2,2,3", ""]))
    return read_recordings(path, Hints())[0]


def person(*answers: str) -> tuple[Callable[[str, Sequence[str]], str], list[str]]:
    """Somebody who gives these answers one after the other, and the questions."""
    asked: list[str] = []
    left = list(answers)

    def ask(question: str, choices: Sequence[str]) -> str:
        asked.append(question)
        return left.pop(0)

    return ask, asked


def test_a_size_that_the_file_contradicts_is_refused_unless_it_shall_count(tmp_path):
    measured = recording(tmp_path, "Width,8.0956,mm", "Length,1,cm")
    with pytest.raises(BadInput) as told:
        known_sizes("a", [measured], Sizes(width_mm=5.0))
    assert str(told.value) == (
        f"{measured.path}: a width of 8.0956 mm, but --width-mm says 5; expected a width for each file "
        "that has none (--answers), or --override to use it all the same"
    )
    known = known_sizes("a", [measured], Sizes(width_mm=5.0, override=True))
    assert known.mm == {"length": 10.0, "width": 5.0, "thickness": None}
    assert known.notes == ("width 5 mm by --width-mm; a.csv gives 8.0956 mm",)


@pytest.mark.parametrize("given", [8.0956, 8.1])
def test_a_rounded_size_is_no_contradiction(tmp_path, given):
    known = known_sizes("a", [recording(tmp_path, "Width,8.0956,mm")], Sizes(width_mm=given))
    assert known == Known({"length": None, "width": given, "thickness": None})


def test_only_what_nobody_tells_is_asked_for_specimen_by_specimen():
    known = {
        "A": Known({"length": 10.0, "width": None, "thickness": 1.0}),
        "B": Known({"length": None, "width": None, "thickness": 2.0}, ("a note",)),
    }
    ask, asked = person("8,5", "12", "")
    assert ask_for_sizes(known, ask) == {
        "A": Known({"length": 10.0, "width": 8.5, "thickness": 1.0}, told={"width": 8.5}),
        "B": Known({"length": 12.0, "width": None, "thickness": 2.0}, ("a note",), {"length": 12.0}),
    }
    assert [question.split(" (")[0] for question in asked] == [
        "width of A in mm?", "length of B in mm?", "width of B in mm?",
    ]  # fmt: skip


@pytest.mark.parametrize(("answer", "value"), [("7 all", 7.0), ("all", None), ("7.5all", 7.5)])
def test_an_answer_may_hold_for_all_that_are_left(answer, value):
    known = {name: Known({"length": 1.0, "width": None, "thickness": 1.0}) for name in "ABC"}
    ask, asked = person("5", answer)
    found = ask_for_sizes(known, ask)
    assert [found[name].mm["width"] for name in "ABC"] == [5.0, value, value]
    assert "'all' behind it: for all 2 that are left" in asked[1]


def test_a_round_specimen_is_answered_by_its_diameter():
    known = {name: Known(dict.fromkeys(("length", "width", "thickness"))) for name in "ABC"}
    ask, asked = person("10 all", "d 8", "d8,5 all")
    found = ask_for_sizes(known, ask)
    assert "'d 8': round, with a diameter of 8" in asked[1]
    for name, diameter in {"A": 8.0, "B": 8.5, "C": 8.5}.items():
        mm = found[name].mm
        assert mm["width"] == mm["thickness"] == pytest.approx(diameter * np.sqrt(np.pi / 4))
    assert len(asked) == 3


@pytest.mark.parametrize("wrong", ["ten", "-1", "0", "nan", "1e9", "3 mm"])
def test_an_answer_that_is_no_size_is_asked_for_again(wrong):
    ask, asked = person(wrong, "3")
    found = ask_for_sizes({"A": Known({"length": None, "width": 1.0, "thickness": 1.0})}, ask)
    assert found["A"].mm["length"] == 3.0
    assert asked[1].startswith(f"'{wrong}' is no number of millimetres. length of A")


def test_what_the_name_of_a_file_may_say_is_proposed_and_not_taken(tmp_path):
    known = known_sizes("T1", [recording(tmp_path, "Width,9,mm", name="T1_L10mm_W8mm.csv")], Sizes())
    assert known.mm == {"length": None, "width": 9.0, "thickness": None}
    assert known.proposals == ("length may be 10 mm by the name of the file; it is not taken",)
    ask, asked = person("", "")
    found = ask_for_sizes({"T1": known}, ask)
    assert asked[0] == "length of T1 in mm? (empty: fill it in later; the name of the file may say 10)"
    assert found["T1"].mm["length"] is None


def test_a_diameter_stands_for_width_and_thickness():
    sizes = Sizes.of(10.0, None, None, 8.0, override=False)
    assert sizes.length_mm == 10.0
    assert sizes.width_mm == sizes.thickness_mm == pytest.approx(8.0 * np.sqrt(np.pi / 4))
    assert Sizes.of(1.0, 2.0, 3.0, None, override=True) == Sizes(1.0, 2.0, 3.0, True)
    with pytest.raises(BadInput, match="--diameter-mm: given beside a width, a thickness or another size"):
        Sizes.of(None, 1.0, None, 8.0, override=False)
    with pytest.raises(BadInput, match="--diameter-mm: -8; expected at least 1e-06"):
        Sizes.of(None, None, None, -8.0, override=False)


def test_a_size_that_contradicts_a_given_diameter_names_the_diameter(tmp_path):
    measured = recording(tmp_path, "Width,8.0956,mm", "Length,1,cm")
    given = Sizes.of(10.0, None, None, 6.0, override=False)
    said = r"a width of 8.0956 mm, but --diameter-mm 6 \(a square of equal area\) says 5.31736; expected"
    with pytest.raises(BadInput, match=said):
        known_sizes("T1", [measured], given)


def test_a_thickness_that_is_known_leaves_no_room_for_a_diameter():
    none = dict.fromkeys(("length", "width", "thickness"))
    known = {"A": Known({**none, "length": 1.0}), "B": Known({**none, "length": 1.0, "thickness": 3.0})}
    ask, asked = person("D8 all", "d 8", "7")
    found = ask_for_sizes(known, ask)
    assert found["A"].mm["width"] == found["A"].mm["thickness"] == pytest.approx(8.0 * np.sqrt(np.pi / 4))
    assert found["B"].mm == {"length": 1.0, "width": 7.0, "thickness": 3.0}
    assert "diameter" not in asked[1]
    assert asked[2].startswith("'d 8' is no number of millimetres")


def test_a_cross_section_stands_for_width_and_thickness(tmp_path):
    sizes = Sizes.of(10.0, None, None, None, 50.0, override=False)
    assert sizes.length_mm == 10.0
    assert sizes.width_mm == sizes.thickness_mm == pytest.approx(np.sqrt(50.0))
    for width, thickness, diameter in ((1.0, None, None), (None, 1.0, None), (None, None, 1.0)):
        with pytest.raises(BadInput, match="given beside a width, a thickness or another size; expected one of them"):
            Sizes.of(None, width, thickness, diameter, 50.0, override=False)
    with pytest.raises(BadInput, match=r"--area-mm2: 0; expected at least 1e-12 and below 1e\+08 mm2"):
        Sizes.of(None, None, None, None, 0.0, override=False)
    measured = recording(tmp_path, "Width,8.0956,mm", "Length,1,cm")
    with pytest.raises(BadInput, match=r"a width of 8.0956 mm, but --area-mm2 50 \(a square of equal area\) says 7.07"):
        known_sizes("T1", [measured], sizes)


@pytest.mark.parametrize("size", ["length_mm", "width_mm", "thickness_mm", "diameter_mm"])
def test_a_size_below_any_is_refused(size):
    given = {"length_mm": None, "width_mm": None, "thickness_mm": None, "diameter_mm": None} | {size: 1e-300}
    with pytest.raises(BadInput, match=f"--{size.replace('_', '-')}: 1e-300; expected at least 1e-06 and below 10000"):
        Sizes.of(**given, override=False)


def test_a_round_specimen_is_told(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("Diameter,5.61,mm\nTime (s),Extension (mm),Load (N)\n0,0,0\n1,0.1,5\n2,0.2,9\n")
    (recording,) = read_recordings(path, Hints())
    said = "round, diameter 5.61 mm: counted as a square of equal area"
    assert said in known_sizes("a", [recording], Sizes(length_mm=10.0)).notes
    other = known_sizes("a", [recording], Sizes(10.0, 5.0, 5.0, override=True))
    assert said not in other.notes
    assert curve_of(recording, Bar(10.0, square_side(5.61), square_side(5.61)), "pull").source.endswith(f"; {said}")
    assert said not in curve_of(recording, Bar(10.0, 5.0, 5.0), "pull").source


def test_a_size_without_a_unit_is_told_whatever_is_given(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("Durchmesser : 100.1\nTime (s),Extension (mm),Load (N)\n0,0,0\n1,0.1,5\n2,0.2,9\n")
    (recording,) = read_recordings(path, Hints())
    said = (
        "a.csv gives a diameter of '100.1' without a unit, so it is not used; if it is in mm, give --diameter-mm 100.1"
    )
    assert said in known_sizes("a", [recording], Sizes()).notes
    assert known_sizes("a", [recording, recording], Sizes(20.0, 10.0, 10.0)).notes == (said,)


@pytest.mark.parametrize(("area", "told"), [(50.0, True), (7.5, False), (7.8, False), (7.0, True)])
def test_a_cross_section_that_contradicts_given_sizes_is_refused(tmp_path, area, told):
    test = recording(tmp_path, "Gauge length: 20 mm", f"Cross-sectional area: {area:g} mm²")
    given = {"width_mm": 5.0, "thickness_mm": 1.5}
    if not told:
        assert known_sizes("a", [test], Sizes(**given)).mm == {"length": 20.0, "width": 5.0, "thickness": 1.5}
        return
    problem = f"a cross-section of {area:g} mm2, but 5 x 1.5 mm is 7.5 mm2; expected sizes that agree, or --override"
    with pytest.raises(BadInput, match=problem):
        known_sizes("a", [test], Sizes(**given))
    with pytest.raises(BadInput, match=problem):
        known_sizes("a", [test], Sizes(), {"width": 5.0, "thickness": 1.5})
    found = known_sizes("a", [test], Sizes(**given, override=True))
    assert any(note.startswith(f"a.csv gives a cross-section of {area:g} mm2, but") for note in found.notes)


def test_a_cross_section_alone_is_that_of_a_square(tmp_path):
    test = recording(tmp_path, "Gauge length: 20 mm", "Cross-sectional area: 30.25 mm²")
    found = known_sizes("a", [test], Sizes())
    assert found.mm == {"length": 20.0, "width": 5.5, "thickness": 5.5}
    assert "cross-section 30.25 mm2: width and thickness are those of a square" in found.notes
    assert known_sizes("a", [test], Sizes(width_mm=5.0)).mm["thickness"] is None, "the width is not that of a square"
    open_ = recording(tmp_path, "Gauge length: 20 mm", "Width, 4", "Cross-sectional area: 30.25 mm²")
    assert known_sizes("a", [open_], Sizes()).mm["width"] is None, "a width without a unit is to be asked for"
    other = replace(test, sizes={**test.sizes, "area": replace(test.sizes["area"], mm=31.0)})
    assert known_sizes("a", [test, other], Sizes()).mm["width"] is None, "two files tell two"


def test_the_cross_section_of_an_ellipse_is_told(tmp_path):
    test = recording(tmp_path, "Gauge length: 20 mm", "Cross-sectional area: 5.9 mm²")
    found = known_sizes("a", [test], Sizes(width_mm=5.0, thickness_mm=1.5))
    assert "a.csv gives 5.9 mm2, as of an ellipse 5 x 1.5 mm; the cross-section of the bar is 7.5 mm2" in found.notes


def test_sizes_of_a_file_that_contradict_each_other_are_told(tmp_path):
    test = recording(tmp_path, "Width: 4 mm", "Thickness: 2 mm", "Cross-sectional area: 50 mm²")
    expected = (
        "gives a cross-section of 50 mm2, but 4 x 2 mm is 8 mm2; expected sizes that agree, or --width-mm and --t"
    )
    with pytest.raises(BadInput, match=expected):
        known_sizes("a", [test], Sizes())
    with pytest.raises(BadInput, match=expected):
        known_sizes("a", [test], Sizes(width_mm=4.0, override=True))
    found = known_sizes("a", [test], Sizes(width_mm=4.0, thickness_mm=2.0, override=True))
    assert found.notes == ("a.csv gives a cross-section of 50 mm2, but 4 x 2 mm is 8 mm2",)
    test = recording(tmp_path, "Diameter: 4 mm", "Width: 2 mm", "Thickness: 1 mm")
    with pytest.raises(BadInput, match="a diameter of 4 mm, but 2 x 1 mm is 2 mm2"):
        known_sizes("a", [test], Sizes())


def test_a_size_that_is_told_in_two_ways_is_left_open_with_a_note(tmp_path):
    test = recording(tmp_path, "Gauge length: 40 mm", "Gauge length: 25 mm")
    found = known_sizes("a", [test], Sizes())
    assert found.mm["length"] is None
    assert found.notes == ("a.csv gives a length of '40 mm and 25 mm', which is not used",)


def test_thousands_in_a_size_are_told_and_not_taken(tmp_path):
    found = known_sizes("a", [recording(tmp_path, 'Gauge length,"20,000 um"', "Width,5.5,mm")], Sizes())
    assert found.mm == {"length": None, "width": 5.5, "thickness": None}
    assert found.notes == ("a.csv gives a length of '20,000 um', which is not used",)
