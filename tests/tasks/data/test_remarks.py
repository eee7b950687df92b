"""What a person is told to check in a recording."""

from dataclasses import replace
from pathlib import Path

import pytest

from sinew.tasks.data.hints import Hints
from sinew.tasks.data.recordings import read_recordings
from sinew.tasks.data.remarks import remarks


@pytest.mark.parametrize(
    ("name", "title", "largest", "told"),
    [
        ("a.xls", "Strain [%]", 0.0997, True),
        ("a.XLSB", "Strain [%]", 0.99, True),
        ("a.xls", "Strain [%]", 4.99, True),  # a membrane may well be pulled to 499 %
        ("a.xls", "Strain [%]", 5.01, False),
        ("a.xlsx", "Strain [%]", 0.0997, False),  # whose formats are read
        ("a.xls", "Strain [mm/mm]", 0.0997, False),
        ("a.xls", "Extension [mm]", 0.0997, False),
    ],
)
def test_small_strains_in_percent_of_a_file_without_formats_are_named(tmp_path, name, title, largest, told):
    path = tmp_path / "a.csv"
    path.write_text(f"Time [s],{title},Force [N]\n" + "".join(f"{i},{largest * i / 4},{i}\n" for i in range(5)))
    (recording,) = read_recordings(path, Hints())
    lines = remarks(replace(recording, path=Path(name)))
    assert bool(lines) is told
    if told:
        assert lines[0].startswith(f"'{title}' reaches only {largest} %. Cells of an {Path(name).suffix} file that are")
