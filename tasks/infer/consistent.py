"""What must agree within a result of an inference, whoever wrote it."""

from collections.abc import Collection, Mapping, Sequence


def check_names(names: Sequence[str], units: Sequence[str], meanings: Sequence[str]) -> None:
    """Raises :class:`ValueError` for a name that stands twice, and for other numbers of units or meanings."""
    if len(set(names)) < len(names):
        raise ValueError(f"names: {max(names, key=list(names).count)} stands twice")
    for what, each in (("units", units), ("meanings", meanings)):
        if len(each) != len(names):
            raise ValueError(f"{what}: {len(each)} of {len(names)} parameters")


def check_marginals(names: Sequence[str], found: Mapping[str, Collection[str]]) -> None:
    """Raises :class:`ValueError` for marginals, by the site or specimen they are ``found`` of, of other parameters."""
    for where, each in found.items():
        if set(each) != set(names):
            other = sorted(set(each) ^ set(names))[0]
            raise ValueError(f"{where}: {other} is not both a parameter and a marginal")


def check_interval(low: float, high: float) -> None:
    """Raises :class:`ValueError` for an interval out of order."""
    if low > high:
        raise ValueError(f"an interval from {low:g} to {high:g}")


def check_marginal(mean: float, sd: float, low: float, high: float) -> None:
    """Raises :class:`ValueError` for an interval out of order, and for a mean that is too far from it.

    An interval of more than half the probability holds a median, which is within a standard deviation of the mean.
    """
    check_interval(low, high)
    margin = sd + 1e-6 * (abs(low) + abs(high))
    if mean < low - margin or mean > high + margin:
        raise ValueError(f"a mean of {mean:g} with a standard deviation of {sd:g} and an interval {low:g} to {high:g}")
