"""The lateral strain of the embedded simulators: closed form, the same with effects, and none where nothing is left."""

from dataclasses import replace

import numpy as np
import pytest

from sinew.runner.store.schema import STATUSES
from sinew.tasks.model import Curve, Model, Protocol, Specimen
from sinew.tasks.model.effect import model_with
from sinew.tasks.model.effects import named
from sinew.tasks.simulate.effects import UniaxialWith
from sinew.tasks.simulate.lateral import OUTPUTS
from sinew.tasks.simulate.uniaxial import Uniaxial

BAR = Specimen("bar", 10.0, 8.0, 4.0)
PULL = Protocol("pull", np.linspace(0.0, 10.0, 41), np.linspace(0.0, 0.4, 41))
BOTH = tuple(OUTPUTS)


def measured() -> Curve:
    gaps = np.where(np.arange(41) % 4 == 0, -0.01, np.nan)
    return Curve(PULL, np.linspace(0.0, 300.0, 41), {"lateral_strain": gaps, "width_change_mm": 8.0 * gaps})


def rows(model: Model, *nu: float) -> np.ndarray:
    found = np.tile(model.reference, (len(nu), 1))
    found[:, model.names.index("nu_m")] = nu
    return found


def test_lateral_strain_in_closed_form():
    model, keep = Model(), np.arange(41)
    done = Uniaxial(compared=BOTH).compare(model, BAR, measured(), rows(model, 0.0, 0.25, 0.4999999), keep)
    stretch = BAR.stretch(PULL)
    none, quarter, half = done.outputs["lateral_strain"]
    np.testing.assert_array_equal(none, 0.0)
    np.testing.assert_allclose((1 + quarter) ** 2 - 1, -0.25 * (stretch**2 - 1), atol=1e-12)
    np.testing.assert_allclose((1 + half) ** 2, 1.5 - 0.5 * stretch**2, atol=1e-6)
    np.testing.assert_allclose(done.outputs["width_change_mm"][1], 8.0 * quarter)
    np.testing.assert_allclose(done.summaries["lateral_strain"], [0.0, quarter.min(), half.min()])


def test_the_error_is_over_the_measured_points_and_the_force_stays_as_it_was():
    model, keep, curve = Model(), np.array([0, 7, 40]), measured()
    parameters = rows(model, *np.linspace(0.0, 0.4, 70))
    alone = Uniaxial().compare(model, BAR, curve, parameters, keep)
    done = Uniaxial(compared=BOTH).compare(model, BAR, curve, parameters, keep)
    np.testing.assert_array_equal(done.force_N, alone.force_N)
    np.testing.assert_array_equal(done.rmse_N, alone.rmse_N)
    assert not alone.rmse
    every = Uniaxial(compared=BOTH).compare(model, BAR, curve, parameters, np.arange(41)).outputs["lateral_strain"]
    gaps = np.arange(41) % 4 == 0
    np.testing.assert_allclose(done.rmse["lateral_strain"], np.sqrt(np.mean((every[:, gaps] + 0.01) ** 2, axis=1)))
    np.testing.assert_array_equal(done.outputs["lateral_strain"], every[:, keep])
    single = Uniaxial(compared=BOTH).compare(model, BAR, curve, parameters[41:42], keep)
    assert single.rmse["lateral_strain"][0] == done.rmse["lateral_strain"][41]  # whatever its neighbours


@pytest.mark.parametrize("names", [("toe-slack",), ("machine-compliance",)])
def test_with_effects_the_width_follows_the_gauge_length(names):
    effects = tuple(named()[name] for name in names)
    model = model_with(Model(), effects)
    parameters = rows(model, 0.25)
    keep = np.arange(41)
    null = parameters.copy()
    first = len(Model().names)
    null[:, first:] = effects[0].null_values
    bare = Uniaxial(compared=BOTH).compare(Model(), BAR, measured(), rows(Model(), 0.25), keep)
    simulator = UniaxialWith(names, compared=BOTH)
    done = simulator.compare(model, BAR, measured(), null, keep)
    np.testing.assert_allclose(done.outputs["lateral_strain"], bare.outputs["lateral_strain"], atol=1e-9)
    np.testing.assert_allclose(done.rmse["lateral_strain"], bare.rmse["lateral_strain"], rtol=1e-6)
    parameters[:, first:] = effects[0].typical
    changed = simulator.compare(model, BAR, measured(), parameters, keep).outputs["lateral_strain"]
    moved = np.abs(changed - bare.outputs["lateral_strain"]).max() > 1e-5
    assert moved == (names == ("machine-compliance",))  # a soft machine leaves less stretch to the gauge length


def test_a_row_without_width_is_a_failed_row():
    model = Model()
    far = replace(measured(), protocol=Protocol("far", PULL.time_s, np.linspace(0.0, 14.0, 41)))
    done = Uniaxial(compared=BOTH).compare(model, BAR, far, rows(model, 0.1, 0.4), np.arange(41))
    assert done.status.tolist() == [0, STATUSES.index("diverged")]
    assert done.messages == ("", "nothing is left of the width")
    assert np.isfinite(done.rmse["lateral_strain"][0])
    for array in (done.rmse_N, done.force_N, *done.outputs.values(), *done.summaries.values(), *done.rmse.values()):
        assert np.isnan(array[1]).all()
