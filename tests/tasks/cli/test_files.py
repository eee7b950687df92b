"""`sinew import --dry-run`: what files are taken for, on the console and as JSON."""

import json
import sys

import pytest

from sinew.runner.errors import one_line
from sinew.tasks.cli import files
from sinew.tasks.cli.main import main
from tests.tasks.simulate.febio.model_file.cube import CUBE

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
        "  ask: cross-section: the file does not give it; --area-mm2",
    ]


def test_of_very_many_remarks_the_first_are_shown(dry_run, monkeypatch):
    words = ("a.csv", "--preload", "keep")  # which has no effect
    _, out = dry_run(*words)
    assert out.count("  remark: ") == 1
    assert "more;" not in out
    monkeypatch.setattr(files, "MOST_REMARKS", 0)
    _, out = dry_run(*words)
    assert out.splitlines()[-1] == "  remark: 1 more; --json lists all"


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


def test_columns_that_are_kept_beside_the_force(dry_run, tmp_path, monkeypatch, capsys):
    path = tmp_path / "a.csv"
    path.write_text(path.read_text().replace("Load (kN)\n", "Load (kN),Width\n").replace(",0.2\n", ",0.2,-0.03\n"))
    _, out = dry_run("a.csv", "--keep-column", "Width=width_change_mm")
    assert "  ask: 'Width': no unit can be found; expected --keep-column 'Width=width_change_mm:UNIT'" in out
    words = ["a.csv", "--out", "cohort", "--area-mm2", "4", "--keep-column", "Width=width_change_mm:mm"]
    monkeypatch.setattr(sys, "argv", ["sinew", "import", *words])
    main()
    assert ", peak 300 N, with width_change_mm\n" in capsys.readouterr().out
    assert (tmp_path / "cohort/a/test.csv").read_text().splitlines()[2] == "1,0.1,200,-0.03"


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
    assert said[1].startswith("    from a.csv: time from 'time_s' in s; displacement from")
    assert said[2].startswith("a/test: a compression, unless the machine counts tension as negative")


def test_the_table_of_files_does_not_steer_the_terminal(monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", "200")
    files._show(("file", "time"), [("a\x1b[2J.csv", "[red]Time (s)[/]")])
    out = capsys.readouterr().out
    assert "\x1b[2J" not in out
    assert "[red]Time (s)[/]" in out


@pytest.fixture
def init(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "cube.feb").write_text(CUBE, "latin-1")

    def run(*words: str) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["sinew", "init", *words, "--out", "study"])
        try:
            main()
        except SystemExit as stopped:
            return int(stopped.code or 0), *capsys.readouterr()
        return 0, *capsys.readouterr()

    return run


def test_sizes_that_no_file_tells_are_filled_in_and_then_the_ranges_are_scaled(init, tmp_path):
    (tmp_path / "a.csv").write_text(EXPORT.partition("\n")[2])
    code, out, _ = init("a.csv", "--length-mm", "20", "--area-mm2", "50")
    assert code == 0
    assert out.endswith("next: sinew run study/study.yaml\n")
    (tmp_path / "study").rename(tmp_path / "with sizes")
    code, out, _ = init("a.csv", "--length-mm", "20")
    assert code == 0
    assert "fill in: study/cohort/a/specimen.json\n" in out
    last = "fill in what is marked null there; then, for ranges that fit the tests:"
    assert out.endswith(f"next: {last} sinew init study/cohort --out study-scaled\n")


# ---- a FEBio model


def test_what_a_model_holds_is_listed_before_anything_is_chosen(init, tmp_path):
    code, out, _ = init("cube.feb")
    assert code == 0
    assert "  gel ä.elastic.E = 10.0\n" in out
    assert out.endswith("next: sinew init cube.feb --out study --vary NAME --move NAME\n")
    code, out, _ = init("cube.feb", "--json")
    assert json.loads(out)["materials"]["gel ä.t1"] == 2.5
    assert not (tmp_path / "study").exists()


def test_a_model_becomes_a_study(init, tmp_path):
    code, out, _ = init("cube.feb", "--vary", "gel ä.elastic.E=5:20", "--move", "pull", "--measure", "side=ux@top")
    assert code == 0
    assert out.splitlines()[0] == "gel_elastic_E: gel ä.elastic.E, 5 to 20 (10)"
    assert out.endswith("study: study/study.yaml\nnext: sinew doctor study/study.yaml\n")
    assert sorted(path.name for path in (tmp_path / "study").iterdir()) == ["cube.feb.j2", "mesh.xml", "study.yaml"]


def test_in_a_dialogue_the_choices_are_asked_for(init, monkeypatch):
    answers = iter(["gel ä.t1; gel ä.g1=0.1:1", "pull", ""])
    monkeypatch.setattr("sinew.tasks.cli.files._is_dialogue", lambda: True)
    monkeypatch.setattr("sinew.tasks.cli.files._ask", lambda question, choices: next(answers))
    code, out, _ = init("cube.feb")
    assert code == 0
    assert "gel_t1: gel ä.t1, 1.25 to 5 (2.5)\n" in out
    assert "force: Rz of top (node_data, sum), in N\n" in out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("cube.feb", "--vary", "gel.E"), "sinew: cube.feb: --vary: no number 'gel.E'; expected one of gel ä."),
        (("cube.feb", "--vary", "gel ä.t1", "--move-factor", "0"), "sinew: --move-factor: 0.0; expected a number that"),
        (
            ("cube.feb", "--vary", "gel ä.t1", "--move-factor", "1e-300"),
            "sinew: --move-factor: 1e-300; expected a numb",
        ),
        (
            ("a.csv", "--vary", "E"),
            "sinew: --vary, --move, --measure, --fibre and --matrix: without a FEBio model; expected one file",
        ),
    ],
)
def test_what_does_not_fit_is_one_line(init, words, message):
    code, _, err = init(*words)
    assert code == 2
    assert err.startswith(message)
    assert err.count("\n") == 1


def test_names_of_files_in_questions_do_not_steer_the_terminal(monkeypatch, capsys):
    evil = "a\x1b]0;owned\x07.csv"
    monkeypatch.setattr("click.termui.visible_prompt_func", lambda words: print(words, end="") or "1")
    assert files._ask(f"{evil}: which unit?", ()) == "1"
    monkeypatch.setattr("click.termui.visible_prompt_func", lambda words: print(words, end="") or one_line(evil))
    assert files._ask("which file?", (evil, "b.csv")) == evil
    said = "".join(capsys.readouterr())
    assert "\\x1b]0;owned" in said
    assert not {"\x1b", "\x07"} & set(said)
