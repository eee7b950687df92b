"""What a methods section says of this task, with the numbers of a result."""

from sinew.tasks.compare.result import CompareResult
from sinew.tasks.drawing.blocks import number, percent


def methods(result: CompareResult) -> str:
    """The paragraph of a methods section; ``[@key]`` cites."""
    if result.contrasts:
        return _contrasts(result)
    pairs = "; ".join(
        f"{one.name}: {number(one.auc)} ({number(one.interval[0])} to {number(one.interval[1])}), of all parameters "
        f"{number(one.all_parameters.auc)}"
        for one in result.pairs
    )
    return (
        f"The posteriors of {len(result.sites)} sites were compared along their first principal component, which has "
        f"{percent(result.component.explained_variance)} of the variance, and by a cross-validated linear "
        f"discriminant on "
        f"all parameters. Areas under the ROC curve, with intervals of {percent(result.confidence)} [@delong]: "
        f"{pairs}. "
        f"They reflect the number of particles, not of specimens."
    )


def _contrasts(result: CompareResult) -> str:
    """Of populations."""
    different = [one for one in result.contrasts if one.different]
    words = "; ".join(
        f"{one.parameter}, {' / '.join(one.sites)}: {number(one.difference.mean)} ({number(one.difference.low)} to "
        f"{number(one.difference.high)})"
        for one in different
    )
    paired = any(one.paired for one in result.contrasts)
    return (
        f"Population means and spreads of {len(result.sites)} sites were compared by their posteriors"
        f"{', paired by donor' if paired else ''}. {len(different)} of {len(result.contrasts)} differences of means "
        f"had an interval of {percent(result.confidence)} without zero{f': {words}' if words else ''}."
    )
