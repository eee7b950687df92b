"""Where the solver stops, and the force between its stops."""

from itertools import pairwise

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from sinew.tasks.model import Protocol
from sinew.tasks.model.protocols import one_step, two_step
from sinew.tasks.simulate.febio.stepping import at_every_row, solver_steps

RATES = (1.0, 10.0, 100.0)


@st.composite
def histories(draw) -> Protocol:
    """Ramps and holds of random lengths, at even or uneven times."""
    parts = draw(
        st.lists(st.tuples(st.integers(1, 150), st.sampled_from([0.0, 0.0, 0.01, -0.01, 0.03])), min_size=1, max_size=8)
    )
    moves = np.concatenate([np.full(rows, move) for rows, move in parts])
    steps = np.full(moves.size, 1.0 / draw(st.sampled_from(RATES)))
    if draw(st.booleans()):
        steps *= np.random.default_rng(draw(st.integers(0, 99))).uniform(0.3, 3.0, moves.size)
    start, displaced = draw(st.sampled_from([0.0, 7.3])), draw(st.sampled_from([0.0, 0.2]))
    time_s = np.concatenate([[start], start + np.cumsum(steps)])
    return Protocol("any", time_s, np.concatenate([[displaced], displaced + np.cumsum(moves)]))


ramps = st.one_of(st.just(0.0), st.floats(0.01, 5.0))
growths = st.one_of(st.just(0.0), st.floats(0.005, 0.5))


@settings(max_examples=150, deadline=None)
@given(histories(), ramps, growths)
def test_the_solver_stops_where_it_must(history, ramp_s, growth):
    time_s, u = history.time_s, history.displacement_mm
    rows = solver_steps(history, ramp_s, growth, 0.0)
    assert (rows[0], rows[-1]) == (0, u.size - 1)
    assert (np.diff(rows) > 0).all()
    stops = set(rows.tolist())
    for row in range(1, u.size - 1):
        before, after = u[row] - u[row - 1], u[row + 1] - u[row]
        if before * after < 0 or (before == 0) != (after == 0):
            assert row in stops, "a corner of the history"
    for first, last in pairwise(rows):
        if last == first + 1:
            continue
        step = time_s[last] - time_s[first]
        if np.ptp(u[first : last + 1]) == 0:
            begin = first
            while begin and u[begin - 1] == u[first]:
                begin -= 1
            assert step <= growth * (time_s[first] - time_s[begin]) * (1 + 1e-6)
        else:
            assert step <= ramp_s * (1 + 1e-6)


@settings(max_examples=150, deadline=None)
@given(histories(), ramps, growths, st.floats(0.001, 0.1), st.integers(0, 99))
def test_the_solver_passes_over_nothing_that_matters_in_a_noisy_history(history, ramp_s, growth, still_mm, seed):
    noise = np.random.default_rng(seed).uniform(-0.45, 0.45, history.time_s.size) * still_mm
    noisy = Protocol("noisy", history.time_s, history.displacement_mm + noise)
    u = noisy.displacement_mm
    rows = solver_steps(noisy, ramp_s, growth, still_mm)
    assert (rows[0], rows[-1]) == (0, u.size - 1)
    assert (np.diff(rows) > 0).all()
    for first, last in pairwise(rows):
        moves = np.diff(u[first : last + 1])
        assert (moves > 0).all() or (moves < 0).all() or np.ptp(u[first : last + 1]) <= 2 * still_mm


@settings(max_examples=50, deadline=None)
@given(histories(), st.floats(0.0, 0.1))
def test_without_limits_the_solver_stops_at_every_row(history, still_mm):
    assert np.array_equal(solver_steps(history, 0.0, 0.0, still_mm), np.arange(history.time_s.size))


def test_a_hold_is_thinned_as_much_as_its_growth_allows():
    history = one_step(10.0, 100.0)
    hold = int(np.argmax(history.displacement_mm))
    sizes = []
    for growth in (0.005, 0.02, 0.1, 0.5):
        rows = solver_steps(history, 0.0, growth, 0.0)
        assert set(range(hold + 2)) <= set(rows.tolist()), "the ramp stays whole"
        sizes.append(rows.size - hold)
    assert sizes == sorted(sizes, reverse=True)
    assert sizes[1] < 500 < sizes[0] < 2500
    assert sizes[3] < 60


def test_a_ramp_is_thinned_to_its_longest_step():
    history = one_step(10.0, 100.0)
    rows = solver_steps(history, 0.1, 0.0, 0.0)
    hold = int(np.argmax(history.displacement_mm))
    assert np.allclose(np.diff(history.time_s[rows[rows < hold]]), 0.1)
    assert set(range(hold, history.time_s.size)) <= set(rows.tolist())


@settings(max_examples=40, deadline=None)
@given(
    st.lists(
        st.tuples(st.floats(0.0, 1.0), st.one_of(st.floats(0.1, 2.0), st.floats(2.0, 20.0), st.floats(20.0, 200.0))),
        min_size=1,
        max_size=6,
    ),
    st.floats(0.0, 2.0),
    st.sampled_from([one_step, two_step]),
    st.sampled_from([10.0, 100.0]),
)
def test_a_relaxation_is_reproduced_between_the_solvers_steps(terms, rest, make, rate_hz):
    """A sum of exponentials in each hold, as the model relaxes, from a smooth ramp."""
    history = make(10.0, rate_hz)
    time_s, u = history.time_s, history.displacement_mm
    moving = np.concatenate([[True], np.diff(u) != 0])
    last_moved = np.maximum.accumulate(np.where(moving, np.arange(u.size), 0))
    since = time_s - time_s[last_moved]
    force = u * (rest + 0.01 + sum(strength * np.exp(-since / tau) for strength, tau in terms))
    rows = solver_steps(history, 0.0, 0.02, 0.0)
    assert rows.size < u.size
    full = at_every_row(history, rows, force[rows], 0.0)
    assert full[rows].tobytes() == force[rows].tobytes()
    assert np.abs(full - force).max() <= 1e-6 * force.max()


@settings(max_examples=100, deadline=None)
@given(histories(), ramps, growths, st.integers(0, 99))
def test_between_steps_the_force_keeps_what_the_solver_said(history, ramp_s, growth, seed):
    rows = solver_steps(history, ramp_s, growth, 0.0)
    force = np.random.default_rng(seed).normal(size=rows.size)
    full = at_every_row(history, rows, force, 0.0)
    assert full.shape == history.time_s.shape
    assert np.isfinite(full).all()
    assert full[rows].tobytes() == force.tobytes()
    for place, (first, last) in enumerate(pairwise(rows)):
        if np.ptp(history.displacement_mm[first : last + 1]):
            low, high = sorted(force[place : place + 2])
            assert (full[first : last + 1] >= low - 1e-9).all(), "monotone in motion"
            assert (full[first : last + 1] <= high + 1e-9).all(), "monotone in motion"
