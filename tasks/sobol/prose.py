"""What a methods section says of this task, with the numbers of a result."""

import numpy as np

from sinew.tasks.drawing.blocks import number
from sinew.tasks.sobol.result import SobolResult


def methods(result: SobolResult) -> str:
    """The paragraph of a methods section; ``[@key]`` cites."""
    left_out = result.base_samples - result.base_samples_used
    failed = f" {left_out:,} base samples with a failed row were left out." if left_out else ""
    return (
        f"First and total order Sobol indices of the {result.objective} were estimated for {len(result.names)} free "
        f"parameters from a Saltelli design on a scrambled Sobol sequence [@saltelli, @salib]: {result.base_samples:,} "
        f"base samples, {result.rows:,} rows, of which {result.failed:,} failed.{failed} Intervals are bootstrap "
        f"intervals at {100 * result.confidence:g} %. {_largest(result)}"
    )


def _largest(result: SobolResult) -> str:
    order = np.argsort(-np.nan_to_num(result.ST))[:3]
    said = [
        f"{result.names[j]} {number(result.ST[j])} ± {number(result.ST_conf[j], 2)}"
        for j in order
        if np.isfinite(result.ST[j])
    ]
    return f"Largest total indices: {', '.join(said)}." if said else "No index is defined, as nothing varied."
