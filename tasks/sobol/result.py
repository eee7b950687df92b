"""The result of a Sobol study: what ``sobol.json`` holds."""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from sinew.tasks.simulate.studied_quantity import panels
from sinew.tasks.sobol.settings import MOST_BASE_SAMPLES, MOST_RUNS, MOST_SCRAMBLES
from sinew.tasks.study.result import OMIT, Count, NotNegatives, Number, Numbers, Result, Share, check_lengths

Array = np.ndarray[Any, Any]
KEYS = ("S1", "S1_conf", "ST", "ST_conf")
SHAPLEY = ("Sh", "Sh_conf")  # where parameters depend on each other
WORDS = {"S1": "first order index", "ST": "total order index", "Sh": "Shapley effect"}
SHORT = {"S1": "first order indices", "ST": "total indices", "Sh": "Shapley effects"}


@dataclass(frozen=True, eq=False)
class Indices:
    """First and total order indices ``[d]`` with the half-widths of their intervals; NaN where nothing varies.

    Shapley effects ``Sh`` where parameters depend on each other.
    """

    S1: Numbers
    S1_conf: NotNegatives
    ST: NotNegatives
    ST_conf: NotNegatives
    Sh: Numbers | None = dataclasses.field(default=None, kw_only=True, metadata=OMIT)
    Sh_conf: NotNegatives | None = dataclasses.field(default=None, kw_only=True, metadata=OMIT)


@dataclass(frozen=True, eq=False)
class Analysis(Indices):
    """SALib's analysis of one output; second order indices ``[d, d]`` if they were asked for."""

    S2: Numbers | None = dataclasses.field(default=None, metadata=OMIT)
    S2_conf: NotNegatives | None = dataclasses.field(default=None, metadata=OMIT)


@dataclass(frozen=True, eq=False)
class OfProtocol(Analysis):
    """The indices of one protocol's objective, and the size of the design."""

    rows: Count = 0
    failed: Count = 0
    base_samples: Count = 0


@dataclass(frozen=True, eq=False)
class OfSpecimen(Indices):
    """The indices of one specimen's objective, in all and by protocol; ``failed`` counts its rows by status."""

    failed: Mapping[str, int]
    protocols: Mapping[str, Indices]


@dataclass(frozen=True, eq=False)
class OfOutput:
    """The indices of one of a template's outputs, made one number by ``summary``; ``is_force``: it is the force."""

    summary: str
    unit: str
    is_force: bool
    S1: Numbers
    S1_conf: NotNegatives
    ST: NotNegatives
    ST_conf: NotNegatives
    protocols: Mapping[str, Indices]
    Sh: Numbers | None = dataclasses.field(default=None, metadata=OMIT)
    Sh_conf: NotNegatives | None = dataclasses.field(default=None, metadata=OMIT)


@dataclass(frozen=True, eq=False)
class Failures:
    """Rows that failed, and the indices if all of them had the smallest, the mean or the largest outcome."""

    rule: str
    rows: Count
    base_samples_left_out: Count
    by_status: Mapping[str, Mapping[str, int]]
    S1_if_smallest: Numbers | None = dataclasses.field(default=None, metadata=OMIT)
    ST_if_smallest: Numbers | None = dataclasses.field(default=None, metadata=OMIT)
    S1_if_mean: Numbers | None = dataclasses.field(default=None, metadata=OMIT)
    ST_if_mean: Numbers | None = dataclasses.field(default=None, metadata=OMIT)
    S1_if_largest: Numbers | None = dataclasses.field(default=None, metadata=OMIT)
    ST_if_largest: Numbers | None = dataclasses.field(default=None, metadata=OMIT)

    def outcomes(self, key: str) -> list[Array]:
        """The indices ``key`` (``S1`` or ``ST``) under each assumption; empty where nothing failed."""
        found = (getattr(self, f"{key}_if_{outcome}") for outcome in ("smallest", "mean", "largest"))
        return [values for values in found if values is not None]


@dataclass(frozen=True, eq=False)
class OfVersion:
    """Runs of a cheaper version of the model, and how many of them failed; of all specimens."""

    runs: Count
    failed: Count


