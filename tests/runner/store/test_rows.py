"""Hashes of rows, their grouping by chunk, and the index of known rows."""

import hypothesis.strategies as st
import numpy as np
from hypothesis import given

from sinew.runner.store.rows import RowIndex, by_chunk, hash_rows, slices, spans
from tests.runner.stores import some


def test_hashes_do_not_depend_on_blocks_or_on_the_sign_of_zero():
    parameters = some(10)
    parameters[4, 0] = 0.0
    hashes = hash_rows(parameters, 3)
    assert len(set(hashes.tolist())) == 10
    parameters[4, 0] = -0.0
    assert np.array_equal(hash_rows(parameters, 100), hashes)


def test_numbers_that_are_nearly_zero_are_told_apart():
    assert len(set(hash_rows(np.array([[1e-17], [2e-17], [-1e-17]]), 10).tolist())) == 3


def test_the_index_finds_rows_that_were_added_in_any_order():
    hashes = np.array([30, 10, 20], dtype=np.uint64)
    index = RowIndex(hashes, np.array([0, 1, 2]))
    index.add(np.array([25, 5], dtype=np.uint64), np.array([3, 4]))
    assert index.find(np.array([5, 10, 20, 25, 30], dtype=np.uint64)).tolist() == [4, 1, 2, 3, 0]
    assert index.find(np.array([4, 6, 31], dtype=np.uint64)).tolist() == [-1, -1, -1]


def test_an_empty_index_finds_nothing():
    none = np.array([], dtype=np.uint64)
    assert RowIndex(none, none.astype(np.int64)).find(np.array([1, 2], dtype=np.uint64)).tolist() == [-1, -1]


def test_slices_cover_all_rows_once():
    assert [(s.start, s.stop) for s in slices(7, 3)] == [(0, 3), (3, 6), (6, 7)]
    assert list(slices(0, 3)) == []


def test_positions_are_grouped_by_the_chunk_of_their_row():
    rows = np.array([9, 0, 5, 1, 4, 8])
    assert [rows[block].tolist() for block in by_chunk(rows, 4)] == [[0, 1], [5, 4], [9, 8]]
    assert list(by_chunk(np.array([], dtype=np.int64), 4)) == []


@given(st.sets(st.integers(0, 40)), st.integers(1, 5))
def test_spans_are_runs_of_consecutive_numbers_of_limited_length(numbers, most):
    found = spans(sorted(numbers), most)
    assert [n for first, last in found for n in range(first, last + 1)] == sorted(numbers)
    lengths = [last - first + 1 for first, last in found]
    assert all(length == most or last + 1 not in numbers for length, (_, last) in zip(lengths, found, strict=True))
    assert max(lengths, default=0) <= most
