"""What a methods section says of this task, with the numbers of a result."""

from sinew.tasks.compare.result import CompareResult
from sinew.tasks.drawing.blocks import number, percent


def methods(result: CompareResult) -> str:
    """The paragraph of a methods section; ``[@key]`` cites."""
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
