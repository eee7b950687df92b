"""Checks of an effect, and sentences on it, that several rules of the verdict use."""

from collections.abc import Iterator, Sequence

MIN_SPECIMENS = 2  # in which an effect must show, where there are so many


def shows_in_few(gains: Sequence[float]) -> Iterator[str]:
    """What is said where an effect shows in too few specimens, by what each gains with it."""
    improved = sum(gain > 0.0 for gain in gains)
    if improved < min(MIN_SPECIMENS, len(gains)):
        yield f"it shows in {improved} of {len(gains)} specimens"


def ends_on_bound(parameters: Sequence[str]) -> Iterator[str]:
    """What is said where parameters of an effect ended on a bound."""
    if parameters:
        yield f"{', '.join(parameters)} ended on a bound, so the effect is not the one in the library"


def as_good(rival: str) -> str:
    """What is said of an effect in whose place a ``rival`` would be nearly as good."""
    return f"{rival} would do nearly as well in its place"
