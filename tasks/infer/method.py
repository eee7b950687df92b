"""The two methods of an inference, each a folder of its own with modules of the same names."""

from importlib import import_module
from typing import Any

from sinew.tasks.infer.result import LikelihoodResult, Posteriors


def module(result: Posteriors, name: str) -> Any:
    """The module ``name`` of the method that a result is of."""
    method = "likelihood" if isinstance(result, LikelihoodResult) else "abc"
    return import_module(f"{__package__}.{method}.{name}")
