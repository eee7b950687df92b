"""The embedded simulator with effects: against the baseline, the real solver's curves, and plain arithmetic."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import lsim

from sinew.tasks.model import Model, Protocol, Specimen
from sinew.tasks.model.effect import Effect
from sinew.tasks.model.effects import library
from sinew.tasks.model.effects.force_drift import SETTLING
from sinew.tasks.model.effects.grip_slip import CREEP
from sinew.tasks.model.effects.machine_compliance import CLOSING
from sinew.tasks.model.effects.softening import SIMO
from sinew.tasks.model.effects.time_lag import FILTER
from sinew.tasks.model.effects.toe_slack import FAMILIES, SPREAD
from sinew.tasks.model.protocols import STANDARD, cyclic, one_step, two_step
from sinew.tasks.simulate.effects import simulate_with
from sinew.tasks.simulate.uniaxial import Uniaxial
from tests.conftest import SHARED, reference_parameters

BAR = Specimen("bar", 10.0, 8.0, 4.0)
LIBRARY = library()
FORMS = [form for effect in LIBRARY.values() for form in (effect, *effect.other_forms)]
TITLES = [form.title for form in FORMS]
PULLED_AND_PUSHED = Protocol(
    "pulled and pushed",
    np.linspace(0.0, 60.0, 301),
    10.0 * np.interp(np.linspace(0.0, 60.0, 301), [0, 6, 26, 33, 40, 60], [0, 0.036, 0.036, -0.006, 0.042, 0.042]),
)


def simulate(effects: tuple[Effect, ...], protocol: Protocol, values: np.ndarray, rows: np.ndarray | None = None):
    model = Model()
    rows = reference_parameters(model)[:4] if rows is None else rows
    return simulate_with(model, effects, BAR, protocol, rows, np.tile(values, (len(rows), 1)))


def error(force: np.ndarray, expected: np.ndarray) -> np.ndarray:
    """Largest difference of each row in parts of its peak."""
    return np.abs(force - expected).max(axis=1) / np.abs(expected).max(axis=1)


def baseline(protocol: Protocol) -> np.ndarray:
    return Uniaxial().simulate(Model(), BAR, protocol, reference_parameters(Model())[:4]).force_N


HISTORIES = [*(make(10.0, 5.0) for make in STANDARD), PULLED_AND_PUSHED]


@pytest.mark.parametrize("protocol", HISTORIES, ids=lambda protocol: protocol.name)
def test_without_effects_it_is_the_baseline(protocol):
    assert error(simulate((), protocol, np.zeros(0)), baseline(protocol)).max() < 1e-12


def test_a_test_that_starts_displaced_starts_at_rest():
    shifted = replace(PULLED_AND_PUSHED, displacement_mm=PULLED_AND_PUSHED.displacement_mm + 0.1)
    assert error(simulate((), shifted, np.zeros(0)), baseline(shifted)).max() < 1e-12


@pytest.mark.parametrize("effect", FORMS, ids=TITLES)
@pytest.mark.parametrize("protocol", HISTORIES, ids=lambda protocol: protocol.name)
def test_at_null_values_an_effect_is_the_baseline(effect, protocol):
    assert error(simulate((effect,), protocol, effect.null_values), baseline(protocol)).max() < 1e-12


def test_all_effects_at_null_values_are_the_baseline():
    effects = tuple(LIBRARY.values())
    values = np.concatenate([effect.null_values for effect in effects])
    for protocol in HISTORIES:
        assert error(simulate(effects, protocol, values), baseline(protocol)).max() < 1e-12


@pytest.mark.parametrize("effect", FORMS, ids=TITLES)
def test_an_effect_is_not_inert(effect):
    force = simulate((effect,), PULLED_AND_PUSHED, effect.typical)
    assert np.isfinite(force).all()
    assert error(force, baseline(PULLED_AND_PUSHED)).max() > 5e-3


@pytest.mark.parametrize("effect", FORMS, ids=TITLES)
def test_each_parameter_of_an_effect_matters(effect):
    force = simulate((effect,), PULLED_AND_PUSHED, effect.typical)
    for column, parameter in enumerate(effect.parameters):
        values = effect.typical
        values[column] = 0.5 * (parameter.reference + parameter.maximum)
        assert error(simulate((effect,), PULLED_AND_PUSHED, values), force).max() > 1e-5, parameter.name


@st.composite
def several_effects(draw: st.DrawFn) -> tuple[tuple[Effect, ...], np.ndarray, np.ndarray]:
    """One to three effects and, within all bounds, two rows of their values and of the model's parameters."""
    effects = tuple(draw(st.lists(st.sampled_from(FORMS), min_size=1, max_size=3, unique_by=lambda e: e.slug)))
    parameters = [parameter for effect in effects for parameter in effect.parameters]

    def within(bounds):
        return [[draw(st.floats(p.minimum, p.maximum)) for p in bounds] for _ in range(2)]

    return effects, np.array(within(parameters)), np.array(within(Model().parameters))


