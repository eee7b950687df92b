"""What can be hidden in a bar: each effect of the library in another form than the library's, and things beyond it.

A form draws its numbers from a generator; ``size`` 1 can be seen, 0 is the baseline.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from scipy.signal import lfilter
from scipy.special import roots_genlaguerre

from tests.hidden.bar import TOE_END, Array, Material, Past, Physics, fibre_stress

Random = np.random.Generator


@dataclass(frozen=True)
class Hidden:
    """A bar's physics, its numbers, and the true values of the library's parameters where the form is the library's."""

    physics: Physics
    magnitude: dict[str, float]
    same_form: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Form:
    """``seen``: whether it changes any force of the three protocols, which never compress the bar."""

    truth: str
    make: Callable[[Random, float], Hidden]
    seen: bool = True


def _softening_logistic(rng: Random, size: float) -> Hidden:
    loss, middle, width = size * rng.uniform(0.25, 0.5), rng.uniform(0.015, 0.03), rng.uniform(0.003, 0.008)

    def logistic(strain: float) -> float:
        return float(1.0 / (1.0 + np.exp(-(strain - middle) / width)))

    def left(past: Past, strain: float, fibre_MPa: float) -> float:
        largest = max(past.largest_strain, strain)
        return 1.0 - loss * (logistic(largest) - logistic(0.0)) / (1.0 - logistic(0.0))

    return Hidden(Physics(fibre_left=left), {"loss": loss, "middle": middle, "width": width})


def _softening_power(rng: Random, size: float) -> Hidden:
    loss, power = size * rng.uniform(0.25, 0.5), rng.uniform(1.0, 3.0)

    def left(past: Past, strain: float, fibre_MPa: float) -> float:
        return 1.0 - loss * (max(past.largest_strain, strain, 0.0) / 0.045) ** power

    return Hidden(Physics(fibre_left=left), {"loss": loss, "power": power})


def _softening_stress(rng: Random, size: float) -> Hidden:
    loss, scale = size * rng.uniform(0.3, 0.6), rng.uniform(2.0, 6.0)

    def left(past: Past, strain: float, fibre_MPa: float) -> float:
        return 1.0 + loss * float(np.expm1(-max(past.largest_fibre_MPa, fibre_MPa) / scale))

    return Hidden(Physics(fibre_left=left), {"loss": loss, "MPa": scale})


def _set_hardening(rng: Random, size: float) -> Hidden:
    limit, hardening = rng.uniform(0.2, 0.6), rng.uniform(0.1, 0.4)

    def matrix(material: Material, strain: float, past: Past) -> tuple[float, float]:
        modulus, plastic = material["E_m"], past.matrix_set
        beyond = modulus * (strain - plastic) - hardening * modulus * plastic
        if abs(beyond) > limit:
            plastic += np.sign(beyond) * (abs(beyond) - limit) / (modulus * (1.0 + hardening))
        return modulus * (strain - size * plastic), plastic

    return Hidden(Physics(matrix=matrix), {"MPa": limit, "hardening": hardening, "part": size})


def _slack_gauss(rng: Random, size: float) -> Hidden:
    mean = size * rng.uniform(0.007, 0.018)
    spread = mean * rng.uniform(0.2, 0.45)
    nodes, weights = np.polynomial.hermite_e.hermegauss(11)
    slack = np.maximum(mean + spread * nodes, 0.0)
    shares = weights / weights.sum()

    def fibre(material: Material, stretch: float) -> float:
        own = [fibre_stress(material, stretch / (1.0 + each)) / (1.0 + each) ** 2 for each in slack]
        return float(shares @ own)

    return Hidden(Physics(fibre=fibre), {"mean": mean, "spread": spread})


def _mode_power(rng: Random, size: float) -> Hidden:
    strength, start, power = size * rng.uniform(0.6, 1.5), rng.uniform(1.0, 10.0), rng.uniform(0.1, 0.35)
    # (1 + t/start)^-power is a sum of exponentials, with weights of the gamma distribution
    nodes, weights = roots_genlaguerre(14, power - 1.0)
    shares = strength * weights / weights.sum()
    terms = tuple((float(share), float(start / node)) for share, node in zip(shares, nodes, strict=True))
    return Hidden(Physics(fibre_terms=terms), {"strength": strength, "start": start, "power": power})


