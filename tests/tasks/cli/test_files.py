"""`sinew import --dry-run`: what files are taken for, on the console and as JSON."""

import json
import sys

import pytest

from sinew.tasks.cli.main import main

EXPORT = "Length,20,mm\nTime (s),Stroke (mm),Load (kN)\n0,0,0.1\n1,0.1,0.2\n2,0.2,0.3\n"


@pytest.fixture
def dry_run(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.csv").write_text(EXPORT)
    (tmp_path / "b.csv").write_text("no numbers")

    def run(*words: str) -> tuple[int, str]:
        monkeypatch.setattr(sys, "argv", ["sinew", "import", *words, "--dry-run"])
        with pytest.raises(SystemExit) as stopped:
            main()
        assert sorted(path.name for path in tmp_path.iterdir()) == ["a.csv", "b.csv"], "nothing is written"
        return stopped.value.code, capsys.readouterr().out

    return run


def test_what_a_file_is_taken_for_is_said_in_a_line_and_its_questions_below(dry_run):
    code, out = dry_run("a.csv")
    assert code == 0
    assert out.splitlines() == [
        "a.csv: time from 'Time (s)' (s), displacement from 'Stroke (mm)' (mm), force from 'Load (kN)' (kN), "
        "length 20 mm; 3 rows, tests: 1",
        "  ask: cross-section: the file does not tell it; --area-mm2",
    ]


def test_the_same_as_json_with_a_refused_file(dry_run):
    code, out = dry_run("a.csv", "b.csv", "--json")
    assert code == 2
    good, bad = json.loads(out)
    assert (good["file"], good["force"], good["peak_force_N"]) == ("a.csv", {"column": "Load (kN)", "unit": "kN"}, 300)
    assert set(bad) == {"file", "error"}


def test_what_an_option_tells_is_not_asked_for(dry_run):
    code, out = dry_run("a.csv", "--area-mm2", "4", "--length-mm", "21", "--json")
    (found,) = json.loads(out)
    assert (code, found["length_mm"], found["area_mm2"], found["ask"]) == (0, 21.0, 4.0, [])


def test_without_a_dry_run_a_folder_is_needed(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.csv").write_text(EXPORT)
    monkeypatch.setattr(sys, "argv", ["sinew", "import", "a.csv"])
    with pytest.raises(SystemExit) as stopped:
        main()
    assert stopped.value.code == 2
    assert "Missing option '--out'" in capsys.readouterr().err


def test_the_peak_of_a_compression_is_its_largest_force(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.csv").write_text("Length,10,mm\ntime_s,displacement_mm,force_N\n0,0,0.1\n1,-1,-5\n2,-3,-9\n")
    monkeypatch.setattr(sys, "argv", ["sinew", "import", "a.csv", "--area-mm2", "4", "--out", "cohort"])
    main()
    said = capsys.readouterr().out.splitlines()
    assert said[0].endswith("stretch 0.7 to 1, peak -9 N")
    assert said[1].startswith("a/test: a compression, unless the machine counts tension as negative")
