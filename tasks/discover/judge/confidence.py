"""How far a verdict can be trusted: how often verdicts of the same word were true in cases with known answers.

No number of a fit is the probability of being right: each is computed as if nature had one of the library's forms. The
blind benchmark (docs/discover_benchmark.md) counts how verdicts of each word did, on effects in other forms and on
other cases than the rules were tuned on. The counts hold for cohorts like those.
"""

from collections.abc import Mapping, Sequence

from scipy.stats import binomtest

from sinew.tasks.discover.result import Confidence

MEANING: Mapping[str, str] = {
    "NAMED": "every name was true",
    "PARTLY": "every name was true",
    "AMBIGUOUS": "something was there, and all of it in the set",
    "OUTSIDE": "the library did not have what was there",
    "NONE": "there was nothing, or nothing that could be seen",
}
SINGLE = "the blind benchmark of virtual specimens, when the library had 16 effects"
SEVERAL = "virtual specimens with one or several effects, with 21 effects in the library"
#: By word: how many verdicts were true in that sense, of how many; those of PARTLY are of a larger library.
RECORD: Mapping[str, tuple[int, int]] = {
    "NAMED": (55, 55),
    "PARTLY": (12, 16),
    "AMBIGUOUS": (5, 6),
    "OUTSIDE": (6, 9),
    "NONE": (30, 31),
}


def confidence(word: str, law: str = "tendon", compared: Sequence[str] = ()) -> Confidence | None:
    """What the record says of verdicts with this word.

    Nothing of those on other models than sinew's own tissue, and where more than the force is ``compared``.
    """
    if law != "tendon" or compared:
        return None
    true, of = RECORD[word]
    cases = SEVERAL if word == "PARTLY" else SINGLE
    return Confidence(MEANING[word], cases, true, of, true / of, clopper_pearson(true, of))


def clopper_pearson(count: int, of: int) -> tuple[float, float]:
    """95 % interval of a share (Clopper and Pearson 1934)."""
    interval = binomtest(count, of).proportion_ci(confidence_level=0.95, method="exact")
    return float(interval.low), float(interval.high)


def in_words(record: Confidence | None) -> str:
    """A confidence in one line."""
    if record is None:
        return (
            "how often such a verdict is true of a model of one's own, or of more than the force, has not been counted"
        )
    low, high = record.interval
    return (
        f"{record.true} of {record.of} such verdicts were true in {record.cases} "
        f"(95 %: {100 * low:.0f} to {100 * high:.0f} %); true means: {record.means}"
    )
