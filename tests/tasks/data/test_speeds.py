"""Times of tables without any: by a speed that is told, by a column of speeds, and tests one under another."""

from pathlib import Path

import numpy as np
import pytest

from sinew.runner.errors import BadInput
from sinew.tasks.data.curves import check_times
from sinew.tasks.data.exports import Reading
from sinew.tasks.data.hints import Hints
from sinew.tasks.data.init import Files, read_all
from sinew.tasks.data.inspection import inspect
from sinew.tasks.data.questions import Unclear
from sinew.tasks.data.recordings import read_recordings
from sinew.tasks.data.told import as_told

ROWS = 11


def written(folder: Path, *, titles: str = "id;vel;Stretch;Force (N)", speeds=(0.1, 0.01), ids=(7, 8)) -> Path:
    """Tests one under another, each of stretches up to 1.5 at its own speed."""
    rows = [f"{one};{v};{1 + i / 20};{i}" for one, v in zip(ids, speeds, strict=True) for i in range(ROWS)]
    path = folder / "set.csv"
    path.write_text("\n".join([titles, *rows]) + "\n")
    return path


def lasting(folder: Path, **hints: object) -> list[float]:
    """How long each test lasts (s)."""
    found = read_recordings(folder / "set.csv", Hints(**hints))
    return [float(np.ptp(one.numbers[:, 0])) for one in found]


def test_each_test_has_the_speed_of_its_column(tmp_path):
    written(tmp_path)
    assert lasting(tmp_path, test_column="id", speed_column="vel=1/s") == pytest.approx([5.0, 50.0])
    assert lasting(tmp_path, test_column="id", speed_column="2 = 1/s") == pytest.approx([5.0, 50.0])
    (one, _) = read_recordings(tmp_path / "set.csv", Hints(test_column="id", speed_column="vel=1/s"))
    assert one.notes == ("times by --speed-column 'vel=1/s'",)


@pytest.mark.parametrize(
    ("title", "motion", "seconds"),
    [
        ("vel [1/s]", "Stretch", 5.0),
        ("vel [1/min]", "Stretch", 300.0),
        ("vel (%/s)", "Stretch", 500.0),
        ("vel [s-1]", "Stretch", 5.0),
        ("Crosshead speed (mm/s)", "Displacement (mm)", 5.0),
        ("Crosshead speed (mm/min)", "Displacement (mm)", 300.0),
        ("Crosshead speed (um/s)", "Displacement (mm)", 5000.0),
    ],
)
def test_speeds_are_read_in_their_unit(tmp_path, title, motion, seconds):
    written(tmp_path, titles=f"id;{title};{motion};Force (N)")
    assert lasting(tmp_path, test_column="id", speed_column="2")[0] == pytest.approx(seconds)


@pytest.mark.parametrize(
    ("speeds", "titles", "words"),
    [
        (
            (0.1, 0.0),
            "id;vel [1/s];Stretch;Force (N)",
            r"row 14, vel \[1/s\]: no speed; expected a number other than 0 in each row",
        ),
        ((0.1, "x"), "id;vel [1/s];Stretch;Force (N)", r"row 14, vel \[1/s\]: no speed"),
        (
            (0.1, 0.1),
            "id;vel [V];Stretch;Force (N)",
            r"unit 'V' of 'vel \[V\]' is none of a stretch's speed; exp",
        ),
        ((0.1, 0.1), "id;vel [%/s];Displacement (mm);Force (N)", "none of a displacement's speed; .* mm/s or mm/min$"),
        ((0.1, 0.1), "id;vel [1/s];Displacement (mm);Force (N)", "none of a displacement's speed; .* mm/s or mm/min$"),
        (
            (0.1, 0.1),
            "id;vel [mm/s];Stretch;Force (N)",
            "none of a stretch's speed; expected a speed in a unit such",
        ),
    ],
)
def test_what_is_no_speed_is_refused(tmp_path, speeds, titles, words):
    written(tmp_path, speeds=speeds, titles=titles)
    with pytest.raises(BadInput, match=words):
        lasting(tmp_path, test_column="id", speed_column="2")


