"""Titles of columns: the name of what a column holds and its unit, apart."""

import re
import unicodedata
from collections.abc import Collection, Iterator, Sequence

from sinew.tasks.data import units, words

#: Titles of columns with the spread of a mean.
SPREADS = ("sd", "std", "se", "sem", "standard deviation", "standard error")
_CHANNELS = "c|ch|chan|channel|kanal|canal|voie|station"
#: "C_1_Force", "Ch 1 Kraft", "Station 1 Force", "Ch Force"
_CHANNEL = re.compile(rf"\b(?:(?:{_CHANNELS}) ?\d+|ch) (?=\D)")
_NUMBERED = re.compile(r"(.*[^\d .]) ?(\d{1,3})")
_AGAIN = re.compile(r"\.\d{1,3}$")
_BRACKETS = re.compile(r"[(\[]([^()\[\]]*)[)\]]")
_IN_FRONT = re.compile(r"[(\[]([^()\[\]]+)[)\]] ?([^()\[\]]+)")  # a unit and a name: ``[um] Displacement``
_UNIT_BEHIND = re.compile(r"(?<=[)\]]) ?in ([^\s()\[\]]+)$")
_ALONG = re.compile(r"([^()\[\]]+)[(\[][xyzXYZ][)\]] ?, ?([^\s,()\[\]]+)")  # a name, its axis and its unit
#: Behind a unit, what makes another quantity of it: ``Force (N) x 1000``, ``Force (N) / width``, ``Force (N) limit``.
_CHANGING = (
    r"\b(?:true|cauchy|kirchhoff|rate|change|per|set ?point|limit|target|command|demand|peak|valley|max|maximum|"
    r"minimum|mean|amplitude|rms)\b"
)
#: Behind a displacement, what says that an extensometer measured it: ``Displacement (Strain 1) (mm)``.
_EXTENSOMETER = re.compile(r"\b(?:strain ?\d|extensometer|extenso|clip[ -]?on|video)\b", re.IGNORECASE)
_CHANGED = re.compile(rf"[x×*·] ?\d|\d ?[x×*·]|(?:^|\s)[/^*]|\^|{_CHANGING}", re.IGNORECASE)
_MINUS = re.compile(r"[-\u2212] ?(?=[^\W\d])")  # "-Force", which has another sign
#: Words behind a name that are of a channel, a sensor or its clock; others have a digit, as "U9C", "500N" and "1".
_OF_CHANNELS = frozenset({
    "ch", "chan", "channel", "kanal", "canal", "voie", "ai", "a", "b", "c", "dev", "module", "mod", "slot", "sensor",
    "cell", "loadcell", "hbm", "input", "default", "sample", "standardmessrate", "messrate", "messkette",
})  # fmt: skip
#: Letters about digits that make another quantity of the name: "SP1", "max2", "x1000".
_OTHERS = frozenset({"sp", "cmd", "ref", "max", "min", "avg", "rms", "std", "sd", "set", "x", "y", "z", "dt", "del"})
#: Words beside a name that change nothing of it: ``Primary load measurement``, ``Contrainte nominale``.
_FILLERS = frozenset({
    "measurement", "measured", "raw", "primary", "value", "values", "signal", "reading", "data",
    "actual", "current", "lead", "actuator",
    "istwert", "messwert", "mesure", "mesurée", "medido", "medida", "smoothed", "filtered", "resampled",
})  # fmt: skip
_NOMINAL = frozenset({"nominal", "nominale", "nominelle"})  # of a strain or a stress: referred to the first sizes
_SPECIMEN = re.compile(r"([^\W\d_]+)\d{1,3}")  # in front of a name: ``RD2 force``
#: What is no name of a specimen there: ``Peak1 Force``.
_NO_SPECIMEN = frozenset({
    "peak", "valley", "target", "command", "demand", "setpoint", "limit", "soll", "sollwert", "mean", "minimum",
    "maximum", "true", "cycle", "zyklus", "step", "fracture", "yield", "failure", "break", "breaking", "ultimate",
    "rupture", "bending", "flexural", "flexure", "shear", "torsion",
    "oscillation", "storage", "loss", "complex", "dynamic",
})  # fmt: skip
#: In front of the names of what is computed, beside what is measured.
_OF_MODELS = frozenset({
    "model", "sim", "simulation", "simulated", "fit", "fitted", "fe", "fea", "fem", "theory", "theoretical",
    "predicted",
})  # fmt: skip
_LETTERS = 3
_SHORTEST = 3  # letters of a name that may stand in front of that of a channel
_LONGEST = 300  # characters of a title with a unit


