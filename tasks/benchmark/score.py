"""From answers and verdicts to a table: what class a case is of, what a verdict on it is worth, and how often.

Whether a case could have been solved at all is judged from the truth and the losses of all candidates, never from the
verdict. docs/discover_benchmark.md has the same definitions in words.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from sinew.tasks.benchmark.answers import Answer
from sinew.tasks.discover.judge.confidence import MEANING, clopper_pearson
from sinew.tasks.discover.result import NAMES, CandidateResult, DiscoverResult

CLEAR = 30.0  # of a whitened sum of squares, beyond what it is expected to be
DEVIATIONS = 3.0  # standard deviations of that sum, on top
APART = 2.0  # times the misfit beyond noise that the truth leaves: what its best rival must leave
RESAMPLES = 10_000
AT_ONCE = 10**7  # numbers that are drawn
STRONG = 1.5  # strength from which on an effect of a compound case should be named

NULL, DETECTABLE, ALIKE, UNDETECTABLE = "null", "detectable", "indistinguishable", "undetectable"
PAIR, OUTSIDE_CLASS, NOT_ASKED, FAILED = "two effects", "outside", "not a candidate", "failed"
COMPOUND = "compound"
CLASSES = (NULL, DETECTABLE, ALIKE, UNDETECTABLE, PAIR, OUTSIDE_CLASS, NOT_ASKED, COMPOUND, FAILED)

RIGHT, WRONG, INCOMPLETE, OPEN, ASTRAY, ALARM, MISSED = (
    *("right", "wrong name", "one of two", "open", "astray", "false alarm"),
    "missed",
)
SOME = "some of them"


@dataclass(frozen=True)
class Case:
    """A case: what is hidden, the discovery (None when it failed), and how long that took (None: unknown)."""

    answer: Answer
    result: DiscoverResult | None
    seconds: float | None = None
    error: str | None = None


@dataclass(frozen=True)
class Share:
    """``count`` of ``of``; whether that should be high or low."""

    name: str
    count: int
    of: int
    high: bool = True

    @property
    def share(self) -> float | None:
        return self.count / self.of if self.of else None

    @property
    def interval(self) -> tuple[float, float] | None:
        """95 % interval of the share (Clopper and Pearson 1934)."""
        if not self.of:
            return None
        return clopper_pearson(self.count, self.of)


@dataclass(frozen=True)
class Median:
    """The median of some values, its 95 % bootstrap interval, and their range."""

    name: str
    values: tuple[float, ...]
    unit: str = ""

    @property
    def median(self) -> float | None:
        return float(np.median(self.values)) if self.values else None

    @property
    def range(self) -> tuple[float, float] | None:
        return (min(self.values), max(self.values)) if self.values else None

    @property
    def interval(self) -> tuple[float, float] | None:
        if len(self.values) < 2:
            return None
        rng, values = np.random.default_rng(0), np.array(self.values)
        rows = max(1, min(RESAMPLES, AT_ONCE // values.size))
        counts = [min(rows, RESAMPLES - begin) for begin in range(0, RESAMPLES, rows)]
        medians = [np.median(rng.choice(values, (count, values.size)), axis=1) for count in counts]
        low, high = np.quantile(np.concatenate(medians), [0.025, 0.975])
        return float(low), float(high)


def null_rejected(result: DiscoverResult) -> bool:
    """Whether the data clearly speak against the model as it is, whatever it lacks.

    Its loss is far beyond that of a true model (chi-square: the standard deviation is the root of twice the degrees of
    freedom), or some candidate gains far more than its parameters would by chance.
    """
    if result.null.loss - result.null.floor > _clear(max(result.null.floor, 0.0)):
        return True
    return any(result.null.loss - one.loss - one.free > _clear(one.free) for one in result.candidates)


def _clear(freedom: float) -> float:
    return CLEAR + DEVIATIONS * float(np.sqrt(2.0 * freedom))


def told_apart(result: DiscoverResult, slug: str) -> bool:
    """Whether the true effect fits clearly better than each other single effect.

    Both by the likelihood, and by what is left beyond noise: where the truth has another form than the library, it
    leaves something itself, and a small difference then says little.
    """
    truth = next((one for one in result.candidates if one.effects == (slug,)), None)
    if truth is None:
        return False
    floor = result.null.floor
    left = max(truth.loss - floor, 0.0)
    return all(
        truth.gain - other.gain > CLEAR and other.loss - floor > APART * left
        for other in result.candidates
        if len(other.effects) == 1 and other.effects != truth.effects
    )


def second_seen(result: DiscoverResult) -> bool:
    """Whether the data clearly speak against every single effect, as they must where two can be told from one."""
    alone = min((one.loss for one in result.candidates if len(one.effects) == 1), default=result.null.loss)
    return alone - result.null.floor > _clear(max(result.null.floor, 0.0))


def class_of(case: Case) -> str:
    """One of :data:`CLASSES`."""
    result, answer = case.result, case.answer
    if result is None:
        return FAILED
    if answer.compound:
        return COMPOUND
    if not answer.truth:
        return NULL
    if not null_rejected(result):
        return UNDETECTABLE
    if answer.outside:
        return OUTSIDE_CLASS
    if len(answer.truth) > 1:
        return PAIR
    if not any(one.effects == answer.truth for one in result.candidates):
        return NOT_ASKED
    return DETECTABLE if told_apart(result, answer.truth[0]) else ALIKE


def outcome_of(case: Case) -> str:
    """What a verdict is worth: right, wrong name, one or some of several, open, astray, false alarm, missed, failed."""
    result, answer = case.result, case.answer
    if result is None:
        return FAILED
    kind, truth = class_of(case), set(answer.truth)
    if kind == COMPOUND and set(result.effects) <= truth:
        strong = set(strong_effects(case))
        return RIGHT if strong <= set(result.effects) else SOME if strong & set(result.effects) else MISSED
    if result.verdict in NAMES:
        if not set(result.effects) <= truth:
            return WRONG
        return RIGHT if set(result.effects) == truth else INCOMPLETE
    if kind == NULL:
        return ALARM if _alarms(result) else RIGHT
    if kind == UNDETECTABLE:
        return ASTRAY if result.verdict == "OUTSIDE" and not answer.outside else RIGHT
    if answer.outside:
        return RIGHT if result.verdict == "OUTSIDE" else MISSED
    if result.verdict == "NONE":
        return MISSED
    if result.verdict == "OUTSIDE" or not truth <= set(result.set):
        return RIGHT if kind == NOT_ASKED and result.verdict == "OUTSIDE" else ASTRAY
    return RIGHT if kind == ALIKE else OPEN


def strong_effects(case: Case) -> list[str]:
    """The effects of a compound case that can clearly be seen."""
    return [slug for slug in case.answer.truth if case.answer.strength.get(slug, 0.0) >= STRONG]


def says_something_is_left(result: DiscoverResult) -> bool:
    """Whether a verdict says that something is left that it does not name."""
    return result.verdict in ("PARTLY", "OUTSIDE") or (result.remainder is not None and result.remainder.beyond_noise)


def _alarms(result: DiscoverResult) -> bool:
    """Whether a verdict says that something is missing; AMBIGUOUS without effects says only that a fit is not safe."""
    return result.verdict in (*NAMES, "OUTSIDE") or (result.verdict == "AMBIGUOUS" and bool(result.set))


def shares(cases: Sequence[Case]) -> list[Share]:
    """The rows of the table that count. A case that failed counts against what needs a verdict."""
    together = [case for case in cases if case.answer.compound]
    cases = [case for case in cases if not case.answer.compound]
    by_class = {name: [case for case in cases if class_of(case) == name] for name in CLASSES}
    failed = by_class[FAILED]
    singles = [case for case in cases if len(case.answer.truth) == 1 and not case.answer.outside]
    pairs = [case for case in cases if len(case.answer.truth) > 1]
    outside = [case for case in cases if case.answer.outside]
    nulls = [case for case in by_class[NULL] if case.result]
    ambiguous = [case for case in [*singles, *pairs] if case.result and case.result.verdict == "AMBIGUOUS"]
    detectable = [*by_class[DETECTABLE], *(case for case in singles if case in failed)]
    found_outside = [*by_class[OUTSIDE_CLASS], *(case for case in outside if case in failed)]
    done = [case for case in cases if case.result]
    return [
        _share("named correctly, clearly detectable single effects", detectable, named_right),
        _share("wrong confident name, all but two effects", [c for c in done if c not in pairs], named_wrong, False),
        _share("false alarm on nulls", nulls, lambda case: outcome_of(case) in (ALARM, WRONG), False),
        _share("truth inside the set when AMBIGUOUS", ambiguous, lambda case: inside(case)),
        _share("outside the library, called OUTSIDE", found_outside, lambda case: _word(case) == "OUTSIDE"),
        _share("both of two effects named", pairs, named_right),
        _share("both of two effects named, where one alone is rejected",
               [case for case in by_class[PAIR] if case.result and second_seen(case.result)], named_right),
        _share("wrong confident name, two effects", [c for c in done if c in pairs], named_wrong, False),
        _share("named correctly, all single effects", singles, named_right),
        _share("NONE or AMBIGUOUS where nothing can be seen", by_class[UNDETECTABLE], lambda case: _word(case)
               in ("NONE", "AMBIGUOUS")),
        coverage(cases),
        *_of_compounds(together),
        *by_word([*cases, *together]).values(),
    ]  # fmt: skip


def _of_compounds(cases: Sequence[Case]) -> list[Share]:
    """The rows of compound cases, which count effects and names; none where there are no such cases."""
    if not cases:
        return []
    strong = [slug in _names(case) for case in cases for slug in strong_effects(case)]
    wrong = [slug not in case.answer.truth for case in cases for slug in _names(case)]
    left = [
        case
        for case in cases
        if case.result and any(case.answer.strength[kind] >= STRONG for kind in case.answer.beside)
    ]
    return [
        Share(f"compound: effects of strength {STRONG:g} or more that are named", sum(strong), len(strong)),
        Share("compound: names of effects that are not there", sum(wrong), len(wrong), high=False),
        _share(f"compound: something else of strength {STRONG:g} or more is said to be left", left,
               lambda case: case.result is not None and says_something_is_left(case.result)),
    ]  # fmt: skip


def _names(case: Case) -> tuple[str, ...]:
    """The effects that a verdict names."""
    return case.result.effects if case.result else ()


def by_word(cases: Sequence[Case]) -> dict[str, Share]:
    """How often verdicts of each word were true, as recorded in :mod:`sinew.tasks.discover.judge.confidence`."""
    said = {word: [case for case in cases if _word(case) == word] for word in MEANING}
    true: dict[str, Callable[[Case], bool]] = {
        "NAMED": lambda case: not named_wrong(case),
        "PARTLY": lambda case: not named_wrong(case),
        "AMBIGUOUS": lambda case: bool(case.answer.truth) and inside(case),
        "OUTSIDE": lambda case: case.answer.outside or class_of(case) == NOT_ASKED,
        "NONE": lambda case: outcome_of(case) == RIGHT,
    }
    return {word: _share(f"{word}: {MEANING[word]}", said[word], true[word]) for word in MEANING}


def medians(cases: Sequence[Case]) -> list[Median]:
    """The rows of the table that are medians."""
    closed = [case.result.gap.closed for case in cases if case.result and case.result.verdict in NAMES]
    return [
        Median("gap closed on held-out data when named", tuple(one for one in closed if one is not None)),
        Median("time of a case", tuple(case.seconds for case in cases if case.seconds is not None), "s"),
    ]


def _share(name: str, cases: Sequence[Case], yes: Callable[[Case], bool], high: bool = True) -> Share:
    return Share(name, sum(yes(case) for case in cases), len(cases), high)


def _word(case: Case) -> str:
    return case.result.verdict if case.result else ""


def named_right(case: Case) -> bool:
    """All of the truth is named and nothing else, with or without a remainder."""
    return _word(case) in NAMES and outcome_of(case) == RIGHT


def named_wrong(case: Case) -> bool:
    """Some effect is named that is not in the truth."""
    return outcome_of(case) == WRONG


def inside(case: Case) -> bool:
    """Whether all of the truth is in the set of an AMBIGUOUS verdict."""
    return case.result is not None and set(case.answer.truth) <= set(case.result.set)


def coverage(cases: Sequence[Case]) -> Share:
    """How many 90 % intervals of correctly named effects hold the true value: each parameter of each specimen."""
    held: list[bool] = []
    for case in cases:
        if case.result and named_right(case):
            named = _candidate(case.result.candidates, case.result.effects)
            for values in named.parameters.values() if named else ():
                known = [(values[name], true) for name, true in case.answer.same_form.items() if name in values]
                held += [one.interval[0] <= true <= one.interval[1] for one, true in known]
    return Share("90 % interval holds the effect's parameter (same form)", sum(held), len(held))


def _candidate(candidates: Sequence[CandidateResult], effects: tuple[str, ...]) -> CandidateResult | None:
    return next((one for one in candidates if set(one.effects) == set(effects)), None)