def _pace_power(rng: Random, size: float) -> Hidden:
    power = size * rng.uniform(0.8, 2.0) * rng.choice([-1.0, 1.0])

    def pace(strain: float) -> float:
        return float((1.0 + max(strain, 0.0) / 0.02) ** power)

    return Hidden(Physics(pace=pace), {"power": power})


def _dashpot_thinning(rng: Random, size: float) -> Hidden:
    viscosity, rate_0 = size * rng.uniform(100.0, 300.0), rng.uniform(0.002, 0.008)

    def viscous(rate: float) -> float:
        return float(viscosity * rate_0 * np.arcsinh(rate / rate_0))

    return Hidden(Physics(viscous=viscous), {"viscosity": viscosity, "rate": rate_0})


def _toe_fung(rng: Random, size: float) -> Hidden:
    power, sharp = rng.uniform(3.0, 5.0), rng.uniform(0.5, 2.0)
    end = TOE_END**2 - 1.0

    def fibre(material: Material, stretch: float) -> float:
        modulus, strain = material["E_f"], stretch**2 - 1.0
        if strain <= 0.0:
            return 0.0
        scale = modulus * end / (2.0 * TOE_END**3 * sharp * power * np.exp(sharp))
        if strain < end:
            own = scale * np.expm1(sharp * (strain / end) ** power)
        else:  # linear in the stretch, as the baseline, with the same slope where it begins
            own = scale * np.expm1(sharp) + modulus * (1.0 / TOE_END - 1.0 / stretch)
        return float((1.0 - size) * fibre_stress(material, stretch) + size * own)

    return Hidden(Physics(fibre=fibre), {"power": power, "sharp": sharp, "part": size})


def _compliance_stiffening(rng: Random, size: float) -> Hidden:
    compliance, scale = size * rng.uniform(1.0e-4, 3.0e-4), rng.uniform(400.0, 1500.0)

    def lost(force_N: float, past: Past) -> float:
        return compliance * force_N / (1.0 + abs(force_N) / scale)

    return Hidden(Physics(lost=lost), {"mm_per_N_at_rest": compliance, "N": scale})


def _compliance_linear(rng: Random, size: float) -> Hidden:
    compliance = size * rng.uniform(1.0e-4, 3.0e-4)

    def lost(force_N: float, past: Past) -> float:
        return compliance * force_N

    return Hidden(Physics(lost=lost), {"mm_per_N": compliance}, {"compliance": compliance})


def _slip_stick(rng: Random, size: float) -> Hidden:
    jump, between = size * rng.uniform(0.004, 0.01), rng.uniform(60.0, 150.0)

    def lost(force_N: float, past: Past) -> float:
        stairs = max(past.largest_N, force_N) / between
        return float(jump * (stairs - np.sin(2.0 * np.pi * stairs) / (2.0 * np.pi)))

    return Hidden(Physics(lost=lost), {"mm": jump, "N": between})


def _drift_logarithm(rng: Random, size: float) -> Hidden:
    offset, change = size * rng.uniform(-4.0, 4.0), size * rng.uniform(8.0, 18.0) * rng.choice([-1.0, 1.0])
    time, whole = rng.uniform(5.0, 40.0), 400.0

    def reading(time_s: Array, displacement_mm: Array, force_N: Array) -> Array:
        return force_N + offset + change * np.log1p(time_s / time) / np.log1p(whole / time)

    return Hidden(Physics(reading=reading), {"offset_N_at_first": offset, "N_in_400_s": change, "s": time})


def _drift_linear(rng: Random, size: float) -> Hidden:
    offset, slope = size * rng.uniform(-5.0, 5.0), size * rng.uniform(0.02, 0.06) * rng.choice([-1.0, 1.0])

    def reading(time_s: Array, displacement_mm: Array, force_N: Array) -> Array:
        return force_N + offset + slope * time_s

    magnitude = {"offset_N": offset, "N_per_s": slope}
    return Hidden(Physics(reading=reading), magnitude, {"force_offset": offset, "force_slope": slope})


