"""What a methods section says of this task, with the numbers of a result."""

from sinew.tasks.infer.method import module
from sinew.tasks.infer.result import Posteriors


def methods(result: Posteriors) -> str:
    """The paragraph of a methods section; ``[@key]`` cites."""
    return str(module(result, "prose").methods(result))
