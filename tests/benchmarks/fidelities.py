"""Sobol indices of a nonlinear tendon with fibres, with 16 parameters: what cheaper versions of the model are worth.

- *Bars*: the model is a bar, the cheaper version a bar of another length and another toe. How often 95 % intervals hold
  the truth, which is known from a large design, and what Saltelli's design takes for intervals as narrow.
- *Mesh*, where febio4 is on the PATH: a dog-bone of 576 elements, with the bar and a mesh of 72 elements in its place.
  How wide intervals are, and what all runs take together in units of a run of the model.
"""

import json
import re
import shutil
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from threadpoolctl import threadpool_limits

from sinew.runner.store.store import open_store
from sinew.tasks.model import Model, Protocol, Specimen
from sinew.tasks.model.parameters import scaled
from sinew.tasks.simulate.plain_design import shares
from sinew.tasks.simulate.saltelli import Design
from sinew.tasks.simulate.uniaxial import Uniaxial
from sinew.tasks.sobol.by_chaos import ByChaos, Version
from sinew.tasks.sobol.method import Intervals
from sinew.tasks.study.resources import resource
from tests.benchmarks.sobol import SCRAMBLES, Case, covered, estimates
from tests.tasks.study.test_pipeline import sinew

Array = np.ndarray
SEEDS, OF_CHEAPER, RUNS = 40, 2048, (32, 48, 72)
TRUTH, BASE = 2**16, (256, 512, 1024, 2048, 4096, 8192, 16384)
MESH_SEEDS = (1, 2, 3)
PULLED = {"relaxation": {"time_s": [0, 5, 65], "displacement_mm": [0, 1.2, 1.2], "points": 131}}
SIZE = {"length_mm": 20, "width_mm": 4, "thickness_mm": 2}
OUTPUTS = {
    "force": {"data": "node_data", "item": "Rz", "set": "grip", "reduce": "sum", "scale": 4, "unit": "N"},
    "shoulder_stress": {"data": "element_data", "item": "s1", "set": "shoulder", "reduce": "max", "unit": "MPa"},
}


def peak(length_mm: float, lambda_0: float) -> Callable[[Array], Array]:
    """The largest force of a bar of this length and toe, as a function of points of the unit cube."""
    time = np.array([*np.linspace(0, 5, 11), *np.linspace(6, 65, 60)])
    protocol = Protocol("relaxation", time, 1.2 * np.minimum(time / 5, 1))
    specimen, model = Specimen("bar", length_mm, 4.0, 2.0), Model(lambda_0=lambda_0)

    def function(share: Array) -> Array:
        parts = np.array_split(share, max(1, len(share) // 4096))
        rows = (scaled(model.free, part) for part in parts)
        found = [Uniaxial().simulate(model, specimen, protocol, each).force_N.max(axis=1) for each in rows]
        return np.concatenate(found)

    return function


def with_cheaper(cheaper: Callable[[Array], Array]) -> Callable[[Case, int, int], dict[str, Array]]:
    """Indices from runs of the model and of a cheaper version."""

    def found(case: Case, runs: int, seed: int) -> dict[str, Array]:
        size = len(case.ranges)
        names, alone = tuple(f"x{j}" for j in range(size)), tuple((j,) for j in range(size))
        each = [shares(size, count, seed, SCRAMBLES, number) for number, count in enumerate((runs, OF_CHEAPER))]
        designs = [Design(names, len(s), False, s, scrambles=SCRAMBLES, members=alone, plain=True) for s in each]
        outcomes = np.concatenate([case.function(each[0]), cheaper(each[1])])
        version = (Version(designs[1], each[1]),)
        one = ByChaos(designs[0], each[0], np.ones(runs, dtype=bool), Intervals(10, 0.95, seed), cheaper=version)
        return dict(vars(one.analysis(outcomes)))

    return found


def bars() -> None:
    function = peak(26.0, 1.01)
    unit = [[0.0, 1.0]] * len(Model().free)
    whole = estimates(Case("", unit, function, np.empty(0)), TRUTH, 10**6)
    case = Case("bar", unit, function, whole["S1"], whole["ST"])
    print(f"  truth: half-widths up to {max(whole['S1_conf'].max(), whole['ST_conf'].max()):.4f}")
    with threadpool_limits(1):
        for runs in RUNS:
            covered(case, runs, SEEDS, with_cheaper(peak(20.0, 1.015)))
    for base in BASE:
        every = [estimates(case, base, seed) for seed in range(5)]
        wide = np.median([max(one["S1_conf"].max(), one["ST_conf"].max()) for one in every])
        print(
            f"  Saltelli's design, {base} base samples ({base * 18:,} runs): widest half-width {wide:.4f}", flush=True
        )


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


def study(folder: Path, sobol: Mapping[str, Any], seed: int) -> Path:
    """The study with its templates; returns its path."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, fineness in (("fine", 2), ("coarse", 1)):
        (folder / f"{name}.feb.j2").write_text(template(fineness))
    simulator = {
        "name": "template", "file": "fine.feb.j2", "force": "force", "outputs": OUTPUTS, "timeout_s": 600,
        "time_steps": {"ramp_s": 0.5, "hold_growth": 0.2}, "fidelities": ["bar", "coarse", "fine"],
        "coarse": {"file": "coarse.feb.j2"},
    }  # fmt: skip
    ranges = {p.name: {"min": p.minimum, "max": p.maximum, "unit": p.unit} for p in Model().parameters}
    content = {
        "name": "fibres", "seed": seed, "specimen": SIZE, "protocols": PULLED, "simulator": simulator,
        "model": {"parameters": ranges}, "store": {"points_per_curve": 24}, "tasks": ["sobol"], "sobol": dict(sobol),
    }  # fmt: skip
    path = folder / "study.yaml"
    path.write_text(yaml.safe_dump(content, sort_keys=False))
    return path


def mesh() -> None:
    for seed in MESH_SEEDS:
        with tempfile.TemporaryDirectory() as temporary:
            folder = Path(temporary)
            sinew("sobol", study(folder, {"method": "multifidelity"}, seed), "--out", folder / "out", "--quiet")
            found = json.loads((folder / "out" / "sobol.json").read_text())
            tables = open_store(folder / "out").tables()
            took = sorted(float(np.median(t.read("wall_seconds", np.arange(len(t))))) for t in tables)
            runs = {"model": found["rows"]} | {k: v["runs"] for k, v in found["surrogate"]["versions"].items()}
            cost = runs["model"] + runs["coarse"] * took[-2] / took[-1] + runs["bar"] * took[0] / took[-1]
            wide = max(max(found[key]) for key in ("S1_conf", "ST_conf"))
            index = ", ".join(f"{name} {value:.3f}" for name, value in zip(found["names"], found["ST"], strict=True))
            print(f"  mesh, seed {seed}: {runs}, as long as {cost:.0f} of the model ({took[-1]:.2f} s each): "
                  f"widest half-width {wide:.4f}; ST {index}", flush=True)  # fmt: skip


def main() -> None:
    bars()
    if shutil.which("febio4") is None:
        print("  mesh: febio4 is not on the PATH")
    else:
        mesh()
