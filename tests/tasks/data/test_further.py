"""Columns that are kept beside the force: their units, gaps and names, in files of one test and of several."""

import numpy as np
import pytest

from sinew.runner.errors import BadInput
from sinew.tasks.data.answers import read_answers
from sinew.tasks.data.cohort import read_cohort
from sinew.tasks.data.exports import Reading, read_exports
from sinew.tasks.data.hints import Hints, further
from sinew.tasks.data.init import init
from sinew.tasks.data.specimen_sizes import Sizes
from sinew.tasks.study.cohort import cohort_of
from sinew.tasks.study.study import read_study

TIMES = np.arange(12) / 10
SEEN = [f"{-0.4 * t:.3f}" if number % 2 == 0 else "" for number, t in enumerate(TIMES)]  # a camera at half the rate


def written(folder, title="Lateral strain (%)", cells=SEEN, name="T1.csv", units="", above=""):
    head = f"{above}Time (s),Displacement (mm),Force (N),Cycle,{title}\n{units}"
    rows = [f"{t:g},{0.1 * t:g},{3 * t:g},1,{cell}" for t, cell in zip(TIMES, cells, strict=True)]
    path = folder / name
    path.write_text(head + "\n".join(rows) + "\n", "utf-8")
    return path


def read(*paths, keep=("Lateral strain=lateral_strain",), **reading):
    hints = Hints(keep_column=keep)
    return read_exports(list(paths), reading=Reading(length_mm=10.0, area_mm2=4.0, hints=hints, **reading))


def column(*paths, keep=("Lateral strain=lateral_strain",)):
    (name,) = [further(one).name for one in keep]
    return read(*paths, keep=keep).specimens[0].curves[0].others[name]


def test_a_column_is_kept_with_its_gaps_and_in_a_known_unit(tmp_path):
    found = column(written(tmp_path))
    np.testing.assert_allclose(found[::2], -0.004 * TIMES[::2], atol=1e-12)
    assert np.isnan(found[1::2]).all()


@pytest.mark.parametrize(
    ("title", "units", "keep", "factor"),
    [
        ("Lateral strain (1)", "", "Lateral strain=lateral_strain", 1.0),
        ("Lateral strain", "s,mm,N,-,%\n", "Lateral strain=lateral_strain", 0.01),
        ("Lateral strain (%)", "", "Lateral strain (%)=lateral_percent", 1.0),
        ("Lateral strain", "", "Lateral strain=lateral_strain:%", 0.01),
        ("Lateral strain", "", "5=lateral_strain:1", 1.0),
        ("Width [µm]", "", "Width=width_change_mm", 1e-3),
        ("Width (mm)", "", "Width=width_um", 1e3),
        ("Width (mm)", "", "width=width", 1.0),
        ("Width (in)", "", "Width=width", 25.4),
        ("Temperature (°C)", "", "Temperature=temperature:1", 1.0),
        ("a=b (kPa)", "", "a=b=pressure", 1e-3),
    ],
)
def test_units_are_those_of_the_title_or_the_row_below_or_told(tmp_path, title, units, keep, factor):
    found = column(written(tmp_path, title, units=units), keep=(keep,))
    np.testing.assert_allclose(found[::2], -0.4 * factor * TIMES[::2], atol=1e-9 * factor)


@pytest.mark.parametrize(
    ("title", "keep", "words"),
    [
        ("Lateral strain", "Lateral strain=lateral_strain", "'Lateral strain': no unit can be found; expected --keep-"),
        (
            "Angle (grad)",
            "Angle=angle",
            "'Angle (grad)': unit 'grad' is not clear or not known; expected --keep-column",
        ),
        ("Load (MN)", "Load=load", "unit 'MN' is not clear or not known"),
        ("Width (mm)", "Width=width:um", "unit 'mm', but --keep-column says um; expected one and the same unit"),
        ("Width (mm)", "Width=width:furlong", "unit 'furlong' of width; expected a unit such as mm"),
        ("Width (mm)", "Width=width_N", "is in mm, but width_N ends in N"),
        ("Lateral strain (%)", "Lateral strain=strain_mm", "has no unit, but strain_mm ends in mm"),
        ("Width (mm)", "Depth=depth", "no file has numbers in a column 'Depth'; expected one of 'Cycle', 'Width (mm)'"),
        ("Width (mm)", "Width", "'Width'; expected TITLE=NAME or TITLE=NAME:UNIT"),
        ("Width (mm)", "Width=force", "'Width=force'; expected TITLE=NAME"),
        ("Width (mm)", "Width=force_N", "'Width=force_N'; expected TITLE=NAME"),
        ("Width (mm)", "Width=a b", "'Width=a b'; expected TITLE=NAME"),
    ],
)
def test_what_is_not_clear_is_one_line(tmp_path, title, keep, words):
    path = written(tmp_path, title)
    with pytest.raises(BadInput) as refused:
        read(path, keep=(keep,))
    assert words in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_name_is_used_once():
    with pytest.raises(BadInput, match="two columns called 'a'"):
        Hints(keep_column=("x=a", "y=a"))


