"""Which files `sinew init` takes, and what it asks a person."""

import json
from collections.abc import Callable, Sequence

import pytest

from sinew.runner.errors import BadInput
from sinew.tasks.data.answers import Answers, read_answers
from sinew.tasks.data.hints import Hints
from sinew.tasks.data.init import Files, find_tables, init, read_all
from sinew.tasks.data.specimen_sizes import Sizes
from sinew.tasks.data.text import read_lines
from tests.tasks.data.test_init import BAR, BAR_OPTIONS, new_specimens, refused, table
from tests.tasks.study.test_pipeline import sinew


def test_files_and_folders_of_tables_are_found_once(tmp_path):
    for name in ("b/2.TXT", "b/1.csv", "b/.hidden.csv", "b/notes.md", "b/c/d/e/f/g/h.csv", "a.xyz"):
        table(tmp_path / name)
    (tmp_path / "link.csv").symlink_to(tmp_path / "b" / "1.csv")
    found = find_tables([tmp_path / "a.xyz", tmp_path / "b", tmp_path / "link.csv", tmp_path / "b" / "1.csv"])
    assert [[path.name for path in paths] for paths in (found.named, found.in_folders)] == [
        ["a.xyz", "link.csv"],
        ["2.TXT"],
    ]
    assert found.left_out == ((tmp_path / "b" / "notes.md", ".md is no ending of a table"),)
    with pytest.raises(BadInput, match=r"holds no file with the ending of a table; expected \.asc, \.csv"):
        find_tables([table(tmp_path / "c" / "notes.md").parent])


def test_links_that_leave_a_folder_are_left_out(tmp_path):
    """Of a folder from somebody else; a link within it, and one that a person names, is a file as any other."""
    mine = table(tmp_path / "mine" / "secret.csv")
    inside = table(tmp_path / "bench" / "deeper" / "T1.csv")
    (tmp_path / "bench" / "T2.csv").symlink_to(inside)
    for name in ("bench/T3.csv", "bench/deeper/T4.csv", "T5.csv"):
        (tmp_path / name).symlink_to(mine)
    found = find_tables([tmp_path / "bench"])
    assert [path.name for path in found.in_folders] == ["T2.csv"]
    why = "a link that leaves the folder; name it itself, if it is meant"
    assert found.left_out == ((tmp_path / "bench" / "T3.csv", why), (tmp_path / "bench" / "deeper" / "T4.csv", why))
    assert find_tables([tmp_path / "T5.csv"]).named == (tmp_path / "T5.csv",)
    (tmp_path / "links").mkdir()
    (tmp_path / "links" / "T6.csv").symlink_to(mine)
    with pytest.raises(
        BadInput, match="links: holds no table but links that leave it; expected tables inside, or what"
    ):
        find_tables([tmp_path / "links"])


def test_files_of_a_folder_without_a_table_are_left_out_and_named(tmp_path, capsys):
    table(tmp_path / "bench" / "T1.csv")
    (tmp_path / "bench" / "SOURCE.txt").write_text("These are the tests of May.\nAsk the lab for more.\n")
    (tmp_path / "bench" / "photo.png").write_bytes(b"x")
    sinew("init", tmp_path / "bench", "--out", tmp_path / "out", *BAR_OPTIONS)
    said = capsys.readouterr().out.splitlines()
    assert [line for line in said if line.startswith("left out")] == [
        f"left out: {tmp_path / 'bench' / 'photo.png'} (.png is no ending of a table)",
        f"left out: {tmp_path / 'bench' / 'SOURCE.txt'} (no table of numbers can be found)",
    ]
    told = refused(capsys, "init", tmp_path / "bench" / "SOURCE.txt", "--out", tmp_path / "other")
    assert "no table of numbers" in told
    (tmp_path / "bench" / "T1.csv").unlink()
    assert "at least one file with a test" in refused(capsys, "init", tmp_path / "bench", "--out", tmp_path / "other")


def test_recordings_of_several_in_one_file_are_several_specimens(tmp_path):
    one = "Time (s),Extension (mm),Load (N)\n0,0,0\n1,0.1,5\n2,0.2,{}\n"
    path = tmp_path / "T1_relax.csv"
    path.write_text(one.format(8) + one.format(9))
    new = new_specimens(path, sizes=BAR)
    assert [(each.specimen.name, each.specimen.curves[0].name) for each in new] == [
        ("T1_1", "relax"),
        ("T1_2", "relax"),
    ]
    with pytest.raises(BadInput, match=r"two tests of specimen T1_1 are called .relax."):
        new_specimens(path, table(tmp_path / "T1_1_relax.csv"), sizes=BAR)


