"""What a sensitivity study varies: parameters, or groups of them, how each is distributed, and which go together."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.special import ndtr, ndtri

from sinew.tasks.model import Parameter
from sinew.tasks.simulate import Array


@dataclass(frozen=True)
class Normal:
    """A normal distribution, cut off at the ends of the parameter's range."""

    mean: float
    sd: float


@dataclass(frozen=True)
class Inputs:
    """``groups``: names of parameters by the name of the group, which moves as one; all others move alone.

    ``distributions``: by the name of a parameter; all others are uniform. ``correlations``: rank correlations
    (Spearman's) by the names of two parameters; all others are independent.
    """

    groups: Mapping[str, Sequence[str]] = field(default_factory=dict)
    distributions: Mapping[str, Normal] = field(default_factory=dict)
    correlations: Mapping[str, Mapping[str, float]] = field(default_factory=dict)

    def factors(self, names: Sequence[str]) -> dict[str, tuple[int, ...]]:
        """What moves as one, by its name: the places in ``names``, in the order in which they begin there."""
        group = {name: title for title, members in self.groups.items() for name in members}
        found: dict[str, tuple[int, ...]] = {}
        for at, name in enumerate(names):
            title = group.get(name, name)
            found[title] = (*found.get(title, ()), at)
        return found

    def of_scores(self, names: Sequence[str]) -> Array:
        """The correlations ``[d, d]`` of normal scores that give these rank correlations (Pearson 1907)."""
        found = np.eye(len(names))
        for one, others in self.correlations.items():
            for other, rank in others.items():
                i, j = names.index(one), names.index(other)
                found[i, j] = found[j, i] = 2.0 * np.sin(np.pi / 6.0 * rank)
        return found

    def values(self, parameters: Sequence[Parameter], share: Array) -> Array:
        """Values ``[..., d]`` of parameters below which ``share`` ``[..., d]`` of their distributions lies."""
        columns = []
        for j, one in enumerate(parameters):
            normal = self.distributions.get(one.name)
            if normal is None:
                columns.append(one.minimum + (one.maximum - one.minimum) * share[..., j])
                continue
            low, high = (ndtr((end - normal.mean) / normal.sd) for end in (one.minimum, one.maximum))
            values = normal.mean + normal.sd * ndtri(low + share[..., j] * (high - low))
            columns.append(np.clip(values, one.minimum, one.maximum))
        return np.stack(columns, axis=-1)


PLAIN = Inputs()