@dataclass(frozen=True, eq=False)
class Surrogate:
    """Polynomials that stand for the model: the largest half-width of intervals that was asked for as ``error``.

    ``reached``: whether all are smaller. ``unexplained``: part of the variance of each outcome that the polynomials do
    not explain, by leave-one-out or by cross-validation, whichever is larger. ``alone``: the same without
    the cheaper ``versions`` of the model.
    """

    error: Number
    reached: bool
    unexplained: Mapping[str, Number]
    alone: Mapping[str, Number] | None = dataclasses.field(default=None, metadata=OMIT)
    versions: Mapping[str, OfVersion] | None = dataclasses.field(default=None, metadata=OMIT)


@dataclass(frozen=True, eq=False)
class Convergence:
    """Indices ``[sizes, d]`` of the total objective from the first ``base_samples`` ``[sizes]`` of the design."""

    base_samples: list[int]
    S1: Numbers
    S1_conf: NotNegatives
    ST: Numbers
    ST_conf: NotNegatives


@dataclass(frozen=True, eq=False)
class SobolResult(Result):
    """Sobol indices of the total objective, and of each protocol, specimen and output.

    ``names`` are of the ``d`` free parameters or ``groups`` of them, ``bounds`` of the free parameters, which are
    uniform unless they have ``distributions``, and independent but for rank ``correlations``. Base samples come from
    ``scrambles`` independent sequences; with a
    ``surrogate``, each is one row. ``field`` is what the store calls the quantity under study and ``objective`` says it
    in words. ``tables`` names each specimen's evaluations in the store; ``fields``: the protocols along which there
    are indices of its fields.
    """

    TASK = "sobol"
    VERSION = 3  # 2: several scrambles; 3: what has no interval where rows failed
    LIBRARIES = ("SALib",)

    names: list[str]
    bounds: list[list[int | float]]
    seed: int
    S1: Numbers
    S1_conf: NotNegatives
    ST: NotNegatives
    ST_conf: NotNegatives
    Sh: Numbers | None = dataclasses.field(default=None, kw_only=True, metadata=OMIT)
    Sh_conf: NotNegatives | None = dataclasses.field(default=None, kw_only=True, metadata=OMIT)
    S2: Numbers | None = dataclasses.field(default=None, kw_only=True, metadata=OMIT)
    S2_conf: NotNegatives | None = dataclasses.field(default=None, kw_only=True, metadata=OMIT)
    rows: Count
    failed: Count
    base_samples: Count
    scrambles: Count
    base_samples_used: Count
    points_asked: int | None
    confidence: Share
    objective: str
    field: str
    evaluations: Count
    protocols: Mapping[str, OfProtocol]
    specimens: Mapping[str, OfSpecimen]
    outputs: Mapping[str, OfOutput] | None = dataclasses.field(default=None, kw_only=True, metadata=OMIT)
    groups: Mapping[str, list[str]] | None = dataclasses.field(default=None, kw_only=True, metadata=OMIT)
    distributions: Mapping[str, Mapping[str, Number]] | None = dataclasses.field(
        default=None, kw_only=True, metadata=OMIT
    )
    correlations: Mapping[str, Mapping[str, Number]] | None = dataclasses.field(
        default=None, kw_only=True, metadata=OMIT
    )
    surrogate: Surrogate | None = dataclasses.field(default=None, kw_only=True, metadata=OMIT)
    fields: Mapping[str, list[str]] | None = dataclasses.field(default=None, kw_only=True, metadata=OMIT)
    failures: Failures
    convergence: Convergence
    tables: Mapping[str, str]
    inputs: str

    def __post_init__(self) -> None:
        """Raises :class:`ValueError` for counts that contradict each other, and indices of others than ``names``."""
        if self.base_samples_used > self.base_samples:
            raise ValueError(f"base_samples_used: {self.base_samples_used} of {self.base_samples}")
        if self.failed > self.rows:
            raise ValueError(f"failed: {self.failed} of {self.rows} rows")
        if any(len(one) != 2 or one[0] > one[1] for one in self.bounds):
            raise ValueError("bounds: not two numbers in order")
        if self.groups is None and len(self.bounds) != len(self.names):
            raise ValueError(f"{len(self.names)} names, {len(self.bounds)} ranges")
        wholes: list[SobolResult | OfOutput | OfSpecimen] = [self, *self.specimens.values()]
        wholes += (self.outputs or {}).values()
        for one in (*wholes, *(part for whole in wholes for part in whole.protocols.values())):
            if any((getattr(one, key) is None) != (self.correlations is None) for key in SHAPLEY):
                raise ValueError("Sh: Shapley effects go with correlations, and only with them")
            check_lengths(self.names, one, self.keys)
        sizes = len(self.convergence.base_samples), len(self.names)
        every = [getattr(self.convergence, key) for key in KEYS]
        if any(array.shape != sizes and (array.size or sizes[0]) for array in every):  # without sizes, [] in the file
            raise ValueError("convergence: not one number for each size and name")
        if any(one.shape != sizes[1:] for key in ("S1", "ST") for one in self.failures.outcomes(key)):
            raise ValueError(f"failures: not {len(self.names)} numbers")

    @property
    def sample(self) -> str:
        """What the design has many of."""
        return "runs" if self.surrogate else "base samples"

    @property
    def refuses(self) -> bool:
        """Whether total indices were refused, as too many rows failed."""
        return bool(self.failed and np.isnan(self.ST).all() and np.isfinite(self.S1).any())

    @property
    def has_design(self) -> bool:
        """Whether it tells a design that this program draws: of another, there are no rows, or too many to draw."""
        base, scrambles = self.base_samples, self.scrambles
        most = MOST_RUNS if self.surrogate else MOST_BASE_SAMPLES
        return 0 < base <= most and 0 < scrambles <= MOST_SCRAMBLES and base % scrambles == 0

    @property
    def keys(self) -> tuple[str, ...]:
        """The names of indices, with those of the half-widths of their intervals."""
        return KEYS if self.correlations is None else (*KEYS, *SHAPLEY)

    @property
    def leading(self) -> str:
        """The index by which parameters are ranked: ST, or Sh where there is one, or S1 where these were refused."""
        if self.refuses:
            return "S1"
        return "ST" if self.correlations is None else "Sh"

    def largest(self, most: int = 3) -> list[int]:
        """The numbers of the parameters with the largest indices, largest first; without those that are NaN."""
        values = getattr(self, self.leading)
        order = np.argsort(-np.nan_to_num(values, nan=-np.inf), kind="stable")[:most]
        return [int(j) for j in order if np.isfinite(values[j])]

    @property
    def total(self) -> str:
        """What the indices of all protocols together are called."""
        return next(iter(self.panels()))

    def by_output(self) -> dict[str, Any]:
        """Indices by name: all together (``total``), each protocol, each of a template's outputs."""
        return {"total": self, **self.protocols, **(self.outputs or {})}

    def panels(self) -> dict[str, Any]:
        """Indices by the title under which a person sees them; what would be shown twice is left out."""
        return panels(self, self.protocols, self.outputs or {}, self.field, self.objective)

    def field_courses(self) -> dict[str, tuple[str, str]]:
        """What has indices of fields, by a name for a person: the table of a specimen, and a protocol."""
        found = {}
        for specimen, protocols in (self.fields or {}).items():
            for protocol in protocols if specimen in self.tables else ():
                both = f"{specimen}: {protocol}" if len(self.tables) > 1 else protocol
                found[both] = (self.tables[specimen], protocol)
        return found

    def courses(self) -> dict[str, tuple[str, str | None]]:
        """What has indices along time, by a name for a person: a specimen, and an output (None: the force)."""
        outputs = {None if one.is_force else name: name for name, one in (self.outputs or {}).items()} or {None: ""}
        found = {}
        for specimen in self.tables:
            for output, name in outputs.items():
                both = f"{specimen}: {name}" if len(self.tables) > 1 else name
                found[both if name else specimen] = (specimen, output)
        return found


RESULT = SobolResult
