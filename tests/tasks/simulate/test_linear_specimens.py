"""Specimens that are linear near a run: exact where runs have shown it, without memory where none has."""

import numpy as np

from sinew.tasks.simulate.linear_specimens import LinearSpecimens, Response, Run

TIME = np.linspace(0.0, 1.0, 50)
PULL = np.concatenate([np.linspace(0.0, 1.0, 30), np.ones(20)])  # mm


def pulled(displacement):
    """A spring of 40 N/mm, and a point of it that a camera follows."""
    return Run(displacement, np.stack([40.0 * displacement, 0.5 * displacement]))


def test_a_first_guess_is_a_spring_of_the_last_motion():
    run = pulled(PULL)
    response = Response.first(run, 1.0)
    np.testing.assert_allclose(response.stiffness, 40.0, rtol=1e-6)
    step = 0.01 * np.sin(TIME)[np.newaxis]
    change, rest = response.to(step)
    np.testing.assert_allclose(change[0, 0], 40.0 * step[0], rtol=1e-6, atol=1e-12)
    assert not change[0, 1].any(), "of other outputs nothing is known"
    np.testing.assert_array_equal(rest, step)
    assert not Response.first(pulled(np.ones(50)), 1.0).stiffness.any(), "nothing moved"


def test_what_a_run_shows_is_exact():
    run, step = pulled(PULL), 0.02 * np.sin(3.0 * TIME)
    response = Response.first(run, 1.0)
    moved = np.stack([55.0 * step, 0.5 * step])
    known = response.after(step, moved, 1.0)
    change, rest = known.to(0.3 * step[np.newaxis])
    np.testing.assert_allclose(change[0], 0.3 * moved, atol=1e-12)
    assert np.abs(rest).max() < 1e-12
    assert np.all(known.stiffness[5:] > 40.0), "and tells how stiff it is besides"
    assert response.after(1e-5 * step, moved, 1.0) is response, "smaller steps drown in the tolerance of a solver"


def test_several_specimens_along_several_displacements():
    run = pulled(PULL)
    specimens = LinearSpecimens(
        run, run.courses + np.array([0.0, 1.0])[:, np.newaxis, np.newaxis], Response.first(run, 1.0)
    )
    found = specimens.along(np.stack([PULL, PULL + 0.1]))
    np.testing.assert_allclose(found[0], run.courses, atol=1e-9)
    np.testing.assert_allclose(found[1, 0], run.courses[0] + 1.0 + 4.0, rtol=1e-6)
    (one,) = LinearSpecimens.of(run, Response.first(run, 1.0)).along(PULL[np.newaxis])
    np.testing.assert_array_equal(one, run.courses)
