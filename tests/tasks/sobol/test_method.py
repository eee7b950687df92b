"""Sobol indices against known answers, against SALib, and with rows that failed."""

import numpy as np
import pytest
import SALib.analyze.sobol as salib_analyze
import SALib.sample.sobol as salib_sample
import SALib.test_functions.Ishigami as ishigami
from hypothesis import given, settings
from hypothesis import strategies as st
from SALib.test_functions import Sobol_G

from sinew.tasks.model import Model, Parameter
from sinew.tasks.simulate.saltelli import Design, base_samples, saltelli
from sinew.tasks.sobol.method import Bootstrap, analyse, convergence, indices, indices_if_failed_had
from sinew.tasks.sobol.result import KEYS

ISHIGAMI = {"num_vars": 3, "names": ["x1", "x2", "x3"], "bounds": [[-np.pi, np.pi]] * 3}
# Ishigami and Homma (1990) with a = 7, b = 0.1
FIRST = np.array([0.3139, 0.4424, 0.0])
TOTAL = np.array([0.5576, 0.4424, 0.2437])
Z = 1.959963984540054


def ishigami_design(base: int, *, second_order: bool = False) -> tuple[Design, np.ndarray]:
    rows = salib_sample.sample(ISHIGAMI, base, calc_second_order=second_order, seed=3)
    return Design(("x1", "x2", "x3"), base, second_order, rows), ishigami.evaluate(rows)


def test_known_answers_lie_in_their_intervals():
    design, output = ishigami_design(4096)
    whole = np.ones(4096, dtype=bool)
    found = indices(design.blocks(output[:, np.newaxis], whole), Bootstrap(300, 0.95, 5).weights(4096), Z)
    assert np.allclose(found["S1"][:, 0], FIRST, atol=0.01)
    assert np.allclose(found["ST"][:, 0], TOTAL, atol=0.01)
    assert (np.abs(found["S1"][:, 0] - FIRST) <= 1.5 * found["S1_conf"][:, 0] + 1e-4).all()
    assert (np.abs(found["ST"][:, 0] - TOTAL) <= 1.5 * found["ST_conf"][:, 0] + 1e-4).all()


@settings(max_examples=15, deadline=None)
@given(st.integers(2, 6), st.integers(3, 6), st.integers(0, 2**31))
def test_many_outputs_at_once_equal_salib_one_at_a_time(power, outputs, seed):
    base = 2**power
    design, _ = ishigami_design(base)
    rng = np.random.default_rng(seed)
    columns = rng.normal(size=(len(design.rows), outputs)) * 10 ** rng.uniform(-3, 3, outputs) + rng.normal(
        size=outputs
    )
    boot = Bootstrap(40, 0.95, seed)
    found = indices(design.blocks(columns, np.ones(base, dtype=bool)), boot.weights(base), Z)
    for m in range(outputs):
        expected = salib_analyze.analyze(
            design.problem, columns[:, m], False, num_resamples=40, seed=Bootstrap(40, 0.95, seed).salib_seed
        )
        for key in KEYS:
            assert np.allclose(found[key][:, m], expected[key], rtol=1e-7, atol=1e-9), key


def test_second_order_indices_come_from_salib():
    design, output = ishigami_design(4096, second_order=True)
    found = analyse(design, output, np.ones(4096, dtype=bool), Bootstrap(50, 0.95, 0))
    assert found.S2[0, 2] == pytest.approx(0.2437, abs=0.01)  # the only interaction of this function
    assert abs(found.S2[0, 1]) < 0.01


def test_an_output_that_does_not_vary_has_no_indices_and_spoils_no_others():
    design, output = ishigami_design(64)
    columns = np.column_stack([np.full(len(output), 3.7), output])
    found = indices(design.blocks(columns, np.ones(64, dtype=bool)), Bootstrap(20, 0.95, 0).weights(64), Z)
    for key in KEYS:
        assert np.isnan(found[key][:, 0]).all()
        assert np.isfinite(found[key][:, 1]).all()
    assert np.isnan(analyse(design, columns[:, 0], np.ones(64, dtype=bool), Bootstrap(20, 0.95, 0)).S1).all()


