"""The result of a discovery: what ``discover.json`` and its copy ``verdict.json`` hold."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from sinew.tasks.discover.follow_up import AddedModel, NextExperiment, Outside, Part, Remainder
from sinew.tasks.discover.misfit_map import Cells, NoiseLevel, OtherNoise, check_compared
from sinew.tasks.model.effects import named
from sinew.tasks.study.files import digest, write_json
from sinew.tasks.study.result import OMIT, Count, Number, Result, Share, plain

Word = Literal["NONE", "NAMED", "PARTLY", "AMBIGUOUS", "OUTSIDE"]
NAMES: tuple[Word, ...] = ("NAMED", "PARTLY")  # words of verdicts that name effects
COPY = "verdict.json"
WITH_EFFECTS = Path("discover", "model.yaml")  # in the result folder: the study with the named effects
TEMPLATE = WITH_EFFECTS.with_name("template")  # the folder of its template
WITH_LAWS = Path("discover", "law.yaml")  # that with laws for what they leave, too
ADOPTED = "adopted"  # folder in the result folder: the results of that study


@dataclass(frozen=True)
class Confidence:
    """How often verdicts of the same word were true in ``cases`` with known answers: ``true`` ``of`` so many.

    ``means`` says in words when such a verdict is true; ``interval`` is the 95 % interval of the ``share``.
    """

    means: str
    cases: str
    true: Count
    of: Count
    share: Share
    interval: tuple[Share, Share]

    def __post_init__(self) -> None:
        """Raises :class:`ValueError` for another share than that of its counts, or one outside its interval."""
        low, high = self.interval
        wrong = abs(self.share * self.of - self.true) > 1e-6 * self.of or not low <= self.share <= high
        if self.true > self.of or low > high or (self.of > 0 and wrong):
            raise ValueError(f"confidence: {self.true} of {self.of}, {self.share:g} ({low:g} to {high:g})")


@dataclass(frozen=True)
class BareFit:
    """The fit of the model without effects: its ``loss`` over all specimens, and the loss expected of a true model.

    Losses are whitened sums of squares. ``trusted``: for every specimen, two starts led to the same fit. ``starts``
    holds the loss from each start, the best first, by specimen.
    """

    loss: float
    floor: float
    trusted: bool
    starts: Mapping[str, tuple[Number, ...]]


@dataclass(frozen=True)
class Apart:
    """How far two curves' own best values of a parameter are apart: in ``errors`` (standard), and the ``values``."""

    parameter: str
    errors: Number
    curves: tuple[str, str]
    values: tuple[Number, Number]


@dataclass(frozen=True)
class SpecimenConflict:
    """The ``statistic`` T of a specimen (in squares of the noise), its degrees of ``freedom``, and the ``p`` value.

    ``by_curve``: what each curve loses in the fit to all; they add up to T. ``apart``: each parameter, the one whose
    own best values are farthest apart first.
    """

    statistic: Number
    freedom: Count
    p: Share
    by_curve: tuple[tuple[str, Number], ...]
    apart: tuple[Apart, ...]


@dataclass(frozen=True)
class Conflict:
    """Whether one set of parameters can be right for all protocols: all specimens together, and each of them."""

    statistic: Number
    freedom: Count
    p: Share
    specimens: Mapping[str, SpecimenConflict]

    @property
    def worst(self) -> Apart | None:
        """The parameter on which the curves of the worst specimen disagree most; None with one curve each."""
        worst = max(self.specimens.values(), key=lambda one: one.statistic)
        return worst.apart[0] if worst.apart else None


@dataclass(frozen=True)
class Gain:
    """How much better held-out data are predicted (whitened sum of squares), and the standard ``error`` of that.

    The error is NaN where there are too few points for one.
    """

    gain: Number
    error: Number


@dataclass(frozen=True)
class InPlace:
    """Part of the ``improvement`` that lies in cells which disagree, and part of all ``cells`` that these are."""

    improvement: float
    cells: float


