"""Results whose files somebody has changed."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from sinew.runner.errors import BadInput
from sinew.tasks.study.result import Result


def refused(folder: Path, result: Result, change: Mapping[str, Any], told: str) -> None:
    """Write a result and change some fields of its file: it is read before, and refused in these words after that."""
    kind = type(result)
    result.write(folder)
    assert kind.read(folder) is not None
    path = kind.path(folder)
    path.write_text(json.dumps(json.loads(path.read_text()) | change))
    with pytest.raises(BadInput, match=told):
        kind.read(folder)
