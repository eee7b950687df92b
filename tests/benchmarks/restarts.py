"""What it costs to keep the state of a run of FEBio, and what an interruption costs with it: a dog-bone, febio4."""

import os
import shutil
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from sinew.runner.evaluation import external
from sinew.runner.evaluation.interim import kept_until_written
from sinew.tasks.simulate.febio import restarts
from sinew.tasks.simulate.febio.simulator import FEBio
from tests.benchmarks.common import median_line
from tests.tasks.simulate.febio.dogbone import BAR, DOGBONE, OWN, RELAX, dogbone
from tests.tasks.simulate.febio.restarting import Interrupted

FINENESS, ROUNDS, EVERY_S = 4, 3, 2.0


def seconds(simulator: FEBio, row: np.ndarray) -> float:
    begun = time.perf_counter()
    with kept_until_written():
        found = simulator.simulate(OWN, BAR, RELAX, row)
    assert not found.status.any(), found.messages
    return time.perf_counter() - begun


def interrupted(simulator: FEBio, row: np.ndarray, after_s: float) -> float:
    """How long a run takes in all that is interrupted once."""
    begun, look = time.perf_counter(), restarts.Interim.look

    def looked(self: restarts.Interim) -> None:
        look(self)
        if time.perf_counter() - begun > after_s:
            raise Interrupted

    restarts.Interim.look = looked  # type: ignore[method-assign]
    try:
        with kept_until_written():
            simulator.simulate(OWN, BAR, RELAX, row)
    except Interrupted:
        pass
    finally:
        restarts.Interim.look = look  # type: ignore[method-assign]
    return time.perf_counter() - begun + seconds(simulator, row)


def main() -> None:
    program = shutil.which("febio4")
    if program is None:
        print("  febio4 is not on the PATH")
        return
    external.MEANWHILE_S = 0.1
    folder = Path(tempfile.mkdtemp())
    os.environ["XDG_STATE_HOME"] = str(folder / "home")
    text = DOGBONE.read_text().replace("fineness = 1", f"fineness = {FINENESS}")
    plain = dogbone(folder, text, Path(program))
    kept = replace(plain, restart_s=EVERY_S)
    draw = np.random.default_rng(1)
    found: dict[str, list[float]] = {"without": [], "states kept": [], "interrupted once, in all": []}
    for _ in range(ROUNDS):
        row = OWN.reference[np.newaxis] * draw.uniform(0.9, 1.1, (1, 4))
        found["without"].append(seconds(plain, row))
        found["states kept"].append(seconds(kept, row))
        found["interrupted once, in all"].append(interrupted(kept, row, found["without"][-1] * draw.uniform(0.3, 0.7)))
    shutil.rmtree(folder)
    print(f"  dog-bone of {72 * FINENESS**3:,} elements, a state at most every {EVERY_S:g} s, {ROUNDS} rounds in turn")
    median_line("a run without restarts", found["without"], "s")
    for name in ("states kept", "interrupted once, in all"):
        ratio = np.median(np.array(found[name]) / np.array(found["without"]))
        median_line(name, found[name], "s")
        print(f"  {name} / without: {ratio:.3f}")
