"""The embedded simulator against the real solver's curves and against its own equations."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sinew.runner.store.schema import STATUSES
from sinew.tasks.model import TENDON, Curve, Model, Parameter, Protocol, Specimen
from sinew.tasks.model.protocols import STANDARD, cyclic, one_step
from sinew.tasks.simulate.uniaxial import LANES, Uniaxial
from tests.conftest import reference, reference_parameters

BAR = Specimen("bar", 10.0, 8.0, 4.0)


@pytest.mark.parametrize("protocol", ["one_step", "two_step", "cyclic"])
def test_matches_the_real_solver(model, protocol):
    history, expected = reference(protocol)
    simulated = Uniaxial().simulate(model, BAR, history, reference_parameters(model))
    assert not simulated.status.any()
    error = np.abs(simulated.force_N - expected).max(axis=1) / np.abs(expected).max(axis=1)
    assert error.max() < 1e-6


def test_fibres_of_no_modulus_bear_nothing():
    model = Model().with_parameter(Parameter("E_f", "MPa", 0.0, 0.0, 0.0, "no fibres"))
    simulated = Uniaxial().simulate(model, BAR, one_step(10.0, 10.0), model.reference[np.newaxis], stresses=True)
    assert not simulated.status.any()
    assert not simulated.fibre_MPa.any()
    assert simulated.force_N.max() > 0


def plain(model: Model, specimen: Specimen, protocol: Protocol, values: np.ndarray) -> np.ndarray:
    """The equations of the design, one parameter set and one step at a time."""
    p = dict(zip(model.names, values, strict=True))
    i0, beta, alpha = model.lambda_0**2, model.beta, p["alpha_f"]
    d = 4 * i0**1.5 * (beta - 1 + alpha * beta * (i0 - 1) ** beta)
    xi = p["E_f"] * (i0 - 1) ** (2 - beta) * np.exp(-alpha * (i0 - 1) ** beta) / d
    b = p["E_f"] * (2 * i0 * (beta - 0.5 + alpha * beta * (i0 - 1) ** beta) - 1) / d
    terms = [[p[f"g_{i}{c}"], p[f"tau_{i}{c}"], 0.0, c] for c in "mf" for i in (1, 2, 3)]
    force, before = [], {}
    for k, t in enumerate(protocol.time_s):
        stretch = 1 + protocol.displacement_mm[k] / specimen.length_mm
        i = stretch**2
        if i <= 1:
            fibre = 0.0
        elif i < i0:
            fibre = 2 * xi * np.exp(alpha * (i - 1) ** beta) * (i - 1) ** (beta - 1)
        else:
            fibre = 2 * b - p["E_f"] / stretch
        now = {"m": p["E_m"] * (i - 1) / 2, "f": fibre}
        total = now["m"] + now["f"]
        if k:
            dt = t - protocol.time_s[k - 1]
            for term in terms:
                decay = np.exp(-dt / term[1])
                term[2] = term[2] * decay + (now[term[3]] - before[term[3]]) * (1 - decay) * term[1] / dt
                total += term[0] * term[2]
        before = now
        force.append(specimen.area_mm2 * stretch * total)
    return np.array(force)


values = st.tuples(*(st.floats(p.minimum, p.maximum) for p in TENDON)).map(np.array)


@settings(max_examples=40, deadline=None)
@given(
    values,
    st.lists(st.tuples(st.floats(0.01, 30), st.floats(-0.3, 0.6)), min_size=3, max_size=25),
    st.floats(2.0, 4.0),
)
def test_follows_its_equations_on_any_history(values, moves, beta):
    model = Model(beta=beta)
    time_s = np.cumsum([0.0] + [step for step, _ in moves])
    displacement = np.array([0.0] + [u for _, u in moves])
    history = Protocol("any", time_s, displacement)
    expected = plain(model, BAR, history, values)
    force = Uniaxial().simulate(model, BAR, history, values[np.newaxis]).force_N[0]
    assert np.allclose(force, expected, rtol=1e-9, atol=1e-9 * max(1.0, np.abs(expected).max()))


def test_full_rate_protocols_have_the_size_of_the_tests():
    assert sum(make(10.0).time_s.size for make in STANDARD) == 73_735


def test_a_row_does_not_depend_on_its_neighbours(model):
    rows = reference_parameters(model)
    rows = np.concatenate([rows, rows[::-1]])[: 2 * LANES + 7]
    history = cyclic(10.0, 10.0)
    together = Uniaxial().simulate(model, BAR, history, rows).force_N
    alone = np.concatenate([Uniaxial().simulate(model, BAR, history, row[np.newaxis]).force_N for row in rows])
    assert together.tobytes() == alone.tobytes()


def test_poisson_ratio_never_reaches_the_force(model):
    rows = np.tile(model.reference, (2, 1))
    rows[1, model.names.index("nu_m")] = 0.39
    force = Uniaxial().simulate(model, BAR, one_step(10.0, 5.0), rows).force_N
    assert force[0].tobytes() == force[1].tobytes()


def test_comparison_is_the_rmse_over_every_point(model):
    history = one_step(10.0, 10.0)
    rows = reference_parameters(model)[:5]
    force = Uniaxial().simulate(model, BAR, history, rows).force_N
    measured = force[0] + np.sin(history.time_s)
    keep = np.array([0, 17, history.time_s.size - 1])
    compared = Uniaxial().compare(model, BAR, Curve(history, measured), rows, keep)
    assert np.allclose(compared.rmse_N, np.sqrt(np.mean((force - measured) ** 2, axis=1)), rtol=1e-12)
    assert compared.force_N.tobytes() == np.ascontiguousarray(force[:, keep]).tobytes()


def test_stresses_add_up_to_the_force(model):
    history = cyclic(10.0, 5.0)
    simulated = Uniaxial().simulate(model, BAR, history, reference_parameters(model)[:3], stresses=True)
    total = BAR.area_mm2 * BAR.stretch(history) * (simulated.matrix_MPa + simulated.fibre_MPa)
    assert np.allclose(total, simulated.force_N, rtol=1e-12, atol=1e-9)


def test_a_test_that_starts_displaced_starts_relaxed(model):
    time_s = np.array([0.0, 1.0, 2.0])
    displaced = Protocol("held", time_s, np.full(3, 0.3))
    force = Uniaxial().simulate(model, BAR, displaced, model.reference[np.newaxis]).force_N[0]
    assert force[0] > 0
    assert np.allclose(force, force[0], rtol=1e-14)


def test_terms_that_have_decayed_do_not_stay_among_the_subnormal_numbers(model):
    """The smallest subnormal number times a decay above one half is itself: a term would stay there, and be slow."""
    history = Protocol("rest", np.arange(4000) * 50.0, np.append([0.0, 0.4], np.zeros(3998)))
    force = Uniaxial().simulate(model, BAR, history, model.reference[np.newaxis]).force_N[0]
    assert force[1:100].all()
    assert force[-1] == 0.0


def test_rounded_time_stamps_count_as_one_step():
    steps, step_of = one_step(10.0).distinct_steps
    assert steps.size == 1
    assert steps[0] == pytest.approx(0.01, rel=1e-12)
    assert not step_of.any()


def test_impossible_parameters_are_failed_rows_with_a_reason(model):
    rows = np.tile(model.reference, (3, 1))
    rows[1, model.names.index("tau_2f")] = 0.0
    rows[2, model.names.index("E_m")] = 1e308
    simulated = Uniaxial().simulate(model, BAR, one_step(10.0, 5.0), rows)
    assert [STATUSES[s] for s in simulated.status] == ["ok", "bad_input", "diverged"]
    assert "tau_2f = 0; expected above 0 s" in simulated.messages[1]
    assert np.isnan(simulated.force_N[1:]).all()
    assert np.isfinite(simulated.force_N[0]).all()
