"""Which runs are chosen next, against what each of them would really bring."""

import numpy as np
from threadpoolctl import threadpool_limits

from sinew.tasks.fitting.emulator import Emulator, Fit, taken_apart
from sinew.tasks.fitting.growth import next_runs
from sinew.tasks.simulate.growing import TURN
from sinew.tasks.simulate.plain_design import shares

SHARE = shares(2, 16, 3, TURN)
POOL = np.random.default_rng(4).random((60, 2))
THETA = (0.0, -1.0, 0.5, np.log(1e-4))  # variance, length scales, noise


def emulator(share=SHARE):
    values = np.sin(5.0 * share[:, [0]]) + share[:, [1]] * np.ones(3)
    return Emulator(share, taken_apart(values, np.ones(3)), [Fit("process", 1, THETA, 0.1)])


def unsure(share):
    """The mean variance over the pool of a process that knows runs at ``share``, in its own units."""
    regressor = emulator(SHARE).processes[0].regressor
    known = regressor.kernel_(share) + regressor.alpha * np.eye(len(share))
    across = regressor.kernel_(POOL, share)
    return np.mean(regressor.kernel_.diag(POOL) - np.einsum("ij,ji->i", across, np.linalg.solve(known, across.T)))


def test_the_first_run_is_the_one_that_makes_it_surest():
    with threadpool_limits(1):
        (chosen,) = next_runs(emulator(), POOL, np.ones(len(POOL)), 1)
    left = [unsure(np.vstack([SHARE, point])) for point in POOL]
    assert chosen == np.argmin(left)


def test_a_batch_is_surer_than_any_of_many_random_ones():
    chosen = next_runs(emulator(), POOL, np.ones(len(POOL)), 8)
    assert len(set(chosen.tolist())) == 8
    rng = np.random.default_rng(1)
    others = [unsure(np.vstack([SHARE, POOL[rng.permutation(len(POOL))[:8]]])) for _ in range(200)]
    assert unsure(np.vstack([SHARE, POOL[chosen]])) < min(others)


def test_a_region_that_likely_fails_is_not_sought_although_nothing_is_known_of_it():
    known = SHARE[SHARE[:, 0] < 0.6]
    alive = 1.0 / (1.0 + np.exp(40.0 * (POOL[:, 0] - 0.6)))
    chosen = next_runs(emulator(known), POOL, alive, 10)
    assert (POOL[chosen, 0] < 0.62).all()


def test_no_run_is_wasted_where_the_model_fails():
    alive = (POOL[:, 0] < 0.5).astype(float)
    chosen = next_runs(emulator(), POOL, alive, 10)
    assert (POOL[chosen, 0] < 0.5).all()
