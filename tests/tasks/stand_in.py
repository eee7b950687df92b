"""A study whose solver is a small script in place of febio4, and what tests read from its results."""

import contextlib
import stat
import sys
import zlib
from pathlib import Path

import numpy as np
import psutil

from sinew.runner.errors import StoreError
from sinew.runner.store.schema import PENDING
from sinew.runner.store.segment import Segment
from sinew.runner.store.store import open_store
from sinew.tasks.data.cohort import write_cohort
from sinew.tasks.data.virtual import virtual_cohort
from tests.trusting import trusted

#: The command without figures and page.
WITHOUT_FIGURES = Path(__file__).parent / "cluster" / "sinew_without_figures.py"

# Plays febio4 with a linear spring. Writes a line when a run begins and another when it is done; both name the row by
# a checksum of its material. It imports only what Python loads quickly: each row starts it anew.
SOLVER = """#!{python} -IS
import os, sys, time, zlib
def note(file, line):
    os.write(os.open(file, os.O_WRONLY | os.O_APPEND | os.O_CREAT), (line + "\\n").encode())
def inside(tag, text):
    return [part.split("</" + tag + ">")[0] for part in text.split("<" + tag + ">")[1:]]
if sys.argv[1] == "-info":
    print("version 9.9.9")
    sys.exit()
text = open("model.feb").read()
row = "%08x" % zlib.crc32(inside("Material", text)[0].encode())
note({begun!r}, row)
place = open({begun!r}).read().count("\\n")
def held():
    try:
        return place > int(open({held!r}).read() or 0)
    except OSError:
        return False
stiffness = float(inside("E", text)[0])
points = [point.split(",") for point in inside("pt", text.split("solver steps")[0])]
time.sleep({seconds})
while held():
    time.sleep(0.1)
with open("reaction.txt", "w") as file:
    for step, (t, u) in enumerate(points[1:], 1):
        file.write("*Step  = %d\\n*Time  = %s\\n*Data  = reaction\\n5,%r\\n" % (step, t, stiffness * float(u)))
open("model.log", "w").write(" N O R M A L   T E R M I N A T I O N\\n")
note({notes!r}, "%s %r" % (row, stiffness))
"""

STUDY = """
name: survival
seed: 7
simulator: {name: febio, executable: SOLVER, timeout_s: 600}
store: {points_per_curve: 16}
model:
  parameters:
    alpha_f: {fixed: 500}
    nu_m: {fixed: 0.2}
sobol: {base_samples: BASE_SAMPLES}
"""
ROWS_PER_BASE_SAMPLE = 16  # 14 free parameters and two more


def named(material: str) -> str:
    """The name that the solver gives to the row with this ``<Material>`` (what is between its tags)."""
    return f"{zlib.crc32(material.encode()):08x}"


def prepare(folder: Path, seconds: float = 0.02, base_samples: int = 32) -> tuple[Path, Path, Path]:
    """Write a study whose solver takes ``seconds`` for a row; returns the study, its cohort and the solver's notes.

    The notes list the runs that are done, ``begun`` in the same folder those that began. While there is a file ``held``
    in that folder, no run ends but the first ones to begin, as many as it says.
    """
    specimens, _ = virtual_cohort(seed=1, per_site=1, rate_hz=1.0)
    write_cohort(folder / "cohort", specimens[:1])
    for name in ("cyclic", "two_step"):
        (folder / "cohort" / specimens[0].name / f"{name}.csv").unlink()
    notes = folder / "notes"
    solver = folder / "solver"
    files = {"notes": str(notes), "begun": str(folder / "begun"), "held": str(folder / "held")}
    solver.write_text(SOLVER.format(python=sys.executable, seconds=seconds, **files))
    solver.chmod(solver.stat().st_mode | stat.S_IXUSR)
    study = folder / "study.yaml"
    study.write_text(STUDY.replace("SOLVER", str(solver)).replace("BASE_SAMPLES", str(base_samples)))
    trusted(study)
    return study, folder / "cohort", notes


def committed(out: Path) -> set[int]:
    """The rows that are committed, in chunks or in the journal.

    Chunks are looked at after the journal: what is folded in meanwhile is in the one or the other.
    """
    if not (out / "store.zarr" / "evaluations").exists():
        return set()
    rows: set[int] = set()
    for path in (path for table in open_store(out).tables() for path in table.segments()):
        with contextlib.suppress(StoreError):  # folded in meanwhile
            rows.update(Segment.read(path).rows.tolist())
    for table in open_store(out).tables():  # opened again, as a table holds the states of when it was opened
        rows.update(np.flatnonzero(table.status != PENDING).tolist())
    return rows


def leftovers(solver: Path) -> list[psutil.Process]:
    """Solver processes that still run."""
    found = []
    for process in psutil.process_iter():
        try:
            if str(solver) in process.cmdline():
                found.append(process)
        except psutil.Error:
            continue
    return found