def test_a_cell_that_is_no_number_is_named(tmp_path):
    path = written(tmp_path, cells=[*SEEN[:4], "lost", *SEEN[5:]])
    with pytest.raises(BadInput, match=r"'Lateral strain \(%\)', row 6: 'lost'; expected a number, or an empty cell"):
        read(path)


def test_files_without_the_column_are_read_with_a_remark(tmp_path):
    paths = (
        written(tmp_path),
        written(tmp_path, "Other (N)", name="T2.csv"),
        written(tmp_path, cells=[""] * 12, name="T3.csv"),
    )
    for number, path in enumerate(paths):  # no two with the same numbers
        path.write_text(path.read_text().replace("\n0,0,0,", f"\n0,0,{number / 100:g},"))
    found = read(*paths)
    assert [list(one.curves[0].others) for one in found.specimens] == [["lateral_strain"], [], []]
    assert found.remarks["T2/test"] == ("no column 'Lateral strain' to keep",)
    assert found.remarks["T3/test"] == ("'Lateral strain' is empty: not kept",)


def test_tests_beside_each_other_have_columns_of_their_own(tmp_path):
    titles = "Time (s),Extension (mm),Load (N),Lateral strain (%)"
    rows = [f"{t:g},{0.1 * t:g},{3 * t:g},{-t:g},{t:g},{0.2 * t:g},{5 * t:g},{-2 * t:g}" for t in TIMES]
    (tmp_path / "both.csv").write_text("\n".join([f"{titles},{titles}", *rows]) + "\n")
    one, two = read(tmp_path / "both.csv").specimens
    np.testing.assert_allclose(one.curves[0].others["lateral_strain"], -0.01 * TIMES, atol=1e-12)
    np.testing.assert_allclose(two.curves[0].others["lateral_strain"], -0.02 * TIMES, atol=1e-12)


@pytest.mark.parametrize("wanted", ["Strain 1 (%)", "Strain 2 (%)", "Strain", "4", "8"])
def test_tests_with_numbered_titles_have_columns_of_their_own(tmp_path, wanted):
    one, two = read(numbered(tmp_path), keep=(f"{wanted}=lateral",)).specimens
    np.testing.assert_allclose(one.curves[0].others["lateral"], -0.01 * TIMES, atol=1e-12)
    np.testing.assert_allclose(two.curves[0].others["lateral"], -0.02 * TIMES, atol=1e-12)


@pytest.mark.parametrize("wanted", ["Temperature (1)", "9"])
def test_one_column_is_that_of_all_tests_beside_each_other(tmp_path, wanted):
    one, two = read(numbered(tmp_path, more=("Temperature (1)",)), keep=(f"{wanted}=warmth",)).specimens
    assert one.curves[0].others["warmth"].tolist() == two.curves[0].others["warmth"].tolist() == [9.0] * 12


def test_columns_that_are_neither_for_each_test_nor_for_all_are_refused(tmp_path):
    path = numbered(tmp_path, more=("Cam 1 (1)", "Cam 2 (1)", "Cam 3 (1)"))
    with pytest.raises(BadInput, match=r"'9' names 3 columns; expected one for each of 2 tests, or one for all"):
        read(path, keep=("9=cam",))


def numbered(folder, more=()):
    """Two tests beside each other, whose titles have numbers, and ``more`` columns of 9 behind them."""
    titles = [f"{each} {n} ({unit})" for n in (1, 2)
              for each, unit in (("Time", "s"), ("Disp", "mm"), ("Force", "N"), ("Strain", "%"))]  # fmt: skip
    rows = [f"{t:g},{0.1 * t:g},{3 * t:g},{-t:g},{t:g},{0.2 * t:g},{5 * t:g},{-2 * t:g}" + ",9" * len(more)
            for t in TIMES]  # fmt: skip
    path = folder / "both.csv"
    path.write_text("\n".join([",".join([*titles, *more]), *rows]) + "\n")
    return path


def test_a_tare_of_the_force_leaves_them(tmp_path):
    (one,) = read(written(tmp_path), tare=True).specimens
    assert "lateral_strain" in one.curves[0].others


def test_a_new_study_can_compare_what_was_kept(tmp_path):
    hints, out = Hints(keep_column=("Lateral strain=lateral_strain",)), tmp_path / "study"
    made = init([written(tmp_path)], out, hints=hints, sizes=Sizes(10.0, 2.0, 2.0))
    assert any("kept beside the force: lateral_strain from 'Lateral strain (%)'" in line for line in made.lines)
    assert any(line.endswith("left out: Cycle") for line in made.lines)
    (one,) = read_cohort(out / "cohort").specimens
    assert np.isnan(one.curves[0].others["lateral_strain"][1])
    assert read_answers(out / "answers.yaml").hints == hints
    text = (out / "study.yaml").read_text()
    assert text.count("measured: {force: {}} ") == 1
    several = "measured: {force: {noise: 0.01}, lateral_strain: {noise: 0.001}} "
    (out / "study.yaml").write_text(text.replace("measured: {force: {}} ", several))
    (one,) = cohort_of(read_study(out / "study.yaml")).specimens
    assert one.noise == {"force": 0.01, "lateral_strain": 0.001}
