"""Whole runs in the process of the test, which draw their figures and page: tests mostly leave these out."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from sinew.tasks.data.cohort import write_cohort
from sinew.tasks.data.virtual import virtual_cohort
from sinew.tasks.study import pipeline
from sinew.tasks.study.workspace import Workspace


@contextmanager
def drawn_in_this_process(drawing: Mapping[str, Callable[..., Any]]) -> Iterator[pytest.MonkeyPatch]:
    """Within it, no workers are started, and what ``drawing`` (the fixture) holds draws; yields further patches."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Workspace, "client", lambda _: None)
        for name, function in drawing.items():
            patch.setattr(pipeline, name, function)
        yield patch


def study_of_one(folder: Path, text: str) -> Path:
    """A study file of this ``text``, which names ``cohort``, beside a cohort of one virtual specimen."""
    specimens, truth = virtual_cohort(seed=1, per_site=1, rate_hz=2.0)
    write_cohort(folder / "cohort", specimens[:1], truth)
    (folder / "study.yaml").write_text(text)
    return folder / "study.yaml"