@settings(max_examples=120, deadline=None)
@given(several_effects(), st.sampled_from([PULLED_AND_PUSHED, cyclic(10.0, 2.0)]))
def test_forces_are_finite_within_all_bounds(drawn, protocol):
    effects, values, rows = drawn
    force = simulate_with(Model(), effects, BAR, protocol, rows, values)
    assert np.isfinite(force).all()
    backwards = np.split(values, np.cumsum([len(effect.parameters) for effect in effects])[:-1], axis=1)[::-1]
    again = simulate_with(Model(), effects[::-1], BAR, protocol, rows, np.concatenate(backwards, axis=1))
    assert again.tobytes() == force.tobytes()  # the order in which effects are given does not matter
    alone = simulate_with(Model(), effects, BAR, protocol, rows[1:], values[1:])
    assert alone.tobytes() == force[1:].tobytes()  # nor do other rows


def test_a_row_does_not_depend_on_the_rows_beside_it():
    """Of all forms alone, and of some together whose forces are found by iteration: 20 pairs of rows each."""
    forms = {f"{form.slug}/{form.form}": form for form in FORMS}
    together = ("machine-compliance/closing", "softening/simo", "toe-slack/spread")
    rng = np.random.default_rng(0)
    for effects in (*((form,) for form in FORMS), tuple(forms[name] for name in together)):
        bounds = [p for effect in effects for p in effect.parameters], Model().parameters
        for _ in range(20):
            values, rows = (
                np.array([[rng.uniform(p.minimum, p.maximum) for p in every] for _ in range(2)]) for every in bounds
            )
            force = simulate_with(Model(), effects, BAR, PULLED_AND_PUSHED, rows, values)
            alone = simulate_with(Model(), effects, BAR, PULLED_AND_PUSHED, rows[1:], values[1:])
            assert alone.tobytes() == force[1:].tobytes(), [effect.slug for effect in effects]


SETS_GIVING_WAY = [*((form,) for form in FORMS if form.giving_way), (CREEP, CLOSING, LIBRARY["creep"])]
SETS_TITLES = [" and ".join(effect.name for effect in effects) for effects in SETS_GIVING_WAY]


@pytest.mark.parametrize("protocol", HISTORIES, ids=lambda protocol: protocol.name)
@pytest.mark.parametrize("effects", SETS_GIVING_WAY, ids=SETS_TITLES)
def test_nearby_rows_give_the_slopes_that_rows_in_balance_give(effects, protocol):
    model, step = Model(), 1e-5
    typical = np.concatenate([effect.typical for effect in effects])
    at = np.concatenate([reference_parameters(model)[0], typical])
    rows = np.concatenate([at[np.newaxis], at + np.diag(step * at)])
    parameters, values = np.split(rows, [len(model.parameters)], axis=1)
    balanced, nearby = (
        simulate_with(model, effects, BAR, protocol, parameters, values, nearby=each) for each in (False, True)
    )
    assert error(nearby, balanced).max() < 1e-9
    slopes = [(forces[1:] - forces[0]) / step for forces in (balanced, nearby)]
    assert np.abs(slopes[1] - slopes[0]).max() < 1e-3 * np.abs(slopes[0]).max()


def test_impossible_rows_are_nan_and_columns_are_counted():
    rows = np.tile(Model().reference, (2, 1))
    rows[1, Model().names.index("E_m")] = np.inf
    force = simulate((), PULLED_AND_PUSHED, np.zeros(0), rows)
    assert np.isfinite(force[0]).all()
    assert np.isnan(force[1]).all()
    with pytest.raises(ValueError, match="2 columns of values for 1 parameters"):
        simulate((LIBRARY["time-lag"],), PULLED_AND_PUSHED, np.zeros(2))


# ---- the machine


