"""Whether an effect inside a user's model acts is judged by all that is compared, not by the force alone."""

from dataclasses import dataclass

import numpy as np
import pytest

from sinew.tasks.discover.fit.acting import tried, why_not
from sinew.tasks.model import Curve, Protocol, Specimen
from sinew.tasks.simulate import Simulated

PULL = Protocol("pull", np.arange(4.0), np.arange(4.0))
BAR = Specimen("a", 10.0, 4.0, 1.0, (Curve(PULL, np.arange(4.0)),))


@dataclass
class Made:
    """A candidate whose force and width change by parts of their peaks at the null and at the typical value."""

    force: tuple[float, float] = (0.0, 0.0)
    width: tuple[float, float] = (0.0, 0.0)
    compared: tuple[str, ...] = ("width",)
    peak_mm: float = 0.02

    def having(self) -> "Made":
        return Made(compared=self.compared, peak_mm=self.peak_mm)

    def null(self) -> np.ndarray:
        return np.array([0.0])

    def typical(self) -> np.ndarray:
        return np.array([1.0])

    def simulated(self, specimen: Specimen, protocol: Protocol, at: np.ndarray) -> Simulated:
        shape, count = np.linspace(0.0, 1.0, 4), len(at)
        force, width = (
            np.array([[1.0 + part] for part in (*parts, 0.0)[:count]]) * peak * shape
            for parts, peak in ((self.force, 50.0), (self.width, self.peak_mm))
        )
        return Simulated(force, np.zeros(count, np.int8), ("",) * count, outputs={"width": width})


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"force": (0.0, 0.1)}, None),
        ({"width": (0.0, 0.1)}, None),
        ({"width": (0.0, 0.1), "compared": ()}, "it does next to nothing here"),
        ({"force": (0.0, 0.1), "width": (0.01, 0.1)}, "at its null value what is compared changes by 0.01 of its peak"),
        ({"force": (0.01, 0.1)}, "at its null value"),
        ({"width": (0.0, 1e-6)}, "it does next to nothing here"),
        ({"width": (0.0, 0.1), "peak_mm": 0.0}, "it does next to nothing here"),
    ],
)
def test_what_is_compared_decides(changes, words):
    found = why_not(tried(Made(**changes), BAR, np.array([0.5])))
    assert found is None if words is None else found.startswith(words)
