"""The result of a comparison of sites: what ``compare.json`` holds."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from sinew.tasks.study.result import ROUNDING, Count, NotNegative, Number, Numbers, Result, Share, Shares


class Area(Protocol):
    """An area under an ROC curve and its interval: of a pair along the component, or of a classifier."""

    @property
    def auc(self) -> float: ...

    @property
    def interval(self) -> Any: ...


def check_area(found: Area) -> None:
    """Raises :class:`ValueError` for an area that is not within its interval ``[2]``."""
    ends = np.asarray(found.interval)
    if ends.shape != (2,) or ends[0] > found.auc + ROUNDING or ends[1] < found.auc - ROUNDING:
        raise ValueError(f"an area of {found.auc:g} with the interval {ends.tolist()}")


@dataclass(frozen=True, eq=False)
class Loadings:
    """The first principal component by parameter: ``loadings``, and the ``mean`` and ``sd`` that standardise."""

    explained_variance: Share
    loadings: Mapping[str, Number]
    mean: Mapping[str, Number]
    sd: Mapping[str, NotNegative]


@dataclass(frozen=True)
class SiteParticles:
    """How many particles a site has, and how many of equal weight they are worth (Kish 1965)."""

    particles: Count
    effective_sample_size: NotNegative

    def __post_init__(self) -> None:
        """Raises :class:`ValueError` for particles that are worth more than they are."""
        if self.effective_sample_size > self.particles * (1.0 + ROUNDING):
            raise ValueError(f"{self.particles} particles worth {self.effective_sample_size:g}")


@dataclass(frozen=True, eq=False)
class Roc:
    """An ROC curve ``[k]``: the shares of the first and of the second site above each threshold."""

    false_positive: Shares
    true_positive: Shares


@dataclass(frozen=True, eq=False)
class Separability:
    """How well a linear classifier of all parameters separates particles that it was not fitted to.

    ``without_difference`` ``[2]`` holds the areas of shuffled sites; it and ``p_value`` are None for few particles.
    """

    auc: Share
    interval: Shares
    without_difference: Shares | None
    p_value: Share | None
    folds: Count
    repeats: Count
    permutations: Count

    def __post_init__(self) -> None:
        """Raises :class:`ValueError` for an area that is not within its interval."""
        check_area(self)


@dataclass(frozen=True, eq=False)
class Pair:
    """Two sites: area under the ROC curve of the component with its interval ``[2]``, and of all parameters."""

    sites: list[str]
    auc: Share
    interval: Shares
    roc: Roc
    all_parameters: Separability

    def __post_init__(self) -> None:
        """Raises :class:`ValueError` for an area that is not within its interval."""
        check_area(self)

    @property
    def name(self) -> str:
        """Both sites, as a person reads them."""
        return " / ".join(self.sites)


@dataclass(frozen=True)
class Interval:
    """``mean`` of a posterior, ends of its interval, and the probability ``direction`` of the likelier sign.

    Of a ratio the sign is that of its logarithm, and ``mean`` is the geometric one.
    """

    mean: Number
    low: Number
    high: Number
    direction: Share

    def __post_init__(self) -> None:
        """Raises :class:`ValueError` for an interval that ends before it begins."""
        if self.low > self.high:
            raise ValueError(f"an interval from {self.low:g} to {self.high:g}")

    def exponential(self) -> "Interval":
        """That of a ratio, from that of its logarithm."""
        mean, low, high = (float(np.exp(one)) for one in (self.mean, self.low, self.high))
        return Interval(mean, low, high, self.direction)


@dataclass(frozen=True)
class Contrast:
    """How one parameter's populations differ at two sites, the second less the first, or over it.

    ``paired``: specimens of the same donors were compared. ``needed``: specimens of each site that would find the
    difference, None for more than 1,000; ``detectable``: the smallest difference that these specimens
    find, None for one of each site.
    """

    sites: list[str]
    parameter: str
    paired: bool
    difference: Interval
    spread_ratio: Interval
    needed: Count | None
    detectable: NotNegative | None

    @property
    def different(self) -> bool:
        """Whether the interval of the difference does not hold zero."""
        return not self.difference.low <= 0.0 <= self.difference.high


@dataclass(frozen=True, eq=False)
class Densities:
    """Densities by site at the values ``component`` ``[g]``; None for a site whose particles do not vary."""

    component: Numbers
    sites: Mapping[str, Numbers | None]

    def shown(self) -> dict[str, Any]:
        """The densities that there are, each with its number among all sites."""
        numbered = enumerate(self.sites.items())
        return {site: (number, values) for number, (site, values) in numbered if values is not None}


@dataclass(frozen=True, eq=False)
class CompareResult(Result):
    """How the sites differ; ``confidence`` is that of all intervals.

    ``contrasts`` of their populations: none after an inference by ABC, which has no populations. ``pairs``: how well
    their posteriors can be told apart.
    """

    TASK = "compare"
    LIBRARIES = ("scikit-learn",)

    VERSION = 3  # 2: contrasts of populations; 3: draws of chains count as many as they are worth

    names: list[str]
    confidence: Share
    contrasts: list[Contrast]
    component: Loadings
    sites: Mapping[str, SiteParticles]
    pairs: list[Pair]
    densities: Densities
    note: str
    inputs: str

    def __post_init__(self) -> None:
        """Raises :class:`ValueError` for a pair of sites that are not compared."""
        for sites in (*(one.sites for one in self.contrasts), *(one.sites for one in self.pairs)):
            if len(sites) != 2 or sites[0] == sites[1] or not set(sites) <= set(self.sites):
                raise ValueError(f"sites {', '.join(sites)}, which are not compared")
        if others := [one.parameter for one in self.contrasts if one.parameter not in self.names]:
            raise ValueError(f"a contrast of {others[0]}, which is no parameter")


RESULT = CompareResult
