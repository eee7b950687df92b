"""What is only likely is refused, or a person says once that it is right."""

from collections.abc import Sequence
from pathlib import Path

import pytest

from sinew.runner.errors import BadInput
from sinew.tasks.data.answers import read_answers
from sinew.tasks.data.hints import Hints
from sinew.tasks.data.init import init
from sinew.tasks.data.specimen_sizes import Sizes

BAR = Sizes(10.0, 8.0, 4.0)
LIKELY = "time_s,Deformation_mm,force_N"


def written(path: Path, header: str = LIKELY, sign: int = 1, rest: str = "") -> Path:
    path.write_text(f"{header}\n" + "".join(f"{i},{i / 20},{sign * 5 * i}\n" for i in range(6)) + rest)
    return path


def test_likely_columns_are_confirmed_once_and_need_no_answer_next_time(tmp_path):
    files = [written(tmp_path / "a.csv"), written(tmp_path / "b.csv", rest="6,0.3,31\n")]
    asked = []

    def ask(question: str, choices: Sequence[str]) -> str:
        asked.append((question, choices))
        return choices[0]

    init(files, tmp_path / "out", ask=ask, sizes=BAR)
    question = (
        "a.csv: displacement from 'Deformation_mm' is likely, not certain; is it right? "
        "(the answer applies to all files that leave this open)"
    )
    assert asked == [(question, ("yes", "no"))]
    kept = read_answers(tmp_path / "out" / "answers.yaml")
    assert kept.confirmed == {"displacement": ("Deformation_mm",)}
    with pytest.raises(BadInput, match="is likely, not certain; expected --displacement-column 'Deformation_mm'"):
        init(files, tmp_path / "more", sizes=BAR, certain=True)
    other = written(tmp_path / "c.csv", header="time_s,displacement_mm,force_N", rest="6,0.3,32\n")
    again = init([*files, other], tmp_path / "again", answers=kept, sizes=BAR, certain=True)
    assert len(again.specimens) == 3
    assert read_answers(tmp_path / "again" / "answers.yaml").confirmed == kept.confirmed


