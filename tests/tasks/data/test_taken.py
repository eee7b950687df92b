"""The table of what files are taken for."""

from pathlib import Path

from sinew.tasks.data.hints import Hints
from sinew.tasks.data.specimen_sizes import Sizes
from sinew.tasks.data.taken import TITLES, look_at, rows_of, usable


def row(folder: Path, text: str, sizes: Sizes | None = None, **hints: str) -> dict[str, str]:
    path = folder / "a.csv"
    path.write_text(text)
    found = look_at([path], Hints(**hints), sizes or Sizes())
    (cells,) = rows_of(found, Hints(**hints))
    return dict(zip(TITLES, cells, strict=True))


def rows(motion: float, load: float, start: float = 0.0) -> str:
    return "".join(f"{i},{start + motion * i:.6g},{0.5 + load * i:.6g}\n" for i in range(6))


def test_a_file_that_tells_all(tmp_path):
    above = "Length,10,mm\nWidth,8.1,mm\nThickness,3.9,mm\n"
    assert row(tmp_path, f"{above}Time,Stroke (mm),Load (kN)\nmin,,\n{rows(0.6, 2.0)}") == {
        "file": "a.csv",
        "time": "Time in min",
        "displacement": "Stroke (mm)",
        "force": "Load (kN)",
        "size": "10 x 8.1 x 3.9 mm",
        "offset, preload": "0 mm, 500 N",
        "peak": "1.05e+04 N",
        "sign": "tension",
        "loaded at": "0.001 1/s",
    }


def test_what_nobody_tells_is_a_question_mark(tmp_path):
    found = row(tmp_path, f"Time (s),Displacement (mm),Load\n{rows(0.1, 2.0)}")
    assert (found["force"], found["size"], found["sign"], found["loaded at"]) == ("Load in ?", "? x ? x ? mm", "?", "?")
    assert (found["offset, preload"], found["peak"]) == ("0 mm, 0.5 ?", "10.5 ?")
    found = row(tmp_path, f"a,b,Load (N)\n{rows(0.1, 2.0)}")
    assert (found["time"], found["displacement"], found["offset, preload"]) == ("?", "?", "?, 0.5 N")


def test_strains_and_speeds(tmp_path):
    found = row(tmp_path, f"Time (s),Strain (%),Stress (kPa)\n{rows(0.1, 2.0)}")
    assert (found["displacement"], found["force"]) == ("strain: Strain (%)", "stress: Stress (kPa)")
    assert (found["offset, preload"], found["peak"], found["loaded at"]) == ("0, 0.0005 MPa", "0.0105 MPa", "0.001 1/s")
    assert row(tmp_path, f"Time (s),Disp (mm),Load (N)\n{rows(0.1, 2.0)}")["loaded at"] == "0.1 mm/s"


def test_signs_and_what_is_counted_as_told(tmp_path):
    text = f"Time (s),Disp (mm),Load (N)\n{rows(0.1, -2.0, start=37.0)}"
    found = row(tmp_path, text)
    assert (found["sign"], found["offset, preload"], found["peak"]) == ("?", "37 mm, 0.5 N", "-9.5 N")
    found = row(tmp_path, text, zero_displacement="first", negate="force")
    assert (found["sign"], found["offset, preload"], found["peak"]) == ("tension", "0 mm, -0.5 N", "9.5 N")
    assert row(tmp_path, text, negate="displacement", zero_displacement="first")["sign"] == "compression"


def test_sizes_that_are_given_and_an_area(tmp_path):
    table = f"Time (s),Disp (mm),Load (N)\n{rows(0.1, 2.0)}"
    assert row(tmp_path, table, Sizes(10.0, 8.0, None))["size"] == "10 x 8 x ? mm"
    assert row(tmp_path, f"Area,30,mm2\n{table}", Sizes(10.0))["size"] == "10 mm, 30 mm2"


def test_recordings_of_several_in_a_file_and_a_file_that_is_refused(tmp_path):
    block = f"Time (s),Disp (mm),Load (N)\n{rows(0.1, 2.0)}"
    assert row(tmp_path, block + block)["file"] == "a.csv (2 tests)"
    found = row(tmp_path, "no numbers")
    assert (found["file"], found["time"], found["force"]) == ("a.csv", "no table of numbers can be found", "")


def test_only_tests_that_need_no_answer_are_used_again(tmp_path):
    contents = {
        "a.csv": f"Time (s),Disp (mm),Load (N)\n{rows(0.1, 2.0)}",
        "b.csv": f"Time (s),Disp (mm),Load\n{rows(0.1, 2.0)}",
        "c.csv": "Time (s),Extensometer (mm),Load (N),Stroke (mm)\n0,0,0,0\n1,1,1,2\n2,2,2,4\n",
    }
    for name, content in contents.items():
        (tmp_path / name).write_text(content)
    found = look_at([tmp_path / name for name in contents], Hints(), Sizes())
    assert list(usable(found)) == [tmp_path / "a.csv"]
