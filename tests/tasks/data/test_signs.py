"""Where displacements and forces are counted from, and their signs: what is doubtful, and what a person says."""

from pathlib import Path

import numpy as np
import pytest

from sinew.runner.errors import BadInput
from sinew.tasks.data.hints import Hints
from sinew.tasks.data.recording import Recording
from sinew.tasks.data.recordings import read_recordings
from sinew.tasks.data.remarks import remarks
from sinew.tasks.data.told import as_told

TITLES = "Time (s),Displacement (mm),Force (N)"


def read(
    folder: Path, motion: float, load: float, *, above: str = "", titles: str = TITLES, start: float = 0.0, **told
):
    """A test of six rows whose motion and load grow by these steps, counted as told."""
    path = folder / "test.csv"
    rows = "".join(f"{i},{start + i * motion:g},{i * load:g}\n" for i in range(6))
    path.write_text(f"{above}\n{titles}\n{rows}")
    (recording,) = read_recordings(path, Hints())
    return as_told(recording, Hints(**told))


def ends(recording: Recording) -> list[float]:
    return [float(number) for number in recording.numbers[-1, 1:]]


def test_a_displacement_that_begins_far_from_0_is_doubtful_until_told(tmp_path):
    found = read(tmp_path, 0.05, 2.0, start=37.21)
    (doubt,) = found.doubts
    assert doubt.text == (
        "the displacement starts at 37.21 mm but changes by only 0.25 mm; the start may be an offset of the machine"
    )
    assert (doubt.option, doubt.choices) == ("--zero-displacement", ("first", "none"))
    assert remarks(found) == [f"{doubt.text}; --zero-displacement first or none"]
    assert ends(found) == [37.46, 10.0]
    kept = read(tmp_path, 0.05, 2.0, start=37.21, zero_displacement="none")
    assert (ends(kept), kept.doubts, kept.notes) == ([37.46, 10.0], (), ())


def test_both_may_be_counted_from_their_first_value(tmp_path):
    zeroed = read(tmp_path, 0.05, 2.0, start=37.21, zero_displacement="first")
    np.testing.assert_allclose(zeroed.numbers[:, 1], [0, 0.05, 0.1, 0.15, 0.2, 0.25], atol=1e-12)
    assert (zeroed.doubts, zeroed.notes) == ((), ("displacement counted from its first value, 37.21 mm",))
    tared = read(tmp_path, 2.0, 0.5, titles="t_s,Load (kN),Disp_mm", start=1.0, zero_force="first")
    assert tared.numbers[:, 2].tolist() == [0, 2000, 4000, 6000, 8000, 10000]
    assert tared.notes == ("force counted from its first value, 1000 N",)


@pytest.mark.parametrize("title", ["Position (mm)", "Length (mm)", "Stretch"])
def test_what_has_a_zero_of_its_own_is_not_shifted(tmp_path, title):
    titles = f"t_s,{title},F_N"
    assert ends(read(tmp_path, 0.05, 2.0, titles=titles, start=1.5, zero_displacement="first")) == [1.75, 10.0]


@pytest.mark.parametrize(
    ("motion", "load", "words", "choices"),
    [
        (-0.1, -2.0, "a compression, unless the machine counts tension as negative", ("both", "force", "none")),
        (-0.1, 2.0, "the specimen gets shorter, but forces are above 0", ("displacement", "force", "none")),
        (0.1, -2.0, "forces are negative, but sinew takes tension as positive", ("force", "none")),
    ],
)
def test_signs_are_doubtful_until_told(tmp_path, motion, load, words, choices):
    (doubt,) = read(tmp_path, motion, load).doubts
    assert doubt.text.startswith(words)
    assert (doubt.option, doubt.choices) == ("--negate", choices)
    assert read(tmp_path, motion, load, negate="none").doubts == ()


