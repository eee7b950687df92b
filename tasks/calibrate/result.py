"""The result of a calibration: what ``calibrate.json`` holds."""

import dataclasses
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path
from typing import Any

import numpy as np

from sinew.runner.errors import BadInput
from sinew.tasks.model import FORCE, Parameter, file_name
from sinew.tasks.simulate.series import with_unit
from sinew.tasks.study.result import OMIT, ROUNDING, AtMostOne, Correlation, Count, NotNegative, Number, Result, Share

SEARCHES = frozenset({"bayesian", "hybrid"})
"""The methods that leave a Bayesian search in the store."""


@dataclass(frozen=True)
class ConfoundedPair:
    """Two parameters that the curves of one specimen can hardly tell apart."""

    parameters: list[str]
    correlation: Correlation


@dataclass(frozen=True)
class QuantityFit:
    """One of several quantities that are compared: its ``unit``, its ``noise`` level, and its RMSE by protocol.

    ``r2``, by protocol: the share of the variance of what was measured that the model explains.
    """

    unit: str
    noise: NotNegative
    rmse: Mapping[str, NotNegative]
    r2: Mapping[str, AtMostOne | None]


@dataclass(frozen=True)
class MethodFit:
    """Where one method ended: total objective (N), how far that is above the noise (a ratio less 1), and its cost.

    ``above_noise_after``: the same after certain numbers of evaluations, at which methods are compared. ``trace``:
    pairs of the number of evaluations and the lowest total so far (N). ``converged`` is None for a method that has no
    such test. Where several quantities are compared, totals are sums of RMSEs over noise, not in newton.
    """

    total_N: NotNegative
    above_noise: float | None
    evaluations: Count
    converged: bool | None
    starts: Count
    above_noise_after: Mapping[str, float | None]
    trace: list[tuple[Count, NotNegative]]

    @property
    def steps(self) -> np.ndarray[Any, Any]:
        """``trace`` as an array ``[n, 2]``."""
        return np.array(self.trace, dtype=float).reshape(-1, 2)


@dataclass(frozen=True)
class SpecimenFit:
    """The best fit of one specimen, by ``method``, and what the curves say of each parameter there.

    ``rmse_N`` is by protocol and ``total_N`` their sum. By protocol as well, of every measured point: ``peak_N``, the
    largest measured force, and ``r2``, the share of the variance of the measured force that the model explains (None
    where the force is constant). ``noise_N`` is what noise alone would leave of the total; None where the curves do not
    say. ``sd_of_range``: standard deviations of the free parameters as parts of their ranges.

    All that is in newton is of the force alone. Where several quantities are compared, ``quantities`` holds each of
    them, and ``objective`` the sum over them and the protocols of RMSE over noise level: ``above_noise`` is of that.
    """

    site: str | None
    donor: str | None
    parameters: Mapping[str, Number]
    rmse_N: Mapping[str, NotNegative]
    peak_N: Mapping[str, NotNegative]
    r2: Mapping[str, AtMostOne | None]
    total_N: NotNegative
    noise_N: NotNegative | None
    above_noise: float | None
    method: str
    on_bound: list[str]
    sd_of_range: Mapping[str, NotNegative]
    determined: list[str]
    confounded: list[ConfoundedPair]
    methods: Mapping[str, MethodFit]
    objective: NotNegative | None = dataclasses.field(default=None, metadata=OMIT)
    quantities: Mapping[str, QuantityFit] | None = dataclasses.field(default=None, metadata=OMIT)

    def sums(self) -> dict[str, float]:
        """The RMSE of each quantity beside the force, summed over protocols, by ``rmse_NAME`` with its unit."""
        others = {name: one for name, one in (self.quantities or {}).items() if name != FORCE}
        return {f"rmse_{with_unit(name, one.unit)}": sum(one.rmse.values()) for name, one in others.items()}

    @property
    def unit(self) -> str:
        """What the total objective is measured in, as it stands beside an axis."""
        return "N" if self.objective is None else "RMSE over noise"

    @property
    def behind(self) -> str:
        """The unit of the total objective, as it stands behind a number."""
        return " N" if self.objective is None else ""

    @property
    def total(self) -> float:
        """The total objective: in newton, or a sum of RMSEs over noise where several quantities are compared."""
        return self.total_N if self.objective is None else self.objective

    @property
    def floor(self) -> float | None:
        """What noise alone would leave of :attr:`total`; None where the curves do not say."""
        if self.quantities is None:
            return self.noise_N
        return None if self.above_noise is None else float(sum(len(one.rmse) for one in self.quantities.values()))

    def percent_of_peak(self, protocol: str) -> float:
        """The root mean square error of a protocol in % of its peak force; NaN where there is no force."""
        peak = self.peak_N[protocol]
        return 100.0 * self.rmse_N[protocol] / peak if peak else float("nan")

    @property
    def unfinished(self) -> bool:
        """Whether the search that found it was cut short by its number of evaluations."""
        found = self.methods.get(self.method)
        return found is not None and found.converged is False

    def values(self, names: list[str]) -> list[float]:
        """Its parameters in the order of ``names``."""
        return [self.parameters[name] for name in names]


