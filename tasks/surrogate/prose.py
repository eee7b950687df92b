"""What a methods section says of this task, with the numbers of a result."""

from sinew.tasks.drawing.blocks import percent, plural
from sinew.tasks.surrogate.result import SurrogateResult
from sinew.tasks.surrogate.show import tested


def methods(result: SurrogateResult) -> str:
    """The paragraph of a methods section; ``[@key]`` cites."""
    runs = [one.runs for one in result.specimens.values()]
    between = f"{min(runs)}" if min(runs) == max(runs) else f"{min(runs)} to {max(runs)}"
    fresh = ""
    if (found := tested(result)) is not None:
        error, inside = found
        fresh = (
            f" At runs that they had not seen, errors were at most {percent(error, 1)}, and at least {percent(inside)} "
            "of the points of each course lay in their 95 % intervals."
        )
    where = "where they told most [@cohn]" if result.growth == "active" else "evenly over the ranges"
    return (
        f"Forces and outputs along time were emulated for {plural(len(runs), 'specimen')} from {between} runs of each. "
        f"Principal components of the courses have sparse polynomial chaos [@blatman] or a Gaussian process, whichever "
        f"had smaller cross-validated errors; runs were added {where}. Cross-validated errors are at most "
        f"{percent(result.error, 1)} of the spread of a course over the runs.{fresh}"
    )
