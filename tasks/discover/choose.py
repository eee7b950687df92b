"""Which effect is missing, if any: from fits with and without, to a verdict.

Each candidate is nested on the null model, and judged by twice its log likelihood (whitened, so correlated noise does
not count twice) less a penalty of ln(points) for each parameter of each specimen (Schwarz 1978).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

CLEARLY = 20.0  # of the criterion: 10 of twice the log likelihood are called very strong (Kass and Raftery 1995)
EXPLAINED = 0.8  # part of the misfit beyond noise that an effect must take away to be a name
HELD_OUT_ERRORS = 2.0  # standard errors by which the prediction of what a fit has not seen must improve


@dataclass(frozen=True)
class Scored:
    """A candidate: its effects' slugs, criterion, loss (whitened sum of squares) and gain on held-out curves.

    ``held_out`` and its standard error are None where nothing was held out. ``on_bound``: names of parameters of the
    effects that ended on a bound in any specimen, null values left out.
    """

    effects: tuple[str, ...]
    criterion: float
    loss: float
    held_out: float | None = None
    held_out_error: float | None = None
    on_bound: tuple[str, ...] = ()


@dataclass(frozen=True)
class Verdict:
    """``word`` is NONE, NAMED, AMBIGUOUS or OUTSIDE; ``effects`` when named, ``alike`` when ambiguous; and why."""

    word: str
    effects: tuple[str, ...]
    alike: tuple[str, ...]
    explained: float | None
    why: str


def criterion(loss: float, parameters: int, points: Sequence[int]) -> float:
    """Of a candidate with ``parameters`` more than the null model in each specimen of so many ``points``."""
    return loss + parameters * float(np.sum(np.log(points)))


def verdict(null: Scored, candidates: Sequence[Scored], floor: float, located: bool, trusted: bool = True) -> Verdict:
    """``floor``: the loss that a true model would have; ``located``: some cell of the null fit is beyond chance.

    ``trusted``: the null fit was found from more than one start. Otherwise what it leaves may be for want of a better
    fit, and says nothing.
    """
    ordered = sorted(candidates, key=lambda one: one.criterion)
    close = [one for one in ordered if one.criterion - ordered[0].criterion < CLEARLY]
    best = min(close, key=lambda one: (len(one.effects), one.criterion), default=null)
    gain = null.criterion - best.criterion
    if not located and gain < CLEARLY:
        return Verdict("NONE", (), (), None, "no cell disagrees beyond chance, and no effect improves the fit clearly")
    if not trusted and gain < CLEARLY:
        return Verdict("AMBIGUOUS", (), (), None, "no two fits of the model as it is agree: more starts are needed")
    explained = (null.loss - best.loss) / max(null.loss - floor, 1e-9)
    if gain < CLEARLY:
        return Verdict("OUTSIDE", (), (), explained, "model and data disagree, and no effect of the library helps")
    if explained < EXPLAINED:
        what = f"the best of the library ({' + '.join(best.effects)}) takes away {100 * explained:.0f} % of the misfit"
        return Verdict("OUTSIDE", (), (), explained, what)
    alike = [
        one for one in ordered if one.criterion - best.criterion < CLEARLY and len(one.effects) == len(best.effects)
    ]
    if len(alike) > 1:
        slugs = tuple(dict.fromkeys(slug for one in alike for slug in one.effects))
        return Verdict("AMBIGUOUS", (), slugs, explained, f"{len(alike)} candidates fit as well as each other")
    if best.held_out is not None and best.held_out < HELD_OUT_ERRORS * (best.held_out_error or 0.0):
        why = f"{' + '.join(best.effects)} fits best, but does not predict what it has not seen"
        return Verdict("AMBIGUOUS", (), best.effects, explained, why)
    if best.on_bound:
        why = f"{', '.join(best.on_bound)} ended on a bound: the effect is not what the library has"
        return Verdict("AMBIGUOUS", (), best.effects, explained, why)
    return Verdict("NAMED", best.effects, (), explained, f"it takes away {100 * explained:.0f} % of the misfit")


def held_out_gain(losses: Mapping[str, tuple[np.ndarray, np.ndarray]], block: int) -> tuple[float, float]:
    """How much better held-out curves are predicted with an effect than without, and its standard error.

    ``losses``: by curve, whitened squared errors ``[t]`` without and with. Errors that follow each other depend on
    each other, so the standard error is that of sums over blocks of ``block`` points.
    """
    gains = [without - having for without, having in losses.values()]
    total = float(sum(gain.sum() for gain in gains))
    sums = np.concatenate([np.add.reduceat(gain, np.arange(0, gain.size, block)) for gain in gains])
    return total, float(np.sqrt(sums.size) * sums.std(ddof=1))
