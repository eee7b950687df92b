"""What the end of a zip says of its list of members."""

import io
import struct
import zipfile

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sinew.runner.zip_end import directory_of

END_64 = struct.Struct("<4sQ2H2L4Q")


def packed(members: int) -> bytes:
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as archive:
        for number in range(members):
            archive.writestr(f"{number:05d}", b"")
    return content.getvalue()


@pytest.mark.parametrize("members", [0, 1, 300, 66_000])
def test_members_and_their_list_are_told(members):
    """Beyond 65,535 of them, a zip has longer records."""
    assert directory_of(io.BytesIO(packed(members))) == (members, members * (46 + 5))


@given(st.binary(max_size=200))
def test_what_is_no_zip_is_refused(content):
    if content[-22:-18] == b"PK\5\6":
        return
    with pytest.raises(ValueError, match="zip"):
        directory_of(io.BytesIO(content))


def test_records_that_contradict_each_other_are_refused():
    """Another reader may follow the locator elsewhere."""
    content = bytearray(packed(66_000))
    locator = len(content) - 22 - 20
    content[locator + 8 : locator + 16] = struct.pack("<Q", 7)
    with pytest.raises(ValueError, match="does not end as a zip"):
        directory_of(io.BytesIO(content))
    with pytest.raises(ValueError, match="does not end as a zip"):
        directory_of(io.BytesIO(bytes(content[-22 - 20 :])))
    with pytest.raises(ValueError, match="does not end as a zip"):
        directory_of(io.BytesIO(packed(3)[:-2] + b"\1\0."))
