"""Titles of columns: the name of what a column holds and its unit, apart."""

import re
import unicodedata

from sinew.tasks.data import units, words

#: Titles of columns with the spread of a mean.
SPREADS = ("sd", "std", "se", "sem", "standard deviation", "standard error")
_CHANNEL = re.compile(r"(?:c|ch|chan|channel|kanal|canal|voie) ?\d+ (?=\D)")  # "C_1_Force", "Ch 1 Kraft"


def name_and_unit(title: str, below: str = "") -> tuple[str, str]:
    """Name, in lower case, and unit (may be empty): ``Force (N)``, ``Kraft [kN]``, ``Zeit / s``, ``force_N``."""
    title = unicodedata.normalize("NFKC", title).strip().lstrip("#").strip().strip("\"'")
    if title.lower() in words.STRETCH:
        return title.lower(), below
    if brackets := re.findall(r"[(\[]\s*([^()\[\]]*?)\s*[)\]]", title):
        unit = next((text for text in brackets if units.is_unit(text)), below or brackets[0])
        return _plain(re.split(r"[(\[]", title)[0]), unit
    for pattern in (r"(.+?)\s*/\s*(\S+)", r"(.+?)\s*,\s*(\S+)", r"(.+)[_ -](?!1$)([^\s_-]+)", r"(.+?)\s+in\s+(\S+)"):
        if (found := re.fullmatch(pattern, title)) and units.is_unit(found[2]):
            return _plain(found[1]), found[2]
    if title in words.UNITS_AS_TITLES:
        return f"({title})", below or title
    return _plain(title), below


def is_spread(title: str) -> bool:
    """Whether a column holds the spread of a mean, such as a standard deviation."""
    return re.sub(r"\s*[(\[].*", "", title, flags=re.DOTALL).strip().lower() in SPREADS


def _plain(text: str) -> str:
    text = re.sub(r"(?<=[a-zäöü])(?=[A-Z])", " ", text)
    text = re.sub(r"[\s_.:-]+", " ", text).strip().lower().removesuffix(" in").strip()
    return _CHANNEL.sub("", text)
