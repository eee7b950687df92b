"""Laws: additions to the model that are written as data in a small grammar, and compiled into effects.

A law says which part of the test it changes, what drives it, in which form, and what it remembers::

    law/PART/MEMORY-DRIVER:UNIT/FORM          law/fibres/largest-strain:0.1/saturating

===========  ==========================================================================================================
word         what it can be
===========  ==========================================================================================================
PART         ``fibres``, ``matrix``: the elastic stress is multiplied by 1 + y; ``series``: y (mm) of the displacement
             is lost outside the gauge length; ``parallel``: y (N) is added to the force that is read
MEMORY       none: the driver as it is; ``largest-``: its largest value so far; ``lagging-``: what follows it late
DRIVER       ``strain``, ``rate`` (1/s, of the strain), ``path`` (strain there and back), ``time`` (s), ``force`` (N)
UNIT         the value of the driver at which y is the law's size, so x = driver / UNIT
FORM         ``power`` x^a; ``exponential`` exp(x / a) - 1; ``logarithm`` log(1 + x / a); ``threshold`` max(x - a, 0);
             ``saturating`` 1 - exp(-x / a); each but ``threshold`` divided by its value at x = 1
===========  ==========================================================================================================

Only laws that dissipate energy, or keep it, are in :data:`ADMISSIBLE`, and the sign of a size is bound accordingly.
None is ``exponential`` in time or path.
Instruments (``parallel`` with time, path or force) may drift either way.
"""

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache, partial
from typing import Any

import numpy as np

from sinew.tasks.model.effect import Array, Bars, Effect, GivingWay, Values
from sinew.tasks.model.lagging import lagging
from sinew.tasks.model.parameters import Parameter

MAX_LAWS = 2  # in one model
LOSS, GAIN, BOTH = "loss", "gain", "both"
_CONSTITUENT = {
    "strain": BOTH,  # elastic: what is stored comes back
    "largest-strain": LOSS,  # damage
    "lagging-strain": LOSS,  # damage that heals
    "rate": GAIN,  # stiffer while it is pulled, by viscosity
    "path": LOSS,  # fatigue
    "time": LOSS,  # ageing
}
#: The signs that a law may have, by part and by driver with its memory.
ADMISSIBLE: Mapping[str, Mapping[str, str]] = {
    "fibres": _CONSTITUENT,
    "matrix": _CONSTITUENT,
    "series": {"force": GAIN, "largest-force": GAIN, "lagging-force": GAIN},  # a spring, slip, creep
    "parallel": {"strain": GAIN, "rate": GAIN, "time": BOTH, "path": BOTH, "force": BOTH},
}
SHAPES: Mapping[str, tuple[float, float, float]] = {  # smallest, largest and typical of a form's a
    "power": (0.25, 4.0, 1.0),
    "exponential": (0.1, 2.0, 0.5),
    "logarithm": (0.003, 1.0, 0.1),
    "threshold": (0.0, 1.0, 0.4),
    "saturating": (0.02, 2.0, 0.3),
}
UNBOUNDED = ("path", "time")  # drivers that grow as long as a test goes on: no law may explode with them
UNITS = {"strain": "1", "rate": "1/s", "path": "1", "time": "s", "force": "N"}
LAG_S = (0.5, 200.0, 10.0)  # smallest, largest and typical
_SIZES = {  # smallest, largest and typical of a size
    "fibres": {LOSS: (-1.5, 0.0, -0.2), GAIN: (0.0, 3.0, 0.3), BOTH: (-0.9, 3.0, 0.2)},
    "series": {GAIN: (0.0, 0.2, 0.02)},
    "parallel": {GAIN: (0.0, 300.0, 30.0), BOTH: (-300.0, 300.0, 30.0)},
}
_NAME = re.compile(r"law/(?P<part>[a-z]+)/(?P<driver>[a-z-]+):(?P<unit>[0-9]{1,9}(?:\.[0-9]{1,12})?)/(?P<form>[a-z]+)")
_NUDGE = 1e-6  # of the driver, for the derivative of a form


@dataclass(frozen=True)
class Term:
    """One law: ``part``, ``driver`` with its memory, the driver's ``unit``, ``form``."""

    part: str
    driver: str
    unit: float
    form: str

    @property
    def of(self) -> str:
        """The driver without its memory."""
        return self.driver.rpartition("-")[2]

    @property
    def memory(self) -> str:
        """``largest``, ``lagging`` or nothing."""
        return self.driver.rpartition("-")[0]

    @property
    def sign(self) -> str:
        return ADMISSIBLE[self.part][self.driver]

    def own(self, what: str) -> str:
        """The name of one of its parameters: ``size``, ``shape`` or ``lag``."""
        return f"{self.part}_{self.driver.replace('-', '_')}_{what}"

    @property
    def name(self) -> str:
        """The law in the grammar."""
        unit = f"{self.unit:.12f}".rstrip("0").rstrip(".")
        return f"law/{self.part}/{self.driver}:{unit}/{self.form}"


