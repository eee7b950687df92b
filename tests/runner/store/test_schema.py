"""The schema of a table: its key and the size of its chunks."""

import math
from dataclasses import replace

import pytest

import sinew.runner.store.store as store_module
from sinew.runner.store.schema import CHUNK_ROWS
from tests.runner.evaluations import table_spec


def test_wide_curves_get_chunks_of_fewer_rows():
    assert table_spec().chunk_rows == CHUNK_ROWS
    wide = table_spec(points=40_667).chunk_rows
    assert wide * 40_667 * 8 <= 2**25
    assert wide >= 16


def test_the_key_names_the_content():
    assert table_spec("a").key == table_spec("a").key
    assert table_spec("a").key != table_spec("b").key
    assert store_module.FORMAT == 1


@pytest.mark.parametrize(
    ("points", "rows"), [(1, 2048), (2048, 2048), (2049, 1024), (4096, 1024), (4097, 512), (200_000, 16), (10**7, 16)]
)
def test_no_chunk_is_larger_than_32_megabytes(points, rows):
    assert table_spec(points=points).chunk_rows == rows


def test_a_key_does_not_depend_on_the_order_of_its_parts():
    one, other = (replace(table_spec(), identity=identity) for identity in ({"a": 1, "b": 2}, {"b": 2, "a": 1}))
    assert one.key == other.key == "b48465408132d0bff24c5d5f94bfe758"
    with pytest.raises(ValueError, match="JSON"):
        _ = replace(table_spec(), identity={"a": math.nan}).key
