"""The result of a prediction: what ``predict.json`` holds."""

import dataclasses
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from sinew.tasks.drawing.blocks import level
from sinew.tasks.predict.settings import fewest_of_new
from sinew.tasks.study.result import OMIT, ROUNDING, Count, Result, Share

SIMULATED = ("hdi", "draws", "new")
"""What is simulated for bands."""
BANDS = {
    "hdi": "mean and HDI bounds",
    "draws": "draws from the posterior",
    "new": "a new specimen",
    "whole": "a new specimen's whole curve",
}
"""The bands, and what each is called: see :mod:`sinew.tasks.predict.method`."""
TOO_NARROW = 0.1  # a share of the points below the probability of a band by more than this is remarked on
WHY_NARROW = {
    "hdi": "it shows the spread of the parameters only, not the noise and not what the model lacks",
    "draws": "it shows the spread of the parameters only, not the noise and not what the model lacks",
    "new": "specimens differ by more than this band knows",
    "whole": "specimens differ by more than this band knows",
}


@dataclass(frozen=True)
class Coverage:
    """The share of measured points inside a band: of all points, by protocol and by specimen.

    None where the band is not given; ``points`` counts the measured points where it is. ``curves``: the share of
    measured curves all of whose points are inside.
    """

    all: Share | None
    points: Count
    protocols: Mapping[str, Share | None]
    specimens: Mapping[str, Share | None]
    curves: Share | None

    def __post_init__(self) -> None:
        """Raises :class:`ValueError` for shares that contradict each other."""
        if len({self.all is None, self.curves is None, self.points == 0}) > 1:
            raise ValueError(f"{self.all} of {self.points:,} points and {self.curves} of the curves")
        if self.all is None or self.curves is None:
            return
        for parts in (self.protocols, self.specimens):
            given = [share for share in parts.values() if share is not None]
            if given and not min(given) - ROUNDING <= self.all <= max(given) + ROUNDING:
                raise ValueError(f"{self.all:g} of all points, but {min(given):g} to {max(given):g} of their parts")
        if (self.all > 1.0 - ROUNDING) != (self.curves > 1.0 - ROUNDING):
            raise ValueError(f"{self.all:g} of all points, but {self.curves:g} of the curves with all of theirs")


@dataclass(frozen=True)
class QuantityPrediction:
    """Coverage by band of a quantity that is compared beside the force, and its ``unit``."""

    unit: str
    coverage: Mapping[str, Coverage]


@dataclass(frozen=True)
class SitePrediction:
    """The bands of one site. ``failed`` counts failed rows by specimen and status, ``coverage`` is by band.

    ``coverage`` is that of the force; ``others`` holds the other quantities that are compared, if there are any.

    ``no_new`` and ``no_stresses`` say why the band for a new specimen or the stresses are missing. ``typical`` is the
    specimen that is drawn, ``stresses_of`` the one along whose displacements the stresses are.
    """

    specimens: list[str]
    failed: Mapping[str, Mapping[str, Count]]
    no_new: str | None
    coverage: Mapping[str, Coverage]
    typical: str
    stresses_of: str | None
    no_stresses: str | None
    others: Mapping[str, QuantityPrediction] | None = dataclasses.field(default=None, metadata=OMIT)

    def __post_init__(self) -> None:
        """Raises :class:`ValueError` for specimens that are not of this site."""
        told = {self.typical, *filter(None, (self.stresses_of,)), *self.failed}
        told.update(*(one.specimens for one in self.coverage.values()))
        if foreign := sorted(told - set(self.specimens)):
            raise ValueError(f"{', '.join(foreign)}: not among its specimens {', '.join(self.specimens)}")

    @property
    def gaps(self) -> list[str]:
        """Why something is missing, a sentence for each."""
        return [why for why in (self.no_new, self.no_stresses) if why is not None]


