"""Writes plot files as FEBio does, from plain lists; tests damage and read them."""

import struct
import zlib

import numpy as np

GRID = [(x, y, z) for z in (0, 1, 2) for y in (0, 1) for x in (0, 1)]
HEXES = [[0, 1, 3, 2, 4, 5, 7, 6], [4, 5, 7, 6, 8, 9, 11, 10]]
TETS = [[0, 1, 3, 4]]
TIMES = (0.0, 0.5, 2.0)


def chunk(tag: int, *parts: bytes) -> bytes:
    content = b"".join(parts)
    return struct.pack("<II", tag, len(content)) + content


def whole(tag: int, *numbers: int) -> bytes:
    return chunk(tag, struct.pack(f"<{len(numbers)}i", *numbers))


def floats(tag: int, numbers) -> bytes:
    return chunk(tag, np.asarray(numbers, "<f4").tobytes())


def counted(tag: int, text: str) -> bytes:
    return chunk(tag, struct.pack("<i", len(text)), text.encode())


def padded(tag: int, text: str) -> bytes:
    return chunk(tag, text.encode().ljust(64, b"\0"))


def item(kind: int, form: int, name: str, array: int = 0, unit: str = "") -> bytes:
    units = [padded(0x01020007, unit)] if unit else []
    parts = [whole(0x01020002, kind), whole(0x01020003, form), whole(0x01020005, array)]
    return chunk(0x01020001, *parts, padded(0x01020004, name), *units)


def domain(kind: int, part: int, name: str, elements: list[list[int]], first: int) -> bytes:
    head = [whole(0x01042102, kind), whole(0x01042103, part), whole(0x01032104, len(elements))]
    listed = [whole(0x01042201, first + i, *nodes) for i, nodes in enumerate(elements)]
    return chunk(0x01042100, chunk(0x01042101, *head, counted(0x01032105, name)), chunk(0x01042200, *listed))


def surface(number: int, name: str, faces: list[list[int]], corners: int) -> bytes:
    head = [whole(0x01043102, number), whole(0x01043103, len(faces)), counted(0x01043104, name)]
    rows = [[i, len(face), *face, *[77] * (corners - len(face))] for i, face in enumerate(faces, 1)]
    listed = chunk(0x01043200, *(whole(0x01043201, *row) for row in rows))
    return chunk(0x01043100, chunk(0x01043101, *head, whole(0x01043105, corners)), listed)


def named_set(base: int, number: int, name: str, items: list[int]) -> bytes:
    head = [whole(base + 0x102, number), whole(base + 0x104, len(items)), counted(base + 0x103, name)]
    return chunk(base + 0x100, chunk(base + 0x101, *head), whole(base + 0x200, *items))


def mesh() -> bytes:
    nodes = b"".join(struct.pack("<i3f", 10 + i, *place) for i, place in enumerate(GRID))
    header = chunk(0x01041100, whole(0x01041101, len(GRID)), whole(0x01041102, 3))
    return chunk(
        0x01040000,
        chunk(0x01041000, header, chunk(0x01041200, nodes)),
        chunk(0x01042000, domain(0, 1, "block", HEXES, 1), domain(2, 2, "", TETS, 3)),
        chunk(0x01043000, surface(1, "top", [[8, 9, 11], [8, 9, 11, 10]], 4)),
        chunk(0x01044000, named_set(0x01044000, 1, "side", [1, 3, 5])),
        chunk(0x01046000, named_set(0x01046000, 1, "upper", [2])),
        chunk(0x01045000, chunk(0x01045100, whole(0x01045101, 1), padded(0x01045102, "tissue"))),
    )


DICTIONARY = (
    (0x01021000, [item(0, 1, "energy")]),
    (0x01023000, [item(1, 0, "displacement", unit="mm"), item(7, 0, "pair", array=2)]),
    (0x01024000, [item(2, 1, "stress", unit="MPa"), item(0, 3, "volume"), item(0, 2, "density"), item(6, 0, "a", 3)]),
    (0x01025000, [item(0, 1, "gap"), item(1, 3, "pull"), item(0, 2, "pressure")]),
)


def value(number: int, *regions: bytes) -> bytes:
    return chunk(0x02020001, whole(0x02020002, number), chunk(0x02020003, *regions))


def numbers(time: float, name: str, count: int) -> np.ndarray:
    """What a test file holds of a variable: different numbers for each name, time and place."""
    return (np.arange(count) + 100 * time + 1000 * sum(map(ord, name))).astype(np.float32)


def state(time: float, rest: bool = False) -> bytes:
    def of(name: str, region: int, count: int) -> bytes:
        return floats(region, numbers(time, name, count))

    later = [] if rest else [of("stress", 1, 12), of("stress", 2, 6)]
    return chunk(
        0x02000000,
        chunk(0x02010000, floats(0x02010002, [time]), whole(0x02010003, 0)),
        chunk(0x02030000, whole(0x02030001, 1, 1, 1)),
        chunk(
            0x02020000,
            chunk(0x02020100, value(1, of("energy", 0, 1))),
            chunk(0x02020300, value(1, of("displacement", 0, 36)), value(2, of("pair", 0, 72))),
            chunk(
                0x02020400,
                value(1, *later),
                value(2, of("volume", 1, 1), of("volume", 2, 1)),
                value(3, of("density", 1, 16)),
                value(4, of("a", 1, 36), of("a", 2, 12)),
            ),
            chunk(0x02020500, value(1, of("gap", 1, 2)), value(2, of("pull", 1, 3)), value(3, of("pressure", 1, 8))),
        ),
    )


def absent(time: float) -> bytes:
    """A state in which every variable is there, for no region."""
    counts = ((0x02020100, 1), (0x02020300, 2), (0x02020400, 4), (0x02020500, 3))
    data = [chunk(tag, *(value(number) for number in range(1, 1 + count))) for tag, count in counts]
    return chunk(0x02000000, chunk(0x02010000, floats(0x02010002, [time])), chunk(0x02020000, *data))


def plot_file(times=TIMES, *, compressed: bool = False, version: int = 0x35) -> bytes:
    """A plot file with two blocks, a surface, a set of each kind, and a variable of each format."""
    header = chunk(0x01010000, whole(0x01010001, version), whole(0x01010004, int(compressed)))
    words = chunk(0x01020000, *(chunk(tag, *items) for tag, items in DICTIONARY))
    states = [state(time, rest=time == 0) for time in times]
    states = [zlib.compress(one) for one in states] if compressed else states
    return b"BEF\0" + chunk(0x01000000, header, words) + mesh() + b"".join(states)