def test_a_speed_without_a_unit_is_asked_about(tmp_path):
    written(tmp_path)
    with pytest.raises(Unclear, match="the unit of the speeds in 'vel' is not known; expected --speed-column, one of"):
        lasting(tmp_path, test_column="id", speed_column="vel")
    assert lasting(tmp_path, test_column="id", speed_column="vel=1/min")[0] == pytest.approx(300.0)
    with pytest.raises(BadInput, match=r"unit 'mm/s' of 'vel' is none of a stretch's speed"):
        lasting(tmp_path, test_column="id", speed_column="vel=mm/s")
    written(tmp_path, titles="id;vel [1/min];Stretch;Force (N)")
    assert lasting(tmp_path, test_column="id", speed_column="vel [1/min]")[0] == pytest.approx(300.0)
    with pytest.raises(BadInput, match=r"'vel \[1/min\]' has the unit '1/min', --speed-column says '1/s'"):
        lasting(tmp_path, test_column="id", speed_column="vel [1/min]=1/s")


def test_a_title_may_hold_an_equals_sign(tmp_path):
    written(tmp_path, titles="id;v=dx/dt [1/s];Stretch;Force (N)")
    assert lasting(tmp_path, test_column="id", speed_column="v=dx/dt [1/s]")[0] == pytest.approx(5.0)


def test_a_speed_tells_no_time_where_a_displacement_is_set_to_zero(tmp_path):
    path = tmp_path / "a.csv"
    moved = [0.05 * i for i in range(41)]
    rows = [f"{u:.2f},{i}" for i, u in enumerate([*moved, *moved])]
    path.write_text("\n".join(["Displacement [mm],Force [N]", *rows]) + "\n")
    for preload, hints in (("keep", {"rate_hz": 1.0}), ("leave-out", {"speed": 0.05})):
        hints = Hints(preload=preload, **hints)
        (one,) = read_recordings(path, hints)
        times = as_told(one, hints).numbers[:, 0]
        assert np.ptp(times) == pytest.approx(81.0 if preload == "keep" else 40.0)
    hints = Hints(preload="keep", speed=0.05)
    (one,) = read_recordings(path, hints)
    with pytest.raises(
        BadInput, match="set to zero again after 41 rows, so a speed gives no time there; expected --ra"
    ):
        as_told(one, hints)


def test_a_speed_that_a_column_contradicts_is_asked_about(tmp_path):
    written(tmp_path)
    with pytest.raises(Unclear) as asked:
        lasting(tmp_path, test_column="id", speed=0.1)
    assert str(asked.value).endswith(
        "'vel' gives other speeds (0.01) than --speed 0.1; expected --speed-column 'vel=1/s' or 'vel=%/s' or "
        "'vel=1/min', or --speed-column none to use --speed all the same"
    )
    assert (asked.value.option, asked.value.choices) == ("--speed-column", ("vel=1/s", "vel=%/s", "vel=1/min", "none"))
    assert lasting(tmp_path, test_column="id", speed=0.1, speed_column="none") == pytest.approx([5.0, 5.0])
    assert lasting(tmp_path, test_column="id", speed=0.1, speed_column="vel=1/s") == pytest.approx([5.0, 50.0])
    written(tmp_path, speeds=(-0.1, 0.102))
    assert lasting(tmp_path, test_column="id", speed=0.1) == pytest.approx([5.0, 5.0])
    written(tmp_path, speeds=(6, 6.1), titles="id;vel [1/min];Stretch;Force (N)")
    assert lasting(tmp_path, test_column="id", speed=0.1) == pytest.approx([5.0, 5.0])


def test_a_machine_at_rest_in_the_first_row_has_a_speed_from_then_on(tmp_path):
    path = written(tmp_path)
    path.write_text(path.read_text().replace("7;0.1;1.0;0", "7;0;1.0;0", 1))
    assert lasting(tmp_path, test_column="id", speed_column="vel=1/s") == pytest.approx([5.0, 50.0])


