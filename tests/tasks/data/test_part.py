"""Some of many rows, without a copy of them."""

from hypothesis import given
from hypothesis import strategies as st

from sinew.tasks.data.part import Part

PLACES = st.none() | st.integers(-12, 12)


@given(st.integers(0, 8), st.integers(0, 8), PLACES, PLACES, st.sampled_from([None, 1, 2, -1]))
def test_a_part_is_what_a_list_of_it_would_be(start, length, first, last, step):
    every = list("abcdefghijklmnop")
    part, known = Part(every, start, start + length), every[start : start + length]
    assert list(part) == known
    assert len(part) == length
    assert list(part[first:last:step]) == known[first:last:step]
    assert [part[at] for at in range(-length, length)] == known + known
    for at in (length, -length - 1):
        try:
            part[at]
        except IndexError:
            continue
        raise AssertionError(at)
