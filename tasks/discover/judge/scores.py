"""Scores of candidates: what a fit with an effect gains, and how much of the misfit it leaves.

Losses are whitened sums of squares, that is, twice the negative log likelihood up to a constant. The criterion adds a
penalty of ln(points) for each parameter of each specimen (Schwarz 1978). The *floor* is the loss of a true model, the
*misfit* is loss beyond the floor.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from sinew.tasks.discover.result import Gain, InPlace


@dataclass(frozen=True)
class Score:
    """The score of a candidate over all specimens: its effects' slugs (none: the bare model), criterion and loss.

    ``gains``: improvement of the criterion over the bare model by specimen. ``held``: by kind of split, the gain on
    held-out data over the bare model; for two effects, ``beyond`` is the same over the better of them alone. Both are
    empty where nothing was held out. ``on_bound``: parameters of the effects that ended on a bound in any specimen;
    null values and limits of a law do not count. ``in_place``: where the improvement lies; None where no cell
    disagrees, or where nobody looked.
    """

    effects: tuple[str, ...]
    criterion: float
    loss: float
    gains: tuple[float, ...] = ()
    held: Mapping[str, Gain] = field(default_factory=dict)
    beyond: Mapping[str, Gain] = field(default_factory=dict)
    on_bound: tuple[str, ...] = ()
    in_place: InPlace | None = None

    @property
    def name(self) -> str:
        return " + ".join(self.effects)


@dataclass(frozen=True)
class Scores:
    """The scores of the ``bare`` model and of all ``candidates``; ``floor`` is the loss expected of a true model."""

    bare: Score
    candidates: tuple[Score, ...]
    floor: float

    @property
    def noise(self) -> float:
        """The loss that noise leaves of these data: the floor or, where a single effect came below it, the smallest.

        The noise is the same for all candidates. Where it happens to be small, a misfit well beyond it would be lost
        in a floor that is made for average noise.
        """
        return min([self.floor, *(one.loss for one in self.candidates if len(one.effects) == 1)])

    @property
    def best(self) -> Score:
        """The candidate with the smallest criterion; the bare model where there are none."""
        return min(self.candidates, key=lambda one: one.criterion, default=self.bare)

    @property
    def best_single(self) -> Score:
        """The best candidate with one effect; the bare model where there is none."""
        singles = (one for one in self.candidates if len(one.effects) == 1)
        return min(singles, key=lambda one: one.criterion, default=self.bare)

    def gain(self, score: Score) -> float:
        """Improvement of the criterion over the bare model."""
        return self.bare.criterion - score.criterion


def criterion(loss: float, parameters: int, points: Sequence[int]) -> float:
    """Of a candidate with ``parameters`` more than the bare model in each specimen of so many ``points``."""
    return loss + parameters * float(np.sum(np.log(points)))


def misfit_by_chance(noise: float) -> float:
    """Three standard deviations of a true model's loss (chi-square: its variance is twice its mean)."""
    return 3.0 * float(np.sqrt(2.0 * noise))


def misfit_left(score: Score, noise: float) -> float:
    """The misfit of a candidate, and one standard deviation more, which noise may hide."""
    return max(score.loss - noise, 0.0) + misfit_by_chance(noise) / 3.0


def explained(bare: Score, score: Score, noise: float) -> float | None:
    """Part of the bare model's misfit that a candidate takes away; None where there is no misfit beyond chance."""
    misfit = bare.loss - noise
    return (bare.loss - score.loss) / misfit if misfit > misfit_by_chance(noise) else None
