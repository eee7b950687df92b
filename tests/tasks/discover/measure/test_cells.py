"""Cells are read off the displacement, and disagree by chance as often as they say."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse import csr_array

from sinew.tasks.discover.measure import cells as cells_module
from sinew.tasks.discover.measure.cells import cells, limits_by_chance, located_part, misfits
from sinew.tasks.discover.result import InPlace
from sinew.tasks.model import Curve
from sinew.tasks.model.protocols import STANDARD, cyclic, two_step
from tests.tasks.discover.results import CELL


@pytest.mark.parametrize("make", STANDARD)
@pytest.mark.parametrize("rate_hz", [2.0, 10.0])
def test_no_point_is_in_two_cells_and_few_are_in_none(make, rate_hz):
    protocol = make(10.0, rate_hz)
    found = cells(Curve(protocol, np.zeros(protocol.time_s.size)))
    points = np.concatenate([cell.points for cell in found])
    assert np.unique(points).size == points.size
    assert points.size >= 0.8 * protocol.time_s.size


def test_cells_have_the_names_of_what_happens_there():
    names = [(c.phase, c.number) for c in cells(Curve(two_step(10.0, 10.0), np.zeros(4068)))]
    one = [("toe", 1), ("ramp", 1), ("peak", 1), ("early hold", 1), ("middle hold", 1), ("late hold", 1)]
    assert names == one + [(phase, 2) for phase, _ in one]
    protocol = cyclic(10.0, 10.0)
    names = [(c.phase, c.number) for c in cells(Curve(protocol, np.zeros(protocol.time_s.size)))]
    assert names[:5] == [("toe", 1), ("ramp", 1), ("peak", 1), ("unload", 1), ("valley", 1)]
    assert names[-1] == ("valley", 12)


def test_a_true_model_is_called_wrong_as_often_as_was_asked(monkeypatch):
    """A linear model, fitted again to each of many data sets."""
    rng = np.random.default_rng(1)
    size, count = 400, 20
    inside = csr_array(np.kron(np.eye(count), np.ones(size // count)))
    time = np.linspace(0, 1, size)
    derivatives = np.column_stack([np.ones(size), time, time**2, np.exp(-5 * time)])
    limit = limits_by_chance(inside, derivatives, [0.05], rng)[0]
    with monkeypatch.context() as patch:
        patch.setattr(cells_module, "AT_ONCE", 3000 * count)  # draws in several parts
        assert limits_by_chance(inside, derivatives, [0.05], rng)[0] == pytest.approx(limit, rel=0.02)
    basis, _ = np.linalg.qr(derivatives)
    crossed = 0
    for _ in range(2000):
        noise = rng.standard_normal(size)
        crossed += np.abs(misfits(inside, noise - basis @ (basis.T @ noise))).max() > limit
    assert crossed / 2000 == pytest.approx(0.05, abs=0.015)


def test_an_improvement_is_where_the_misfit_was_or_elsewhere():
    before = [[replace(CELL, z=z) for z in (10.0, 1.0, 2.0, 1.0)]]
    there = [[replace(CELL, z=z) for z in (0.0, 1.0, 1.0, 1.0)]]
    elsewhere = [[replace(CELL, z=z) for z in (10.0, 0.0, 0.0, 1.0)]]
    assert located_part(before, there) == InPlace(pytest.approx(100 / 103), 0.25)
    assert located_part(before, elsewhere) == InPlace(0.0, 0.25)
    assert located_part(there, there) is None
