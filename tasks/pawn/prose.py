"""What a methods section says of this task, with the numbers of a result."""

from sinew.tasks.drawing.blocks import largest, number
from sinew.tasks.pawn.result import PawnResult


def methods(result: PawnResult) -> str:
    """The paragraph of a methods section; ``[@key]`` cites."""
    above = int((result.median > result.no_influence).sum())
    return (
        f"PAWN indices [@pianosi] of the {result.objective} were computed with SALib [@salib] from "
        f"{result.rows:,} rows of "
        f"the Sobol study ({result.failed:,} failed) in {result.slides} slides. The medians of {above} of "
        f"{len(result.names)} parameters are above the level of no influence, {number(result.no_influence)}. Largest "
        f"medians: {largest(result.names, result.median)}."
    )