@dataclass(frozen=True, kw_only=True)
class PairCorrelation:
    """The correlation of two parameters within donors, or the ``reason`` why it has no number.

    ``p_holm`` is ``p`` adjusted for the number of pairs (Holm); ``interval`` is of 95 %. ``determined``: the curves
    determine both parameters in at least half of the specimens.
    """

    parameters: list[str]
    reason: str | None = dataclasses.field(default=None, metadata=OMIT)
    r: Correlation | None = dataclasses.field(default=None, metadata=OMIT)
    dof: Count | None = dataclasses.field(default=None, metadata=OMIT)
    p: Share | None = dataclasses.field(default=None, metadata=OMIT)
    interval: list[Correlation] | None = dataclasses.field(default=None, metadata=OMIT)
    determined: bool
    p_holm: Share | None = dataclasses.field(default=None, metadata=OMIT)


@dataclass(frozen=True)
class Correlations:
    """Correlations of all pairs of free parameters (``names``) within donors, across sites.

    ``determined``: the share of specimens in which each parameter is determined. ``tests`` counts the pairs that have a
    number.
    """

    sites: list[str]
    donors: list[str]
    specimens: Count
    names: list[str]
    determined: Mapping[str, Share]
    tests: Count
    pairs: list[PairCorrelation]


@dataclass(frozen=True)
class NoCorrelations:
    """Why nothing can be said of any pair."""

    reason: str


@dataclass(frozen=True, eq=False)
class CalibrateResult(Result):
    """The parameters of each specimen that bring the model closest to its curves.

    ``units`` and ``meanings`` are of all parameters (``names``), ``bounds`` of the ``free`` ones. ``data``: what it is
    of, by specimen (:func:`sinew.tasks.study.same_data.data_of`).
    """

    TASK = "calibrate"
    VERSION = 3  # 2: peak_N and r2 were added; 3: spikes are no noise
    LIBRARIES = ("scikit-optimize", "scikit-learn", "pingouin")

    names: list[str]
    units: list[str]
    meanings: list[str]
    free: list[str]
    bounds: list[tuple[Number, Number]]
    methods: list[str]
    evaluations: Count
    bayesian_evaluations: Count
    specimens: Mapping[str, SpecimenFit]
    inputs: str
    correlations: Correlations | NoCorrelations
    data: Mapping[str, str] | None = dataclasses.field(default=None, metadata=OMIT)

    def __post_init__(self) -> None:
        """Raises :class:`ValueError`: a free parameter has no range or is outside it, or another one varies."""
        if len(self.free) != len(self.bounds):
            raise ValueError(f"{len(self.free)} free parameters, {len(self.bounds)} ranges")
        for what, listed in (("parameters", self.names), ("free parameters", self.free)):
            if len(set(listed)) < len(listed) or not set(listed) <= set(self.names):
                raise ValueError(f"{what} that are named twice, or are no parameters")
        fixed: dict[str, float] = {}
        ranges = dict(zip(self.free, self.bounds, strict=True))
        for specimen, fit in self.specimens.items():
            for name, value in fit.parameters.items():
                if name not in ranges:
                    if fixed.setdefault(name, value) != value:
                        raise ValueError(f"{name}, which is not free, is {fixed[name]:g} and {value:g}")
                    continue
                low, high = ranges[name]
                room = ROUNDING * abs(high - low)
                if value < low - room or value > high + room:
                    raise ValueError(f"{name} {value:g} of {specimen}, outside its range {low:g} to {high:g}")

    def refuse_other_ranges(self, path: Path, free: Sequence[Parameter]) -> None:
        """Raises :class:`BadInput` where the free parameters of a study, or their ranges, are not those of ``path``."""
        now = [(one.name, one.minimum, one.maximum) for one in free]
        for one, then in zip_longest(now, ((name, *ends) for name, ends in zip(self.free, self.bounds, strict=True))):
            if one != then:
                raise BadInput(path, f"{(one or then or '?')[0]}: another range than now", "`sinew calibrate` again")

    @property
    def has_search(self) -> bool:
        """Whether the store keeps the points of a Bayesian search."""
        return bool(SEARCHES & set(self.methods))

    @property
    def typical(self) -> str:
        """The specimen of the median total objective; of an even number, the better of the two in the middle."""
        ordered = sorted(self.specimens, key=lambda name: (self.specimens[name].total, name))
        return ordered[(len(ordered) - 1) // 2]

    def not_determined(self, specimen: SpecimenFit) -> list[str]:
        """The free parameters that the curves of a specimen do not determine."""
        return [name for name in self.free if name not in specimen.determined]

    @property
    def often_on_bound(self) -> list[str]:
        """The parameters that ended on a bound in half of the specimens or more.

        Only specimens that determine a parameter count: elsewhere it says nothing where it ended.
        """
        fits = self.specimens.values()
        counts = Counter(name for fit in fits for name in fit.on_bound if name in fit.determined)
        return [name for name in self.free if 2 * counts[name] >= len(self.specimens)]

    def often_at_zero(self, name: str) -> bool:
        """Whether a parameter whose range begins at 0 ended there in half of the specimens or more."""
        low, high = self.bounds[self.free.index(name)]
        fits = [fit for fit in self.specimens.values() if name in fit.determined and name in fit.on_bound]
        lower = [fit.parameters[name] < (low + high) / 2 for fit in fits]
        return low == 0.0 and 2 * sum(lower) >= len(self.specimens)


RESULT = CalibrateResult


def search_group(specimen: str) -> str:
    """Where the store keeps the points of a specimen's Bayesian search."""
    return f"calibrate/{file_name(specimen)}"
