"""The size that a Zstandard frame states, for all forms of its header (RFC 8878, section 3.1.1)."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from numcodecs import Zstd

from sinew.runner.store.chunks import zstd_size

MAGIC = b"\x28\xb5\x2f\xfd"


def frame(size: int, length: int, dictionary: int, *, single: bool, checked: bool, blocks: list[int]) -> bytes:
    """A frame whose size takes ``length`` bytes and whose dictionary has so many, with raw blocks of these lengths."""
    described = (0, 1, 2, 4, 8).index(length) - 1 if length > 1 else 0
    flags = described << 6 | single << 5 | checked << 2 | (0, 1, 2, 4).index(dictionary)
    content = MAGIC + bytes([flags]) + (b"" if single else b"\x00") + bytes(dictionary)
    content += (size - (256 if length == 2 else 0)).to_bytes(length, "little")
    for number, block in enumerate(blocks):
        content += (block << 3 | (number == len(blocks) - 1)).to_bytes(3, "little") + bytes(block)
    return content + bytes(4 * checked)


@given(
    st.sampled_from([1, 2, 4, 8]),
    st.sampled_from([0, 1, 2, 4]),
    st.booleans(),
    st.booleans(),
    st.lists(st.integers(0, 40), min_size=1, max_size=4),
    st.data(),
)
def test_the_size_of_any_header(length, dictionary, single, checked, blocks, data):
    least = 256 if length == 2 else 0
    size = data.draw(st.integers(least, least + 256**length - 1))
    single = single or length == 1  # a byte of size is there in single segments only
    whole = frame(size, length, dictionary, single=single, checked=checked, blocks=blocks)
    assert zstd_size(whole) == size
    assert zstd_size(whole + b"x") is None
    assert zstd_size(whole[:-1]) is None


@pytest.mark.parametrize("size", [0, 1, 255, 256, 300, 65_791, 65_792, 10**6])
def test_the_size_of_what_the_library_writes(size):
    assert zstd_size(bytes(Zstd(3).encode(bytes(size)))) == size


@pytest.mark.parametrize("content", [b"", MAGIC, MAGIC + b"\x20", b"\x29" + MAGIC[1:] + bytes(10)])
def test_what_is_no_frame_has_no_size(content):
    assert zstd_size(content) is None
