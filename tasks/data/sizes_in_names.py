"""Sizes that the name of a file may tell, such as ``T1_L10mm_W8mm.csv``. They are proposed to a person, never taken."""

import re
from collections.abc import Mapping

from sinew.tasks.data import units

_LABELS = {
    "length": ("l", "l0", "gl", "len", "length", "gauge"),
    "width": ("w", "b", "b0", "width"),
    "thickness": ("t", "th", "thk", "h", "thick", "thickness"),
    "diameter": ("d", "dia", "diam", "diameter"),
}
_NAMES = {label: name for name, labels in _LABELS.items() for label in labels}
_NUMBER = r"\d{1,4}(?:[.,p]\d{1,4})?"
_UNIT = r"(?:mm|cm|um|µm)"
_LABELLED = re.compile(
    rf"(?<![a-z0-9])(?P<label>{'|'.join(sorted(_NAMES, key=len, reverse=True))})[=_ -]?"
    rf"(?P<number>{_NUMBER})(?P<unit>{_UNIT})?(?![a-z0-9])"
)
#: "10x8x4mm" is length, width and thickness, "8x4mm" width and thickness.
_PRODUCT = re.compile(rf"(?<![a-z0-9.])({_NUMBER})[x×]({_NUMBER})(?:[x×]({_NUMBER}))?({_UNIT})?(?![a-z0-9])")
_WORD = 3  # letters of a label that is a word
_ENOUGH = 2  # letters that say a size without a unit: one alone may be the name of a specimen, as in "T1"


def sizes_in_name(name: str) -> Mapping[str, float]:
    """Sizes (mm) that a name may tell, by ``length``, ``width``, ``thickness`` and ``diameter``.

    A letter counts if it has a unit or, where none has, if another letter tells another size. What is told twice is
    left out.
    """
    text = name.casefold()
    labelled = list(_LABELLED.finditer(text))
    sure = [found for found in labelled if found["unit"] or len(found["label"]) >= _WORD]
    told = [(_NAMES[found["label"]], _mm(found["number"], found["unit"])) for found in sure or labelled]
    if not sure and len({size for size, _ in told}) < _ENOUGH:
        told = []
    product = _PRODUCT.search(text)
    if product is not None:
        numbers = [number for number in product.groups()[:3] if number is not None]
        names = ("length", "width", "thickness")[-len(numbers) :]
        told += [(size, _mm(number, product[4])) for size, number in zip(names, numbers, strict=True)]
    sizes = {size: {mm for other, mm in told if other == size} for size, _ in told}
    return {size: min(values) for size, values in sizes.items() if len(values) == 1 and 0 not in values}


def _mm(number: str, unit: str | None) -> float:
    factor = units.factor(units.LENGTH, unit) if unit else None
    return float(number.replace(",", ".").replace("p", ".")) * (factor or 1.0)
