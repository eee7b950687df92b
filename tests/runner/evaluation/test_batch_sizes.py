"""How many rows the next batch holds."""

import math

import pytest

from sinew.runner.evaluation.batch_sizes import BatchSizes

ALL = 10**6


def measured(each: float, *, multiple: int = 1, largest: int = ALL) -> BatchSizes:
    sizes = BatchSizes(multiple, largest)
    sizes.measured(each)
    return sizes


def size(sizes: BatchSizes, slots: int = 1, *, aim_s=0.5, left=ALL, running=0, limit=ALL, awaited=None) -> int:
    return sizes.next(slots, aim_s, left, running, limit, awaited)


def test_a_batch_takes_as_long_as_it_shall():
    assert size(measured(0.01)) == 50
    assert size(measured(0.01), aim_s=0.25) == 25
    assert size(measured(2.0)) == 1


def test_many_workers_get_longer_batches():
    """A scheduler keeps up with 30 batches per second."""
    assert size(measured(0.01), 60) == 200
    assert size(measured(0.01), 15) == 50


def test_the_median_of_the_last_nine_run_times_counts():
    sizes = BatchSizes(1, ALL)
    for seconds in (9.0, 9.0, *[0.01] * 5, 5.0, 5.0, 5.0, 5.0):
        sizes.measured(seconds)
    assert size(sizes) == 50
    sizes.measured(math.nan)
    sizes.measured(math.inf)
    assert size(sizes) == 50


def test_rows_that_take_no_time_are_no_reason_to_fail():
    assert size(measured(0.0)) == ALL


def test_the_first_batches_are_small_and_grow_eightfold_at_most():
    sizes = BatchSizes(1)
    assert [size(sizes) for _ in range(2)] == [1, 1], "nothing is known yet"
    sizes.measured(1e-6)
    assert [size(sizes) for _ in range(3)] == [8, 64, 512]
    assert sizes.largest == 512


def test_batches_are_multiples():
    sizes = BatchSizes(16)
    assert size(sizes) == 16
    sizes.measured(0.01)
    assert size(sizes) == 64, "50 rounded up"
    assert size(sizes, left=3) == 16


def test_a_batch_is_no_larger_than_a_chunk_or_a_fair_part():
    assert size(measured(0.01), limit=20) == 20
    assert size(measured(0.01), 4, left=101) == 26


def test_the_last_rows_are_not_cut_into_ever_smaller_batches():
    assert size(measured(0.001), 2, left=10) == 50
    assert size(measured(0.1), 2, left=10) == 5, "half of them takes long enough"
    assert size(measured(0.001), 2, left=10, running=50, awaited=0) == 15, "an adaptive run waits for them all"


def test_what_an_adaptive_run_waits_for_comes_in_short_batches():
    assert size(measured(0.01), awaited=0) == 10
    assert size(measured(0.01), awaited=0, aim_s=0.05) == 5
    assert size(measured(0.01), 60, awaited=0) == 50, "120 batches per second are too many"


def test_in_a_long_queue_batches_may_be_longer_up_to_the_usual_duration():
    assert size(measured(0.01), 2, awaited=100) == 25
    assert size(measured(0.01), 2, awaited=1000) == 50
    assert size(measured(0.01), 2, awaited=20) == 10


def test_half_of_what_waits_and_runs_is_left_for_those_who_become_free():
    assert size(measured(0.02), 2, awaited=0, left=7, running=12) == 5
    assert size(measured(0.02), 2, left=7, running=12) == 4


def test_how_long_rows_may_take_is_told_by_the_slowest():
    assert BatchSizes(1).expected_s(10) == 0.0
    sizes = measured(0.5)
    sizes.measured(2.0)
    sizes.measured(1.0)
    assert sizes.expected_s(10) == pytest.approx(1.25 * 2.0 * 10)
    for _ in range(200):
        sizes.measured(0.1)
    assert sizes.expected_s(1) == pytest.approx(0.125), "what is long ago does not count"