@pytest.mark.parametrize("compliance", [1e-5, 2e-4])
@pytest.mark.parametrize("protocol", HISTORIES, ids=lambda protocol: protocol.name)
def test_what_the_machine_takes_is_compliance_times_force(compliance, protocol):
    """The gauge length alone, pulled by what is left to it, gives the same force."""
    force = simulate((LIBRARY["machine-compliance"],), protocol, np.array([compliance]))
    for row, values in zip(force, reference_parameters(Model()), strict=False):
        left = Protocol("left", protocol.time_s, protocol.displacement_mm - compliance * row)
        alone = Uniaxial().simulate(Model(), BAR, left, values[np.newaxis]).force_N
        assert error(alone, row[np.newaxis]).max() < 1e-8


@pytest.mark.parametrize("protocol", HISTORIES, ids=lambda protocol: protocol.name)
def test_contacts_that_close_take_most_at_small_forces(protocol):
    at_rest, closing = 3e-4, 200.0
    force = simulate((CLOSING,), protocol, np.array([at_rest, closing]))
    assert np.isfinite(simulate((CLOSING,), protocol, np.array([2e-3, 150.0]))).all()  # far from a straight spring
    taken = at_rest * closing * np.sign(force) * (1.0 - np.exp(-np.abs(force) / closing))
    for row, lost, values in zip(force, taken, reference_parameters(Model()), strict=False):
        left = Protocol("left", protocol.time_s, protocol.displacement_mm - lost)
        alone = Uniaxial().simulate(Model(), BAR, left, values[np.newaxis]).force_N
        assert error(alone, row[np.newaxis]).max() < 1e-8


@pytest.mark.parametrize("protocol", HISTORIES, ids=lambda protocol: protocol.name)
def test_slip_is_lost_for_good_and_in_balance_with_the_force(protocol):
    per_force, per_impulse = 1e-4, 1e-6
    force = simulate((LIBRARY["grip-slip"],), protocol, np.array([per_force, per_impulse]))
    pull = np.maximum(force, 0.0)
    slip = per_force * np.maximum.accumulate(pull, axis=1)
    slip += per_impulse * np.cumsum(pull * np.diff(protocol.time_s, prepend=0.0), axis=1)
    assert (np.diff(slip, axis=1) >= 0.0).all()
    for row, values in enumerate(reference_parameters(Model())[:4]):
        left = Protocol("left", protocol.time_s, protocol.displacement_mm - slip[row])
        alone = Uniaxial().simulate(Model(), BAR, left, values[np.newaxis]).force_N
        assert error(alone, force[[row]]).max() < 1e-8


@pytest.mark.parametrize("protocol", HISTORIES, ids=lambda protocol: protocol.name)
def test_grips_hold_up_to_a_part_of_the_force_without_slip(protocol):
    rate, part = 1e-4, 0.7
    force = simulate((CREEP,), protocol, np.array([rate, part]))
    held = part * baseline(protocol).max(axis=1, keepdims=True)
    slip = rate * np.cumsum(np.maximum(force - held, 0.0) * np.diff(protocol.time_s, prepend=0.0), axis=1)
    assert (slip[:, -1] > 0.01).any()
    for row, values in enumerate(reference_parameters(Model())[:4]):
        left = Protocol("left", protocol.time_s, protocol.displacement_mm - slip[row])
        alone = Uniaxial().simulate(Model(), BAR, left, values[np.newaxis]).force_N
        assert error(alone, force[[row]]).max() < 1e-8


def test_area_drift_and_lag_act_on_the_reading():
    protocol = one_step(10.0, 5.0)
    expected = baseline(protocol)
    force = simulate((LIBRARY["area-error"],), protocol, np.array([1.2]))
    assert np.allclose(force, 1.2 * expected, rtol=1e-12)
    force = simulate((LIBRARY["force-drift"],), protocol, np.array([-7.0, 0.03]))
    assert np.allclose(force, expected - 7.0 + 0.03 * protocol.time_s, rtol=1e-12)
    force = simulate((LIBRARY["time-lag"],), protocol, np.array([0.6]))
    assert np.allclose(force[:, 3:], expected[:, :-3], rtol=1e-9, atol=1e-9)
    force = simulate((SETTLING,), protocol, np.array([-7.0, 20.0, 40.0]))
    assert np.allclose(force, expected - 7.0 + 20.0 * (1.0 - np.exp(-protocol.time_s / 40.0)), rtol=1e-12)


