"""Discrepancies of all that is compared: each quantity has its own, and all determine the same parameters."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sinew.tasks.fitting.discrepancy import Discrepancy, determined, discrepancy_of
from sinew.tasks.fitting.measured import Measured
from sinew.tasks.simulate import Array

SWEEPS = 2  # over the quantities: the sizes of one depend on those of the others through the parameters alone


@dataclass(frozen=True, eq=False)
class Discrepancies:
    """The discrepancies of a specimen, ``each`` with its quantity's ``places`` among the residuals."""

    places: tuple[Array, ...]
    each: tuple[Discrepancy, ...]

    @property
    def count(self) -> int:
        """How many sizes they have."""
        return sum(len(one.blocks) for one in self.each)

    def whitening(self, sizes: Array) -> Callable[[Array], Array]:
        """What makes residuals ``[g]``, or slopes ``[g, k]``, of discrepancies of these sizes and noise white."""
        every = [one.whitening(own) for one, own in zip(self.each, self._split(sizes), strict=True)]

        def white(vectors: Array) -> Array:
            if len(every) == 1:
                return every[0](vectors)
            found = np.empty_like(vectors)
            for places, one in zip(self.places, every, strict=True):
                found[places] = one(vectors[places])
            return found

        return white

    def sized(self, error: Array, slopes: Array, begin: Array, iterations: int = 30) -> tuple[Array, float]:
        """The sizes ``[count]`` of the largest evidence, found from ``begin``, and that evidence.

        ``error`` ``[g]`` and ``slopes`` ``[g, k]``: as of :meth:`Discrepancy.evidence`.
        """
        if len(self.each) == 1:
            return self.each[0].sized(error, slopes, begin, iterations)
        sizes = self._split(begin)
        within = [(error[places], slopes[places]) for places in self.places]

        def terms() -> list[tuple[float, Array]]:
            return [one.terms(own, *part) for one, own, part in zip(self.each, sizes, within, strict=True)]

        precisions = [precision for _, precision in terms()]
        for _ in range(SWEEPS):
            for number, one in enumerate(self.each):
                others = np.sum(precisions, axis=0) - precisions[number]
                sizes[number], _ = one.sized(*within[number], sizes[number], iterations, others)
                precisions[number] = one.terms(sizes[number], *within[number])[1]
        alone = sum(each for each, _ in terms())
        return np.concatenate(sizes), alone + determined(np.sum(precisions, axis=0))

    def _split(self, sizes: Array) -> list[Array]:
        """Sizes of each quantity."""
        return np.split(sizes, np.cumsum([len(one.blocks) for one in self.each])[:-1])


def discrepancies_of(measured: Measured) -> Discrepancies:
    """The discrepancies of a specimen."""
    each = tuple(discrepancy_of(measured, quantity=name) for name in measured.quantities)
    return Discrepancies(tuple(measured.places.values()), each)