def is_law(name: str) -> bool:
    """Whether a name means a law, right or wrong."""
    return name.startswith("law/")


@cache
def law(name: str) -> Effect:
    """The effect that a law means. Raises :class:`ValueError`, which says what is wrong with it."""
    found = _NAME.fullmatch(name)
    if found is None:
        raise ValueError("not of the form law/PART/DRIVER:UNIT/FORM, as law/fibres/largest-strain:0.1/power")
    part, driver, form, unit = (*found.group("part", "driver", "form"), float(found["unit"]))
    for what, said, possible in (
        ("part", part, list(ADMISSIBLE)),
        ("driver", driver, list(ADMISSIBLE.get(part, {}))),
        ("form", form, forms_of(driver)),
    ):
        if said not in possible:
            raise ValueError(f"{said} is no {what}; expected one of {', '.join(possible)}")
    if not unit > 0.0:
        raise ValueError("the unit of the driver is 0; expected a number above 0")
    return compiled(Term(part, driver, unit, form))


def forms_of(driver: str) -> list[str]:
    """The forms that a law with this driver may have."""
    return [form for form in SHAPES if form != "exponential" or driver not in UNBOUNDED]


def terms(units: Mapping[str, float]) -> Iterator[Term]:
    """All admissible laws, for ``units`` of the drivers."""
    for part, drivers in ADMISSIBLE.items():
        for driver in drivers:
            for form in forms_of(driver):
                yield Term(part, driver, units[driver.rpartition("-")[2]], form)


def compiled(term: Term) -> Effect:
    """The effect of a law, with ranges for tendons of 10 mm and 1,000 N."""
    every: dict[str, dict[str, Any]] = {
        "fibres": {"fibre_stress": partial(_on_fibres, term)},
        "matrix": {"matrix_stress": partial(_on_matrix, term)},
        "series": {"displacement": partial(_in_series, term), "giving_way": partial(_giving_way, term)},
        "parallel": {"reading": partial(_in_parallel, term)},
    }
    size, shape = term.own("size"), term.own("shape")
    unit = {"series": "mm", "parallel": "N"}.get(term.part, "1")
    low, high, typical = _SIZES["fibres" if term.part == "matrix" else term.part][term.sign]
    parameters = [
        Parameter(
            size, unit, low, high, typical, f"the law's size at {term.driver} = {term.unit:g}",
            floor=-math.inf if low < 0.0 else 0.0, strain_power=1 if term.part == "series" else 0,
        ),
        Parameter(shape, "1", *SHAPES[term.form], "the law's shape", exclusive=term.form != "threshold"),
    ]  # fmt: skip
    if term.memory == "lagging":
        parameters.append(Parameter(term.own("lag"), "s", *LAG_S, "how late it follows", exclusive=True))
    return Effect(
        slug=term.name.rpartition("/")[0],
        form=term.form,
        title=f"A law for {term.part}, driven by {term.driver.replace('-', ' ')}",
        description="A description with predictive value, found by search; not a mechanism.",
        equation=equation(term),
        reference="the grammar of docs/laws.md",
        parameters=tuple(parameters),
        null={size: 0.0},
        seen_by=(),
        confounded_with={},
        no_febio="a law has no FEBio partial",
        **every[term.part],
    )


def equation(term: Term) -> str:
    """The law in symbols, with the names of its parameters."""
    x = f"{term.of} / {term.unit:g}{'' if UNITS[term.of] == '1' else ' ' + UNITS[term.of]}"
    if term.memory:
        x = f"{term.memory} {x}" if term.memory == "largest" else f"{x}, late by {term.own('lag')}"
    a = term.own("shape")
    form = {
        "power": f"x^{a}",
        "exponential": f"(exp(x / {a}) - 1) / (exp(1 / {a}) - 1)",
        "logarithm": f"log(1 + x / {a}) / log(1 + 1 / {a})",
        "threshold": f"max(x - {a}, 0)",
        "saturating": f"(1 - exp(-x / {a})) / (1 - exp(-1 / {a}))",
    }[term.form]
    size = term.own("size")
    said = {
        "fibres": f"S_f -> S_f (1 + {size} {form})",
        "matrix": f"S_m -> S_m (1 + {size} {form})",
        "series": f"gauge displacement = grip displacement - {size} {form}",
        "parallel": f"force read = force + {size} {form}",
    }[term.part]
    return f"{said}, x = {x}"