@dataclass(frozen=True)
class Estimate:
    """A parameter's value and its 90 % interval."""

    value: Number
    unit: str
    interval: tuple[Number, Number]


@dataclass(frozen=True)
class SharedEstimate(Estimate):
    """A parameter of the test machine, as one value for all specimens; ``p``: of values so far apart by chance."""

    p: Share


@dataclass(frozen=True)
class CandidateResult:
    """The model with one or two effects, fitted to every specimen.

    ``forms`` are the forms of the effects that fit best. ``free`` counts the effects' parameters over all specimens.
    ``gain`` is the improvement of the criterion over the bare model, in all and by specimen (``gains``); ``explained``
    the part of the misfit beyond noise that the effects take away, None where there is hardly any. ``held_out`` and its
    error: the gain on held-out protocols, or else on later cycles, None where neither was asked. ``splits`` has the
    gain by kind of split; ``beyond_one`` the same for a pair against the better of its effects alone. ``on_bound``
    names parameters that ended on a bound. ``parameters`` are by specimen and name.
    """

    effects: tuple[str, ...]
    forms: tuple[str, ...]
    loss: float
    free: Count
    gain: float
    gains: Mapping[str, Number]
    explained: float | None
    held_out: float | None
    held_out_error: float | None
    splits: Mapping[str, Gain]
    beyond_one: Mapping[str, Gain]
    in_place: InPlace | None
    on_bound: tuple[str, ...]
    parameters: Mapping[str, Mapping[str, Estimate]]
    shared: Mapping[str, SharedEstimate]

    @property
    def name(self) -> str:
        return " + ".join(self.effects)


@dataclass(frozen=True)
class SplitGap:
    """Held-out error in units of noise (root mean square), without and with the effects.

    ``floor`` is what a true model would come to; ``closed`` the part of the gap to it that the effects close, None
    where there is no gap.
    """

    before: Number
    after: Number
    floor: Number
    closed: float | None


@dataclass(frozen=True)
class Gap:
    """The gap on the most telling ``split`` that there is, and on all ``splits``. All None where nothing was held out.

    See :class:`SplitGap`.
    """

    split: str | None = None
    before: float | None = None
    after: float | None = None
    floor: float | None = None
    closed: float | None = None
    splits: Mapping[str, SplitGap] | None = field(default=None, metadata=OMIT)


@dataclass(frozen=True)
class Law:
    """Laws that describe what the effects ``beside`` them leave: no mechanism, but they predict what was not fitted.

    ``names``: in the grammar of :mod:`sinew.tasks.model.law`; ``equations``: in symbols. ``share``: the part of the
    bare model's misfit that they take away, with its 90 % interval. ``parameters``: by specimen. ``gap``: errors on
    held-out data with and without them. ``path``: the study with them, in the result folder, and its ``difference``.
    ``refuted_by``: the test that would tell them from ``other``, the best other laws; None where there are none.
    """

    names: tuple[str, ...]
    equations: tuple[str, ...]
    beside: tuple[str, ...]
    share: Number
    interval: tuple[Number, Number]
    parameters: Mapping[str, Mapping[str, Estimate]]
    gap: Gap
    path: str
    difference: str
    other: tuple[str, ...]
    refuted_by: NextExperiment | None


