"""Which estimator answers for the rows of a design, of which some may have failed; and how indices converge.

=============================  ========================================================================================
nothing failed                 Saltelli's, by SALib
rows failed                    S1 from the rows that ran (:mod:`sinew.tasks.sobol.given_data`); ST and Shapley effects
                               from base samples without a failed row
more than ``LIMIT`` of them    the same S1; the others are refused: what is left of the ranges is no box, and their
                               indices may be off by twice the share that failed
=============================  ========================================================================================
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from sinew.tasks.simulate.saltelli import FEWEST, Design
from sinew.tasks.sobol.given_data import Independent, first_order, independent
from sinew.tasks.sobol.method import Intervals, analyse, indices_if_failed_had, of_design
from sinew.tasks.sobol.result import KEYS, SHAPLEY, Analysis, Convergence

Array = np.ndarray[Any, Any]
LIMIT = 0.005  # of all rows
FIRST_SIZE = 5  # the convergence begins with 2**5 base samples
RULE = "S1 is that of the rows that ran, ST that of base samples without a failed row"
REFUSED = f"S1 is that of the rows that ran; ST is refused, as more than {100 * LIMIT:g} % of the rows failed"
OF_GROUPS = "; S1 of groups of several parameters is unknown"
FEWEST_SCRAMBLES = 3  # of which one can be left out, and there are still pairs
WITHOUT_INTERVAL = f"; S1 has no interval, which needs {FEWEST_SCRAMBLES} scrambles"


@dataclass(frozen=True, eq=False)
class Estimator:
    """Indices of any outputs of a design; ``ok`` ``[n]``: its rows that ran, ``ran``: those that are independent."""

    design: Design
    ok: Array
    ran: Independent
    intervals: Intervals

    @property
    def whole(self) -> Array:
        """Base samples ``[base samples]`` without a failed row."""
        return np.asarray(self.ok.reshape(self.design.base_samples, self.design.block).all(axis=1))

    @property
    def refuses(self) -> bool:
        """Whether too many rows failed for total indices."""
        return bool((~self.ok).mean() > LIMIT)

    @property
    def rule(self) -> str:
        """What is done about failed rows, in words."""
        several = any(len(at) > 1 for at in self.design.members)
        few = np.unique(self.ran.scramble).size < FEWEST_SCRAMBLES
        return (REFUSED if self.refuses else RULE) + (OF_GROUPS if several else "") + (WITHOUT_INTERVAL if few else "")

    def of(self, outcomes: Array) -> dict[str, Array]:
        """S1, S1_conf, ST, ST_conf ``[d, m]`` of outcomes ``[n, m]``, NaN where one is refused or nothing varies."""
        if self.ok.all():
            return of_design(self.design, outcomes, self.whole, self.intervals)
        found = first_order(self.ran, outcomes[self.ran.at], self.intervals)
        if self.design.orders is not None:
            found |= {key: np.full_like(found["ST"], np.nan) for key in SHAPLEY}
        if not self.refuses:
            by_blocks = of_design(self.design, outcomes, self.whole, self.intervals)
            found |= {key: values for key, values in by_blocks.items() if key not in ("S1", "S1_conf")}
        return found

    def analysis(self, outcomes: Array) -> Analysis:
        """The same of one output ``[n]``, with indices of second order where the design has them."""
        if self.ok.all() and self.design.orders is None:
            return analyse(self.design, outcomes, self.whole, self.intervals)
        found = {key: values[:, 0] for key, values in self.of(outcomes[:, np.newaxis]).items()}
        if self.design.second_order and not self.refuses:
            by_blocks = analyse(self.design, outcomes, self.whole, self.intervals)
            return Analysis(**found, S2=by_blocks.S2, S2_conf=by_blocks.S2_conf)
        return Analysis(**found)

    def first(self, base: int) -> "Estimator":
        """That of the first ``base`` samples of the design."""
        design = self.design.first(base)
        rows = base * design.block
        of = self.ran.at < rows
        ran = Independent(self.ran.features[of], self.ran.at[of], self.ran.scramble[of])
        return Estimator(design, self.ok[:rows], ran, self.intervals)

    def if_failed_had(self, outcomes: Array) -> dict[str, Array]:
        """Indices of one output ``[n]`` if failed rows had the smallest, the mean or the largest outcome."""
        return indices_if_failed_had(self.design, outcomes, self.ok, self.intervals)

    def convergence(self, outcomes: Array) -> Convergence:
        """Indices of one output ``[n]`` from the first 32, 64, ... base samples; none where ST is refused.

        It begins where there are enough samples of each sequence.
        """
        base, least = self.design.base_samples, FEWEST * self.design.scrambles
        sizes = [2**k for k in range(FIRST_SIZE, 31) if least <= 2**k <= base] or [base]
        curve: dict[str, list[Array]] = {key: [] for key in KEYS}
        used = []
        for size in sizes if not self.refuses else ():
            first = self.first(size)
            if first.refuses or first.whole.sum() < 2:
                continue
            found = first.of(outcomes[: len(first.ok), np.newaxis])
            used.append(size)
            for key in KEYS:
                curve[key].append(found[key][:, 0])
        shape = (len(used), len(self.design.names))
        return Convergence(used, *(np.array(curve[key]).reshape(shape) for key in KEYS))


def estimator(design: Design, features: Array, ok: Array, intervals: Intervals) -> Estimator:
    """For rows of which those that are ``ok`` ``[n]`` ran; ``features``: see :func:`independent`."""
    return Estimator(design, ok, independent(design, features, ok), intervals)
