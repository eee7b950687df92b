"""What is compared along a protocol: shares of points, values where nothing was measured, and names of columns."""

import numpy as np
import pytest

from sinew.tasks.model import Protocol
from sinew.tasks.simulate.evaluation import kept_points
from sinew.tasks.simulate.series import Series, with_unit


def series(values, level: float = 2.0) -> Series:
    values = np.array(values, dtype=float)
    return Series("width", "pull", "width_pull", np.arange(values.size, dtype=float), values, level)


def test_every_measured_point_belongs_to_the_nearest_kept_one():
    rows = np.array([0, 4, 9])
    np.testing.assert_array_equal(series(np.arange(10)).shares(rows), [2, 5, 3])
    gaps = np.where(np.arange(10) % 3 == 0, 1.0, np.nan)  # 0, 3, 6, 9
    np.testing.assert_array_equal(series(gaps).shares(rows), [1, 2, 1])
    assert series(gaps).count == 4


def test_values_are_in_levels_and_interpolated_where_nothing_was_measured():
    np.testing.assert_array_equal(series([0, 2, 4]).at(np.array([1, 2])), [1.0, 2.0])
    np.testing.assert_array_equal(series([0, np.nan, 4, np.nan]).at(np.arange(4)), [0.0, 1.0, 2.0, 2.0])


@pytest.mark.parametrize(
    ("name", "unit", "column"),
    [("force", "N", "force_N"), ("width_change_mm", "mm", "width_change_mm"), ("strain", "1", "strain"),
     ("rate", "mm/s", "rate_mm_per_s")],
)  # fmt: skip
def test_columns_name_their_unit(name, unit, column):
    assert with_unit(name, unit) == column


def test_points_are_kept_where_everything_was_measured():
    time = np.linspace(0.0, 100.0, 2001)
    moved = np.minimum(time, 5.0)
    alone = kept_points(Protocol("hold", time, moved), 96)
    seen = np.arange(3, 2001, 10)
    kept = kept_points(Protocol("hold", time, moved, seen), 96)
    assert kept.size == alone.size == 96
    assert np.isin(kept[1:-1], seen).all()
    assert kept[[0, -1]].tolist() == [0, 2000]
    few = kept_points(Protocol("hold", time, moved, np.array([7, 900])), 96)
    assert few.size == 96
    assert {7, 900} <= set(few.tolist())
