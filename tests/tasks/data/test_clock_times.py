"""Clock times and dates in exports."""

import pytest

from sinew.runner.errors import BadInput
from sinew.tasks.data.exports import Reading, read_export
from tests.tasks.data.test_inspection import taken


@pytest.mark.parametrize("other", ["Elapsed time (s)", "Time (s)"])
def test_the_time_since_the_start_goes_before_a_clock_beside_it(tmp_path, other):
    rows = "10:22:33,0.0,0,1\n10:22:33,0.1,1,2\n10:22:33,0.2,2,3\n10:22:34,0.3,3,4\n"
    found = taken(tmp_path, f"Time,{other},Displacement (mm),Force (N)\n{rows}")
    assert found["time"] == {"column": other, "unit": "s"}
    curve = read_export(tmp_path / "export.csv", reading=Reading(length_mm=10, area_mm2=4)).curves[0]
    assert curve.protocol.time_s.tolist() == [0.0, 0.1, 0.2, 0.3]


@pytest.mark.parametrize(
    "rows",
    [
        ("0,0,1", "00:01.5,1,2", "00:02.5,2,3", "00:03.5,3,4"),
        ("00:01.5,0,1", "2.5,1,2", "00:03.5,2,3", "00:04.5,3,4"),
        ("0,0,1", "1,1,2", "2,2,1:23.4", "3,3,4"),
        ("03/05/2024 10:00:00,0,1", "04/05/2024 10:00:10,1,2", "05/05/2024 10:00:20,2,3"),  # or of three months
        ("2024-05-03 10:00:00,0,1", "10:00:10,1,2", "10:00:20,2,3"),
        ("2024-05-33 10:00:00,0,1", "2024-05-34 10:00:10,1,2", "2024-05-35 10:00:20,2,3"),
    ],
)
def test_clock_times_among_other_numbers_or_of_other_days_are_refused(tmp_path, rows):
    path = tmp_path / "a.csv"
    path.write_text("\n".join(["Time (min),Stroke (mm),Load (N)", *rows, ""]))
    with pytest.raises(BadInput, match=r"a\.csv: row \d"):
        read_export(path, reading=Reading(length_mm=10, area_mm2=4))


def test_clock_times_with_dates_go_on_over_midnight(tmp_path):
    rows = ["2024-02-28 23:59:58.5,0,1", "2024-02-29 00:00:01,1,2", "2024-03-01T00:00:01,2,3"]
    path = tmp_path / "a.csv"
    path.write_text("\n".join(["Time,Stroke (mm),Load (N)", *rows, ""]))
    curve = read_export(path, reading=Reading(length_mm=10, area_mm2=4)).curves[0]
    assert curve.protocol.time_s.tolist() == [0.0, 2.5, 86_402.5]


def test_clock_times_count_on_beyond_a_day(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("Time,Stroke (mm),Load (N)\n23:59:59.5,0,1\n24:00:00.5,1,2\n120:00:00.5,2,3\n")
    curve = read_export(path, reading=Reading(length_mm=10, area_mm2=4)).curves[0]
    assert curve.protocol.time_s.tolist() == [0.0, 1.0, 96 * 3600.0 + 1.0]
