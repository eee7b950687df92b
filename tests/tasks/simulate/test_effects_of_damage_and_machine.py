"""Effects beyond the standard ones in the embedded simulator, against plain arithmetic: friction, creep, buckling,
rupture, fatigue that heals, a matrix that stiffens, slip beyond a force."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from sinew.tasks.model import Model, Protocol
from sinew.tasks.model.effects import named
from sinew.tasks.simulate.uniaxial import Uniaxial
from tests.conftest import reference_parameters
from tests.tasks.simulate.test_effects import BAR, HISTORIES, PULLED_AND_PUSHED, baseline, error, simulate

EFFECTS = named()
ROWS = reference_parameters(Model())[:4]
by_name = pytest.mark.parametrize("protocol", HISTORIES, ids=lambda protocol: protocol.name)


def pulled_by(protocol: Protocol, displacement_mm: np.ndarray) -> np.ndarray:
    """Forces ``[4, t]`` of the bare bars along displacements ``[4, t]``."""
    own = [Protocol("own", protocol.time_s, moved) for moved in displacement_mm]
    return np.concatenate([Uniaxial().simulate(Model(), BAR, p, ROWS[[i]]).force_N for i, p in enumerate(own)])


# ---- friction


def test_friction_builds_up_over_its_distance_and_stays_in_a_hold():
    time = np.arange(9.0)
    protocol = Protocol("steps", time, np.array([0.0, 0.02, 0.1, 0.1, 0.08, 0.02, 0.02, 0.03, 0.2]))
    force = simulate((EFFECTS["friction"],), protocol, np.array([20.0, 0.04]))
    expected = 20.0 * np.array([0.0, 0.5, 1.0, 1.0, 0.5, -1.0, -1.0, -0.75, 1.0])
    assert np.allclose(force - baseline(protocol), expected)
    sudden = simulate((EFFECTS["friction"],), protocol, np.array([20.0, 0.0]))
    assert np.allclose(sudden - baseline(protocol), 20.0 * np.array([0, 1, 1, 1, -1, -1, -1, 1, 1]))


@by_name
def test_friction_that_the_force_causes(protocol):
    plain = baseline(protocol)
    acting = simulate((EFFECTS["friction"],), protocol, np.array([1.0, 0.02])) - plain
    pressed = simulate((EFFECTS["friction/pressed"],), protocol, np.array([0.1, 0.02]))
    assert error(pressed, plain + 0.1 * np.abs(plain) * acting).max() < 1e-12
    clamped = simulate((EFFECTS["friction/clamped"],), protocol, np.array([0.1, 0.02]))
    assert error(clamped, plain + 0.1 * np.abs(plain).max(axis=1, keepdims=True) * acting).max() < 1e-12


# ---- a specimen that becomes longer, or that slips


@by_name
def test_creep_follows_the_strain(protocol):
    rate = 5e-4
    strain = np.maximum(protocol.displacement_mm / BAR.length_mm, 0.0)
    growth = rate * np.concatenate([[0.0], np.cumsum(0.5 * (strain[1:] + strain[:-1]) * np.diff(protocol.time_s))])
    grown = (BAR.length_mm + protocol.displacement_mm) / (1.0 + growth) - BAR.length_mm
    force = simulate((EFFECTS["creep"],), protocol, np.array([rate]))
    assert error(force, pulled_by(protocol, np.tile(grown, (4, 1)))).max() < 1e-8


@by_name
@pytest.mark.parametrize("form", ["stress", "part"])
def test_creep_beyond_a_limit_is_in_balance_with_the_force(protocol, form):
    size, limit = (2e-5, 10.0) if form == "stress" else (1e-3, 0.4)
    force = simulate((EFFECTS[f"creep/{form}"],), protocol, np.array([size, limit]))
    peak = baseline(protocol).max(axis=1, keepdims=True)
    driver = force / BAR.area_mm2 if form == "stress" else force / peak
    steps = np.diff(protocol.time_s, prepend=protocol.time_s[0])
    growth = size * np.cumsum(np.maximum(driver - limit, 0.0) * steps, axis=1)
    assert (growth[:, -1] > 1e-4).any()
    grown = (BAR.length_mm + protocol.displacement_mm) / (1.0 + growth) - BAR.length_mm
    assert error(force, pulled_by(protocol, grown)).max() < 1e-8


@by_name
def test_grips_slide_beyond_a_force(protocol):
    speed, hold = 1e-4, 300.0
    force = simulate((EFFECTS["grip-slip/force"],), protocol, np.array([speed, hold]))
    steps = np.diff(protocol.time_s, prepend=protocol.time_s[0])
    slip = speed * np.cumsum(np.maximum(force - hold, 0.0) * steps, axis=1)
    assert (slip[:, -1] > 1e-3).any()
    assert error(force, pulled_by(protocol, protocol.displacement_mm - slip)).max() < 1e-8


# ---- a specimen that buckles


def test_what_buckles_bears_a_part_of_the_push_or_bends():
    plain = baseline(PULLED_AND_PUSHED)
    assert (plain.min(axis=1) < 0.0).all()
    force = simulate((EFFECTS["buckling"],), PULLED_AND_PUSHED, np.array([0.75]))
    assert error(force, np.where(plain < 0.0, 0.25 * plain, plain)).max() < 1e-12
    compliance = 0.02
    bent = simulate((EFFECTS["buckling/bending"],), PULLED_AND_PUSHED, np.array([compliance]))
    moved = PULLED_AND_PUSHED.displacement_mm - compliance * np.minimum(bent, 0.0)
    assert error(bent, pulled_by(PULLED_AND_PUSHED, moved)).max() < 1e-8
    assert (bent.min(axis=1) > 0.5 * plain.min(axis=1)).all()


# ---- stiffness that is lost or gained


def elastic(protocol: Protocol, name: str, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Forces ``[t]`` of a bar that does not relax, with an effect and without."""
    model = Model()
    row = np.array([[0.0 if p.name.startswith("g_") else p.reference for p in model.parameters]])
    return simulate((EFFECTS[name],), protocol, values, row)[0], simulate((), protocol, np.zeros(0), row)[0]


