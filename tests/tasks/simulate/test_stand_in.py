"""The bar that stands in for a model of the user's own is the embedded simulator, with that model's parameters."""

import numpy as np
import pytest

from sinew.tasks.model import Curve, Model, Protocol, Specimen
from sinew.tasks.model.parameters import own_parameter
from sinew.tasks.simulate import Output
from sinew.tasks.simulate.bar_parameters import parameters_of_the_bar
from sinew.tasks.simulate.stand_in import StandIn
from sinew.tasks.simulate.uniaxial import Uniaxial

OWN = Model((own_parameter("stiffness", "MPa", 5.0, 50.0), own_parameter("E_f", "MPa", 100.0, 200.0)), law="template")
TIME = np.linspace(0.0, 10.0, 41)
PROTOCOL = Protocol("ramp", TIME, 0.1 * np.minimum(TIME, 5.0))
BAR = Specimen("s", 20.0, 4.0, 2.0, (Curve(PROTOCOL, np.full(41, 3.0)),))
FORCE = Output("pull", "N", "last")
ROWS = np.array([[10.0, 120.0], [40.0, 180.0]])


def test_it_is_the_embedded_simulator():
    given = (("E_m", "stiffness"), ("E_f", "E_f"), ("beta", 3.0), ("lambda_0", 1.02), ("g_1m", 0.5), ("tau_1m", 4.0))
    usual = Model()
    values = {"E_f": ROWS[:, 1], "E_m": ROWS[:, 0], "g_1m": 0.5, "tau_1m": 4.0, "nu_m": 0.3}
    neutral = {name: 1.0 if name.startswith("tau") else 0.0 for name in usual.names}
    own = np.column_stack([np.broadcast_to({**neutral, **values}[name], 2) for name in usual.names])
    expected = Uniaxial().simulate(Model(beta=3.0, lambda_0=1.02), BAR, PROTOCOL, own).force_N
    found = StandIn(given, FORCE).simulate(OWN, BAR, PROTOCOL, ROWS)
    np.testing.assert_array_equal(found.force_N, expected)
    assert not found.status.any() and expected[:, -1].min() > 1.0


def test_its_force_is_stored_as_that_of_the_model():
    bar = StandIn((("E_m", "stiffness"),), FORCE)
    keep = np.array([0, 20, 40])
    found = bar.compare(OWN, BAR, BAR.curves[0], ROWS, keep)
    force = bar.simulate(OWN, BAR, PROTOCOL, ROWS).force_N
    np.testing.assert_array_equal(found.force_N, force[:, keep])
    np.testing.assert_array_equal(found.outputs["pull"], force[:, keep])
    np.testing.assert_array_equal(found.summaries["pull"], force[:, -1])
    np.testing.assert_allclose(found.rmse_N, np.sqrt(np.mean((force - 3.0) ** 2, axis=1)))
    assert bar.capabilities.force == "pull" and bar.capabilities.quick


@pytest.mark.parametrize("name", parameters_of_the_bar())
def test_whatever_is_left_out_changes_nothing(name):
    """A bar of nothing has no force, whichever parameter is given at the value that it has when it is left out."""
    found = StandIn((), FORCE).simulate(OWN, BAR, PROTOCOL, ROWS)
    assert not found.status.any() and not found.force_N.any()
    other = StandIn(
        ((name, {"beta": 2.0, "lambda_0": 1.01, "nu_m": 0.3}.get(name, 1.0 if "tau" in name else 0.0)),), FORCE
    )
    np.testing.assert_array_equal(other.simulate(OWN, BAR, PROTOCOL, ROWS).force_N, found.force_N)


def test_other_parameters_are_another_simulator():
    one, other = StandIn((("E_m", "stiffness"),), FORCE), StandIn((("E_m", 10.0),), FORCE)
    assert one.identity() != other.identity()
