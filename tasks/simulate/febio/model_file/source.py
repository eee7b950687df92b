"""Reading a FEBio input so that parts of its text can be replaced and all else stays as it is."""

import codecs
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

from sinew.runner.errors import BadInput, shown
from sinew.runner.files import read_input

MAX_BYTES = 2**26
DEEPEST = 100
MOST_ELEMENTS = 500_000  # beside those of the mesh: each takes up to 900 bytes
LONGEST_NAME = 200  # characters of a tag, or of a name
MOST_TEXT = 2**24  # characters beside the mesh
MOST_ATTRIBUTES = 2_000_000  # of the elements that are kept
MOST_NAMES = 100_000  # of tags and attributes; the parser keeps each
MOST_BRACES = 1_000_000  # in the template, each becomes nine characters
MESH = ("Mesh", "Geometry")  # below these sections only the sections themselves are kept
VERSIONS = ("3.0", "4.0")
_DECLARATION = re.compile(rb"\A\s*<\?xml[^>]*\?>\s*")
_ENCODING = re.compile(rb"\A[^>]{0,200}?encoding\s*=\s*[\"']([A-Za-z0-9_.:-]{1,40})[\"']")
_MANY_ATTRIBUTES = re.compile(rb"<(?![!?])(?:[^<=]*+=){10000}")  # of one element: the parser gives all of them at once
_TAG = re.compile(rb"""<(?:[^"'>]++|"[^"]*+"|'[^']*+')*+>""")  # without places to return to, which take memory
#: Encodings of models, as Python calls them. Others take time with the square of the text, or give no text at all.
ENCODINGS = frozenset((
    "utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "ascii", "gb2312", "gbk", "gb18030", "big5", "shift_jis",
    "cp932", "euc_jp", "euc_kr", "cp949", "koi8-r", *(f"iso8859-{number}" for number in range(1, 17)),
    *(f"cp{number}" for number in range(1250, 1259)),
))  # fmt: skip


@dataclass(eq=False)
class Element:
    """An element of the input and where it stands: bytes of the text of :class:`Source`, in UTF-8.

    ``start`` and ``end`` hold all of it, ``inside`` what is between its tags (None: it has one tag only). ``text`` is
    its own text, without that of its children.
    """

    tag: str
    attributes: Mapping[str, str]
    start: int
    text: str = ""
    end: int = 0
    inside: tuple[int, int] | None = None
    children: list["Element"] = field(default_factory=list)

    def find(self, tag: str) -> "Element | None":
        """The first child of this tag."""
        return next((child for child in self.children if child.tag == tag), None)

    def all(self, *tags: str) -> Iterator["Element"]:
        """The children of these tags."""
        return (child for child in self.children if child.tag in tags)

    @property
    def name(self) -> str:
        return self.attributes.get("name", "").strip()


@dataclass(frozen=True)
class Source:
    """A FEBio input: its ``text`` in UTF-8 without an XML declaration, and the ``root`` of its elements."""

    path: Path
    text: bytes
    root: Element

    @property
    def version(self) -> str:
        return self.root.attributes["version"].strip()

    @property
    def mesh(self) -> Element | None:
        """The section of nodes, elements and sets."""
        return next(self.root.all(*MESH), None)

    def section(self, tag: str) -> Element | None:
        """A section of the input by its tag."""
        return self.root.find(tag)


def read_source(path: Path) -> Source:
    """Read a FEBio input. Raises :class:`BadInput`."""
    text = _without_declaration(_in_utf_8(path, read_input(path, MAX_BYTES, "a FEBio input of at most 64 MB")))
    if _MANY_ATTRIBUTES.search(text):
        raise BadInput(path, "has an element of 10,000 attributes", "a model as FEBio Studio writes it")
    if (braces := text.count(b"{")) > MOST_BRACES:
        raise BadInput(path, f"has {braces:,} braces", f"at most {MOST_BRACES:,}")
    root = _elements(path, text)
    if root.tag != "febio_spec":
        raise BadInput(path, f"holds <{shown(root.tag)[1:-1]}>", "a FEBio model, which is a <febio_spec>")
    version = root.attributes.get("version", "").strip()
    if version not in VERSIONS:
        problem = f"is of FEBio's format {version[:10]}" if version else "does not tell its format"
        raise BadInput(path, problem, "format 3.0 or 4.0: open the model in FEBio Studio and export it as 4.0")
    for element in _walk(root):
        if element.tag == "Include" or "from" in element.attributes:
            raise BadInput(path, f"<{element.tag}> reads another file", "a model in one file")
    return Source(path, text, root)


def _walk(element: Element) -> Iterator[Element]:
    waiting = [element]
    while waiting:
        yield (one := waiting.pop())
        waiting.extend(reversed(one.children))