def test_the_first_half_of_a_doubled_design_is_the_design():
    model = Model()
    small, large = saltelli(model, 32, False, 9), saltelli(model, 64, False, 9)
    assert np.array_equal(large.rows[: len(small.rows)], small.rows)
    assert not np.array_equal(saltelli(model, 32, False, 10).rows, small.rows)


def test_a_design_stays_within_the_bounds_and_moves_one_parameter_at_a_time():
    model = Model()
    design = saltelli(model, 16, False, 1)
    low = [parameter.minimum for parameter in model.parameters]
    high = [parameter.maximum for parameter in model.parameters]
    assert (design.rows >= low).all()
    assert (design.rows <= high).all()
    blocks = design.rows.reshape(16, design.block, -1)
    for j in range(16):
        changed = blocks[:, 1 + j] != blocks[:, 0]
        assert not np.delete(changed, j, axis=1).any()


def test_fixed_parameters_stay_at_their_value():
    fixed = Parameter("nu_m", "1", 0.3, 0.3, 0.3, "")
    design = saltelli(Model().with_parameter(fixed), 8, False, 1)
    assert design.names == Model().names[:-1]
    assert (design.rows[:, -1] == 0.3).all()


@pytest.mark.parametrize(
    ("points", "parameters", "second_order", "base"),
    [
        (20_000, 16, False, 2048),
        (36_864, 16, False, 2048),
        (36_865, 16, False, 4096),
        (20_000, 16, True, 1024),
        (1, 3, False, 2),
    ],
)
def test_points_are_rounded_up_to_a_power_of_two(points, parameters, second_order, base):
    assert base_samples(points, parameters, second_order) == base


def test_failed_rows_leave_out_their_base_samples_only():
    design, output = ishigami_design(2048)
    ok = np.ones(len(output), dtype=bool)
    ok[np.random.default_rng(0).choice(len(output), 30, replace=False)] = False
    output = np.where(ok, output, np.nan)
    whole = ok.reshape(2048, design.block).all(axis=1)
    found = indices(design.blocks(output[:, np.newaxis], whole), Bootstrap(100, 0.95, 0).weights(int(whole.sum())), Z)
    assert np.allclose(found["ST"][:, 0], TOTAL, atol=0.03)
    reported = indices_if_failed_had(design, output, ok)
    for key in ("S1", "ST"):
        filled = np.stack([reported[f"{key}_if_{value}"] for value in ("smallest", "mean", "largest")])
        assert np.abs(filled - found[key][:, 0]).max() < 0.1
        assert (np.ptp(filled, axis=0) > 0).all()
    assert indices_if_failed_had(design, output, np.ones_like(ok)) == {}


def test_intervals_cover_the_truth_about_as_often_as_they_say():
    """95 % intervals of the total index of Sobol's g-function over repeated, independently scrambled designs."""
    a = np.array([0.0, 1.0, 4.5, 9.0])
    truth = Sobol_G.total_sensitivity_index(a)
    problem = {"num_vars": 4, "names": list("abcd"), "bounds": [[0, 1]] * 4}
    hits = []
    for seed in range(60):
        rows = salib_sample.sample(problem, 256, calc_second_order=False, seed=seed)
        design = Design(tuple("abcd"), 256, False, rows)
        output = Sobol_G.evaluate(rows, a)[:, np.newaxis]
        found = indices(design.blocks(output, np.ones(256, dtype=bool)), Bootstrap(200, 0.95, seed).weights(256), Z)
        hits.append(np.abs(found["ST"][:, 0] - truth) <= found["ST_conf"][:, 0])
    assert np.mean(hits) >= 0.93  # quasi-random designs err less than the bootstrap, which knows nothing of them, says


def test_intervals_have_the_width_of_their_confidence():
    assert Bootstrap(10, 0.95, 0).z == pytest.approx(1.95996, abs=1e-5)
    assert Bootstrap(10, 0.9, 0).z == pytest.approx(1.64485, abs=1e-5)