def name_and_unit(title: str, below: str = "") -> tuple[str, str]:
    """Name, in lower case, and unit (may be empty): ``Force (N)``, ``Kraft [kN]``, ``Zeit / s``, ``force_N``."""
    title = unicodedata.normalize("NFKC", title).strip().lstrip("#").strip().strip("\"'")
    if title.lower() in words.STRETCH:
        return title.lower(), below
    if len(title) > _LONGEST:
        return _plain(title[:_LONGEST]), below  # no name of a column; words are looked for in it again and again
    if (inside := _BRACKETS.fullmatch(title)) is not None and not units.is_unit(inside[1].strip()):  # "(Load)"
        title = inside[1].strip()
    if (front := _IN_FRONT.fullmatch(title)) is not None and units.is_unit(front[1].strip()):
        return _plain(front[2]), units.agreed([front[1].strip(), below])
    if brackets := [text.strip() for text in _BRACKETS.findall(title)]:
        told = [text for text in brackets if units.is_unit(text)]
        along = _ALONG.fullmatch(title)
        if along is not None and units.is_unit(along[2]):  # "Position (z), mm"
            return _plain(along[1]), units.agreed([along[2], below])
        name = re.split(r"[(\[]", title)[0]
        other = " ".join([*(text for text in brackets if text not in told), _BRACKETS.sub(" ", title[len(name) :])])
        if _CHANGED.search(other):
            name = f"{name} {other}"
        elif _EXTENSOMETER.search(other) and _plain(name) in words.DISPLACEMENT:
            name = words.EXTENSOMETER[0]
        behind = _UNIT_BEHIND.search(title)
        if not told and behind is not None and units.is_unit(behind[1]):  # "FY(U=0) in kN", beside "FY(U=23) in kN"
            return _plain(title[: behind.start()]), units.agreed([behind[1], below])
        return _plain(name), units.agreed([*told, below]) or brackets[-1]
    title = title.rstrip("._") or title  # "Time_s_" of MATLAB and "Time..s." of R, which have no brackets in names
    for name, unit in _parts(" ".join(title.split())):
        if units.is_unit(unit) and not _is_minimum(name, unit):
            return _plain(name), units.agreed([unit, below])
    if title in words.UNITS_AS_TITLES:
        return f"({title})", units.agreed([title, below])
    return _plain(title), below


def by_extensometer(title: str) -> bool:
    """Whether a title says that another device than the machine measured: ``Tensile strain (Strain 1)``."""
    return bool(_EXTENSOMETER.search(title))


def _parts(title: str) -> Iterator[tuple[str, str]]:
    """How a title with single spaces may part into a name and a unit, which is one word: in time with its length."""
    last = title.rfind(" ")
    for mark in "/,":
        at = title.find(mark, max(1, last - 1))  # a space may stand behind it
        if at > 0 and (unit := title[at + 1 :].strip()):
            yield title[:at].rstrip(), unit
    at = max(map(title.rfind, "_ .-"))
    if at > 0 and title[at + 1 :] not in ("", "1"):
        yield title[:at], title[at + 1 :]
    name, word, unit = title.rpartition(" in ")
    if word and name and unit and " " not in unit:
        yield name, unit


def _is_minimum(name: str, unit: str) -> bool:
    """Whether a ``min`` behind a name is the smallest value, as in ``Load Min``, and not minutes."""
    name = _plain(name)  # "time_1_min" is of tests beside each other
    return unit.lower() == "min" and name not in words.TIME and without_number(name) not in words.TIME


def without_number(name: str) -> str:
    """A name without the number at its end: ``strain`` of ``strain 1``."""
    found = _NUMBERED.fullmatch(name)
    return name if found is None else found[1]


def without_numbers(names: Sequence[str]) -> list[str]:
    """Names of tests beside each other without the numbers that tell them apart: ``time 1, force 1, time 2, force 2``.

    A number stays where times have none, or other ones: ``load 1, load 2`` may be two load cells.
    """
    found = [_NUMBERED.fullmatch(name) for name in names]
    numbers: dict[str, set[str]] = {}
    for one in found:
        if one is not None:
            numbers.setdefault(one[1], set()).add(one[2])
    for name in names:  # the first may have none: time, force, time 2, force 2
        if name in numbers:
            numbers[name].add("")
    of_times = [each for base, each in numbers.items() if base in words.TIME and len(each) > 1]
    return [
        one[1] if one is not None and numbers[one[1]] in of_times else name
        for name, one in zip(names, found, strict=True)
    ]


def without_suffix(title: str, titles: Sequence[str]) -> str:
    """A title without the number that pandas puts behind one that comes again: ``Force (N).1`` beside ``Force (N)``."""
    base = _AGAIN.sub("", title)
    return base if base != title and base in titles else title


def known_within(name: str, known: Collection[str]) -> str:
    """The known name within one of more words, which change nothing of it; empty where there is none."""
    return _before_channel(name, known) or _among_fillers(name, known)


