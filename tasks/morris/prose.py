"""What a methods section says of this task, with the numbers of a result."""

from sinew.tasks.drawing.blocks import largest
from sinew.tasks.morris.result import MorrisResult


def methods(result: MorrisResult) -> str:
    """The paragraph of a methods section; ``[@key]`` cites."""
    return (
        f"Elementary effects [@morris] on the {result.objective} were computed with SALib [@salib] from "
        f"{result.trajectories:,} trajectories on {result.levels} levels ({result.rows:,} rows, "
        f"{result.failed:,} failed; "
        f"{result.trajectories_used:,} trajectories used), and summarised by the mean of absolute values mu* "
        f"[@campolongo]. Largest mu* ({result.unit}): {largest(result.names, result.mu_star)}."
    )