def test_a_seed_draws_the_same_resamples_in_every_version():
    assert Bootstrap(3, 0.95, 4).weights(5).tolist() == [[1, 1, 1, 1, 1], [1, 0, 2, 1, 1], [2, 0, 0, 1, 2]]


def test_rounding_errors_are_no_variation_and_small_numbers_may_be():
    design, output = ishigami_design(64)
    noise = np.random.default_rng(0).normal(size=len(output))
    columns = np.column_stack([1e6 + 1e-8 * noise, 1e-9 * output, 1e150 * output, 100.0 + output, output])
    found = indices(design.blocks(columns, np.ones(64, dtype=bool)), Bootstrap(20, 0.95, 0).weights(64), Z)
    for key in KEYS:
        assert np.isnan(found[key][:, 0]).all(), key
        assert np.allclose(found[key][:, 1:4], found[key][:, 4:]), "indices have no units"
    whole = np.ones(64, dtype=bool)
    assert np.isnan(analyse(design, columns[:, 0], whole, Bootstrap(20, 0.95, 0)).ST).all()
    for at in (1, 3):
        assert np.allclose(analyse(design, columns[:, at], whole, Bootstrap(20, 0.95, 0)).ST, found["ST"][:, at])


def test_an_output_of_zeros_has_no_indices():
    design, output = ishigami_design(8)
    assert np.isnan(analyse(design, 0.0 * output, np.ones(8, dtype=bool), Bootstrap(20, 0.95, 0)).S1).all()


def test_a_resample_without_variation_warns_nobody():
    blocks = np.array([[[1.0], [3.0], [1.0]], [[0.0], [5.0], [2.0]], [[1.0], [2.0], [4.0]]])  # A, AB and B
    only_the_first = np.array([[3.0, 0.0, 0.0], [1.0, 1.0, 1.0]])
    found = indices(blocks, only_the_first, Z)
    assert np.isfinite(found["ST"]).all()
    assert np.isnan(found["ST_conf"]).all()


def test_the_analysis_of_one_output_uses_its_bootstrap():
    design, output = ishigami_design(64)
    boot = Bootstrap(50, 0.9, 7)
    whole = np.arange(64) != 5
    one = analyse(design, output, whole, boot)
    many = indices(design.blocks(output[:, np.newaxis], whole), boot.weights(63), boot.z)
    for key in KEYS:
        assert np.allclose(getattr(one, key), many[key][:, 0]), key
    assert one.S2 is None


def test_outcomes_of_whole_base_samples_are_numbers():
    design, output = ishigami_design(8)
    output[3] = np.nan
    with pytest.raises(ValueError, match=r"^outcomes of whole base samples must be numbers$"):
        analyse(design, output, np.ones(8, dtype=bool), Bootstrap(20, 0.95, 0))


def test_a_convergence_begins_with_32_base_samples_and_ends_with_all():
    design, output = ishigami_design(128)
    whole = np.arange(128) % 10 != 3
    boot = Bootstrap(20, 0.95, 0)
    curve = convergence(design, output, whole, boot)
    assert curve.base_samples == [32, 64, 128]
    for size, at in zip(curve.base_samples, range(3), strict=True):
        blocks = design.blocks(output[:, np.newaxis], whole & (np.arange(128) < size))
        found = indices(blocks, boot.weights(len(blocks)), boot.z)
        for key in KEYS:
            assert np.array_equal(getattr(curve, key)[at], found[key][:, 0]), (size, key)


def test_a_convergence_of_few_base_samples_has_one_point():
    design, output = ishigami_design(16)
    assert convergence(design, output, np.ones(16, dtype=bool), Bootstrap(20, 0.95, 0)).base_samples == [16]


def test_a_convergence_leaves_out_sizes_with_less_than_two_whole_base_samples():
    design, output = ishigami_design(128)
    boot, number = Bootstrap(20, 0.95, 0), np.arange(128)
    assert convergence(design, output, number >= 31, boot).base_samples == [64, 128]
    assert convergence(design, output, number >= 30, boot).base_samples == [32, 64, 128]