@dataclass(frozen=True, eq=False)
class PredictResult(Result):
    """Bands around the curves of each site, from ``rows`` simulations, and how many measured points they cover.

    ``from_population``: those of a new specimen come from a population's posterior, not from the other specimens.
    """

    TASK = "predict"
    VERSION = 5  # 3: whole curves; 4: words; 5: bands of a new specimen of a population by rank

    probability: Share
    draws: Count
    rows: Count
    failed: Count
    sites: Mapping[str, SitePrediction]
    coverage: Mapping[str, Coverage]
    inputs: str
    others: Mapping[str, QuantityPrediction] | None = dataclasses.field(default=None, metadata=OMIT)
    from_population: bool = False

    def __post_init__(self) -> None:
        """Raises :class:`ValueError` for numbers that contradict each other."""
        if self.failed > self.rows:
            raise ValueError(f"{self.failed:,} of {self.rows:,} simulations failed")
        each = [sum(statuses.values()) for site in self.sites.values() for statuses in site.failed.values()]
        if sum(each) != self.failed:
            raise ValueError(f"failed: {self.failed:,} simulations, but {sum(each):,} of the specimens")
        for site, coverage in self.by_site.items():
            if "hdi" not in coverage or set(coverage) - set(BANDS):
                raise ValueError(f"coverage of {site}: of {', '.join(coverage)}, not of {', '.join(BANDS)}")
        for band, one in self.coverage.items():
            points = sum(site.coverage[band].points for site in self.sites.values() if band in site.coverage)
            if one.points != points:
                raise ValueError(f"coverage of all, {band}: {one.points:,} points, but {points:,} of the sites")

    def shares_of_others(self) -> Iterator[dict[str, Any]]:
        """As :meth:`shares`, of the quantities that are compared beside the force; ``quantity`` names each."""
        sites = {site: one.others for site, one in self.sites.items()} | {"all": self.others}
        for site, others in sites.items():
            for name, found in (others or {}).items():
                for band, one in found.coverage.items():
                    if one.all is not None:
                        shares = {"share": one.all, "by_protocol": [one.protocols.get(each) for each in self.protocols]}
                        yield {"site": site, "quantity": name, "band": band, **shares, "points": one.points}

    @property
    def by_site(self) -> dict[str, Mapping[str, Coverage]]:
        """Coverage by site and band; ``all`` is that of all sites together."""
        return {site: one.coverage for site, one in self.sites.items()} | {"all": self.coverage}

    @property
    def protocols(self) -> list[str]:
        """Names of all protocols."""
        return list(self.coverage["hdi"].protocols)

    @property
    def remarks(self) -> list[str]:
        """What a person should know of the bands, in a sentence each."""
        fewest = fewest_of_new(self.probability)
        held = level((self.draws - 1) / (self.draws + 1))
        few = f"{self.draws} draws hold {held} of a posterior between them, not {level(self.probability)}"
        few += f": {fewest:,} are needed (predict.draws)"
        return [few] * (self.draws < fewest) + self.narrow

    @property
    def narrow(self) -> list[str]:
        """A sentence for each band of each site that holds far fewer points than it should."""
        return [
            f"{site}: the {level(self.probability)} band of {BANDS[band]} holds {100 * float(one.all):.0f} % of "
            f"the points: {WHY_NARROW[band]}"
            for site, prediction in self.sites.items()
            for band, one in prediction.coverage.items()
            if one.all is not None and one.all < self.probability - TOO_NARROW
        ]

    def shares(self) -> list[dict[str, Any]]:
        """A row for each site and band that is given: ``share`` of all points, ``by_protocol``, and ``points``."""
        return [
            {
                "site": site,
                "band": band,
                "share": one.all,
                "by_protocol": [one.protocols.get(name) for name in self.protocols],
                "points": one.points,
                "curves": one.curves,
            }
            for site, bands in self.by_site.items()
            for band, one in bands.items()
            if one.all is not None
        ]


RESULT = PredictResult


def bands_group(site: str) -> str:
    """Where the store keeps the bands of a site."""
    return f"predict/{site}"


def of_quantity(dataset: Any, name: str) -> Any:
    """The part of a site's bands that is of a quantity beside the force, with the names of those of the force."""
    dim, prefix = f"{name}_point", f"{name}_"
    part = dataset.drop_dims([each for each in dataset.dims if each != dim])
    return part.rename({each: str(each).removeprefix(prefix) for each in [*part.variables, dim]})
