"""Where slow functions run: in this process, or on a worker."""

from collections.abc import Callable
from typing import Any

Compute = Callable[..., Any]  # of a function and its arguments, as ``Session.compute`` of adaptive runs


def directly(function: Callable[..., Any], *arguments: Any) -> Any:
    """What the function returns, here and now."""
    return function(*arguments)
