"""ArviZ, which summarises draws and writes the files of both methods."""

import warnings
from typing import Any


def arviz() -> Any:
    """The package ArviZ, without its warning at each import that it will change."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", r"[\s\S]*ArviZ is undergoing a major refactor", FutureWarning)
        import arviz
    return arviz