def test_a_table_in_a_folder_that_says_nothing_of_a_test_is_left_out(tmp_path):
    table(tmp_path / "bench" / "T1.csv")
    (tmp_path / "bench" / "calibration.txt").write_text("1 2\n3 4\n5 6\n")
    found = find_tables([tmp_path / "bench"])
    read = read_all(found, Hints())
    assert [one.path.name for one in read.recordings] == ["T1.csv"]
    assert [path.name for path, _ in read.left_out] == ["calibration.txt"]
    assert "no column of time" in read.left_out[0][1]
    (tmp_path / "bench" / "half.csv").write_text("Time (s),a\n1,2\n3,4\n5,6\n")
    with pytest.raises(BadInput, match=r"half\.csv: row 1: no column of displacement"):
        read_all(find_tables([tmp_path / "bench"]), Hints())


def test_a_file_of_a_folder_with_a_broken_table_is_refused(tmp_path):
    table(tmp_path / "bench" / "T1.csv")
    broken = table(tmp_path / "bench" / "T2.csv")
    broken.write_text(broken.read_text().replace("0.2,", "0.2x,"))
    with pytest.raises(BadInput, match=r"T2\.csv: row"):
        init([tmp_path / "bench"], tmp_path / "out", sizes=BAR)


def answers(**known: str) -> tuple[Callable[[str, Sequence[str]], str], list[str]]:
    """Somebody who answers questions that begin with a word, and the questions."""
    asked: list[str] = []

    def ask(question: str, choices: Sequence[str]) -> str:
        asked.append(question)
        return known[question.split()[0]]

    return ask, asked


def test_a_person_is_asked(tmp_path):
    table(tmp_path / "T1_relax.csv", "time_s,displacement_mm,force")
    ask, asked = answers(force="mN", length="10", width="8,5", thickness="")
    made = init([tmp_path / "T1_relax.csv"], tmp_path / "out", ask=ask)
    assert len(asked) == 4
    specimen = json.loads((tmp_path / "out" / "cohort" / "T1" / "specimen.json").read_text())
    assert (specimen["length_mm"], specimen["width_mm"], specimen["thickness_mm"]) == (10, 8.5, None)
    assert made.to_fill_in == (tmp_path / "out" / "cohort" / "T1" / "specimen.json",)
    kept = read_answers(tmp_path / "out" / "answers.yaml")
    assert kept == Answers(sizes={"T1": {"length": 10.0, "width": 8.5}}, answered=Hints(force_unit="mN"))


