"""What changes with what, as some steps have shown: a linear map that is known along these steps only.

See Fang and Saad (2009) Numer Linear Algebra Appl 16:197 on multisecant methods.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from sinew.tasks.simulate import Array

LAST, RANK = 16, 1e-3  # steps that are remembered, and how far from each other they must be


@dataclass(frozen=True, eq=False)
class Secants:
    """The last ``steps`` ``[p, n]``, each of length 1, and the ``changes`` ``[p, ...]`` that each would make."""

    steps: Array
    changes: Array

    @classmethod
    def none(cls, size: int, *shape: int) -> "Secants":
        """Nothing is known of what steps ``[size]`` change in an array of this shape."""
        return cls(np.empty((0, size)), np.empty((0, *shape)))

    def forgotten(self) -> "Secants":
        """Nothing is known any more."""
        return Secants(self.steps[:0], self.changes[:0])

    def after(self, step: Array, change: Array) -> "Secants":
        """The same, and that a ``step`` ``[n]`` made a ``change``."""
        length = float(np.linalg.norm(step))
        if not length > 0.0:
            return self
        steps, changes = ([each, *former][:LAST] for each, former in
                          ((step / length, self.steps), (change / length, self.changes)))  # fmt: skip
        return Secants(np.array(steps), np.array(changes))

    def split(self, steps: Array) -> tuple[Array, Array]:
        """The changes ``[r, ...]`` that ``steps`` ``[r, n]`` make as far as they are known, and the rest of each."""
        weights = steps @ self._inverse.T
        return np.tensordot(weights, self.changes, 1), steps - weights @ self.steps

    @cached_property
    def _inverse(self) -> Array:
        return np.asarray(np.linalg.pinv(self.steps.T, RANK))
