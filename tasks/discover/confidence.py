"""How far a verdict can be trusted: how often its word was true in cases whose truth was known.

No number that a fit gives is a probability of being right: each is computed as if nature had one of the library's
forms. What can be told is how verdicts of the same word did in the blind benchmark (docs/discover_benchmark.md), where
effects had other forms, and rules were tuned on other cases. It holds for cohorts like those.
"""

from collections.abc import Mapping
from typing import Any

from scipy.stats import binomtest

MEANING: Mapping[str, str] = {
    "NAMED": "every name was true",
    "AMBIGUOUS": "something was there, and all of it in the set",
    "OUTSIDE": "the library did not have what was there",
    "NONE": "there was nothing, or nothing that could be seen",
}
#: By word: how many verdicts of the benchmark's 101 cases were true in that sense, of how many.
RECORD: Mapping[str, tuple[int, int]] = {"NAMED": (55, 55), "AMBIGUOUS": (5, 6), "OUTSIDE": (6, 9), "NONE": (30, 31)}


def confidence(word: str) -> dict[str, Any]:
    """What the record says of verdicts with this word: ``share`` that was true, with its 95 % ``interval``."""
    true, of = RECORD[word]
    return {
        "means": MEANING[word],
        "true": true,
        "of": of,
        "share": true / of,
        "interval": list(clopper_pearson(true, of)),
    }


def clopper_pearson(count: int, of: int) -> tuple[float, float]:
    """95 % interval of a share (Clopper and Pearson 1934)."""
    found = binomtest(count, of).proportion_ci(confidence_level=0.95, method="exact")
    return float(found.low), float(found.high)


def in_words(told: Mapping[str, Any]) -> str:
    """One line of a confidence."""
    low, high = told["interval"]
    return (
        f"{told['true']} of {told['of']} such verdicts were true in the blind benchmark (95 %: {100 * low:.0f} to "
        f"{100 * high:.0f} %): {told['means']}"
    )