def test_a_likely_column_is_asked_about_with_those_that_are_not_used(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text(
        "time_s,Deformation_mm,force_N,Camera,Valve\n" + "".join(f"{i},{i / 20},{i},0,1\n" for i in range(6))
    )
    asked = []
    with pytest.raises(BadInput):
        init([path], tmp_path / "out", ask=lambda question, _: asked.append(question) or "no", sizes=BAR)
    assert "is likely, not certain (not used: 'Camera', 'Valve'); is it right?" in asked[0]


def test_a_column_of_words_is_not_offered_in_place_of_a_likely_one(tmp_path):
    path = tmp_path / "a.csv"
    rows = "".join(f"{i},{i / 20},{i},{i / 10},{'up' if i % 2 else 'down'}\n" for i in range(6))
    path.write_text(f"time_s,Deformation_mm,force_N,Camera_mm,Phase\n{rows}")
    offered = []

    def ask(question: str, choices: Sequence[str]) -> str:
        offered.append(tuple(choices))
        return "Camera_mm" if "which column" in question else "no" if "is likely" in question else choices[0]

    init([path], tmp_path / "out", ask=ask, sizes=BAR)
    assert offered[1] == ("Camera_mm", "none of them")


def test_a_column_of_words_is_not_offered_where_no_title_tells(tmp_path):
    path = tmp_path / "a.csv"
    rows = "".join(f"{i},{i / 20},{i},{'up' if i % 2 else 'down'}\n" for i in range(6))
    path.write_text(f"time_s,Way,force_N,Phase\n{rows}")
    offered = []
    init([path], tmp_path / "out", ask=lambda _, choices: offered.append(tuple(choices)) or choices[0], sizes=BAR)
    assert offered[0] == ("Way", "none of them")


def test_a_column_that_is_not_right_is_refused(tmp_path):
    path = written(tmp_path / "a.csv", header="time_s,Deformation_mm,force_N,Camera")
    first, *rest = path.read_text().splitlines()
    path.write_text("\n".join([first, *(f"{line},0" for line in rest), ""]))
    words = (
        "'Deformation_mm' is not its displacement; expected --displacement-column with a title or number; the file "
        "also has 'Camera'"
    )
    with pytest.raises(BadInput, match=words):
        init([path], tmp_path / "out", ask=lambda *_: "no", sizes=BAR)
    assert not (tmp_path / "out").exists()


def test_where_nobody_can_answer_a_doubtful_sign_is_refused(tmp_path):
    path = written(tmp_path / "a.csv", sign=-1)
    with pytest.raises(BadInput, match=r"forces are negative, but .*expected --negate force or none"):
        init([path], tmp_path / "out", sizes=BAR)
    assert not (tmp_path / "out").exists()
    init([path], tmp_path / "out", sizes=BAR, hints=Hints(negate="force"))


def test_another_column_than_the_likely_one_can_be_named(tmp_path):
    """The file is read again; files with other titles keep theirs, and next time nothing is asked."""
    for name, more in (("a.csv", ""), ("b.csv", "6,0.3,31\n")):
        path = written(tmp_path / name, header=f"{LIKELY},Camera_mm,Valve", rest=more)
        first, *rest = path.read_text().splitlines()
        path.write_text("\n".join([first, *(f"{line},0.{i},1" for i, line in enumerate(rest)), ""]))
    other = written(tmp_path / "c.csv", header="time_s,displacement_mm,force_N", rest="6,0.3,32\n")
    files, asked = [tmp_path / "a.csv", tmp_path / "b.csv", other], []

    def ask(question: str, choices: Sequence[str]) -> str:
        asked.append(question)
        return "Camera_mm" if "which column" in question else "no" if "Deformation" in question else choices[0]

    made = init(files, tmp_path / "out", ask=ask, sizes=BAR)
    assert "displacement from 'Deformation_mm' is likely, not certain" in asked[0]
    assert asked[1].startswith("a.csv: which column is the displacement? ")
    assert len(asked) == 2
    moved = {one.name: one.curves[0].protocol.displacement_mm[-1] for one in made.specimens}
    assert moved == pytest.approx({"a": 0.5, "b": 0.6, "c": 0.3})
    kept = read_answers(tmp_path / "out" / "answers.yaml")
    assert kept.instead == {"displacement": {"Deformation_mm": "Camera_mm"}}
    assert not kept.confirmed
    init(files, tmp_path / "again", answers=kept, sizes=BAR, certain=True)


def test_a_column_that_no_title_tells_is_asked_for(tmp_path):
    path = written(tmp_path / "a.csv", header="time_s,Way,force_N")
    asked = []

    def ask(question: str, choices: Sequence[str]) -> str:
        asked.append((question.partition(" (the")[0], tuple(choices)))
        return choices[0]

    made = init([path], tmp_path / "out", ask=ask, sizes=BAR)
    assert asked[0] == ("displacement, length or strain in a.csv: which column?", ("Way", "none of them"))
    assert asked[1][0] == "displacement, length or strain in a.csv: which unit?"
    assert made.specimens[0].curves[0].protocol.displacement_mm[-1] == pytest.approx(0.25)
    with pytest.raises(BadInput, match="no column of displacement, length or strain among 'time_s, Way, force_N'"):
        init([path], tmp_path / "more", ask=lambda _, choices: choices[-1], sizes=BAR)


def test_what_was_answered_on_a_wrong_column_is_not_used_for_the_right_one(tmp_path):
    """Each begins at a place of its own, which may be its zero or not."""
    path = tmp_path / "a.csv"
    rows = "".join(f"{i},{5 + i / 20},{5 * i},{7 + i / 10}\n" for i in range(8))
    path.write_text(f"time_s,Deformation_mm,force_N,Gauge_mm\n{rows}")
    asked = []

    def ask(question: str, choices: Sequence[str]) -> str:
        asked.append(question)
        return "Gauge_mm" if "which column" in question else "no" if "is likely" in question else choices[0]

    made = init([path], tmp_path / "out", ask=ask, sizes=BAR)
    assert [("likely" in one, "which column" in one, "7 mm" in one) for one in asked] == [
        (True, False, False), (False, True, False), (False, False, True)]  # fmt: skip
    assert made.specimens[0].curves[0].protocol.displacement_mm[-1] == pytest.approx(0.7)


def test_an_answer_that_does_not_help_ends_the_dialogue(tmp_path):
    """The unit that is asked for cannot be that of the column which was named, as that has another one."""
    path = tmp_path / "a.csv"
    rows = "".join(f"{i},{i / 20},{5 * i},{20 + i}\n" for i in range(8))
    path.write_text(f"time_s,Deformation_mm,force_N,Temp (kPa)\n{rows}")

    def ask(question: str, choices: Sequence[str]) -> str:
        return "Temp (kPa)" if "which column" in question else "no" if "is likely" in question else choices[0]

    with pytest.raises(BadInput, match=r"column 'Temp \(kPa\)': no unit of the displacement"):
        init([path], tmp_path / "out", ask=ask, sizes=BAR)


def test_a_column_that_was_said_to_be_wrong_is_not_taken_because_it_is_right_elsewhere(tmp_path):
    both = tmp_path / "a.csv"
    both.write_text("time_s,Deformation_mm,force_N,Gauge_mm\n" + "".join(f"{i},{i},{i},{i / 10}\n" for i in range(8)))
    alone = written(tmp_path / "b.csv")

    def ask(question: str, choices: Sequence[str]) -> str:
        return "Gauge_mm" if "which column" in question else "no" if "a.csv: displ" in question else choices[0]

    def moved(made) -> dict[str, float]:
        return {one.name: float(one.curves[0].protocol.displacement_mm[-1]) for one in made.specimens}

    first = moved(init([both, alone], tmp_path / "out", ask=ask, sizes=BAR))
    assert first == pytest.approx({"a": 0.7, "b": 0.25})
    kept = read_answers(tmp_path / "out" / "answers.yaml")
    again = init([both, alone], tmp_path / "again", answers=kept, ask=lambda _, choices: choices[0], sizes=BAR)
    assert moved(again) == first
    with pytest.raises(BadInput, match=r"b.csv: 'Deformation_mm' was said to be no displacement, but 'Gauge_mm'"):
        init([both, alone], tmp_path / "more", answers=kept, sizes=BAR)


def test_another_column_cannot_be_that_of_each_of_several_tests(tmp_path):
    titles = "time_s,Deformation_mm,force_N"
    rows = "".join(f"{i},{i / 20},{5 * i},{i},{i / 30},{4 * i},{i / 10}\n" for i in range(8))
    (tmp_path / "a.csv").write_text(f"{titles},{titles},Gauge_mm\n{rows}")

    def ask(question: str, choices: Sequence[str]) -> str:
        return "Gauge_mm" if "which column is the" in question else "no" if "is likely" in question else choices[0]

    with pytest.raises(BadInput, match="cannot be of each of its 2 tests beside each other; expected a file for each"):
        init([tmp_path / "a.csv"], tmp_path / "out", ask=ask, sizes=BAR)
