"""Specimens that no inference knew, and whether the bands of a new specimen hold their curves."""

from collections.abc import Sequence

import numpy as np

from sinew.tasks.benchmark.infer.drawn import SITES, Conditions, Truth, measured
from sinew.tasks.benchmark.infer.result import LeftOut
from sinew.tasks.infer.result import LikelihoodResult, draws_of_new, particles_group
from sinew.tasks.model import FORCE, Specimen
from sinew.tasks.predict.method import bands_of, noise_level
from sinew.tasks.predict.settings import NEW
from sinew.tasks.simulate import Array
from sinew.tasks.simulate.evaluation import kept_points
from sinew.tasks.study import streams
from sinew.tasks.study.workspace import Workspace

PROBABILITY = 0.95
STREAM = "specimens left out"


def left_out(
    workspace: Workspace,
    result: LikelihoodResult,
    truth: Truth,
    specimens: Sequence[Specimen],
    conditions: Conditions,
) -> list[LeftOut]:
    """One more specimen of each site, measured as the others were, and the bands that `sinew predict` would draw."""
    found = []
    for number, (site, at) in enumerate(zip(SITES, truth.further, strict=True)):
        rng = streams.generator(workspace.seed, STREAM, number)
        one = measured(rng, f"{site}/further", workspace.model, at, conditions)
        stored = workspace.store.read_result(particles_group(site))
        varied = tuple(str(name) for name in stored["parameter"].values)
        rows = workspace.model.full(varied, draws_of_new(stored, NEW, streams.key(workspace.seed, STREAM, number)))
        others = [each for each in specimens if each.name in result.sites[site].specimens]
        for curve in one.curves:
            keep = kept_points(curve.protocol, workspace.study.store.points_per_curve)
            simulated = workspace.simulator.simulate(workspace.model, one, curve.protocol, rows)
            force = simulated.force_N[simulated.status == 0][:, keep]
            noise = noise_level(others, curve.name, FORCE)
            simulated_bands = {"hdi": force, "draws": force, "new": force}
            bands = bands_of(simulated_bands, noise, PROBABILITY, from_population=True)
            inside = {name: _inside(curve.force_N[keep], bands[name]) for name in ("new", "whole")}
            found.append(LeftOut(site, curve.name, float(inside["new"].mean()), bool(inside["whole"].all())))
    return found


def _inside(force: Array, band: tuple[Array, Array] | None) -> Array:
    """Which points ``[t]`` are inside a band."""
    assert band is not None, "there are enough draws"
    return np.asarray((force >= band[0]) & (force <= band[1]))