def test_bundles_tear_at_their_strains_for_good():
    moved = 10.0 * np.array([0.0, 0.019, 0.0215, 0.019, 0.0, 0.0275, 0.035, 0.019])
    protocol = Protocol("tearing", np.arange(8.0), moved)
    largest = np.maximum.accumulate(0.5 * ((1.0 + moved / 10.0) ** 2 - 1.0))
    force, plain = elastic(protocol, "rupture", np.array([0.1, 0.02, 0.002]))
    assert np.allclose(force, plain * (1.0 - 0.1 * np.clip((largest - 0.02) / 0.002, 0.0, 1.0)))
    force, plain = elastic(protocol, "rupture/several", np.array([0.1, 0.02, 0.002, 0.007]))
    torn = sum(np.clip((largest - 0.02 - k * 0.007) / 0.002, 0.0, 1.0) for k in range(4))
    assert np.allclose(force, plain * (1.0 - 0.1 * torn))
    assert 2.0 < torn[-1] < 3.0


def test_fatigue_heals_with_time():
    tiring, healing = 3.0, 0.05
    time = np.linspace(0.0, 60.0, 601)
    moved = 0.3 * np.where(time < 20.0, np.sin(time) ** 2, np.sin(20.0) ** 2)
    protocol = Protocol("cycles", time, moved)
    force, plain = elastic(protocol, "cyclic-fatigue/healing", np.array([tiring, healing]))
    strain = 0.5 * ((1.0 + moved / 10.0) ** 2 - 1.0)
    rate = np.abs(np.diff(strain)) / np.diff(time)

    def lost(t: float, d: np.ndarray) -> np.ndarray:
        return tiring * (1.0 - d) * rate[min(int(t / 0.1), rate.size - 1)] - healing * d

    expected = solve_ivp(lost, (0.0, 60.0), [0.0], t_eval=time, max_step=0.02, rtol=1e-8).y[0]
    assert np.allclose(force, plain * (1.0 - expected), atol=2e-3 * plain.max())
    assert force[-1] > force[210], "it heals in the hold"
    never, _ = elastic(protocol, "cyclic-fatigue/healing", np.array([0.2, 0.0]))
    alike, _ = elastic(protocol, "cyclic-fatigue", np.array([0.2]))
    assert np.allclose(never, alike)


def test_a_matrix_stiffens_with_the_square_of_the_strain():
    model = Model()
    row = np.array([[0.0 if p.name.startswith("g_") or p.name == "E_f" else p.reference for p in model.parameters]])
    strain = 0.5 * ((1.0 + PULLED_AND_PUSHED.displacement_mm / 10.0) ** 2 - 1.0)
    force = simulate((EFFECTS["matrix-stiffening"],), PULLED_AND_PUSHED, np.array([300.0]), row)[0]
    plain = simulate((), PULLED_AND_PUSHED, np.zeros(0), row)[0]
    assert np.allclose(force, plain * np.exp(300.0 * strain**2))