@pytest.mark.parametrize(
    ("motion", "force", "words"),
    [
        (1.0, -1.0, "forces are negative, but sinew takes tension as positive"),
        (1.0, 1.0, None),
        (-1.0, -1.0, "a compression, unless the machine counts tension as negative"),
        (-1.0, 1.0, "the specimen gets shorter, but forces are above 0"),
    ],
)
def test_the_sign_of_cycles_that_end_below_zero_is_that_of_their_peaks(tmp_path, motion, force, words):
    moved = np.abs(np.sin(np.linspace(0.0, 4.0 * np.pi, 120)))
    load = 1343.0 * moved**3 - 483.0 * (1.0 - moved)
    rows = zip(np.arange(120) / 10, motion * moved, force * load, strict=True)
    path = tmp_path / "cycles.csv"
    text = "\n".join(f"{t:.4f},{d:.5f},{f:.3f}" for t, d, f in rows)
    path.write_text(f"Time (s),Displacement (mm),Force (N)\n{text}\n")
    recording = as_told(*read_recordings(path, Hints()), Hints())
    assert [doubt.text[: len(words)] for doubt in recording.doubts] == [words] if words else not recording.doubts


def test_a_start_of_most_of_the_way_is_doubtful(tmp_path):
    path = tmp_path / "offset.csv"
    for start, open_ in ((0.31, True), (0.25, False)):
        rows = "\n".join(f"{i},{start + 0.0039 * i:.4f},{8 * i}" for i in range(100))
        path.write_text(f"Time (s),Displacement (mm),Force (N)\n{rows}\n")
        recording = as_told(*read_recordings(path, Hints()), Hints())
        assert [doubt.option for doubt in recording.doubts] == ["--zero-displacement"] * open_


def test_what_gets_the_other_sign(tmp_path):
    assert ends(read(tmp_path, 0.1, -2.0, negate="force")) == [0.5, 10.0]
    assert ends(read(tmp_path, -0.1, 2.0, negate="displacement")) == [0.5, 10.0]
    both = read(tmp_path, 0.1, 2.0, negate="both")
    assert ends(both) == [-0.5, -10.0]
    assert not np.signbit(both.numbers[0]).any(), "0 stays 0"
    assert both.notes == ("displacement with the other sign, by --negate", "force with the other sign, by --negate")
    with pytest.raises(
        BadInput, match="a stretch has no sign, but --negate says both; expected --negate force or none"
    ):
        read(tmp_path, 0.1, 2.0, titles="t_s,Stretch,F_N", start=1.0, negate="both")


@pytest.mark.parametrize(
    ("above", "titles"),
    [
        ("Test type: Compression", TITLES),
        ("Prüfart,Druckversuch", TITLES),
        ("", "Time (s),Compressive extension (mm),Load (N)"),
        ("", f"{TITLES},压缩应变(%)"),
        ("", f"{TITLES},Naprężenie ściskające (MPa)"),
        ("Вид испытания,сжатие", TITLES),
        ("", "Time On Sample (s),Displacement Into Surface (mm),Load On Sample (N)"),
        ("Indenter shape correction,none", TITLES),
    ],
)
def test_a_compression_counted_as_positive_is_doubtful(tmp_path, above, titles):
    path = tmp_path / "test.csv"
    path.write_text(
        f"{above}\n{titles}\n" + "".join(f"{i},{i},{i}{',1' * (titles.count(',') - 2)}\n" for i in range(6))
    )
    (doubt,) = as_told(read_recordings(path, Hints())[0], Hints()).doubts
    assert doubt.text.startswith("a compression by '")
    assert "which is the sign of tension" in doubt.text
    assert doubt.choices == ("both", "force", "none")


@pytest.mark.parametrize(
    "title", ["Size (mm)", "Ecartement entre outils (mm)", "Tool distance (mm)", "Tool separation"]
)
@pytest.mark.parametrize(
    ("load", "words", "choices"),
    [
        (2.0, "forces are above 0, which is the sign of tension", ("both", "force", "none")),
        (-2.0, "forces are negative", ("displacement", "none")),
    ],
)
def test_a_length_that_falls_as_the_displacement_rises_tells_of_a_compression(tmp_path, title, load, words, choices):
    path = tmp_path / "test.csv"

    def doubts(sign, **told):
        rows = "".join(f"{i},{0.1 * i:g},{load * i:g},{20 + sign * 0.1 * i:g}\n" for i in range(6))
        path.write_text(f"{TITLES},{title}\n{rows}")
        return as_told(read_recordings(path, Hints())[0], Hints(**told)).doubts

    (doubt,) = doubts(-1)
    assert doubt.text == f"a compression: '{title}' falls as the displacement rises, and {words}"
    assert doubt.choices == choices
    assert doubts(-1, negate=choices[0]) == ()
    assert not any("compression" in one.text for one in doubts(1))