# ---- what a law does


def shaped(form: str, x: Array, a: Array) -> Array:
    """A form ``[n, t]`` at ``x`` ``[n, t]``, 0 or more, with its shape ``a`` ``[n, 1]``.

    It is 1 at x = 1, but for a threshold. Beyond x = 10, an exponential goes on at its value there.
    """
    values: Array
    if form == "power":
        values = np.float_power(x, a)
    elif form == "exponential":
        values = np.expm1(np.minimum(x, 10.0) / a) / np.expm1(1.0 / a)
    elif form == "logarithm":
        values = np.log1p(x / a) / np.log1p(1.0 / a)
    elif form == "threshold":
        values = np.maximum(x - a, 0.0)
    else:
        values = np.expm1(-x / a) / np.expm1(-1.0 / a)
    return values


def _remembered(term: Term, bars: Bars, driver: Array, values: Values) -> Array:
    """The driver in its unit, with its memory."""
    x = driver / term.unit
    if term.memory == "largest":
        x = np.maximum.accumulate(x, axis=1)
    elif term.memory == "lagging":
        x = lagging(bars.time_s, x, values[term.own("lag")])
    return x


def _driver(term: Term, bars: Bars, strain: Array) -> Array:
    """The driver ``[n, t]``, 0 or more, where it is not a force."""
    if term.of == "strain":
        return np.abs(strain)
    change = np.diff(strain, axis=1, prepend=strain[:, :1])
    if term.of == "path":
        return np.cumsum(np.abs(change), axis=1)
    if term.of == "time":
        return np.broadcast_to(bars.time_s - bars.time_s[0], strain.shape)
    steps = np.where(bars.steps_s > 0.0, bars.steps_s, np.inf)
    rate: Array = change / steps
    return rate


def _sized(term: Term, bars: Bars, driver: Array, values: Values) -> Array:
    """What the law gives, y ``[n, t]``, for a driver ``[n, t]``."""
    x = _remembered(term, bars, driver, values)
    return values[term.own("size")] * shaped(term.form, np.maximum(x, 0.0), values[term.own("shape")])


def _times(term: Term, bars: Bars, stress: Array, strain: Array, values: Values) -> Array:
    changed: Array = stress * np.maximum(1.0 + _sized(term, bars, _driver(term, bars, strain), values), 0.0)
    return changed


def _on_fibres(term: Term, bars: Bars, values: Values) -> Array:
    return _times(term, bars, bars.fibre_MPa, bars.fibre_strain, values)


def _on_matrix(term: Term, bars: Bars, values: Values) -> Array:
    return _times(term, bars, bars.matrix_MPa, bars.strain, values)


def _in_parallel(term: Term, bars: Bars, values: Values) -> Array:
    if term.of == "force":
        return bars.force_N + np.sign(bars.force_N) * _sized(term, bars, np.abs(bars.force_N), values)
    driver = _driver(term, bars, bars.strain)
    sign = np.sign(driver if term.of == "rate" else bars.strain if term.of == "strain" else 1.0)
    return bars.force_N + sign * _sized(term, bars, np.abs(driver), values)


def _pull(term: Term, bars: Bars) -> Array:
    """The force that drives a law in series: a spring works both ways, what slips and creeps does so under tension."""
    return np.maximum(bars.force_N, 0.0) if term.memory else np.abs(bars.force_N)


def _in_series(term: Term, bars: Bars, values: Values) -> Array:
    lost = _sized(term, bars, _pull(term, bars), values)
    return bars.displacement_mm - (lost if term.memory else np.sign(bars.force_N) * lost)


def _giving_way(term: Term, bars: Bars, values: Values) -> tuple[GivingWay, ...]:
    """The slope of what is lost, for Newton's method: it need not be exact."""
    pull = _pull(term, bars)
    x = np.maximum(_remembered(term, bars, pull, values), 0.0)
    size, a = values[term.own("size")], values[term.own("shape")]
    slope = size * (shaped(term.form, x + _NUDGE, a) - shaped(term.form, x, a)) / _NUDGE / term.unit
    pulled = bars.force_N > 0.0
    if term.memory == "largest":
        rises = np.diff(np.maximum.accumulate(pull, axis=1), axis=1, prepend=pull[:, :1]) > 0.0
        return (GivingWay(slope * rises, np.ones_like(pull)),)
    if term.memory == "lagging":
        kept = np.exp(-bars.steps_s / values[term.own("lag")])
        return (GivingWay(slope * (1.0 - kept) * pulled, kept),)
    return (GivingWay(slope, np.zeros_like(pull)),)
