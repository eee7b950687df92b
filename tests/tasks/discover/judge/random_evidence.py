"""Random evidence on all sides of the rules' thresholds."""

from itertools import combinations

import numpy as np

from sinew.tasks.discover.judge.rules import Evidence
from sinew.tasks.discover.judge.scores import Score, Scores
from sinew.tasks.discover.result import Gain, InPlace

SLUGS = ("drift", "lag", "slack", "slip", "softening")
SPLITS = ("protocol", "later cycles", "specimen")


def evidence(seed: int) -> Evidence:
    """Evidence that is the same for the same seed."""
    rng = np.random.default_rng(seed)
    floor = 10.0 ** rng.uniform(1.0, 3.5)
    misfit = 10.0 ** rng.uniform(0.0, 5.0)
    bare = Score((), floor + misfit, floor + misfit)
    order = rng.permutation(len(SLUGS))[: rng.integers(1, len(SLUGS) + 1)]
    of_pairs = rng.random() < 0.5  # one effect leaves a part of the misfit that a second could take away
    left = {}
    for rank, number in enumerate(order):
        few = 10.0 ** rng.uniform(-3.0, -0.3) if of_pairs else 10.0 ** rng.uniform(-5.0, -0.5)
        left[SLUGS[number]] = few if rank == 0 or (rank == 1 and not of_pairs) else rng.uniform(0.3, 1.2)
    singles = [_score(rng, (slug,), floor, part * misfit, bare) for slug, part in left.items()]
    pairs = []
    if of_pairs or rng.random() < 0.5:
        for both in combinations(left, 2):
            takes = 1.0 - 10.0 ** rng.uniform(-3.0, 0.0) if not pairs else rng.uniform(0.0, 0.4)
            part = min(left[slug] for slug in both) * (1.0 - takes)
            pairs.append(_score(rng, both, floor, part * misfit, bare))
    located = rng.random() < 0.8
    surely = located and rng.random() < 0.8
    return Evidence(Scores(bare, (*singles, *pairs), floor), located, surely, rng.random() < 0.8)


def _score(rng: np.random.Generator, effects: tuple[str, ...], floor: float, misfit: float, bare: Score) -> Score:
    loss = floor + misfit + float(rng.normal(0.0, 0.5 * np.sqrt(2.0 * floor)))
    criterion = loss + 8.0 * len(effects) * int(rng.integers(1, 4))
    unsure = rng.random() < 0.15  # most pass their checks
    gains = tuple(float(gain) for gain in rng.normal(0.0 if unsure else 500.0, 100.0, int(rng.integers(1, 4))))
    held = _gains(rng, unsure)
    beyond = _gains(rng, rng.random() < 0.3) if len(effects) == 2 else {}
    on_bound = ("limit",) if rng.random() < 0.1 else ()
    share = rng.uniform(0.05, 0.9)
    in_place = InPlace(rng.uniform(0.1 if unsure else 0.5, 1.0), share) if rng.random() < 0.9 else None
    return Score(effects, criterion, loss, gains, held, beyond, on_bound, in_place)


def _gains(rng: np.random.Generator, unsure: bool) -> dict[str, Gain]:
    kinds = SPLITS[: rng.integers(0, 4)]
    return {kind: Gain(float(rng.normal(200.0 if unsure else 900.0, 100.0)), 100.0) for kind in kinds}