def _before_channel(name: str, known: Collection[str]) -> str:
    """The known name in front of that of a channel or a sensor, which has a digit: ``kraft`` of ``kraft u9c 500n``.

    A number alone may follow it at once: ``disp`` of ``disp1``.

    Empty where there is none, or where a word behind it may make another quantity of it: ``force limit 1``.
    """
    if len(base := without_number(name)) >= _SHORTEST and base != name and base in known:
        return base
    found = [word for word in known if len(word) >= _SHORTEST and name.startswith((f"{word} ", f"{word}/"))]
    word = max(found, key=len, default="")
    rest = re.split(r"[\s/]+", name[len(word) :].replace("sample rate", "sample"))
    rest = [each for each in rest if each]
    numbered = any(map(str.isdigit, "".join(rest)))
    return word if word and numbered and all(map(_of_channel, rest)) else ""


def _among_fillers(name: str, known: Collection[str]) -> str:
    """The known name among words that change nothing of it; empty where there is none."""
    base = without_fillers(name)
    return base if base != name and len(base) >= _SHORTEST and base in known else ""


def without_fillers(name: str) -> str:
    """A name without words that change nothing of it, and without that of a specimen in front: ``RD2 force``."""
    parts = name.split()[1:] if specimen_in_front(name) else name.split()
    parts = [part for part in parts if part not in _FILLERS]
    bare = " ".join(part for part in parts if part not in _NOMINAL)
    return bare if bare in words.STRAIN or bare in words.STRESS else " ".join(parts)


def specimen_in_front(name: str) -> str:
    """What looks like the name of a specimen in front of a name: ``rd2`` of ``rd2 force``; empty where nothing does."""
    first, _, rest = name.partition(" ")
    found = _SPECIMEN.fullmatch(first)
    return "" if not rest or found is None or found[1] in _OTHERS | _FILLERS | _NO_SPECIMEN else first


def of_several_specimens(titles: Sequence[str]) -> bool:
    """Whether each title has the name of another specimen in front: ``RD2_force_kN, RD5_force_kN``."""
    found = {specimen_in_front(name_and_unit(title)[0]) for title in titles}
    return len(found) == len(titles) > 1 and "" not in found


def stations(names: Sequence[str], motions: Collection[str], loads: Collection[str]) -> list[str]:
    """The words in front of each name that stand in front of a motion and of a load alike; empty where none do.

    They name the station, ``esh b force, esh b displacement``, or tests beside each other, where each has the same
    columns: ``steel strain, steel stress, copper strain, copper stress``. Words that make other quantities are none:
    ``peak force, peak displacement``. None are found where a column is called by the name of a motion or a load alone.
    """
    none = [""] * len(names)
    if not {*motions, *loads}.isdisjoint(names):
        return none
    shared = sorted(_in_front(names, {*motions}) & _in_front(names, {*loads}))
    if any(set(station.split()) & (_OTHERS | _NO_SPECIMEN | _OF_MODELS) for station in shared):
        return none
    known = {*motions, *loads, *words.TIME}
    found = [next((one for one in shared if name.removeprefix(f"{one} ") in known - {name}), "") for name in names]
    pairs = list(zip(names, found, strict=True))
    columns = [sorted(without_station(name, of) for name, of in pairs if of == one) for one in shared]
    return found if all(each == columns[0] for each in columns) else none


def without_station(name: str, station: str) -> str:
    """A name without the words in front of it that :func:`stations` has found."""
    return name.removeprefix(f"{station} ") if station else name


def _in_front(names: Sequence[str], known: Collection[str]) -> set[str]:
    """The words in front of known names, where there are some."""
    parts = [name.split() for name in names]
    return {" ".join(words[:at]) for words in parts for at in range(1, len(words)) if " ".join(words[at:]) in known}


def _of_channel(word: str) -> bool:
    """Whether a word is of a channel or a sensor: ``ch``, ``ai2``, or a few letters about digits, as ``mx840b``."""
    letters = re.sub(r"\d", "", word)
    if letters in _OF_CHANNELS or not letters:
        return True
    return letters != word and letters.isalpha() and len(letters) <= _LETTERS and letters not in _OTHERS


def is_spread(title: str) -> bool:
    """Whether a column holds the spread of a mean, such as a standard deviation."""
    name = re.split(r"[(\[]", title, maxsplit=1)[0].strip().lower()
    return name in SPREADS or name.rpartition("_")[2] in SPREADS


def _plain(text: str) -> str:
    if _MINUS.match(text):
        return f"-{text[1:].strip().lower()}"
    text = re.sub(r"(?<=[a-zäöü])(?=[A-Z])", " ", text)
    text = re.sub(r"[\s_.:-]+", " ", text).strip().lower().removesuffix(" in").strip()
    return _CHANNEL.sub("", text)
