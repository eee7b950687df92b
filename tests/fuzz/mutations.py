"""Damage to a valid file: pieces changed, cut, doubled or replaced, and values of JSON replaced by odd ones."""

import json
from random import Random
from typing import Any

PIECES = (
    b"", b"\0", b"\n", b"\r", b",", b";", b'"', b"'", b"{", b"}", b"[", b"]", b":", b"-", b".", b"e9", b"e308", b"nan",
    b"inf", b"_", b"9" * 400, b"\xff", b"\xed\xa0\x80", "\u202e".encode(), b"\x1b[2J", b"&a ", b"*a", b"!!binary ",
    b"<<: ",
    b"../../", b"{{ x }}", b"{% for i in range(9) %}", b"<!ENTITY a 'b'>", b" " * 5000, b"x" * 5000, b"[" * 3000, b"\t",
)  # fmt: skip
ODD: tuple[Any, ...] = (
    None, True, "", "x", "\ud800", "\x1b[2J", "../..", "9" * 50, "x" * 5000, [], {}, [[]], [None], {"": None}, 0,
    -1, 55, 2**31, 10**13, 10**400, 1e300, -1e300, 1e-320, 0.5, [0, 0], ["a"] * 100, float("nan"), float("inf"),
)  # fmt: skip


def mutated(content: bytes, random: Random) -> bytes:
    """The content with one to four pieces of damage."""
    if random.random() < 0.5:
        changed = _other_value(content, random)
        if changed is not None:
            return changed
    for _ in range(random.choice((1, 1, 2, 4))):
        content = random.choice(_HOW)(content, random)
    return content


def _replaced(content: bytes, random: Random) -> bytes:
    start = random.randrange(len(content) + 1)
    return content[:start] + random.choice(PIECES) + content[start + random.choice((0, 0, 1, 3, 20)) :]


def _flipped(content: bytes, random: Random) -> bytes:
    if not content:
        return b"\0"
    at = random.randrange(len(content))
    return content[:at] + bytes([content[at] ^ 1 << random.randrange(8)]) + content[at + 1 :]


def _cut(content: bytes, random: Random) -> bytes:
    return content[: random.randrange(len(content) + 1)]


def _lines(content: bytes, random: Random) -> bytes:
    lines = content.split(b"\n")
    one, other = random.randrange(len(lines)), random.randrange(len(lines))
    how = random.randrange(4)
    if how == 0:
        del lines[one]
    elif how == 1:
        lines.insert(other, lines[one])
    elif how == 2:
        lines[one], lines[other] = lines[other], lines[one]
    else:
        lines[one] = lines[one] * random.choice((2, 200))
    return b"\n".join(lines)


_HOW = (_replaced, _replaced, _replaced, _flipped, _cut, _lines)


def _other_value(content: bytes, random: Random) -> bytes | None:
    """JSON with one value gone, odd, under another name, or taken from elsewhere in it; None if it is no JSON."""
    try:
        document = json.loads(content)
    except (ValueError, RecursionError):
        return None
    if not isinstance(document, dict | list) or not document:
        return None
    parent: Any = document
    while True:
        key = random.choice(list(parent) if isinstance(parent, dict) else range(len(parent)))
        value = parent[key]
        if not isinstance(value, dict | list) or not value or random.random() < 0.3:
            break
        parent = value
    how = random.randrange(5)
    if how == 0:
        del parent[key]
    elif how == 1 and isinstance(parent, dict):
        parent[str(random.choice(ODD))] = parent.pop(key)
    elif how == 2 and isinstance(parent, list):
        parent.extend([value] * random.choice((1, 99)))
    else:
        parent[key] = random.choice(ODD)
    return json.dumps(document).encode()
