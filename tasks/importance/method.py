"""Random forest importance (scikit-learn): impurity importance as in Pekedis (2025), and permutation importance.

Permutation importance is judged on base samples that the forest has not seen. Rows of one base sample share
coordinates, so they stay together when rows for growing and rows for testing the forest are split.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from sinew.tasks.importance.result import Forest
from sinew.tasks.study.streams import Stream, generator, state

Array = np.ndarray[Any, Any]
TEST_SHARE = 0.25
FEWEST_BLOCKS = 8


@dataclass(frozen=True, eq=False)
class Split:
    """Rows ``grown`` and ``tested`` on: positions in the design, without those that failed."""

    grown: Array
    tested: Array


def split(blocks: int, block: int, ok: Array, max_rows: int, seed: int) -> Split:
    """Choose whole base samples (``block`` rows each of ``blocks``) at random, at most ``max_rows`` rows of them.

    ``ok`` ``[n]``: rows that did not fail.
    """
    rng = generator(seed, Stream.FOREST_SPLIT)
    chosen = rng.permutation(blocks)[: max(FEWEST_BLOCKS, max_rows // block)]
    tested = chosen[: max(1, round(TEST_SHARE * chosen.size))]

    def rows(of: Array) -> Array:
        found = (np.sort(of)[:, np.newaxis] * block + np.arange(block)).ravel()
        return found[ok[found]]

    return Split(rows(chosen[tested.size :]), rows(tested))


def forest_importance(
    features: Array, outcomes: Array, rows: Split, *, trees: int, repeats: int, seed: int, threads: int
) -> Forest:
    """Grow a forest on ``features`` ``[n, d]`` and ``outcomes`` ``[n]``; the importance of each feature."""
    from sklearn.ensemble import RandomForestRegressor
    from sklearn.inspection import permutation_importance

    state_ = state(seed, Stream.FOREST)
    forest = RandomForestRegressor(trees, random_state=state_, n_jobs=threads)
    forest.fit(features[rows.grown], outcomes[rows.grown])
    forest.set_params(n_jobs=1)  # threads would add up the trees' predictions in the order in which they end
    by_tree = np.stack([tree.feature_importances_ for tree in forest.estimators_])
    unseen = features[rows.tested], outcomes[rows.tested]
    permuted = permutation_importance(forest, *unseen, n_repeats=repeats, random_state=state_, scoring="r2")
    return Forest(
        impurity_percent=100 * forest.feature_importances_,
        impurity_sd=100 * by_tree.std(axis=0, ddof=1),
        permutation=permuted.importances_mean,
        permutation_sd=permuted.importances_std,
        r2_on_unseen=float(forest.score(*unseen)),
    )
