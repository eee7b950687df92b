"""What follows a break, or a jump of the motion in the last rows, is left out where a person says so."""

from pathlib import Path

import numpy as np
import pytest

from sinew.tasks.data.curves import Bar, curve_of
from sinew.tasks.data.ends import END
from sinew.tasks.data.hints import Hints
from sinew.tasks.data.recording import Recording
from sinew.tasks.data.recordings import read_recordings
from sinew.tasks.data.told import as_told

WAY = np.linspace(0.0, 1.0, 100)
RAMP = 100.0 * WAY
BROKEN = np.where(np.arange(100) > 90, 60.0, RAMP)


def read(folder: Path, moved=WAY, force=RAMP, titles="Time (s),Displacement (mm),Force (N)", **told) -> Recording:
    path = folder / "test.csv"
    further = ",w" if told.get("keep_column") else ""
    rows = "".join(
        f"{i / 10:g},{u:.10g},{f:.10g}{further and ',7'}\n" for i, (u, f) in enumerate(zip(moved, force, strict=True))
    )
    path.write_text(f"{titles}{further}\n{rows}")
    hints = Hints(**told)
    return as_told(read_recordings(path, hints)[0], hints)


def ends(recording: Recording) -> list[str]:
    return [one.text for one in recording.doubts if one.option == END]


def test_a_break_is_doubtful_until_told(tmp_path):
    (doubt,) = read(tmp_path, force=BROKEN).doubts
    assert doubt.text == (
        "the force falls from 90.91 N to 60 N from 9 to 9.1 s, while the specimen is still being loaded; "
        "this may be a break, which the model does not describe"
    )
    assert (doubt.option, doubt.choices) == ("--end", ("leave-out", "keep"))
    kept = read(tmp_path, force=BROKEN, end="keep")
    assert (len(kept.numbers), kept.doubts, kept.notes) == (100, (), ())
    cut = read(tmp_path, force=BROKEN, end="leave-out", keep_column=("w=width:mm",))
    assert (len(cut.numbers), len(cut.rows), cut.doubts) == (91, 91, ())
    assert cut.notes == (f"the last 9 rows left out, as --end says: {doubt.text}",)
    assert curve_of(cut, Bar(10.0, 1.0, 1.0), "pull").others["width"].size == 91


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("last", [1, 5])
def test_a_motion_that_jumps_at_the_end_is_doubtful_until_told(tmp_path, sign, last):
    moved = sign * WAY
    moved[-last:] = -sign * 1.4
    (text,) = ends(read(tmp_path, moved, sign * RAMP, negate="none"))
    assert text.startswith(f"the displacement jumps from {number(moved[-last - 1])} mm to {-sign * 1.4:g} mm at ")
    assert f"at {(100 - last) / 10:g} s, at the end of the test" in text
    cut = read(tmp_path, moved, sign * RAMP, negate="none", end="leave-out")
    assert len(cut.numbers) == 100 - last
    assert ends(cut) == []


def number(value: float) -> str:
    return f"{value:.4g}"


def test_what_comes_first_ends_the_test(tmp_path):
    moved = WAY.copy()
    moved[-1] = 5.0
    (told,) = ends(read(tmp_path, moved, BROKEN))
    assert told.startswith("the force falls") and "; later, the displacement jumps" in told
    assert len(read(tmp_path, moved, BROKEN, end="leave-out").numbers) < 92
    assert ends(read(tmp_path, moved, RAMP))[0].startswith("the displacement jumps")


def test_stresses_and_strains_are_told_in_their_units(tmp_path):
    titles = "Time (s),Strain (mm/mm),Stress (kPa)"
    assert ends(read(tmp_path, WAY, BROKEN, titles))[0].startswith("the stress falls from 0.09091 MPa to 0.06 MPa")
    moved = np.append(WAY[:-1], 3.0)
    assert ends(read(tmp_path, moved, RAMP, titles))[0].startswith("the strain jumps from 0.9899 to 3 at 9.9 s")


@pytest.mark.parametrize(("step", "named"), [(0.15, False), (0.25, True)])  # 20 usual steps are 0.2 mm
def test_a_jump_is_of_many_usual_steps(tmp_path, step, named):
    moved = WAY.copy()
    moved[-1] += step
    assert bool(ends(read(tmp_path, moved))) is named


def test_usual_ends_are_not_doubtful(tmp_path):
    back = np.concatenate([np.linspace(0.0, 1.0, 60), np.linspace(1.0, 0.0, 41)[1:]])
    held = np.concatenate([np.linspace(0.0, 1.0, 60), np.full(40, 1.0)])
    midst = np.where(np.arange(100) < 50, WAY, WAY + 1.0)
    for moved in (WAY, back, held, midst):
        assert ends(read(tmp_path, moved, 100.0 * moved)) == []
        assert len(read(tmp_path, moved, 100.0 * moved, end="leave-out").numbers) == 100
    assert ends(read(tmp_path, WAY[:3], RAMP[:3])) == [], "a short test"
    assert ends(read(tmp_path, 0.0 * WAY, RAMP)) == [], "nothing moves"


def test_where_times_go_back_there_is_no_end(tmp_path):
    """The file is refused for its times."""
    recording = read(tmp_path, force=BROKEN)
    recording.numbers[50, 0] = 0.0
    assert ends(as_told(recording, Hints())) == []


def test_an_end_is_looked_for_in_what_is_counted(tmp_path):
    """An offset of the force, and the machine's sign, change neither the question nor the answer."""
    for told in ({"zero_force": "first"}, {"zero_force": "first", "negate": "both"}):
        sign = -1.0 if "negate" in told else 1.0
        force = 1000.0 + sign * BROKEN
        assert len(ends(read(tmp_path, sign * WAY, force, **told))) == 1
        assert len(read(tmp_path, sign * WAY, force, **told, end="leave-out").numbers) == 91


@pytest.mark.parametrize("titles", ["Time (s),Stretch,Force (N)", "Time (s),Length (mm),Force (N)"])
def test_a_compression_told_as_a_length_may_break(tmp_path, titles):
    moved = 1.0 - 0.2 * WAY
    assert len(ends(read(tmp_path, moved, -BROKEN, titles, negate="none"))) == 1


def test_an_end_that_leaves_next_to_nothing_is_none(tmp_path):
    moved = np.array([0.0, 0.1, 5.0, 5.1, 5.2, 5.3, 5.4])
    assert ends(read(tmp_path, moved, 10.0 * moved)) == []


def test_zeros_at_the_end_are_doubtful_until_told(tmp_path):
    moved, force = WAY.copy(), RAMP.copy()
    moved[80:] = force[80:] = 0.0
    found = read(tmp_path, moved, force)
    assert ends(found) == ["displacement and force are exactly 0 in the last 20 rows; they may not have been recorded"]
    assert len(read(tmp_path, moved, force, end="leave-out").numbers) == 80
    back = np.concatenate([WAY[:50], WAY[49::-1]])
    assert ends(read(tmp_path, back, 100 * back)) == [], "it goes back to where it began"
