"""Which specimen and which protocol a file belongs to, by its name and folder."""

import os
import re
import unicodedata
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

from sinew.runner.errors import BadInput
from sinew.tasks.data.cohort import NAME
from sinew.tasks.data.columns import LIKELY

UNSURE = "unsure: a number may be a specimen's or a trial's; rename to SPECIMEN_PROTOCOL if it is wrong"
#: Words in file names, in letters of English, that name a protocol; the rest of the name is that of the specimen.
PROTOCOLS = (
    "one_step", "two_step", "onestep", "twostep", "step", "steps", "stress_relaxation", "relaxation", "relax",
    "creep", "hold", "cyclic", "cycles", "cycle", "cyc", "precondition", "preconditioning", "ramp", "pull", "failure",
    "fail", "rupture", "tension", "tensile", "quasistatic", "dynamic", "sinus", "sine", "fast", "slow", "loading",
    "test", "compression", "compressive",
    "zug", "zugversuch", "zyklisch", "zyklen", "zyklus", "kriechen", "rampe", "halten", "vorkonditionierung",
    "traction", "cyclique", "fluage", "traccion", "ciclico", "relajacion", "rampa", "fluencia",
    "trazione", "rilassamento",
)  # fmt: skip
#: "_2026_05_11_10_20_33", "-20260511T1020", "_2026-05-11"
_STAMP = re.compile(
    r"[_-](?:19|20)\d\d([_-]?)(?:0[1-9]|1[0-2])\1(?:0[1-9]|[12]\d|3[01])"
    r"(?:[_T-]{1,2}[0-2]\d[_-]?[0-5]\d(?:[_-]?[0-5]\d)?)?$"
)
_MOST_WORDS = 3  # of a protocol's name
_NUMBER = re.compile(r"_?(?<!\d)(?!(?:19|20)\d\d$)\d{1,4}$")  # of a test; a year or a date is none


@dataclass(frozen=True)
class FileName:
    """A specimen, with its site in front (``SITE/SPECIMEN``), a protocol, and ``how`` sure both are."""

    specimen: str
    protocol: str
    how: str = LIKELY


def names_of(paths: Sequence[Path]) -> dict[Path, FileName]:
    """The specimen and the protocol of each file.

    ``T1_relax.csv`` is protocol ``relax`` of specimen ``T1``. If the name is that of a protocol only, the folder names
    the specimen. The folder above the specimen names the site. If no name holds a protocol, but all together form a
    grid (``A_p1, A_p2, B_p1, B_p2``), the last parts are the protocols; else each file is a specimen. Dates and times
    at the end of names are left out where this leaves different names.
    Raises :class:`BadInput` if no name can be made of a file's, or two files would have the same one.
    """
    stems = {path: plain_name(path.stem) for path in paths}
    plain = {path: _STAMP.sub("", stem) or stem for path, stem in stems.items()}
    if plain != stems:
        with suppress(BadInput):  # two files of one name: the stamps tell them apart
            return _names(plain)
    return _names(stems)


def _names(stems: Mapping[Path, str]) -> dict[Path, FileName]:
    for path, stem in stems.items():
        if not NAME.fullmatch(stem):
            raise BadInput(path, "a name from which no name of a specimen can be made", "a letter or digit in the name")
    root = Path(os.path.commonpath([path.absolute().parent for path in stems]))
    names = {path: _name(path, stem, root) for path, stem in stems.items()}
    if not any(_protocol_in(stem) for stem in stems.values()):
        names |= _grid(stems, names)
    taken: dict[tuple[str, str], Path] = {}
    for path, name in names.items():
        other = taken.setdefault((name.specimen.casefold(), name.protocol.casefold()), path)
        if other != path:
            problem = f"specimen {name.specimen}, protocol {name.protocol}, as {other}"
            raise BadInput(path, problem, "names such as SPECIMEN_PROTOCOL.csv, each pair once")
    return names


def of_test(name: FileName, test: str) -> FileName:
    """The name of one of several tests in a file, which are taken for tests of several specimens."""
    plain = re.sub(r"_+", "_", plain_name(test))  # of "1 _ 1"
    return replace(name, specimen=f"{name.specimen}_{plain}") if test else name


def plain_name(text: str) -> str:
    """A text as a name that a cohort may have; empty when nothing is left of it."""
    plain = unicodedata.normalize("NFKD", text).encode("ascii", "ignore").decode()
    return re.sub(r"[^A-Za-z0-9_+.-]+", "_", plain).strip("_.-+ ")[:80]


def _name(path: Path, stem: str, root: Path) -> FileName:
    parent = path.absolute().parent
    folders = [name for name in map(plain_name, parent.relative_to(root).parts) if name]
    found = _protocol_in(stem)
    if found is None:
        specimen, protocol, how = stem, "test", LIKELY
    elif found[0]:
        specimen, protocol, how = *found, LIKELY
    else:  # the folder is the specimen
        specimen, protocol = folders.pop() if folders else plain_name(parent.name) or "specimen", found[1]
        how = UNSURE if protocol[-1].isdigit() else LIKELY
    return FileName("/".join([*folders[-1:], specimen]), protocol, how)


def _protocol_in(stem: str) -> tuple[str, str] | None:
    """The rest of a file's name and the protocol that it ends, or begins, with."""
    words = [word for word in re.split(r"[\s_.-]+", stem) if word]
    for count in range(min(_MOST_WORDS, len(words)), 0, -1):
        for own, rest in ((words[-count:], words[:-count]), (words[:count], words[count:])):
            name = "_".join(own).lower()
            if name in PROTOCOLS or _NUMBER.sub("", name) in PROTOCOLS:
                return "_".join(rest), name
    return None


def _grid(stems: Mapping[Path, str], names: Mapping[Path, FileName]) -> dict[Path, FileName]:
    """Names such as A_p1, A_p2, B_p1, B_p2: all specimens have the same protocols. Empty where they are no grid."""
    parts = {path: stem.rpartition("_") for path, stem in stems.items()}
    sites = {path: name.specimen.rpartition("/")[0] for path, name in names.items()}
    specimens = {part[0] for part in parts.values()}
    protocols = {part[2] for part in parts.values()}
    usable = all(NAME.fullmatch(name) for name in (*specimens, *protocols))
    if not usable or len(specimens) < 2 or len(protocols) < 2 or len(parts) != len(specimens) * len(protocols):
        return {}
    if len({(sites[path], part[0], part[2]) for path, part in parts.items()}) != len(parts):
        return {}
    return {path: FileName("/".join(filter(None, [sites[path], part[0]])), part[2]) for path, part in parts.items()}
