"""Generations have as many particles as are worth the effective sample size that is wanted."""

from types import SimpleNamespace

import pytest

from sinew.tasks.infer.abc.population import EnoughParticles


@pytest.mark.parametrize(("worth", "expected"), [(1.0, 1000), (0.5, 1000), (0.25, 1600), (1e-4, 10_000)])
def test_uneven_weights_call_for_more_particles(worth, expected):
    size = EnoughParticles(1000, 400)
    assert (size(-1), size(0)) == (1000, 1000)
    size.update([SimpleNamespace(worth_=worth)], None, t=1)
    assert (size(0), size(1)) == (1000, expected)
