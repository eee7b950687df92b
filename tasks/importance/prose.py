"""What a methods section says of this task, with the numbers of a result."""

from sinew.tasks.drawing.blocks import largest, number
from sinew.tasks.importance.result import ImportanceResult


def methods(result: ImportanceResult) -> str:
    """The paragraph of a methods section; ``[@key]`` cites."""
    return (
        f"A random forest [@breiman] was grown on {result.rows_grown:,} rows of the Sobol study and tested on "
        f"{result.rows_tested:,} rows of unseen base samples, with R² = {number(result.r2_on_unseen)} for the "
        f"{result.objective}. Largest permutation importance: {largest(result.names, result.permutation)}."
    )
