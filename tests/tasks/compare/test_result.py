"""What a comparison cannot find."""

import pytest

from sinew.tasks.compare.result import Interval


def test_an_interval_ends_after_it_begins():
    assert Interval(1.0, 0.5, 0.5, 0.9).exponential().high > 1.0
    Interval(float("nan"), float("nan"), float("nan"), float("nan"))
    with pytest.raises(ValueError, match=r"an interval from 2 to 0\.5"):
        Interval(1.0, 2.0, 0.5, 0.9)