def test_a_filter_is_of_the_first_order():
    protocol = cyclic(10.0, 5.0)
    expected = baseline(protocol)
    force = simulate((FILTER,), protocol, np.array([0.4]))
    for row, unfiltered in zip(force, expected, strict=True):
        _, filtered, _ = lsim(([1.0], [0.4, 1.0]), unfiltered, protocol.time_s)
        assert np.abs(row - filtered).max() < 1e-9 * np.abs(expected).max()
    uneven = Protocol("thinned", np.delete(protocol.time_s, 7), np.delete(protocol.displacement_mm, 7))
    thinned = simulate((FILTER,), uneven, np.array([0.4]))
    assert error(thinned, np.delete(force, 7, axis=1)).max() < 2e-3


# ---- fibres


def test_fibres_that_are_recruited_one_after_the_other_are_the_mean_of_slack_ones():
    """Stresses add up, and the memory is linear in them, so the force is the mean of bars of one slack each."""
    protocol = cyclic(10.0, 5.0)
    rows = reference_parameters(Model())[:4]
    force = simulate((SPREAD,), protocol, np.array([0.99, 0.6]), rows)
    slack = 1.0 - 0.01 * (1.0 + 0.6 * (2.0 * (np.arange(400) + 0.5) / 400 - 1.0))
    alone = [simulate((LIBRARY["toe-slack"],), protocol, np.array([each]), rows) for each in slack]
    assert error(force, np.mean(alone, axis=0)).max() < 1e-3
    nodes, weights = np.polynomial.legendre.leggauss(FAMILIES)
    slack = 1.0 - 0.01 * (1.0 + 0.6 * nodes)
    alone = [simulate((LIBRARY["toe-slack"],), protocol, np.array([each]), rows) for each in slack]
    assert error(force, np.tensordot(0.5 * weights, alone, axes=1)).max() < 1e-12
    one = simulate((SPREAD,), protocol, np.array([0.99, 0.0]), rows)
    assert error(one, simulate((LIBRARY["toe-slack"],), protocol, np.array([0.99]), rows)).max() < 1e-12


# ---- branches


def test_viscosity_is_a_stress_in_proportion_to_the_rate():
    protocol = PULLED_AND_PUSHED
    strain = 0.5 * (BAR.stretch(protocol) ** 2 - 1.0)
    rate = np.diff(strain, prepend=0.0) / np.diff(protocol.time_s, prepend=-1.0)
    expected = baseline(protocol) + 100.0 * BAR.area_mm2 * BAR.stretch(protocol) * rate
    assert error(simulate((LIBRARY["rate-viscosity"],), protocol, np.array([100.0])), expected).max() < 1e-12


def test_fluid_flow_is_a_matrix_mode_of_its_strength_and_time():
    """As its documentation says, the baseline can take up such a pressure."""
    model = Model()
    rows = np.tile(model.reference, (2, 1))
    g, tau = model.names.index("g_2m"), model.names.index("tau_2m")
    rows[1, g] = 0.0
    values = np.array([[0.0, 10.0], [rows[0, g] * rows[0, model.names.index("E_m")], rows[0, tau]]])
    force = simulate_with(model, (LIBRARY["fluid-flow"],), BAR, PULLED_AND_PUSHED, rows, values)
    assert error(force[:1], force[1:]).max() < 1e-12


def test_times_that_depend_on_strain_are_scaled_times_in_a_hold():
    """A jump to one strain: every time is scaled by the same factor."""
    time = np.concatenate([[0.0, 1e-9], np.linspace(0.1, 50.0, 500)])
    protocol = Protocol("jump", time, np.where(time > 0, 0.3, 0.0))
    model = Model()
    rows = reference_parameters(model)[:4]
    force = simulate((LIBRARY["strain-dependent-relaxation"],), protocol, np.array([30.0]), rows)
    scaled = rows.copy()
    scaled[:, [i for i, name in enumerate(model.names) if name.startswith("tau")]] *= np.exp(
        30.0 * 0.5 * (1.03**2 - 1.0)
    )
    assert error(force, simulate((), protocol, np.zeros(0), scaled)).max() < 1e-7


def test_times_that_change_during_a_step_do_not_depend_on_the_sampling():
    """Samples of 0.1 s in a ramp of 0.6 s, against steps a hundred times as fine."""
    time = np.concatenate([np.linspace(0.0, 0.6, 7), np.linspace(0.7, 5.0, 44)])
    protocol = Protocol("ramp", time, 0.5 * np.minimum(time / 0.6, 1.0))
    fine = np.interp(np.arange(50 * 100 + 1) / 100, np.arange(time.size), time)
    finely = Protocol("ramp", fine, 0.5 * np.minimum(fine / 0.6, 1.0))
    effect = (LIBRARY["strain-dependent-relaxation"],)
    for factor in (-30.0, 30.0):
        coarse, exact = (simulate(effect, each, np.array([factor])) for each in (protocol, finely))
        assert error(coarse, exact[:, ::100]).max() < 1e-3