@pytest.mark.parametrize("above", ["Load cell: tension/compression 50 N", "Tensile test", "Zug-Druckversuch"])
def test_a_line_on_both_directions_tells_of_none(tmp_path, above):
    assert read(tmp_path, 0.1, 2.0, above=above).doubts == ()


def test_a_compression_that_is_told_and_below_0_is_certain_to_be_one(tmp_path):
    (doubt,) = read(tmp_path, -0.1, -2.0, above="Compression test").doubts
    assert doubt.text.startswith("a compression: the specimen gets shorter and forces are negative")


SAMPLES_S = np.linspace(0.0, 8.0, 401)
PULL, AFTER = np.minimum(SAMPLES_S, 6.0), np.maximum(SAMPLES_S - 6.0, 0.0)
LATER = SAMPLES_S >= 6.0


def sampled(folder: Path, motion_mm: np.ndarray, force_N: np.ndarray, **told) -> Recording:
    path = folder / "test.csv"
    rows = "".join(f"{t:g},{u:g},{f:g}\n" for t, u, f in zip(SAMPLES_S, motion_mm, force_N, strict=True))
    path.write_text(f"{TITLES}\n{rows}")
    (recording,) = read_recordings(path, Hints())
    return as_told(recording, Hints(**told))


def test_a_displacement_that_is_set_to_zero_again_after_a_preload_is_doubtful_until_told(tmp_path):
    motion, force = np.where(LATER, AFTER, PULL), SAMPLES_S
    found = sampled(tmp_path, motion, force)
    (doubt,) = found.doubts
    assert doubt.text == (
        "the displacement jumps from 5.98 mm to 0 mm at 6 s while the force does not change: likely set to zero "
        "again after a preload of 300 rows"
    )
    assert (doubt.option, doubt.choices) == ("--preload", ("leave-out", "keep"))
    kept = sampled(tmp_path, motion, force, preload="keep")
    assert (len(kept.numbers), kept.doubts) == (401, ())
    assert kept.numbers[:, 1] == pytest.approx(np.where(LATER, 5.98 + AFTER, PULL))
    cut = sampled(tmp_path, motion, force, preload="leave-out")
    assert (len(cut.numbers), len(cut.rows), cut.doubts) == (101, 101, ())
    assert cut.numbers[0].tolist() == [6.0, 0.0, 6.0]
    assert cut.notes == ("the first 300 rows left out, as --preload says: then the displacement was set to zero again",)


@pytest.mark.parametrize(
    ("motion", "force"),
    [
        (np.where(LATER, AFTER, PULL), 3.0 * np.where(LATER, AFTER, PULL)),  # the specimen was let go
        (PULL - AFTER, 3.0 * (PULL - AFTER)),
        (0.0 * PULL, PULL),
        # broken, and moved back in two rows; cycles that end in a slack region, without load
        (np.where(LATER, 0.0, PULL) + 2.0 * (np.arange(401) == 300), np.where(SAMPLES_S < 5.0, SAMPLES_S, 0.0)),
        (SAMPLES_S % 1.0, np.where(SAMPLES_S % 1.0 > 0.5, 0.0, SAMPLES_S % 1.0)),
        (PULL + 3.0 * (SAMPLES_S > 5.0) + 5.0 * (SAMPLES_S > 7.0), SAMPLES_S),  # two jumps to elsewhere
        (np.where(LATER, 0.0, PULL), np.maximum(3.0 - np.abs(SAMPLES_S - 3.0), 0.0)),  # driven back behind the test
    ],
)
def test_other_courses_are_not_taken_for_a_preload(tmp_path, motion, force):
    assert not [one for one in sampled(tmp_path, motion, force).doubts if one.option == "--preload"]
    assert len(sampled(tmp_path, motion, force, preload="leave-out").numbers) == 401


