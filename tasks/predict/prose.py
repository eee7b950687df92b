"""What a methods section says of this task, with the numbers of a result."""

from sinew.tasks.drawing.blocks import level, percent
from sinew.tasks.predict.result import BANDS, PredictResult


def methods(result: PredictResult) -> str:
    """The paragraph of a methods section; ``[@key]`` cites."""
    covers = "; ".join(
        f"{BANDS[band]}: {percent(one.all)} of {one.points:,} points"
        for band, one in result.coverage.items()
        if one.all is not None
    )
    source = (
        "from draws of the population's posterior" if result.from_population
        else "from the calibrated parameters of the other specimens of its site"
    )  # fmt: skip
    return (
        f"Bands of {level(result.probability)} around the curves of each specimen were computed from "
        f"{result.draws:,} "
        f"draws of each posterior [@pekedis] and, for a new specimen, {source} "
        f"({result.rows:,} simulations, {result.failed:,} failed). "
        f"{f'They cover: {covers}.' if covers else 'Nothing was measured that they could cover.'}"
    )
