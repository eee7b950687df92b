"""What a verdict comes with: the next experiment, a description of the misfit, or the model with the effects."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from sinew.tasks.study.result import OMIT, Number


@dataclass(frozen=True)
class RivalPair:
    """Effects that are taken for the ``truth``, and those of the ``other`` model that is fitted instead."""

    truth: tuple[str, ...]
    other: tuple[str, ...]


@dataclass(frozen=True)
class PairSeparation(RivalPair):
    """How well a test separates a pair: expected gain in twice the log likelihood, largest difference of forces (N)."""

    expected_2_log_likelihood: Number
    newtons: Number


@dataclass(frozen=True)
class MenuEntry:
    """A test that could be done, and how well it separates each pair of rivals, the hardest pair first."""

    name: str
    words: str
    pairs: tuple[PairSeparation, ...]


@dataclass(frozen=True)
class NextExperiment:
    """The test to do next: what it shows of its hardest ``pair`` of rivals, and the ``menu`` that it is chosen from.

    The model that is wrong is off by ``newtons`` (N), ``at_s`` (s) into the test of ``specimen``.
    """

    name: str
    words: str
    expected_2_log_likelihood: Number
    newtons: Number
    at_s: Number
    specimen: str
    pair: RivalPair
    menu: tuple[MenuEntry, ...]


@dataclass(frozen=True)
class Similarity:
    """How much a misfit looks like an effect: ``cosine`` of measured minus simulated and of the effect's trace.

    Both are in units of the noise, without what the bare model can take up; negative where the misfit is the opposite
    of the effect. Noise in the misfit keeps it below one. ``own``: part of the trace that the bare model cannot take
    up; where it is next to nothing, the cosine is 0.
    """

    effect: str
    parameter: str
    cosine: Number
    own: Number


@dataclass(frozen=True)
class Row:
    """Measured minus simulated force (N) in phases of a ``kind``, in the first and in the last that came to ``x``.

    ``x`` is the strain reached in a loading or unloading, and the time (s) since the beginning of a hold. ``first`` and
    ``last`` are the numbers of the phases; ``error_N`` is the larger standard error of the two.
    """

    kind: str
    x: Number
    first: int
    first_N: Number
    last: int
    last_N: Number
    error_N: Number


@dataclass(frozen=True)
class Correction:
    """A smooth correction of one specimen's simulated forces: its ``table``, and what it explains.

    ``beyond``: the misfit beyond noise (whitened sum of squares); ``explained``: the part of it that the correction
    takes away in phases that it has not seen, 0 where there is no misfit beyond noise. ``freedom``: of the fit.
    """

    specimen: str
    freedom: int
    beyond: Number
    explained: Number
    table: tuple[Row, ...]
    sentence: str


@dataclass(frozen=True)
class Outside:
    """A description of a misfit that no effect explains: the most similar effects first, a correction by specimen.

    ``largest_cosine`` is that of an effect whose trace is all of the misfit beyond noise.
    """

    what: str
    largest_cosine: Number
    similar: tuple[Similarity, ...]
    corrections: tuple[Correction, ...]


@dataclass(frozen=True)
class Part:
    """One of several effects that were fitted together, beside what none of them explains.

    ``share``: the part of the misfit beyond noise that would be left in addition without it, and its 90 % interval.
    ``evidence``: twice the log evidence that is lost without it; ``ratio``: the misfit that is left without it, in
    times of that with it. ``rival``: the effect that leaves least misfit in its place, the evidence that this regains,
    and the misfit that is left with it, in times of that with the one; None where the effect is uncertain for another
    reason. ``doubt``: why the effect is not certain; None where it is. ``mends``: the effect whose form this one may
    only mend, if there is one.
    """

    effect: str
    form: str
    share: Number
    interval: tuple[Number, Number]
    evidence: Number
    ratio: Number
    rival: str | None
    rival_evidence: Number | None
    rival_ratio: Number | None
    doubt: str | None
    mends: str | None = field(default=None, metadata=OMIT)


@dataclass(frozen=True)
class Remainder:
    """What the model with the named effects leaves: the ``share`` of the misfit, with its 90 % interval.

    ``newtons``: root mean square over all points, less that of the noise (N). ``beyond_noise``: it is more than chance
    leaves of a true model. ``cells``: names of those where it is largest, of all specimens. ``like``: what it looks
    like in the specimen in which most is left.
    """

    share: Number
    interval: tuple[Number, Number]
    newtons: Number
    beyond_noise: bool
    cells: tuple[str, ...]
    like: str


@dataclass(frozen=True)
class Checks:
    """What added effects change, as the largest difference of forces over all curves (N).

    ``at_null_N``: at their null values, where it must be nothing; ``at_fit_N``: at the fitted values; ``noise_N``: the
    noise there. ``not_inert``: the effects change more than noise.
    """

    at_null_N: Number
    at_fit_N: Number
    noise_N: Number
    not_inert: bool


@dataclass(frozen=True)
class SolverRun:
    """A curve in the real solver, in parts of the peak force: deviation from the embedded simulator, change by effects.

    ``failed`` holds the solver's message instead where there is no force.
    """

    deviation: float | None = field(default=None, metadata=OMIT)
    change: float | None = field(default=None, metadata=OMIT)
    failed: str | None = field(default=None, metadata=OMIT)


@dataclass(frozen=True)
class SolverCheck:
    """Input of the real solver with the effects (paths in the result folder), and its runs by curve, if it ``ran``.

    ``why`` says why it did not.
    """

    inputs: tuple[str, ...]
    ran: bool
    why: str | None = field(default=None, metadata=OMIT)
    version: str | None = field(default=None, metadata=OMIT)
    runs: Mapping[str, SolverRun] | None = field(default=None, metadata=OMIT)


@dataclass(frozen=True)
class AddedModel:
    """The study with the named effects: its ``path`` in the result folder, what changed in it, and checks of it."""

    path: str
    difference: str
    checks: Checks
    febio: SolverCheck
