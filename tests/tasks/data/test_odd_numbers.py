"""Limits of sensors, converters that overflow and gaps in time are told."""

import numpy as np

from sinew.tasks.data.remarks import remarks
from tests.tasks.data.one_test_file import TIME, changed, read


def test_a_usual_test_is_not_odd(tmp_path):
    assert remarks(read(tmp_path)) == []


def test_a_force_at_its_limit_is_told(tmp_path):
    moved = np.linspace(0.0, 1.0, 40)
    (line,) = remarks(read(tmp_path, moved=moved, force=np.minimum(100.0 * moved, 80.0)))
    assert line == (
        "the force stays at exactly 80 N, its largest value, in 8 rows while the displacement goes on; "
        "it may be the limit of the load cell"
    )
    (line,) = remarks(read(tmp_path, moved=moved, force=changed(100.0 * moved, slice(30, 35), 120.0)))
    assert "in 5 rows" in line
    assert remarks(read(tmp_path, moved=moved, force=changed(100.0 * moved, slice(30, 34), 120.0))) == []


def test_a_converter_that_overflows_is_told(tmp_path):
    moved = np.linspace(0.0, 1.0, 40)
    force = np.where(moved > 0.8, -32.8 + 20 * (moved - 0.8), 40.0 * moved)
    found = [line for line in remarks(read(tmp_path, moved=moved, force=force)) if "converter" in line]
    assert found == ["the force turns from 31.79 to -32.39 N from one row to the next, at 3.2 s; "
                     "a converter may have overflowed"]  # fmt: skip
    cyclic = 30.0 * np.sin(np.arange(40) / 3)
    assert not [line for line in remarks(read(tmp_path, force=cyclic)) if "converter" in line]


def test_a_gap_in_time_is_told(tmp_path):
    time = TIME + np.where(np.arange(40) > 25, 3600.0, 0.0)
    (line,) = remarks(read(tmp_path, time=time))
    assert line == ("times go on from 2.5 to 3602.6 s from one row to the next; rows may be missing in between")
    assert remarks(read(tmp_path, time=np.geomspace(1.0, 4000.0, 40))) == [], "ever longer steps"
    assert remarks(read(tmp_path, time=np.concatenate([TIME[:20], TIME[19] + np.arange(1, 21) * 10.0]))) == [], (
        "another rate"
    )


def test_a_force_that_rises_as_a_motion_does_is_told(tmp_path):
    even, curved = np.arange(40) * 0.25, np.sqrt(np.arange(40.0))

    def told(moved, force):
        return any("may be exchanged" in line for line in remarks(read(tmp_path, moved=moved, force=force)))

    assert told(curved, even)
    assert not told(curved, changed(even, slice(5, 7), 1.1)), "a measured force"
    assert not told(even * 2, even), "an elastic specimen"
    assert not told(curved, even[::-1])
