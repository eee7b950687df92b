"""A small study of all tasks, whose solver is a script that notes each input it is given."""

import stat
import sys
import zlib
from pathlib import Path

from sinew.tasks.data.cohort import write_cohort
from sinew.tasks.data.virtual import virtual_cohort
from sinew.tasks.model import Model
from tests.tasks.stand_in import SOLVER
from tests.trusting import trusted

NAMED_BY_MATERIAL = 'zlib.crc32(inside("Material", text)[0].encode())'
NAMED_BY_INPUT = "zlib.crc32(text.encode())"  # several specimens share materials
FREE = ("E_f", "E_m", "g_1m")
STUDY = """
name: chaos
seed: 7
cohort: cohort
simulator: {{name: febio, executable: {solver}, timeout_s: 120}}
cluster: {{name: local, workers: 2}}
tasks: [sobol, importance, surrogate, morris, pawn, calibrate, infer, predict, compare, discover]
retries: 20  # a solver that is killed from outside is no failed row
store: {{points_per_curve: 16}}
model: {{parameters: {{{fixed}}}}}
sobol: {{base_samples: 16, specimens: [distal/1], resamples: 20}}
importance: {{trees: 10, repeats: 2}}
surrogate: {{error: 0.002, runs: 64, specimens: [distal/1]}}
morris: {{trajectories: 4, specimens: [distal/1], resamples: 20}}
pawn: {{slides: 4, resamples: 20}}
calibrate: {{evaluations: 40, bayesian: {{evaluations: 20}}}}
infer: {{paper: true, population: 8, generations: 2, epsilon: 1.0, pending: 16}}
predict: {{draws: 8}}
compare: {{permutations: 20}}
discover: {{effects: [toe-slack], starts: 1, laws: false}}
"""


def named(text: str) -> str:
    """The name that the solver gives to this input."""
    return f"{zlib.crc32(text.encode()):08x}"


def prepare(folder: Path) -> Path:
    """Write study, cohort and solver into ``folder``; the solver notes runs in ``begun`` and ``notes`` there."""
    specimens = virtual_cohort(seed=1, per_site=1, rate_hz=1.0)[0][:2]
    write_cohort(folder / "cohort", specimens)
    for path in (folder / "cohort").rglob("*.csv"):
        if path.stem != "one_step":
            path.unlink()
    solver = folder / "solver"
    notes, begun = str(folder / "notes"), str(folder / "begun")
    assert NAMED_BY_MATERIAL in SOLVER
    text = SOLVER.replace(NAMED_BY_MATERIAL, NAMED_BY_INPUT)
    solver.write_text(text.format(python=sys.executable, seconds=0.02, notes=notes, begun=begun))
    solver.chmod(solver.stat().st_mode | stat.S_IXUSR)
    fixed = ", ".join(f"{p.name}: {{fixed: {p.reference}}}" for p in Model().parameters if p.name not in FREE)
    study = folder / "study.yaml"
    study.write_text(STUDY.format(solver=solver, fixed=fixed))
    return trusted(study)
