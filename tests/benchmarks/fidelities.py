"""Sobol indices of a nonlinear tendon with fibres in a dog-bone: runs of the solver with and without cheaper versions.

Sixteen parameters; the model has 8 times the elements of the coarse version, which has 72. Needs febio4. What
Saltelli's design would take for intervals as narrow is found with sinew's own bar, of which a run costs nothing: how
fast its intervals shrink depends on the outcome, which is nearly the same.
"""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from sinew.runner.store.store import open_store
from sinew.tasks.model import Model
from sinew.tasks.study.resources import resource

ERROR = 0.02
SEEDS = (1, 2, 3)
BASE = (256, 512, 1024, 2048, 4096, 8192)  # base samples of Saltelli's design, of the bar
SIZE = {"length_mm": 20, "width_mm": 4, "thickness_mm": 2}
PULLED = {"relaxation": {"time_s": [0, 5, 65], "displacement_mm": [0, 1.2, 1.2], "points": 131}}
OUTPUTS = {
    "force": {"data": "node_data", "item": "Rz", "set": "grip", "reduce": "sum", "scale": 4, "unit": "N"},
    "shoulder_stress": {"data": "element_data", "item": "s1", "set": "shoulder", "reduce": "max", "unit": "MPa"},
}


def template(fineness: int) -> str:
    """The dog-bone of the tutorial with so many elements along each edge of its own, of sinew's tissue."""
    dogbone = resource("configs/dogbone/dogbone.feb.j2").read_text("utf-8")
    tendon = resource("templates/tendon.feb.j2").read_text("utf-8")
    tissue = re.search(r"<material .*?</material>", tendon, re.DOTALL)
    assert tissue is not None
    material = re.sub(r"{{ (?:parameters|constants)\.(\w+) \| full }}", r"{{ \1 }}", tissue[0])
    material = material.replace("{{ beta }}", "2").replace("{{ lambda_0 }}", "1.01").replace('"tendon"', '"tissue"')
    text = re.sub(r"<material .*?</material>", lambda _: material, dogbone, flags=re.DOTALL)
    return text.replace("set fineness = 1", f"set fineness = {fineness}")


def study(folder: Path, sobol: Mapping[str, Any], fine: int, coarse: int | None, seed: int) -> Path:
    """The study with its templates; returns its path."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "fine.feb.j2").write_text(template(fine))
    simulator = {
        "name": "template", "file": "fine.feb.j2", "force": "force", "outputs": OUTPUTS, "timeout_s": 600,
        "time_steps": {"ramp_s": 0.5, "hold_growth": 0.2}, "max_file_mb": 256,
    }  # fmt: skip
    if coarse is not None:
        (folder / "coarse.feb.j2").write_text(template(coarse))
        simulator |= {"fidelities": ["bar", "coarse", "fine"], "coarse": {"file": "coarse.feb.j2"}}
    ranges = {p.name: {"min": p.minimum, "max": p.maximum, "unit": p.unit} for p in Model().parameters}
    content = {
        "name": "fibres", "seed": seed, "specimen": SIZE, "protocols": PULLED, "simulator": simulator,
        "model": {"parameters": ranges}, "store": {"points_per_curve": 24}, "tasks": ["sobol"], "sobol": dict(sobol),
    }  # fmt: skip
    path = folder / "study.yaml"
    path.write_text(yaml.safe_dump(content, sort_keys=False))
    return path


def bar(folder: Path, base: int, seed: int) -> Path:
    """The same study of sinew's own bar."""
    folder.mkdir(parents=True, exist_ok=True)
    content = {
        "name": "bar", "seed": seed, "specimen": SIZE, "protocols": PULLED, "tasks": ["sobol"],
        "sobol": {"base_samples": base},
    }  # fmt: skip
    path = folder / "study.yaml"
    path.write_text(yaml.safe_dump(content, sort_keys=False))
    return path


def seconds(out: Path) -> dict[str, float]:
    """Time of all runs (s) in each table of a result folder, by whether it is of the model or of a version."""
    store = open_store(out)
    found = {}
    for name in store.tables():
        table = store.read(name)
        found[name] = float(np.nansum(table["wall_seconds"].to_numpy()))
    return found
