"""Virtual specimens that have more than the model, their likelihood, and how far a best fit is from the truth."""

import numpy as np

from sinew.tasks.data.noise import noise_of_each
from sinew.tasks.data.virtual import virtual_specimen
from sinew.tasks.fitting.measured import Measured
from sinew.tasks.infer.likelihood.best import best_fit
from sinew.tasks.infer.likelihood.scores import scores_of
from sinew.tasks.infer.likelihood.target import Target
from sinew.tasks.model import Model
from sinew.tasks.model.effects import named
from sinew.tasks.model.parameters import bounds
from sinew.tasks.model.protocols import cyclic, one_step, two_step
from sinew.tasks.simulate.uniaxial import Uniaxial

VARIED = ("E_f", "alpha_f", "g_2f", "E_m", "g_2m")
MODEL = Model()
FREE = tuple(parameter for parameter in MODEL.parameters if parameter.name in VARIED)


def target(number, effect="", screw=0.0, strength=1.0, rate_hz=10.0):
    """The likelihood of specimen ``number``, and its true scores ``[k]``."""
    rng = np.random.default_rng([3, number])
    at = rng.uniform(0.3, 0.7, len(FREE))
    low, high = bounds(FREE)
    values = MODEL.full(VARIED, (low + (high - low) * at)[np.newaxis])[0]
    effects = (named()[effect],) if effect else ()
    specimen, _ = virtual_specimen(
        rng, "a/1", MODEL, values, (one_step, two_step, cyclic), rate_hz=rate_hz, noise=0.003, ar1=0.3,
        effects=effects, strength=strength, screw=screw,
    )  # fmt: skip
    measured = Measured(specimen, noise_of_each([specimen.curves])[0])
    return Target(MODEL, FREE, Uniaxial(), measured), scores_of(at)


def fitted(one, truth):
    """The best fit, how far it is from the truth in standard deviations ``[k]``, and these."""
    best = best_fit(one, np.random.default_rng(1))
    deviations = np.sqrt(np.diag(best.covariance))
    return best, (best.at - truth) / deviations, deviations
