"""Files that tests give to readers: whatever stands in one, it is read, or refused in one printable line."""

from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from hypothesis import HealthCheck, settings
from hypothesis import strategies as st

from sinew.runner.errors import BadInput

quick = settings(max_examples=100, deadline=None, suppress_health_check=[HealthCheck.too_slow])


def read_or_refuse(read: Callable[[Path], Any], path: str, *, files: dict[str, str | bytes]) -> Any:
    """What ``read`` makes of the file at ``path``, or None when it says in one line what is wrong with it."""
    with TemporaryDirectory() as folder:
        for name, content in files.items():
            file = Path(folder, name)
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(content.encode() if isinstance(content, str) else content)
        try:
            return read(Path(folder, path))
        except BadInput as problem:
            line = str(problem)
            assert line.isprintable()
            assert line.startswith(folder)
            assert "; expected " in line
            return None


def mutated(valid: str) -> st.SearchStrategy[bytes]:
    """A valid file with a few pieces replaced by others."""
    piece = st.binary(max_size=4) | st.sampled_from(
        [b"", b",", b"\n", b"\r", b'"', b";", b"-", b".", b"e9", b"e308", b"\0", b"\xff", b"nan", b"inf", b"_", b"1 "]
    )
    edit = st.tuples(st.integers(0, len(valid)), st.integers(0, 3), piece)

    def apply(edits: list[tuple[int, int, bytes]]) -> bytes:
        content = valid.encode()
        for start, length, new in edits:
            content = content[:start] + new + content[start + length :]
        return content

    return st.lists(edit, min_size=1, max_size=4).map(apply)


NUMBERS = st.integers(-(10**400), 10**400) | st.integers(-3, 300) | st.floats() | st.sampled_from([0, 1e-320, 1e308])
CELLS = st.one_of(
    st.floats(0, 100).map(repr),
    st.integers(0, 99).map(str),
    st.floats().map(repr),
    st.text(st.characters(codec="utf-8"), max_size=3),
    st.sampled_from(["", " ", " 1", "1 ", "+1", "0x10", "1d5", "1_0", "1e999", "True", "NA", '"1"', "1\0", "٣", "1,2"]),
)


def table(header: str, rows: list[list[str]]) -> str:
    return "\n".join([header, *(",".join(row) for row in rows)]) + "\n"
