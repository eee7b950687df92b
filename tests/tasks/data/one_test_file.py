"""A small test as a file, for tests of what is odd in it."""

from pathlib import Path

import numpy as np

from sinew.tasks.data.hints import Hints
from sinew.tasks.data.recording import Recording
from sinew.tasks.data.recordings import read_recordings

TITLES = "Time (s),Extension (mm),Force (N)"
TIME = np.arange(40) / 10
WAY = np.minimum(np.arange(40) / 20, 1.0)
FORCE = np.round(50.0 * WAY**2, 2)


def read(folder: Path, time=TIME, moved=WAY, force=FORCE, above: str = "", titles: str = TITLES) -> Recording:
    path = folder / "test.csv"
    rows = "".join(f"{t:.3f},{u:.4f},{f:.2f}\n" for t, u, f in zip(time, moved, force, strict=True))
    path.write_text(f"{above}{titles}\n{rows}")
    return read_recordings(path, Hints())[0]


def changed(values, places, to):
    found = np.array(values, dtype=float)
    found[places] = to
    return found