def test_what_files_are_taken_for_is_shown_before_anything_is_asked_and_they_are_read_once(tmp_path, monkeypatch):
    reads: list[str] = []
    monkeypatch.setattr("sinew.tasks.data.tables.read_lines", lambda path: reads.append(path.name) or read_lines(path))
    paths = [table(tmp_path / "A_relax.csv"), table(tmp_path / "B_relax.csv", "time_s,displacement_mm,force", 2.0)]
    ask, asked = answers(force="N", length="10 all", width="8 all", thickness="4 all")
    shown: list[tuple[str, ...]] = []

    def show(titles: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
        assert (asked, titles[0]) == ([], "file")
        shown.extend(map(tuple, rows))

    init(paths, tmp_path / "out", ask=ask, show=show)
    assert [(row[0], row[3]) for row in shown] == [("A_relax.csv", "force_N in N"), ("B_relax.csv", "force in ?")]
    assert reads == ["A_relax.csv", "B_relax.csv", "B_relax.csv"], "the one that is asked for, again"


def test_answers_are_kept_and_the_same_export_needs_none(tmp_path):
    paths = [
        table(tmp_path / f"{name}_relax.csv", "time_s,displacement_mm,force", scale)
        for name, scale in (("T1", 1.0), ("T2", 2.0))
    ]
    ask, asked = answers(force="mN", length="10 all", width="8 all", thickness="4 all")
    init(paths, tmp_path / "out", ask=ask)
    assert len(asked) == 4
    kept = read_answers(tmp_path / "out" / "answers.yaml")
    init(paths, tmp_path / "again", answers=kept)
    for name in ("answers.yaml", "cohort/T2/specimen.json", "cohort/T2/relax.csv"):
        first, again = ((tmp_path / folder / name).read_text() for folder in ("out", "again"))
        assert again == first
    made = init(paths, tmp_path / "wide", answers=kept, sizes=Sizes(width_mm=9.0))
    assert made.to_fill_in == ()
    assert read_answers(tmp_path / "wide" / "answers.yaml").sizes["T1"]["width"] == 9.0, "what is given now counts"


def test_sizes_that_were_answered_before_are_told(tmp_path):
    path = table(tmp_path / "T1.csv", "Length,10,mm\ntime_s,displacement_mm,force_N")
    kept = Answers(sizes={"T1": {"width": 8.0}})
    made = init([path], tmp_path / "out", answers=kept, sizes=Sizes(thickness_mm=4.0))
    assert [line for line in made.lines if "answered before" in line and "T1.csv" not in line] == [
        "    width 8 mm, as answered before"
    ]
    assert made.specimens[0].length_mm == 10.0


def test_an_answer_that_a_file_contradicts_counts_with_override_only(tmp_path):
    path = table(tmp_path / "T1.csv", "Length,10,mm\ntime_s,displacement_mm,force_N")
    given = Sizes(12.0, 8.0, 4.0, override=True)
    init([path], tmp_path / "out", sizes=given)
    kept = read_answers(tmp_path / "out" / "answers.yaml")
    assert kept.sizes == {"T1": {"length": 12.0, "width": 8.0, "thickness": 4.0}}
    with pytest.raises(BadInput, match=r"a length of 10 mm, but an earlier answer says 12; .*or --override"):
        init([path], tmp_path / "more", answers=kept, certain=True)
    again = init([path], tmp_path / "again", answers=kept, sizes=Sizes(override=True), certain=True)
    assert again.specimens[0].length_mm == 12.0
    assert "    length 12 mm by an earlier answer; T1.csv gives 10 mm" in again.lines


def test_a_length_that_the_strains_contradict_is_asked_for(tmp_path):
    """Zwick writes the distance of the grips above the table, and strains of the gauge length."""
    path = tmp_path / "film.csv"
    rows = "".join(f"{i},{i / 2},{i / 2 / 80 * 100:.6f},{5 * i}\n" for i in range(9))
    path.write_text(
        f"Einspannlänge,832.756,mm\nZeit (s),Standardweg (mm),Dehnung (%),Standardkraft (N)\n{rows}", "utf-8"
    )
    asked = []

    def ask(question: str, choices: Sequence[str]) -> str:
        asked.append(question)
        return choices[0] if choices else "80"

    made = init([path], tmp_path / "out", ask=ask, sizes=Sizes(None, 11.4, 0.2))
    assert made.specimens[0].length_mm == 80.0
    assert any(question.startswith("length of film in mm?") for question in asked)
    note = "gauge length is not taken from the file: 832.756 mm in the lines above, but 80 mm by 'Dehnung (%)'"
    assert any(note in line for line in made.lines)
    with pytest.raises(BadInput, match=r"does not give the length of film; expected --length-mm"):
        init([path], tmp_path / "more", sizes=Sizes(None, 11.4, 0.2), certain=True, hints=CHOSEN)
    again = init([path], tmp_path / "again", sizes=Sizes(80.0, 11.4, 0.2), certain=True, hints=CHOSEN)
    assert again.specimens[0].length_mm == 80.0


CHOSEN = Hints(displacement_column="Standardweg (mm)")


def test_a_first_length_is_asked_for_and_kept(tmp_path):
    path = tmp_path / "gap.csv"
    path.write_text("time_s,Gap (um),force_N\n" + "".join(f"{i},{9401 - 100 * i},{-0.1 * i}\n" for i in range(9)))
    told = Sizes(None, 8.0, 4.0)
    asked = []

    def ask(question: str, choices: Sequence[str]) -> str:
        asked.append(question)
        return choices[0]

    made = init([path], tmp_path / "out", ask=ask, sizes=told, hints=Hints(negate="none"))
    assert made.specimens[0].length_mm == pytest.approx(9.401)
    assert "gap.csv: 9.401 mm, the length in the first row: is it the gauge length?" in asked
    kept = read_answers(tmp_path / "out" / "answers.yaml")
    assert kept.sizes["gap"]["length"] == pytest.approx(9.401)
    again = init([path], tmp_path / "again", answers=kept, sizes=told, certain=True)
    assert again.specimens[0].length_mm == pytest.approx(9.401)


def test_a_file_of_notes_is_left_out_also_where_a_rate_is_told(tmp_path):
    (tmp_path / "bench").mkdir()
    (tmp_path / "bench" / "a.csv").write_text("u_mm,F_N\n0,0\n1,1\n2,2\n")
    (tmp_path / "bench" / "notes.csv").write_text("a,b,c\n1,2,3\n2,3,4\n3,4,5\n")
    read = read_all(find_tables([tmp_path / "bench"]), Hints(rate_hz=10.0))
    assert ([one.path.name for one in read.recordings], len(read.left_out)) == (["a.csv"], 1)


def test_a_study_that_needed_no_answers_keeps_none(tmp_path):
    block = "Length,10,mm\nWidth,8,mm\nThickness,4,mm\n"
    init([table(tmp_path / "T1.csv", f"{block}time_s,displacement_mm,force_N")], tmp_path / "out")
    assert not (tmp_path / "out" / "answers.yaml").exists()


@pytest.mark.parametrize(
    ("header", "words"),
    [
        ("time_s,Deformation_mm,force_N", "displacement from 'Deformation_mm' is likely, not certain; expected "
         "--displacement-column 'Deformation_mm' to confirm it"),
        ("time_s,displacement_mm,force_N", "does not give the length and the width and the thickness of T1; expected "
         "--length-mm, --width-mm, --thickness-mm"),
    ],
)  # fmt: skip
def test_for_scripts_only_what_is_certain_is_taken(tmp_path, capsys, header, words):
    path = table(tmp_path / "T1.csv", header)
    assert words in refused(capsys, "init", path, "--out", tmp_path / "out", "--yes")
    assert not (tmp_path / "out").exists()
    sinew("init", path, "--out", tmp_path / "out", "--yes", "--displacement-column", "2", *BAR_OPTIONS)
    assert (tmp_path / "out" / "study.yaml").exists()


def test_a_trial_that_may_be_a_specimen_is_not_certain(tmp_path):
    path = table(tmp_path / "cycle_2.csv")
    with pytest.raises(BadInput, match="a number may be a specimen's or a trial's"):
        init([path], tmp_path / "out", sizes=BAR, certain=True)


def test_which_column_is_meant_is_asked_once(tmp_path):
    paths = [tmp_path / "a.csv", tmp_path / "b.csv"]
    for path in paths:
        path.write_text("Time (s),Crosshead (mm),Extensometer (mm),Load (N)\n0,0,0,0\n1,2,1,5\n2,4,2,9\n")
    with pytest.raises(BadInput, match=r"'Extensometer .mm.' and 'Crosshead .mm.' may both be the"):
        read_all(Files(tuple(paths), ()), Hints())
    ask, asked = answers(displacement="Crosshead (mm)")
    read = read_all(Files(tuple(paths), ()), Hints(), ask)
    assert [one.numbers[-1, 1] for one in read.recordings] == [4.0, 4.0]
    assert asked == ["displacement in a.csv: which column? (the answer applies to all files that leave this open)"]


def test_where_a_displacement_counts_from_and_its_sign_are_asked_once_and_kept(tmp_path):
    rows = "".join(f"{i},{37.21 + i / 20},{-5 * i}\n" for i in range(6))
    paths = [tmp_path / "a.csv", tmp_path / "b.csv"]
    for number, path in enumerate(paths):
        path.write_text(f"time_s,displacement_mm,force_N\n{rows}6,37.6,{-30 - number}\n")
    asked = []

    def ask(question: str, choices: Sequence[str]) -> str:
        asked.append(question)
        return choices[0]

    made = init(paths, tmp_path / "out", ask=ask, sizes=BAR)
    assert asked == [
        "a.csv: the displacement starts at 37.21 mm but changes by only 0.39 mm; "
        "the start may be an offset of the machine; "
        "count it from its first value? (the answer applies to all files that leave this open)",
        "a.csv: forces are negative, but sinew takes tension as positive; check the sign convention of the machine; "
        "which sign should be reversed? (the answer applies to all files that leave this open)",
    ]
    assert [one.curves[0].force_N[-1] for one in made.specimens] == [30.0, 31.0]
    assert [one.curves[0].protocol.displacement_mm[0] for one in made.specimens] == [0.0, 0.0]
    assert "    a.csv: displacement counted from its first value, 37.21 mm" in made.lines
    kept = read_answers(tmp_path / "out" / "answers.yaml")
    assert kept.answered == Hints(zero_displacement="first", negate="force")
    again = init(paths, tmp_path / "again", answers=kept, sizes=BAR, certain=True)
    assert again.specimens[0].curves[0].digest == made.specimens[0].curves[0].digest


@pytest.mark.parametrize(
    ("motion", "load", "words"),
    [(37.0, 1.0, "expected --zero-displacement first or none"), (0.0, -1.0, "expected --negate force or none")],
)
def test_an_offset_or_a_sign_that_may_be_meant_otherwise_is_not_certain(tmp_path, motion, load, words):
    path = tmp_path / "a.csv"
    path.write_text("time_s,displacement_mm,force_N\n" + "".join(f"{i},{motion + i},{load * i}\n" for i in range(6)))
    with pytest.raises(BadInput, match=words):
        init([path], tmp_path / "out", sizes=BAR, certain=True)
    init([path], tmp_path / "out", sizes=BAR, certain=True, hints=Hints(zero_displacement="none", negate="none"))


def test_where_nobody_can_be_asked_all_options_are_told_at_once(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("time_s,displacement_mm,force_N\n" + "".join(f"{i},{37 + i},{-i}\n" for i in range(6)))
    other = tmp_path / "b.csv"
    other.write_text("time_s,displacement_mm,force_N\n" + "".join(f"{i},{i},{i}\n" for i in range(6)) + "6,900,6\n")
    told = "expected --zero-displacement first or none; also open: --negate, --end"
    with pytest.raises(BadInput, match=told):
        init([path, other], tmp_path / "out", sizes=BAR)
    with pytest.raises(BadInput, match=r"expected --end leave-out or keep\Z"):
        init([other], tmp_path / "out", sizes=BAR)
    assert not (tmp_path / "out").exists()


def test_an_answer_holds_for_no_file_that_says_it_itself(tmp_path):
    rows = "".join(f"{i},{i / 20},{-5 * i}\n" for i in range(6))
    (tmp_path / "a.csv").write_text(f"time_s,displacement_mm,force\n{rows}")
    (tmp_path / "b.csv").write_text(f"time_s,displacement_mm,force_N\n{rows.replace('-', '')}")
    (tmp_path / "c.csv").write_text(f"time_s,displacement_mm,force\n{rows.replace('25', '26')}")
    paths = [tmp_path / f"{name}.csv" for name in "abc"]
    ask, asked = answers(**{"force": "kN", "a.csv:": "force"})
    made = init(paths, tmp_path / "out", ask=ask, sizes=BAR)
    assert len(asked) == 2
    assert [one.curves[0].force_N[-1] for one in made.specimens] == [25_000.0, 25.0, 26_000.0]
    kept = read_answers(tmp_path / "out" / "answers.yaml")
    assert kept.answered == Hints(force_unit="kN", negate="force")
    again = init(paths, tmp_path / "again", answers=kept, sizes=BAR, certain=True)
    assert [one.curves[0].digest for one in again.specimens] == [one.curves[0].digest for one in made.specimens]


def test_an_answer_that_is_none_of_the_choices_of_another_file_is_asked_again(tmp_path):
    for name, motion, load in (("a", -1, 1), ("b", 1, -1)):
        rows = "".join(f"{i},{motion * i},{load * 5 * i}\n" for i in range(6))
        (tmp_path / f"{name}.csv").write_text(f"time_s,displacement_mm,force_N\n{rows}")
    ask, asked = answers(**{"a.csv:": "displacement", "b.csv:": "force"})
    read = read_all(Files((tmp_path / "a.csv", tmp_path / "b.csv"), ()), Hints(), ask)
    assert [one.numbers[-1, 1:].tolist() for one in read.recordings] == [[5.0, 25.0], [5.0, 25.0]]
    assert len(asked) == 2


def test_an_answer_holds_for_all_files_that_do_not_say(tmp_path):
    paths = [table(tmp_path / f"{name}.csv", "time_s,displacement_mm,force") for name in "ab"]
    ask, asked = answers(force="kN")
    read = read_all(Files(tuple(paths), ()), Hints(), ask)
    assert [recording.numbers[-1, 2] for recording in read.recordings] == [80_000, 80_000]
    assert read.left_out == []
    assert read.answered == Hints(force_unit="kN")
    assert asked == ["force in a.csv: which unit? (the answer applies to all files that leave this open)"]
