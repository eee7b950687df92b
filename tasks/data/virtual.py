"""A virtual cohort: the 27 published specimens, pulled by the three protocols and measured with noise.

Parameters are those of Pekedis (2025), table 2. Gauge lengths, widths and thicknesses scatter around 10 x 8 x 4 mm.
Forces carry first-order autoregressive noise. All that is true of the specimens is known, for ``truth.json``.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd

from sinew.tasks.model import Curve, Model, Protocol, Specimen
from sinew.tasks.model.effect import Effect
from sinew.tasks.model.protocols import STANDARD
from sinew.tasks.simulate.effects import simulate_with
from sinew.tasks.study.resources import resource

GAUGE_MM = (10.0, 8.0, 4.0)
GAUGE_SCATTER = 0.04
TURNS = 5  # of a screw up to the largest displacement
Array = np.ndarray[Any, np.dtype[Any]]


def published() -> pd.DataFrame:
    """The 27 published specimens: site, specimen, one column for each parameter, and the RMSE of the fit in newton."""
    return pd.read_csv(resource("configs/table2.csv"), dtype={"site": str, "specimen": str})


def virtual_cohort(
    *,
    seed: int,
    per_site: int = 9,
    rate_hz: float = 100.0,
    noise: float = 0.003,
    ar1: float = 0.3,
    effects: tuple[Effect, ...] = (),
    screw: float = 0.0,
) -> tuple[list[Specimen], dict[str, Any]]:
    """Specimens with simulated measurements, and their true parameters and noise.

    ``per_site``: how many of the nine specimens of each site. ``rate_hz``: samples per second. ``noise``: standard
    deviation as a fraction of the specimen's peak force. ``ar1``: correlation of neighbouring samples. ``effects``:
    what the specimens have beside the model, at typical sizes. ``screw``: how far the machine's uneven screw is off at
    most, as a fraction of the largest displacement; no effect of the library describes that. The numbers of a specimen
    depend on the seed and its own row in the table only, so a smaller cohort holds the same specimens as a larger one.
    """
    model = Model()
    specimens, truth = [], {}
    for number, row in published().iterrows():
        if int(row["specimen"]) > per_site:
            continue
        rng = np.random.default_rng([seed, int(str(number))])
        name = f"{row['site']}/{row['specimen']}"
        values = np.array([row[parameter] for parameter in model.names], dtype=float)
        specimen, scale = virtual_specimen(
            rng, name, model, values, STANDARD, rate_hz=rate_hz, noise=noise, ar1=ar1, effects=effects, screw=screw
        )
        specimens.append(replace(specimen, donor=str(row["specimen"])))
        truth[name] = {
            "parameters": dict(zip(model.names, values.tolist(), strict=True)),
            "noise_sd_N": scale,
            "noise_ar1": ar1,
        }
    known = {"seed": seed, "rate_hz": rate_hz, "source": "Pekedis (2025), table 2", "specimens": truth}
    if effects:
        known["effects"] = {one.name: dict(zip(one.names, one.typical.tolist(), strict=True)) for one in effects}
    if screw:
        known["screw"] = {"fraction_of_displacement": screw, "turns": TURNS}
    return specimens, known


def virtual_specimen(
    rng: np.random.Generator,
    name: str,
    model: Model,
    values: Array,
    tests: Sequence[Callable[[float, float], Protocol]],
    *,
    rate_hz: float,
    noise: float,
    ar1: float,
    effects: tuple[Effect, ...] = (),
    strength: float = 1.0,
    screw: float = 0.0,
) -> tuple[Specimen, float]:
    """A specimen of parameters ``values`` ``[d]`` of ``model`` with simulated measurements, and their noise (N).

    Its sizes and its noise are drawn from ``rng``; ``tests`` make the protocols from gauge length and rate; effects
    have ``strength`` times their typical sizes. The rest is as for :func:`virtual_cohort`.
    """
    length, width, thickness = (round(size * (1 + GAUGE_SCATTER * rng.standard_normal()), 4) for size in GAUGE_MM)
    bare = Specimen(name, length, width, thickness)
    protocols = [make(length, rate_hz) for make in tests]
    moved = [_screwed(protocol, screw) for protocol in protocols]
    nothing = np.concatenate([np.empty(0), *(effect.null_values for effect in effects)])
    typical = np.concatenate([np.empty(0), *(effect.typical for effect in effects)])
    sizes = typical if strength == 1.0 else nothing + strength * (typical - nothing)
    rows = values[np.newaxis]
    forces = [simulate_with(model, effects, bare, protocol, rows, sizes[np.newaxis])[0] for protocol in moved]
    scale = noise * max(force.max() for force in forces)
    curves = tuple(
        Curve(protocol, force + scale * autoregressive(rng, force.size, ar1))
        for protocol, force in zip(protocols, forces, strict=True)
    )
    return Specimen(name, length, width, thickness, curves), scale


def _screwed(protocol: Protocol, size: float) -> Protocol:
    """How the specimen is pulled by a screw that is off by a wave, where the machine records ``protocol``."""
    recorded = protocol.displacement_mm
    largest = np.abs(recorded).max()
    off = size * largest * np.sin(2.0 * np.pi * TURNS * recorded / largest)
    return replace(protocol, displacement_mm=recorded + off)


def autoregressive(rng: np.random.Generator, size: int, ar1: float) -> Array:
    """Stationary noise ``[size]`` of unit variance whose neighbours correlate by ``ar1``."""
    from scipy.signal import lfilter

    steps = rng.standard_normal(size)
    steps[1:] *= np.sqrt(1 - ar1**2)
    return np.asarray(lfilter([1.0], [1.0, -ar1], steps))
