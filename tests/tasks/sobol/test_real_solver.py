"""Indices by few runs of the real solver are those of brute force, which took 24,576 runs of it."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml

from sinew.tasks.study.resources import resource
from tests.conftest import DATA
from tests.tasks.study.test_pipeline import sinew

BAR = {"E_m": "E_matrix", "nu_m": "nu", "g_1m": "g_1", "tau_1m": "tau_1"}
BRUTE_FORCE = json.loads((DATA / "dogbone_brute_force.json").read_text())


def indices(folder: Path, sobol: dict, **simulator: object) -> dict:
    """What a study of the tutorial's dog-bone finds."""
    shutil.copytree(resource("configs/dogbone"), folder / "dogbone")
    study = yaml.safe_load(resource("configs/dogbone.yaml").read_text())
    study["simulator"] |= simulator
    study |= {"sobol": sobol, "tasks": ["sobol"]}
    (folder / "study.yaml").write_text(yaml.safe_dump(study, sort_keys=False))
    sinew("sobol", folder / "study.yaml", "--out", folder / "out", "--quiet")
    return json.loads((folder / "out" / "sobol.json").read_text())


@pytest.mark.febio
@pytest.mark.parametrize(
    ("sobol", "simulator", "runs"),
    [
        ({"method": "surrogate", "error": 0.02}, {}, 64),
        ({"method": "multifidelity", "error": 0.02}, {"fidelities": ["bar", "fine"], "bar": BAR}, 32),
    ],
    ids=["surrogate", "multifidelity"],
)
def test_few_runs_find_the_indices_of_brute_force(tmp_path, sobol, simulator, runs):
    found = indices(tmp_path, sobol, **simulator)
    assert found["rows"] == runs and found["surrogate"]["reached"]
    assert found["names"] == BRUTE_FORCE["names"]
    held, apart = [], []
    for output, known in BRUTE_FORCE["outputs"].items():
        for key in ("S1", "ST"):
            difference = np.abs(np.subtract(found["outputs"][output][key], known[key]))
            both = np.hypot(found["outputs"][output][f"{key}_conf"], known[f"{key}_conf"])
            held += (difference <= both).tolist()
            apart.append(difference.max())
    assert max(apart) < 0.02
    assert np.mean(held) >= 0.95
