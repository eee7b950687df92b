"""Measurements for tests of the parts of a discovery: a model with few free parameters, and its curves with noise."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sinew.tasks.data.noise import Noise
from sinew.tasks.data.virtual import autoregressive
from sinew.tasks.discover.fit.candidate import Candidate
from sinew.tasks.fitting.measured import Measured
from sinew.tasks.model import Curve, Model, Protocol, Specimen

BAR = Specimen("one", 10.0, 8.0, 4.0)
NOISE = Noise(1.0, 0.3)


def model_with_free(*names: str) -> Model:
    """The model with all parameters fixed but these."""
    model = Model()
    for parameter in model.parameters:
        if parameter.name not in names:
            value = 2000.0 if parameter.name == "alpha_f" else parameter.reference
            model = model.with_parameter(replace(parameter, minimum=value, maximum=value, reference=value))
    return model


def measurements(
    candidate: Candidate, at: np.ndarray, tests: Sequence[tuple[Specimen, Protocol]], seed: int
) -> Measured:
    """The curves of a candidate ``at`` ``[k]`` on its unit cube, with noise, in tests of specimens that are alike."""
    rng = np.random.default_rng(seed)
    curves = []
    for specimen, protocol in tests:
        force = candidate.forces(specimen, protocol, at[np.newaxis])[0]
        curves.append(Curve(protocol, force + NOISE.sd_N * autoregressive(rng, force.size, NOISE.ar1)))
    return Measured(replace(tests[-1][0], curves=tuple(curves)), NOISE)
