"""The golden study: all tasks on two virtual specimens, small enough for every run of the tests."""

from pathlib import Path
from unittest import mock

import sinew
from sinew.tasks.data.cohort import write_cohort
from sinew.tasks.data.virtual import virtual_cohort
from sinew.tasks.registry import TASKS
from sinew.tasks.study.workspace import Workspace
from tests.tasks.few_parameters import held_but

FREE = ("E_f", "alpha_f", "tau_3f")
FIXED = held_but(FREE)
STUDY = f"""
name: golden
seed: 11
cohort: cohort
model:
  parameters:
{FIXED}
sobol: {{base_samples: 16, scrambles: 1, resamples: 20}}
surrogate: {{error: 0.002, runs: 96, specimens: [distal/1]}}
morris: {{trajectories: 5, resamples: 20}}
pawn: {{slides: 4, resamples: 20}}
importance: {{trees: 10, repeats: 2}}
calibrate: {{evaluations: 30, starts: 1, bayesian: {{evaluations: 12, initial: 6, seeds: 10}}}}
infer: {{paper: true, population: 10, generations: 2, epsilon: 2.0}}
predict: {{draws: 5}}
discover: {{effects: [toe-slack], starts: 2, specimens: [distal/1]}}
"""


def make(folder: Path) -> Path:
    """Run the golden study in ``folder``, in this process; returns its result folder."""
    specimens, truth = virtual_cohort(seed=1, per_site=1, rate_hz=2.0)
    write_cohort(folder / "cohort", specimens[:2], truth)
    (folder / "study.yaml").write_text(STUDY, "utf-8")
    study = sinew.read_study(folder / "study.yaml")
    with mock.patch.object(Workspace, "client", lambda self: None):  # rows are evaluated here, not on a cluster
        sinew.run(study, *TASKS, out=folder / "out")
    return folder / "out"