def test_an_answer_reads_the_file_again(tmp_path):
    path = written(tmp_path)
    asked = []

    def ask(question, choices):
        asked.append(choices)
        return choices[0]

    read = read_all(Files((path,), ()), Hints(speed=0.1), ask)
    assert asked == [("id", "none"), ("vel=1/s", "vel=%/s", "vel=1/min", "none")]
    assert [float(np.ptp(one.numbers[:, 0])) for one in read.recordings] == pytest.approx([5.0, 50.0])
    assert (read.answered.test_column, read.answered.speed_column) == ("id", "vel=1/s")


@pytest.mark.parametrize("timing", [{"rate_hz": 10.0}, {"speed": 0.1}, {"speed_column": "vel=1/s"}])
def test_tests_one_under_another_without_times_are_asked_about(tmp_path, timing):
    written(tmp_path, speeds=(0.1, 0.1))
    with pytest.raises(
        Unclear, match="2 values of 'id', one under another, may each be a test of its own; expected --test-column 'id'"
    ):
        lasting(tmp_path, **timing)
    assert len(lasting(tmp_path, test_column="id", **timing)) == 2
    assert len(lasting(tmp_path, test_column="none", **timing)) == 1


def test_a_rate_goes_with_no_column_of_speeds():
    with pytest.raises(BadInput, match="--speed-column: given together with --rate-hz"):
        _ = Hints(rate_hz=1.0, speed_column="vel").timing
    assert Hints(rate_hz=1.0, speed_column="none").timing.given


def test_a_dry_run_asks_for_times_and_tests(tmp_path):
    found = inspect(written(tmp_path)).content()
    assert found["specimens"] == 2
    one = inspect(
        tmp_path / "set.csv", Reading(hints=Hints(test_column="none", speed=0.1, speed_column="none"))
    ).content()
    assert one["specimens"] == 1
    assert not any("--test-column" in each for each in one["ask"])
    assert any(each.endswith("--rate-hz, --speed or --speed-column") for each in found["ask"])


def test_no_speed_is_asked_for_where_the_motion_rests(tmp_path):
    path = tmp_path / "rests.csv"
    path.write_text("Extension (mm),Load (N)\n0,0\n0.1,5\n0.1,4\n0.3,9\n")
    assert inspect(path).content()["ask"][0].endswith("; --time-column NAME or NUMBER or --rate-hz")


CLOCK = "Time,Disp (mm),Force (N)\n" + "".join(f"10:22:{33 + i // 10:02d},{i / 100},{0.1 + i}\n" for i in range(35))


def test_rows_that_share_a_time_are_counted_by_their_rate(tmp_path):
    path = tmp_path / "test.csv"
    path.write_text(CLOCK)
    (recording,) = read_recordings(path, Hints(rate_hz=10.0))
    assert recording.numbers[:, 0] == pytest.approx(np.arange(35) / 10.0)
    assert "times by" in " ".join(recording.notes)
    with pytest.raises(BadInput, match=r"its times span 3 s, its rows at this rate 34 s; expected about 11.33 rows"):
        read_recordings(path, Hints(rate_hz=1.0))


def test_times_of_a_coarse_clock_are_refused_with_the_way_out(tmp_path):
    path = tmp_path / "test.csv"
    path.write_text(CLOCK)
    with pytest.raises(Unclear, match=r"times repeat in 31 of 35 rows, first in row 3; .*, or --rate-hz") as asked:
        read_recordings(path, Hints())
    assert (asked.value.option, asked.value.choices) == ("--same-times", ("spread",))
    (recording,) = read_recordings(path, Hints(same_times="spread"))
    check_times(recording)
    assert np.diff(recording.numbers[:30, 0]) == pytest.approx(0.1)
    assert "times repeat in 31 of 35 rows, first in row 3; they are spread evenly" in recording.notes[-1]