def _lag_two_filters(rng: Random, size: float) -> Hidden:
    times = size * rng.uniform(0.1, 0.4, 2)

    def reading(time_s: Array, displacement_mm: Array, force_N: Array) -> Array:
        for time in times:
            force_N = _filtered(time_s, force_N, time)
        return force_N

    return Hidden(Physics(reading=reading), {"s_1": float(times[0]), "s_2": float(times[1])})


def _filtered(time_s: Array, force_N: Array, time: float) -> Array:
    """A filter of the first order, exact for a force that is linear between samples."""
    ratio = (time_s[1] - time_s[0]) / time
    kept, mean = np.exp(-ratio), -np.expm1(-ratio) / ratio
    above = force_N - force_N[0]
    return np.asarray(force_N[0] + lfilter([1.0 - mean, mean - kept], [1.0, -kept], above))


def _area(rng: Random, size: float) -> Hidden:
    factor = 1.0 + size * rng.uniform(0.06, 0.2) * rng.choice([-1.0, 1.0])
    return Hidden(Physics(area_factor=factor), {"factor": factor}, {"area_factor": factor})


def _fatigue_cycles(rng: Random, size: float) -> Hidden:
    loss, power = size * rng.uniform(0.015, 0.03), rng.uniform(0.6, 1.0)

    def left(past: Past, strain: float, fibre_MPa: float) -> float:
        return float(1.0 - loss * past.cycles**power)

    return Hidden(Physics(fibre_left=left, matrix_left=left), {"loss": loss, "power": power})


def _fluid_two(rng: Random, size: float) -> Hidden:
    moduli, times = size * rng.uniform(50.0, 120.0, 2), (rng.uniform(0.5, 3.0), rng.uniform(10.0, 60.0))
    terms = tuple((float(modulus), time) for modulus, time in zip(moduli, times, strict=True))
    magnitude = {"MPa_1": terms[0][0], "s_1": times[0], "MPa_2": terms[1][0], "s_2": times[1]}
    return Hidden(Physics(strain_terms=terms), magnitude)


def _preload_shift(rng: Random, size: float) -> Hidden:
    shift = size * rng.uniform(0.003, 0.008)

    def fibre(material: Material, stretch: float) -> float:
        return fibre_stress(material, stretch + shift) * (stretch + shift) / stretch

    return Hidden(Physics(fibre=fibre), {"shift": shift})


def _compression_linear(rng: Random, size: float) -> Hidden:
    part = size * rng.uniform(0.1, 0.4)

    def fibre(material: Material, stretch: float) -> float:
        if stretch < 1.0:
            return part * material["E_f"] * 0.5 * (stretch**2 - 1.0)
        return fibre_stress(material, stretch)

    return Hidden(Physics(fibre=fibre), {"part": part})


def _friction(rng: Random, size: float) -> Hidden:
    part = size * rng.uniform(0.02, 0.04)

    def reading(time_s: Array, displacement_mm: Array, force_N: Array) -> Array:
        direction = np.sign(np.diff(displacement_mm, prepend=displacement_mm[:1]))
        last = np.maximum.accumulate(np.where(direction != 0.0, np.arange(direction.size), 0))
        return force_N + part * force_N.max() * direction[last]  # in a hold it keeps its last direction

    return Hidden(Physics(reading=reading), {"part": part})


def _rupture(rng: Random, size: float) -> Hidden:
    drop, at = size * rng.uniform(0.04, 0.09), rng.uniform(0.022, 0.032)

    def left(past: Past, strain: float, fibre_MPa: float) -> float:
        return 1.0 - drop if max(past.largest_strain, strain) > at else 1.0

    return Hidden(Physics(fibre_left=left, matrix_left=left), {"drop": drop, "strain": at})


def _creep(rng: Random, size: float) -> Hidden:
    rate = size * rng.uniform(4.0e-4, 1.0e-3)

    def grown(past: Past) -> float:
        return 1.0 + rate * past.strain_time

    return Hidden(Physics(grown=grown), {"rate": rate})


