"""How much of the time of two workers the real solver gets. Needs febio4 on the PATH."""

import shutil
import stat
import tempfile
import time
from pathlib import Path

import numpy as np

from sinew.runner.cluster.client import open_client
from sinew.runner.cluster.local import Local
from sinew.runner.evaluation.ensemble import evaluate
from sinew.runner.store.store import Store
from sinew.tasks.simulate.febio.attempt import solver_version
from sinew.tasks.simulate.febio.simulator import FEBio
from sinew.tasks.simulate.febio.tendon import read_template
from tests.benchmarks.common import evaluation, rows

ROWS = 150
WRAPPER = """#!/bin/bash
begin=$EPOCHREALTIME
"{solver}" "$@"
code=$?
echo "$begin $EPOCHREALTIME" >> "{notes}"
exit $code
"""


def main() -> None:
    solver = shutil.which("febio4")
    if solver is None:
        print("  skipped: febio4 is not on the PATH")
        return
    folder = Path(tempfile.mkdtemp())
    notes = folder / "notes"
    wrapper = folder / "solver"
    wrapper.write_text(WRAPPER.format(solver=Path(solver).resolve(), notes=notes))
    wrapper.chmod(wrapper.stat().st_mode | stat.S_IXUSR)
    simulator = FEBio(str(wrapper), solver_version(wrapper), read_template(folder, None), folder / "attempts")
    work = evaluation(simulator)
    with open_client(Local(2)) as client:
        with Store.writing(folder / "warm", "benchmark") as store:
            table = store.table(work.table())
            evaluate(lambda: client, table, work, table.plan(rows(4, seed=1)))
        notes.unlink()
        with Store.writing(folder / "out", "benchmark") as store:
            table = store.table(work.table())
            started = time.perf_counter()
            found = table.plan(rows(ROWS))
            evaluate(lambda: client, table, work, found)
            taken = time.perf_counter() - started
            assert not table.status[found].any()
    inside = float(sum(end - begin for begin, end in np.loadtxt(notes)))
    shutil.rmtree(folder)
    print(f"  {ROWS} rows x 3 protocols at 100 Hz: {taken:.1f} s with two workers, {inside:.1f} s inside the solver")
    print(f"  share of the workers' time inside the solver: {100 * inside / (2 * taken):.1f} %")
