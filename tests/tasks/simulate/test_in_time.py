"""Balance from the first point to the last: where Newton's method works too, and where it alone fails."""

import numpy as np
import pytest

from sinew.runner.store.schema import STATUSES
from sinew.tasks.model import Model
from sinew.tasks.model.effect import model_with
from sinew.tasks.model.protocols import cyclic
from sinew.tasks.simulate import effects as embedded
from sinew.tasks.simulate import in_time
from sinew.tasks.simulate.effects import UniaxialWith, simulate_with
from tests.tasks.simulate.test_effects import BAR, FORMS, PULLED_AND_PUSHED, error, simulate

GIVING_WAY = {f"{form.slug}/{form.form}".rstrip("/"): form for form in FORMS if form.giving_way}
BY_NAME = {f"{form.slug}/{form.form}".rstrip("/"): form for form in FORMS}
# found among random values: Newton's method goes to and fro between both sides of where a bundle tears
TORN = tuple(BY_NAME[name] for name in ("grip-slip", "rupture/several", "toe-slack/spread"))
ROW = np.array([[173.0, 0.0, 1.0, 2.0, 2.0, 2.0, 3.0, 20.0, 46.0, 1.0, 2.0, 2.0, 2.0, 3.0, 20.0, 0.0]])
VALUES = np.array([[1.57379178e-4, 1e-6, 0.109375, 0.01953125, 0.001953125, 0.03125, 1.0, 0.0]])


@pytest.mark.parametrize("form", GIVING_WAY.values(), ids=GIVING_WAY)
def test_it_finds_what_newtons_method_finds(form, monkeypatch):
    expected = simulate((form,), PULLED_AND_PUSHED, form.typical)
    monkeypatch.setattr(embedded, "ITERATIONS", 0)
    assert error(simulate((form,), PULLED_AND_PUSHED, form.typical), expected).max() < 1e-7


def test_where_newtons_method_fails_it_finds_the_force(monkeypatch):
    force = simulate_with(Model(), TORN, BAR, cyclic(10.0, 2.0), ROW, VALUES)
    assert np.isfinite(force).all()
    monkeypatch.setattr(embedded, "BALANCE", 1e-12)
    finer = simulate_with(Model(), TORN, BAR, cyclic(10.0, 2.0), ROW, VALUES)
    assert error(force, finer).max() < 1e-7


def test_a_kink_is_where_newtons_method_alone_fails(monkeypatch):
    asked = []
    found = in_time._within_an_interval
    monkeypatch.setattr(in_time, "_within_an_interval", lambda *given: asked.append(given[-1]) or found(*given))
    simulate_with(Model(), TORN, BAR, cyclic(10.0, 2.0), ROW, VALUES)
    assert asked


def test_a_bar_that_is_not_balanced_is_a_failed_row_beside_others(monkeypatch):
    monkeypatch.setattr(in_time, "WORK", 0)
    names = ("grip-slip", "rupture", "toe-slack")
    chosen = tuple(BY_NAME[name] for name in names)
    null = np.concatenate([form.null_values for form in chosen])[np.newaxis]
    torn = np.array([[1.57379178e-4, 1e-6, 0.109375, 0.01953125, 0.001953125, 1.0]])
    rows = np.concatenate([np.repeat(ROW, 2, axis=0), [torn[0], null[0]]], axis=1)
    monkeypatch.setattr(embedded, "ITERATIONS", 0)
    done = UniaxialWith(names).simulate(model_with(Model(), chosen), BAR, cyclic(10.0, 2.0), rows)
    assert [STATUSES[status] for status in done.status] == ["diverged", "ok"]
    assert done.messages[0] == "no force was found"
    assert np.isfinite(done.force_N[1]).all()


def test_a_bar_is_found_beside_others():
    """Each as if it were alone: the second needs what the first does not."""
    null = np.concatenate([form.null_values for form in TORN])[np.newaxis]
    both, rows = np.concatenate([null, VALUES, null]), np.repeat(ROW, 3, axis=0)
    force = simulate_with(Model(), TORN, BAR, cyclic(10.0, 2.0), rows, both)
    for row in range(3):
        alone = simulate_with(Model(), TORN, BAR, cyclic(10.0, 2.0), rows[row : row + 1], both[row : row + 1])
        assert alone.tobytes() == force[row : row + 1].tobytes()
    assert not np.array_equal(force[1], force[0])


def test_forces_that_become_no_numbers_end_the_search(monkeypatch):
    """A curve of NaN from some point on is not in balance, and takes little work."""
    calls = []
    pulled = embedded._Run.pulled

    def broken(self, bars):
        calls.append(1)
        moved = pulled(self, bars)
        if len(calls) > 1:
            moved.force_N[:, 100:] = np.nan
        return moved

    monkeypatch.setattr(embedded, "ITERATIONS", 0)
    monkeypatch.setattr(embedded._Run, "pulled", broken)
    force = simulate_with(Model(), TORN, BAR, cyclic(10.0, 2.0), ROW, VALUES)
    assert np.isnan(force).all()
    assert len(calls) < 2_000