@dataclass(frozen=True, eq=False)
class DiscoverResult(Result):
    """The verdict on a cohort, and everything that it rests on.

    ``effects`` are those that are named, ``set`` those that cannot be told apart. ``located``: some cell disagrees
    beyond chance; ``surely``: so far beyond that a laboratory can rely on it. ``candidates`` come the best first,
    ``cells`` by specimen for the bare model, and ``after`` with the effects ``shown``, which are those of the candidate
    that the verdict is about. Of the last fields, ``next_experiment`` goes with AMBIGUOUS, ``outside`` with OUTSIDE,
    ``model`` and ``remainder`` with NAMED and PARTLY. ``parts``: the effects that were fitted together where one or
    two do not explain all. ``law``, with PARTLY and OUTSIDE: what describes the rest, where something predicts it.
    ``confidence`` is None for a model of the user's own, of which ``left_out`` are effects that its solver does not
    have as it should, by name, and why. ``compared``: what was compared beside the force, and its noise, by specimen.

    ``VERSION`` covers fits, rules, thresholds and the record of :mod:`sinew.tasks.discover.judge.confidence`, and the
    noise that is taken from the curves.
    """

    TASK = "discover"
    VERSION = 14
    LIBRARIES = ("scikit-learn",)

    verdict: Word
    effects: tuple[str, ...]
    set: tuple[str, ...]
    why: str
    confidence: Confidence | None
    explained: float | None
    null: BareFit
    conflict: Conflict
    located: bool
    surely: bool
    noise: Mapping[str, NoiseLevel]
    candidates: tuple[CandidateResult, ...]
    cells: Cells
    shown: tuple[str, ...]
    gap: Gap
    next_experiment: NextExperiment | None
    outside: Outside | None
    model: AddedModel | None
    inputs: str
    parts: tuple[Part, ...] = ()
    law: Law | None = field(default=None, metadata=OMIT)
    remainder: Remainder | None = field(default=None, metadata=OMIT)
    left_out: Mapping[str, str] | None = field(default=None, metadata=OMIT)
    after: Cells | None = field(default=None, metadata=OMIT)
    compared: Mapping[str, Mapping[str, OtherNoise]] | None = field(default=None, metadata=OMIT)

    def __post_init__(self) -> None:
        """Raises :class:`ValueError` for a verdict that its other fields contradict."""
        if bool(self.effects) != (self.verdict in NAMES) or (self.set and self.verdict != "AMBIGUOUS"):
            raise ValueError(f"a verdict {self.verdict} with effects {self.effects} and set {self.set}")
        known = [set(one.effects) for one in self.candidates]
        for what, effects in (("effects", self.effects), ("shown", self.shown)):
            if effects and known and set(effects) not in known:
                raise ValueError(f"{what}: {' + '.join(effects)}, which is no candidate")
        check_compared(self.compared, self.cells, self.after)
        misfit = self.null.loss - self.null.floor
        if self.explained is not None and not self.explained * misfit <= self.null.loss * (1.0 + 1e-6):
            raise ValueError(f"explained: {self.explained:g} of a misfit of {misfit:g}")

    @property
    def answer(self) -> str:
        """The named effects, or those that cannot be told apart; empty where there are none."""
        return " + ".join(self.effects) or " or ".join(self.set)

    @property
    def headline(self) -> str:
        """The word of the verdict with its effects."""
        return f"{self.verdict} {self.answer}".strip()

    @property
    def shown_name(self) -> str:
        return " + ".join(self.shown)

    @property
    def judged(self) -> CandidateResult | None:
        """The candidate that the verdict is about, None where that is the bare model."""
        return next((one for one in self.candidates if one.effects == self.shown), None)

    @classmethod
    def versions(cls) -> dict[str, Any]:
        """As for every result, and what else a verdict depends on: forces with effects, and the library of effects."""
        from sinew.tasks.simulate.effects import VERSION  # its kernels are slow to import

        return {**super().versions(), "forces": VERSION, "effects": digest(_library())}

    def write(self, folder: Path) -> None:
        """Write ``discover.json`` and its copy, each whole or not at all."""
        super().write(folder)
        write_json(folder / COPY, {**plain(self), "version": self.VERSION})


def _library() -> dict[str, Any]:
    """What a discovery takes from each effect of the library, besides the forces that it computes."""
    return {
        name: [
            effect.equation,
            [[one.name, one.unit, one.minimum, one.maximum, one.reference] for one in effect.parameters],
            dict(effect.null),
            list(effect.shared),
            dict(effect.febio),
        ]
        for name, effect in named().items()
    }


RESULT = DiscoverResult


def named_study(folder: Path) -> Path | None:
    """The study with the effects that a discovery in ``folder`` named; None where it named none."""
    found, path = DiscoverResult.read(folder), folder / WITH_EFFECTS
    return path if found is not None and found.verdict in NAMES and path.is_file() else None