def _hum(rng: Random, size: float) -> Hidden:
    part, frequency, begin = size * rng.uniform(0.012, 0.03), rng.uniform(0.02, 0.2), rng.uniform(0.0, 6.3)

    def reading(time_s: Array, displacement_mm: Array, force_N: Array) -> Array:
        return force_N + part * force_N.max() * np.sin(2.0 * np.pi * frequency * time_s + begin)

    return Hidden(Physics(reading=reading), {"part": part, "Hz": frequency})


def _buckling(rng: Random, size: float) -> Hidden:
    part = size * rng.uniform(0.85, 1.0)

    def reading(time_s: Array, displacement_mm: Array, force_N: Array) -> Array:
        return np.where(force_N < 0.0, (1.0 - part) * force_N, force_N)

    return Hidden(Physics(reading=reading), {"part": part})


def _gain(rng: Random, size: float) -> Hidden:
    part = size * rng.uniform(0.06, 0.15)

    def reading(time_s: Array, displacement_mm: Array, force_N: Array) -> Array:
        share = force_N / force_N.max()
        return force_N * (1.0 + part * share * (1.0 - share))  # a load cell whose line is bent

    return Hidden(Physics(reading=reading), {"part": part})


def _crosstalk(rng: Random, size: float) -> Hidden:
    part, wave_mm, begin = size * rng.uniform(0.01, 0.025), rng.uniform(0.01, 0.03), rng.uniform(0.0, 6.3)

    def reading(time_s: Array, displacement_mm: Array, force_N: Array) -> Array:
        # the screw of the drive, once a turn
        return force_N + part * force_N.max() * np.sin(2.0 * np.pi * displacement_mm / wave_mm + begin)

    return Hidden(Physics(reading=reading), {"part": part, "mm": wave_mm})


def _warming(rng: Random, size: float) -> Hidden:
    part, time = size * rng.uniform(0.08, 0.2), rng.uniform(30.0, 120.0)

    def reading(time_s: Array, displacement_mm: Array, force_N: Array) -> Array:
        return force_N * (1.0 - part * np.sin(time_s / time) ** 2)  # the room warms, and cools again

    return Hidden(Physics(reading=reading), {"part": part, "s": time})


FORMS = {
    "softening-logistic": Form("softening", _softening_logistic),
    "softening-power": Form("softening", _softening_power),
    "softening-stress": Form("softening", _softening_stress),
    "set-hardening": Form("permanent-set", _set_hardening),
    "slack-gauss": Form("toe-slack", _slack_gauss),
    "mode-power": Form("relaxation-mode", _mode_power),
    "pace-power": Form("strain-dependent-relaxation", _pace_power),
    "dashpot-thinning": Form("rate-viscosity", _dashpot_thinning),
    "toe-fung": Form("toe-exponent", _toe_fung),
    "compliance-stiffening": Form("machine-compliance", _compliance_stiffening),
    "compliance-linear": Form("machine-compliance", _compliance_linear),
    "slip-stick": Form("grip-slip", _slip_stick),
    "drift-logarithm": Form("force-drift", _drift_logarithm),
    "drift-linear": Form("force-drift", _drift_linear),
    "lag-two-filters": Form("time-lag", _lag_two_filters),
    "area": Form("area-error", _area),
    "fatigue-cycles": Form("cyclic-fatigue", _fatigue_cycles),
    "fluid-two": Form("fluid-flow", _fluid_two),
    "preload-shift": Form("preload", _preload_shift),
    "compression-linear": Form("fiber-compression", _compression_linear, seen=False),
    "friction-sudden": Form("friction", _friction),
    "rupture-sudden": Form("rupture", _rupture),
    "creep-strain": Form("creep", _creep),
    "buckling-whole": Form("buckling", _buckling),
}
OUTSIDE = {
    "gain": Form("OUTSIDE", _gain),
    "crosstalk": Form("OUTSIDE", _crosstalk),
    "hum": Form("OUTSIDE", _hum),
    "warming": Form("OUTSIDE", _warming),
}
PAIRS = (
    ("slack-gauss", "softening-logistic"),
    ("softening-stress", "lag-two-filters"),
    ("slack-gauss", "drift-linear"),
    ("toe-fung", "compliance-linear"),
    ("dashpot-thinning", "drift-logarithm"),
    ("preload-shift", "set-hardening"),
    ("fatigue-cycles", "compliance-stiffening"),
)