def _without_declaration(text: bytes) -> bytes:
    """The text without its XML declaration; lines keep their numbers."""
    declared = _DECLARATION.match(text)
    return b"\n" * declared[0].count(b"\n") + text[declared.end() :] if declared else text


def _in_utf_8(path: Path, content: bytes) -> bytes:
    told = _ENCODING.match(content)
    encoding = told[1].decode("ascii") if told else "utf-8-sig"
    if content.startswith(codecs.BOM_UTF8):
        encoding = "utf-8-sig"
    elif content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        encoding = "utf-16"
    try:
        if codecs.lookup(encoding).name not in ENCODINGS:
            raise LookupError(encoding)
        return content.decode(encoding).encode()
    except LookupError:
        raise BadInput(path, f"is in an unknown encoding ({encoding})", "UTF-8") from None
    except UnicodeError:
        raise BadInput(path, f"is not text in {encoding}", "a FEBio input in the encoding that it names") from None


@dataclass
class _Kept:
    """How much of a model is kept. Its methods raise :class:`BadInput` for one too many."""

    path: Path
    elements: int = 0
    attributes: int = 0
    characters: int = 0

    def element(self, tag: str, attributes: Mapping[str, str], depth: int) -> None:
        """Count an element."""
        self.elements += 1
        self.attributes += len(attributes)
        self._check(self.elements, MOST_ELEMENTS, "elements")
        self._check(self.attributes, MOST_ATTRIBUTES, "attributes")
        for name in (tag, attributes.get("name", "")):
            if len(name) > LONGEST_NAME:
                raise BadInput(self.path, f"has a name of {len(name):,} characters", f"at most {LONGEST_NAME}")
        _check_depth(self.path, depth)

    def text(self, size: int) -> None:
        """Count characters."""
        self.characters += size
        self._check(self.characters, MOST_TEXT, "characters")

    def _check(self, count: int, most: int, what: str) -> None:
        if count > most:
            raise BadInput(self.path, f"has more than {most:,} {what} beside its mesh", "a smaller model")


def _check_depth(path: Path, depth: int) -> None:
    if depth > DEEPEST:
        raise BadInput(path, "is nested too deeply", f"at most {DEEPEST} elements in each other")


def _check_prefixes(path: Path, tag: str, attributes: Mapping[str, str]) -> None:
    """Refuse names with a prefix, for which readers that know namespaces need a declaration."""
    if ":" in tag or any(":" in name and not name.startswith("xml:") for name in attributes):
        raise BadInput(path, f"<{shown(tag)[1:-1]}> has a name with a prefix", "names as FEBio writes them")


def _elements(path: Path, text: bytes) -> Element:
    """The tree of elements, with their places. Raises :class:`BadInput` for what is no XML, or has a document type."""
    names: dict[str, str] = {}
    parser = expat.ParserCreate("utf-8", intern=names)
    top = Element("", {}, 0)
    open_elements = [top]
    texts: list[list[str]] = [[]]  # of these
    kept = _Kept(path)
    skipped = 0  # depth below a part of the mesh, whose nodes and elements are not kept

    def refuse(*_: object) -> None:
        raise BadInput(path, "has a document type", "XML without one")

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal skipped
        _check_prefixes(path, tag, attributes)
        if len(names) > MOST_NAMES:
            raise BadInput(path, f"has more than {MOST_NAMES:,} names of tags and attributes", "a FEBio model")
        if skipped or (len(open_elements) == 4 and open_elements[2].tag in MESH):
            skipped += 1
            _check_depth(path, len(open_elements) + skipped)
            return
        kept.element(tag, attributes, len(open_elements))
        element = Element(tag, attributes, parser.CurrentByteIndex)
        open_elements[-1].children.append(element)
        open_elements.append(element)
        texts.append([])

    def end(tag: str) -> None:
        nonlocal skipped
        if skipped:
            skipped -= 1
            return
        element = open_elements.pop()
        element.text = "".join(texts.pop()).strip()
        opening = _TAG.match(text, element.start)
        assert opening is not None, "expat has read it"
        begin, at = opening.end(), parser.CurrentByteIndex
        if opening[0].endswith(b"/>"):
            element.end = begin
            return
        closing = _TAG.match(text, at)
        assert closing is not None, "expat has read it"
        element.inside, element.end = (begin, at), closing.end()

    def characters(data: str) -> None:
        if not skipped and not (len(open_elements) == 4 and open_elements[2].tag in MESH):
            kept.text(len(data))
            texts[-1].append(data)

    parser.buffer_text = True
    parser.StartDoctypeDeclHandler = refuse
    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.CharacterDataHandler = characters
    try:
        parser.Parse(text, True)
    except expat.ExpatError as error:
        raise BadInput(path, f"line {error.lineno} is no XML ({expat.errors.messages[error.code]})", "XML") from None
    return top.children[0]