def test_a_displacement_that_is_set_to_zero_twice_counts_from_the_last_zero_or_goes_on_at_both(tmp_path):
    """After a preload, and again after a preconditioning; a later jump to elsewhere is none of them."""
    motion = np.where(SAMPLES_S < 3.0, PULL, np.where(LATER, AFTER, PULL - 3.0))
    (doubt,) = sampled(tmp_path, motion, SAMPLES_S).doubts
    assert doubt.text == (
        "the displacement jumps 2 times, the last time from 2.98 mm to 0 mm at 6 s while the force does not change: "
        "likely set to zero again after a preload of 300 rows"
    )
    cut = sampled(tmp_path, motion, SAMPLES_S, preload="leave-out")
    assert (len(cut.numbers), cut.numbers[0].tolist(), cut.doubts) == (101, [6.0, 0.0, 6.0], ())
    kept = sampled(tmp_path, motion, SAMPLES_S, preload="keep")
    assert kept.numbers[[149, 150, 299, 300, 400], 1] == pytest.approx([2.98, 2.98, 5.96, 5.96, 7.96])
    assert kept.notes == (
        "displacement counted on by 2.98 mm after the first 150 rows, where it was set to zero again",
        "displacement counted on by 2.98 mm after the first 300 rows, where it was set to zero again",
    )
    (doubt,) = sampled(tmp_path, np.where(LATER, AFTER, PULL) + 5.0 * (SAMPLES_S > 7.0), SAMPLES_S).doubts
    assert "jumps from 5.98 mm to 0 mm at 6 s" in doubt.text


def test_few_rows_before_a_new_zero_are_enough_and_an_option_that_finds_none_says_so(tmp_path):
    """A step of 19 usual ones, in a file of 60 rows."""
    rows = [(0.1 * i, 0.05 * i, 0.1 * i) for i in range(20)] + [
        (2 + 0.1 * i, 0.05 * i, 1.9 + 0.5 * i) for i in range(40)
    ]
    path = tmp_path / "coarse.csv"
    path.write_text(f"{TITLES}\n" + "".join(f"{t:g},{u:g},{f:g}\n" for t, u, f in rows))
    (recording,) = read_recordings(path, Hints())
    assert [doubt.option for doubt in as_told(recording, Hints()).doubts] == ["--preload"]
    assert len(as_told(recording, Hints(preload="leave-out")).numbers) == 40
    nowhere = "--preload has no effect: the displacement is never set to zero again"
    assert sampled(tmp_path, PULL, 3.0 * PULL, preload="keep").notes == (nowhere,)


def test_what_is_kept_beside_the_force_goes_with_the_rows(tmp_path):
    path = tmp_path / "test.csv"
    rows = "".join(f"{t:g},{u:g},{t:g},{t:g}\n" for t, u in zip(SAMPLES_S, np.where(LATER, AFTER, PULL), strict=True))
    path.write_text(f"{TITLES},Width\n{rows}")
    hints = Hints(keep_column=("Width=width:mm",), preload="leave-out")
    (recording,) = read_recordings(path, hints)
    found = as_told(recording, hints)
    assert found.further.values["width"].tolist() == found.numbers[:, 0].tolist()


def test_a_strain_may_start_at_an_offset_as_well(tmp_path):
    path = tmp_path / "test.csv"
    path.write_text("time_s,strain_%,force_N\n" + "".join(f"{i},{12 + i},{i}\n" for i in range(8)))
    (recording,) = (as_told(one, Hints()) for one in read_recordings(path, Hints()))
    (doubt,) = recording.doubts
    assert doubt.text == (
        "the strain starts at 0.12 but changes by only 0.07; the start may be an offset of the machine"
    )
    first = as_told(recording, Hints(zero_displacement="first"))
    assert first.numbers[0, 1] == 0.0
