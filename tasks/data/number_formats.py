"""How a number format of a spreadsheet shows numbers: as they are, in percent, in thousands, or with a unit."""

import re
from dataclasses import dataclass

PERCENT, THOUSANDS, UNCLEAR = "percent", "thousands", "unclear"  # how a format shows all numbers
FAILED = "failed"  # a number that stands for an error of a formula
OTHERWISE = "otherwise"  # with another sign, other digits or another decimal mark than they have
WITH = "shown with "  # so it does, with the unit behind this
HAS_UNIT = re.compile(r"[^\W\d_]|[%°]")  # a letter
BRACKETS = " ()[]"  # and spaces around a unit
LONGEST_UNIT, LONGEST = 20, 1000  # characters of a unit, and of a format: Excel allows 255
IN_THOUSANDS = re.compile(r"[0#?](,+)(?![0#?,])")  # in a number format: each comma divides by a thousand
#: Parts of a format: a text, a character, what leaves space, a currency or condition, and what stands for digits.
PART = re.compile(r'"([^"]*)"|\\(.)|([_*].)|\[([^\]]*)\]|(General|[0#?.,%]|[Ee][-+])|(;)|(.)', re.DOTALL)
DIGITS = ("0", "#", "?", "General")
FURTHER_DIGIT = re.compile(r"(?<![^\W\d_])(?<![\d²³^])\d")  # in a text, and not in a unit such as mm2
DECIMAL_MARK = re.compile(r"[.,:]")
MINUS = ("-", "\u2212", "\u2013")
#: A number as a cell shows it, before its unit.
NUMBER = re.compile(r"[-+\u2212(]?\s?[\d.,'\s]*\d(?:[eE][-+]?\d+)?")
LARGEST_POWER = 290  # of ten, that is compared
ROUNDING = 0.5 + 1e-6  # of the last digit that is shown


@dataclass
class Section:
    """A section of a format: what stands for ``digits``, and the texts that it writes before, among and behind them."""

    digits: str = ""
    texts: tuple[str, str] = ("", "")
    among: str = ""
    condition: bool = False

    @property
    def unit(self) -> str:
        """The unit that it writes beside numbers, or nothing."""
        words = (text.strip(BRACKETS) for text in self.texts)
        return " ".join(text for text in words if HAS_UNIT.search(text))[:LONGEST_UNIT]

    @property
    def has_numbers(self) -> bool:
        """Whether it shows numbers, and not only a text."""
        return any(sign in self.digits for sign in DIGITS)


def shown_by(code: str) -> str | None:
    """How a format shows numbers: one of the ways above, or None: as they are.

    The third section is of zero, unless they have conditions; the second is of negative numbers. No spreadsheet program
    writes one longer than ``LONGEST``, which is unclear.
    """
    if len(code) > LONGEST:
        return UNCLEAR
    parts = _sections(code)
    conditions = any(part.condition for part in parts)
    sections = [part for part in parts[: 3 if conditions else 2] if part.has_numbers]
    if any(IN_THOUSANDS.search(part.digits) for part in sections):
        return THOUSANDS
    otherwise = any(map(_has_other_digits, sections)) or (not conditions and _has_minus(parts[0]))
    percents = {part.digits.count("%") for part in sections}
    if not percents <= {0}:
        return PERCENT if percents == {1} and not otherwise else UNCLEAR
    if otherwise:
        return OTHERWISE
    units = sorted({part.unit for part in sections if part.unit})
    return WITH + " or ".join(units) if units else None


def _sections(code: str) -> list[Section]:
    found = [Section()]
    for quoted, escaped, space, bracket, digits, end, other in PART.findall(code):
        here = found[-1]
        if end:
            found.append(Section())
        elif digits:
            here.digits += digits
            if here.has_numbers and here.texts[1] and (digits in DIGITS or digits == "."):
                here.among += here.texts[1]
                here.texts = here.texts[0], ""
        elif bracket[:1] in ("<", "=", ">"):
            here.condition = True
        elif text := quoted or escaped or _of_bracket(bracket) or ("" if space else _as_it_is(other)):
            before, behind = here.texts
            here.texts = (before, behind + text) if here.has_numbers else (before + text, behind)
    return found


def _of_bracket(content: str) -> str:
    """What a currency in brackets shows: ``[$kN-409]`` shows ``kN``; colours and languages show nothing."""
    return content[1:].partition("-")[0] if content.startswith("$") else ""


def _as_it_is(character: str) -> str:
    """A character that needs no quotes; letters stand for parts of a date."""
    return "" if character.isalpha() else character


def _has_other_digits(section: Section) -> bool:
    """Whether texts beside or among the digits change the number that one reads."""
    marks = DECIMAL_MARK.search(section.among)
    return bool(marks) or any(FURTHER_DIGIT.search(text) for text in (*section.texts, section.among))


def _has_minus(section: Section) -> bool:
    """Whether the section of positive numbers writes a minus."""
    before, behind = section.texts
    return section.has_numbers and (any(sign in before for sign in (*MINUS, "(")) or behind.strip().startswith(MINUS))


def differs(text: str, value: float) -> bool:
    """Whether a cell shows a number other than its ``value``, in whatever language, beyond its rounding.

    Numbers below zero may be shown without their sign, in red for example.
    """
    sign = -1.0 if text[:1] in ("-", "\u2212", "(") else 1.0
    readings = _readings(text.strip("-+\u2212() "))
    if not readings:
        return False
    if sign < 0 < value:
        return True
    return all(abs(abs(value) - number) > ROUNDING * last + 1e-12 * abs(value) for number, last in readings)


def _readings(text: str) -> list[tuple[float, float]]:
    """The numbers that a text may be, each with the size of its last digit."""
    digits, _, power = re.sub(r"[\s']", "", text).lower().partition("e")
    if abs(int(power or 0)) > LARGEST_POWER:
        return []
    scale = 10.0 ** int(power or 0)
    found = []
    for thousands, decimal in ((",", "."), (".", ",")):
        plain, _, behind = digits.partition(decimal)
        groups = plain.split(thousands)
        if not all(map(str.isdigit, (*groups, behind or "0"))) or any(len(group) != 3 for group in groups[1:]):
            continue
        if len(groups) > 1 and groups[0].startswith("0"):
            continue
        found.append((float(f"{''.join(groups)}.{behind or '0'}") * scale, 10.0 ** -len(behind) * scale))
    return found
