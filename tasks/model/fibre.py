"""The fibres' elastic law, "fiber-exp-pow-linear" (Maas et al., FEBio theory manual, section 5), for many bars.

With I = stretch^2 and I0 = lambda_0^2: no stress up to I = 1, then 2 xi exp(alpha (I-1)^beta) (I-1)^(beta-1), and
2 B - E_f / stretch beyond I0; continuity of stress and stiffness at I0 gives xi and B. Models with effects use it; the
kernel of those without has the same law (:mod:`sinew.tasks.simulate.uniaxial`), and the two must agree.
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from sinew.runner.compiled import at_first_call

# np.float_power for powers with an exponent for each bar: ``**`` computes squares another way when there is one bar
# alone, so that its last digit would depend on its neighbours.

Array = np.ndarray[Any, np.dtype[Any]]


def stress(stretch: Array, material: Mapping[str, Array]) -> Array:
    """Second Piola-Kirchhoff stress ``[n, t]`` (MPa) at the fibres' ``stretch`` ``[n, t]``.

    ``material`` holds E_f (MPa), alpha_f, beta and lambda_0, each ``[n, 1]``.
    """
    result = np.empty_like(stretch)
    _stress(np.ascontiguousarray(stretch), *_constants(material), result)
    return result


def energy(stretch: Array, material: Mapping[str, Array]) -> Array:
    """Strain energy density ``[n, t]`` (MPa): its derivative by I is half the :func:`stress`."""
    modulus, alpha, beta, lambda_0 = (material[name] for name in ("E_f", "alpha_f", "beta", "lambda_0"))
    toe, _, _, _, linear, _ = (constant[:, np.newaxis] for constant in _constants(material))
    square, square_0 = stretch**2, lambda_0**2
    decay = np.exp(-alpha * np.float_power(square_0 - 1.0, beta))
    in_toe = _toe_energy(np.clip(square, 1.0, square_0) - 1.0, toe * decay, alpha, beta)
    beyond = np.maximum(square, square_0)
    return in_toe + 0.5 * linear * (beyond - square_0) - modulus * (np.sqrt(beyond) - lambda_0)


def _toe_energy(strain: Array, slope: Array, alpha: Array, beta: Array) -> Array:
    power = np.float_power(strain, beta)
    safe = np.where(alpha == 0.0, 1.0, alpha)
    return 0.5 * slope / beta * np.where(alpha == 0.0, power, np.expm1(alpha * power) / safe)


def _constants(material: Mapping[str, Array]) -> tuple[Array, Array, Array, Array, Array, Array]:
    """2 xi exp(alpha (I0-1)^beta), alpha, beta, I0, 2 B and E_f, each ``[n]``."""
    modulus, alpha, beta, lambda_0 = (material[name][:, 0] for name in ("E_f", "alpha_f", "beta", "lambda_0"))
    square = lambda_0**2
    power = np.float_power(square - 1.0, beta)
    d = 4 * square**1.5 * (beta - 1 + alpha * beta * power)
    toe = 2 * modulus * np.float_power(square - 1.0, 2.0 - beta) / d
    linear = 2 * modulus * (2 * square * (beta - 0.5 + alpha * beta * power) - 1) / d
    return toe, alpha, beta, square, linear, modulus


@at_first_call(error_model="numpy")
def _stress(stretch, toe, alpha, beta, toe_end, linear, modulus, result):  # type: ignore[no-untyped-def]
    for row in range(stretch.shape[0]):
        toe_end_power = (toe_end[row] - 1.0) ** beta[row]
        last, value = np.nan, 0.0
        for t in range(stretch.shape[1]):
            stretched = stretch[row, t]
            if stretched != last:  # powers are expensive; a hold needs them once
                square = stretched * stretched
                strain = square - 1.0
                if square <= 1.0:
                    value = 0.0
                elif square < toe_end[row]:
                    power = strain ** beta[row]
                    value = toe[row] * math.exp(alpha[row] * (power - toe_end_power)) * strain ** (beta[row] - 1.0)
                else:
                    value = linear[row] - modulus[row] / stretched
                last = stretched
            result[row, t] = value
