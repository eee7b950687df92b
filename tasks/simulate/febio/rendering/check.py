"""What a rendered input may hold.

FEBio is a large program in C++. It keeps many texts in arrays of fixed length, gives what it logs to ``printf`` as a
format, and reads lists of numbers by ranges. What it has no room for, or would take for an instruction, is refused.
"""

import re
from pathlib import PurePath
from xml.etree.ElementTree import Element

from .wrong import Wrong

_PATH = re.compile(r"\s*([/~\\]|[A-Za-z]:)")
#: FEBio's reader turns ``&lt;`` into ``<`` before it looks for tags, and passes over carriage returns.
_MARKUP, _IN_ATTRIBUTES = re.compile(r"[<\x00-\x08\x0b-\x1f\x7f]"), re.compile(r'[<"\x00-\x08\x0b-\x1f\x7f]')
#: Bytes that FEBio has room for, at least, in a tag or in an attribute that is not among these.
ROOM = 200
ROOM_OF = {"delim": 15, "bc": 31, "type": 60, "surface": 60, "elem_set": 60}
ROOM_IN_LISTS, ROOM_OF_DEGREES = 255, 7  # for each part of a list; for the name of a degree of freedom
ROOM_OF_TEXTS = 500  # for all of a text, which may be a formula, but for elements that are lists
LISTS = re.compile(r"(.*_data|.*[Ss]et|.*[Ll]ist|var|Edge|Surface|Nodes|Elements|MeshData|ElementData)")
SHORT = 100  # blanks that are left as they are
_BLANKS = " \t\n"
_NO_BLANKS = str.maketrans("", "", _BLANKS)
_NUMBERS = re.compile(r"[-+.,:eE0-9 \t\n]*")
_RANGE = re.compile(r"\s*([-+]?\d+)\s*:\s*([-+]?\d+)(?:\s*:\s*([-+]?\d+))?")
MOST_IDS = 10**7  # in the ranges of one list
_PRINTED = re.compile(r"%[iglt]")
_OWN_FILES = re.compile(r"(sinew|model|solver-output|failure)\b", re.IGNORECASE)  # of a run
_FORBIDDEN = ("Include", "Plugins", "Import", "RVE")


def check(main: str, root: Element) -> None:
    """Refuse any text that is no FEBio input, could name a file outside the attempt's folder, or has no room there.

    Blank text between elements is shortened, as FEBio keeps it. Raises :class:`Wrong`.
    """
    if root.tag != "febio_spec":
        raise Wrong(main, f"renders to <{root.tag}>", "<febio_spec>")
    for element in root.iter():
        if (found := next((name for name in (element.tag, *element.attrib) if "{" in name), None)) is not None:
            raise Wrong(main, f"<{found[:80]}> has a namespace", "none, as FEBio knows no namespaces")
        if element.tag in _FORBIDDEN:
            raise Wrong(main, f"<{element.tag}>", "everything in the template and in what it includes by Jinja2")
        if _size(element.tag) > ROOM:
            raise _too_long(main, element.tag, _size(element.tag), ROOM)
        for name, value in element.attrib.items():
            _check_attribute(main, element, name, value)
        element.text, element.tail = _without_blanks(element.text), _without_blanks(element.tail)
        for text in filter(None, (element.text, element.tail)):
            _check_text(main, element.tag, text)


def _without_blanks(text: str | None) -> str | None:
    return "\n" if text and len(text) > SHORT and not text.strip(_BLANKS) else text


def _size(text: str) -> int:
    """In bytes, as FEBio counts."""
    return len(text.encode())


def _check_attribute(main: str, element: Element, name: str, value: str) -> None:
    label = f"{element.tag} {name}"
    if (found := _IN_ATTRIBUTES.search(value)) is not None:
        raise _markup(main, label, found[0])
    if _size(value) > (most := ROOM_OF.get(name, ROOM)):
        raise _too_long(main, label, _size(value), most)
    if ";" in value and name != "data":
        raise _replacement(main, label)
    if name == "bc":
        _check_degrees(main, label, value)
    printed = name == "format" and "file" in element.attrib
    if "%" in (_PRINTED.sub("", value) if printed else value):
        raise _percent(main, label, "%i, %g, %l or %t in the format of a file" if printed else "no percent sign")
    if name == "from" or (name == "file" and (PurePath(value).name != value or value in ("", ".", ".."))):
        raise Wrong(main, f'<{label}="{value[:40]}">', "a file name without a folder")
    if name == "file" and _OWN_FILES.match(value):
        raise Wrong(main, f'<{label}="{value[:40]}">', "another name than those of a run's own files")
    _refuse_path(main, label, value)


def _check_text(main: str, tag: str, text: str) -> None:
    if (found := _MARKUP.search(text)) is not None:
        raise _markup(main, tag, found[0])
    if "%" in text:
        raise _percent(main, tag, "no percent sign")
    _refuse_path(main, tag, text)
    if ";" in text:
        raise _replacement(main, tag)
    parts = text.split(",")
    if (longest := max(map(_size, parts))) > ROOM_IN_LISTS:
        raise _too_long(main, tag, longest, ROOM_IN_LISTS)
    length = _size(text)
    if length > ROOM_OF_TEXTS and not (LISTS.fullmatch(tag) and _NUMBERS.fullmatch(text)):
        raise _too_long(main, tag, length, ROOM_OF_TEXTS)
    if tag.endswith(("dof", "dofs", "bc")):
        _check_degrees(main, tag, text)
    if ":" in text:
        _check_ranges(main, tag, parts)


def _check_degrees(main: str, label: str, value: str) -> None:
    longest = max(_size(part.translate(_NO_BLANKS)) for part in value.split(","))
    if longest > ROOM_OF_DEGREES:
        raise _too_long(main, label, longest, ROOM_OF_DEGREES)


def _check_ranges(main: str, tag: str, parts: list[str]) -> None:
    """FEBio makes a list of all numbers from the first to the second, by the third; with 0, without end."""
    ids = 0
    for found in map(_RANGE.match, parts):
        if found is not None:
            first, last, step = int(found[1]), int(found[2]), int(found[3] or 1)
            ids += max(0, last - first) // max(1, step) + 1
            if step < 1 or ids > MOST_IDS or max(abs(first), abs(last), step) > 10**9:
                raise Wrong(main, f"<{tag[:40]}> has {found[0].strip()[:40]}", f"ranges of at most {MOST_IDS:,} ids")


def _refuse_path(main: str, label: str, value: str) -> None:
    if _PATH.match(value) or "../" in value or "..\\" in value:
        raise Wrong(main, f"<{label}> names a path ({value.strip()[:40]})", "nothing outside of the template")


def _markup(main: str, label: str, found: str) -> Wrong:
    return Wrong(main, f"<{label[:40]}> holds {found!r}", "nothing that FEBio reads as markup, or skips")


def _percent(main: str, label: str, expected: str) -> Wrong:
    return Wrong(main, f"<{label[:40]}> holds '%', which FEBio takes for an instruction", expected)


def _replacement(main: str, label: str) -> Wrong:
    return Wrong(main, f"<{label[:40]}> holds ';', by which FEBio replaces parts of formulas", "formulas written out")


def _too_long(main: str, label: str, length: int, most: int) -> Wrong:
    return Wrong(main, f"<{label[:40]}> has {length:,} bytes", f"at most {most}, for which FEBio has room")
