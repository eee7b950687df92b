"""How often 95 % intervals of Sobol indices hold the truth: Ishigami's and the g-function, the tendon, and a function
of which a corner fails.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from SALib.test_functions import Ishigami, Sobol_G

from sinew.tasks.model import Model
from sinew.tasks.model.parameters import scaled
from sinew.tasks.simulate.plain_design import shares
from sinew.tasks.simulate.saltelli import Design, drawn
from sinew.tasks.sobol.by_chaos import ByChaos
from sinew.tasks.sobol.estimate import estimator
from sinew.tasks.sobol.method import Intervals
from sinew.tasks.sobol.result import KEYS
from tests.benchmarks.common import evaluation

Array = np.ndarray
SEEDS, SCRAMBLES = 150, 8
WORTH = 0.01  # an index from which on its coverage counts
G = np.array([0.0, 1.0, 4.5, 9.0, 99.0, 99.0])
TENDON_SEEDS, TENDON_TRUTH = 40, 2**16


@dataclass(frozen=True)
class Case:
    """A function of rows ``[n, d]`` within ``ranges``, NaN where it fails, and its true indices."""

    name: str
    ranges: Sequence[Sequence[float]]
    function: Callable[[Array], Array]
    first: Array
    total: Array | None = None


def estimates(case: Case, base: int, seed: int) -> dict[str, Array]:
    names = tuple(f"x{j}" for j in range(len(case.ranges)))
    rows = drawn(names, case.ranges, base, seed, second_order=False, scrambles=SCRAMBLES)
    design = Design(names, base, False, rows, scrambles=SCRAMBLES)
    outcomes = case.function(rows)
    features = rows.reshape(base, design.block, -1)[:, [0, -1]]
    found = estimator(design, features, np.isfinite(outcomes), Intervals(10, 0.95, seed)).of(outcomes[:, np.newaxis])
    return {key: values[:, 0] for key, values in found.items()}


def by_surrogate(case: Case, rows: int, seed: int) -> dict[str, Array]:
    """The same from polynomial chaos, trained with so many plain rows."""
    share = shares(len(case.ranges), rows, seed, SCRAMBLES)
    low, high = np.array(case.ranges, dtype=float).T
    names = tuple(f"x{j}" for j in range(len(case.ranges)))
    alone = tuple((j,) for j in range(len(names)))
    design = Design(names, rows, False, share, scrambles=SCRAMBLES, members=alone, plain=True)
    outcomes = case.function(low + (high - low) * share)
    found = ByChaos(design, share, np.isfinite(outcomes), Intervals(10, 0.95, seed)).analysis(outcomes)
    return {key: getattr(found, key) for key in KEYS}


def covered(
    case: Case, base: int, seeds: int, estimate: Callable[[Case, int, int], dict[str, Array]] | None = None
) -> None:
    """Print coverage and bias of both indices, of parameters whose index is worth it."""
    every = [(estimate or estimates)(case, base, seed) for seed in range(seeds)]
    truth = {"S1": case.first, "ST": case.total}
    tell(f"{case.name}, {base} {'rows by surrogate' if estimate else 'base samples'}", every, truth)


def tell(of: str, every: Sequence[Mapping[str, Array]], known: Mapping[str, Array | None]) -> None:
    """Print how often the intervals of ``every`` estimate hold the indices that are ``known``, and their errors."""
    for key, truth in known.items():
        if truth is None:
            continue
        apart = np.array([one[key] for one in every]) - truth
        half = np.array([one[f"{key}_conf"] for one in every])
        held = (np.abs(apart) <= half).mean(axis=0)
        worth = truth > WORTH
        print(
            f"  {of}, {len(every)} seeds: {key} held in {held[worth].min():.2f} to "
            f"{held[worth].max():.2f} of {worth.sum()} parameters above {WORTH:g} (mean {held[worth].mean():.3f}), "
            f"largest bias {np.abs(apart.mean(axis=0)).max():.4f}, median of the largest error "
            f"{np.median(np.abs(apart).max(axis=1)):.4f}, widest half-width "
            f"{np.median(half, axis=0).max():.4f}",
            flush=True,
        )


def corner(share: float) -> Case:
    """Four parameters; a ``share`` of the unit cube fails, at one corner. The truth is that of two million rows."""
    edge = 2.0 - np.sqrt(2.0 * share)

    def function(rows: Array) -> Array:
        value = 3 * rows[:, 0] + 2 * rows[:, 1] ** 2 + 2 * rows[:, 2] * rows[:, 0] + 0.3 * rows[:, 3]
        return np.where(rows[:, 0] + rows[:, 1] > edge, np.nan, value)

    rows = np.random.default_rng(0).random((2_000_000, 4))
    outcome = function(rows)
    rows, outcome = rows[np.isfinite(outcome)], outcome[np.isfinite(outcome)]
    first = []
    for column in rows.T:
        part = (column * 500).astype(int)
        count, total = np.bincount(part, minlength=500), np.bincount(part, outcome, minlength=500)
        means = total / np.maximum(count, 1)
        first.append(count @ (means - outcome.mean()) ** 2 / count.sum() / outcome.var())
    return Case(f"corner of {100 * share:g} % fails", [[0, 1]] * 4, function, np.array(first))


def objective() -> Callable[[Array], Array]:
    """The objective of one virtual specimen at 5 Hz, of rows ``[n, d]`` of the tissue's parameters."""
    evaluated = evaluation(rate_hz=5.0)

    def function(rows: Array) -> Array:
        parts = np.array_split(rows, max(1, len(rows) // 4096))
        return np.concatenate([evaluated(part).values["objective"].sum(axis=1) for part in parts])

    return function


def tendon() -> Case:
    """The objective of one virtual specimen; the truth is that of a large design of other seeds."""
    model, of_rows = Model(), objective()
    unit = [[0.0, 1.0]] * len(model.free)

    def function(rows: Array) -> Array:
        return of_rows(scaled(model.free, rows))

    whole = estimates(Case("", unit, function, np.empty(0)), TENDON_TRUTH, 10**6)
    print(f"  tendon: truth from {TENDON_TRUTH} base samples, half-widths up to {whole['S1_conf'].max():.4f} (S1) and "
          f"{whole['ST_conf'].max():.4f} (ST)")  # fmt: skip
    return Case("tendon", unit, function, whole["S1"], whole["ST"])


def main() -> None:
    ishigami = Case(
        "Ishigami", [[-np.pi, np.pi]] * 3, Ishigami.evaluate,
        np.array([0.313905, 0.442411, 0.0]), np.array([0.557589, 0.442411, 0.243684]),
    )  # fmt: skip
    g = Case(
        "g-function", [[0, 1]] * 6, lambda rows: Sobol_G.evaluate(rows, G),
        Sobol_G.sensitivity_index(G), Sobol_G.total_sensitivity_index(G),
    )  # fmt: skip
    for case in (ishigami, g):
        for base in (256, 2048):
            covered(case, base, SEEDS)
    for share in (0.005, 0.05, 0.5):
        for base in (256, 2048):
            covered(corner(share), base, SEEDS)
    for case in (ishigami, g):
        for rows in (64, 144, 320):
            covered(case, rows, SEEDS, by_surrogate)
    case = tendon()
    for base in (256, 2048):
        covered(case, base, TENDON_SEEDS)
    for rows in (144, 320, 1000):
        covered(case, rows, TENDON_SEEDS, by_surrogate)