# ---- the real solver


def solver_curves(stem: str, protocol: str, names: list[str]) -> tuple[Protocol, np.ndarray, np.ndarray, np.ndarray]:
    """Protocol, forces ``[6, t]`` (N), model parameters and the effect's parameters of a file of the reference."""
    folder = SHARED / "reference"
    table = np.loadtxt(folder / f"{stem}.{protocol}.csv", delimiter=",", skiprows=1)
    path = folder / f"{stem}.parameters.csv"
    header = path.read_text().splitlines()[0].split(",")
    sets = np.loadtxt(path, delimiter=",", skiprows=1)
    rows, values = (sets[:, [header.index(name) for name in wanted]] for wanted in (Model().names, names))
    return Protocol(protocol, table[:, 0], table[:, 1]), 2.0 * table[:, 2:].T, rows, values


SAME_FORM = {
    "fiber_prestretch": (LIBRARY["toe-slack"], ["stretch"]),
    "fiber_damage_weibull": (LIBRARY["softening"], ["Dmax", "alpha", "mu"]),
    "fiber_damage_simo": (SIMO, ["a", "b"]),
    "fourth_relaxation_mode": (LIBRARY["relaxation-mode"], ["g_4f", "tau_4f"]),
    "toe_exponent": (LIBRARY["toe-exponent"], ["beta"]),
}


@pytest.mark.shared
@pytest.mark.parametrize("stem", SAME_FORM)
@pytest.mark.parametrize("protocol", ["one_step", "two_step", "cyclic"])
def test_matches_the_real_solver(stem, protocol):
    effect, names = SAME_FORM[stem]
    history, expected, rows, values = solver_curves(stem, protocol, names)
    force = simulate_with(Model(), (effect,), BAR, history, rows, values, sudden=True)
    assert error(force, expected).max() < 1e-6


@pytest.mark.shared
@pytest.mark.parametrize("protocol", ["one_step", "two_step", "cyclic"])
def test_preload_matches_the_real_solver(protocol):
    history, expected, rows, values = solver_curves("fiber_prestretch", protocol, ["stretch"])
    taut = values[:, 0] > 1.0
    force = simulate_with(Model(), (LIBRARY["preload"],), BAR, history, rows[taut], values[taut], sudden=True)
    assert taut.sum() == 3
    assert error(force, expected[taut]).max() < 1e-6


@pytest.mark.shared
@pytest.mark.parametrize("protocol", ["one_step", "two_step", "cyclic"])
def test_permanent_set_is_near_the_real_solver(protocol, capsys):
    """The solver yields by the von Mises stress in three dimensions; the embedded form knows the axis only."""
    history, expected, rows, values = solver_curves("matrix_plasticity", protocol, ["Y0", "Ymax"])
    own = np.column_stack([np.full(6, 0.85), values[:, 0], values[:, 1] - values[:, 0]])
    force = simulate_with(Model(), (LIBRARY["permanent-set"],), BAR, history, rows, own)
    deviation = error(force, expected)
    size = error(simulate_with(Model(), (), BAR, history, rows, np.zeros((6, 0))), expected)
    with capsys.disabled():
        print(
            f"\npermanent-set, {protocol}: deviates by {deviation.max():.1%} of the peak; "
            f"the effect itself is {size.max():.1%}"
        )
    assert deviation.max() < 0.02
    visible = size > 1e-3
    assert (deviation[visible] < 0.35 * size[visible]).all()


# ---- rest


def test_prestretch_is_relaxed_at_rest_and_sudden_when_asked():
    protocol = two_step(10.0, 5.0)
    model, preload = Model(), (LIBRARY["preload"],)
    rows = reference_parameters(model)[:4]
    values = np.full((4, 1), 1.005)
    relaxed = simulate_with(model, preload, BAR, protocol, rows, values)
    sudden = simulate_with(model, preload, BAR, protocol, rows, values, sudden=True)
    assert (relaxed[:, 0] > 1.0).all()
    assert (sudden[:, 0] == 0.0).all()
    assert (sudden[:, 1] > 1.5 * relaxed[:, 1]).all()
    assert (np.abs(sudden - relaxed)[:, -1] < 0.2 * np.abs(sudden - relaxed)[:, 1]).all()
