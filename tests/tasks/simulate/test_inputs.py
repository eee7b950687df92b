"""What a sensitivity study varies, and Sobol indices of it that are known."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import kstest, truncnorm

from sinew.tasks.model import Model
from sinew.tasks.model.parameters import own_parameter
from sinew.tasks.simulate.inputs import Inputs, Normal
from sinew.tasks.simulate.saltelli import saltelli
from sinew.tasks.sobol.estimate import estimator
from sinew.tasks.sobol.method import Intervals

NAMES = ("a", "b", "c", "d")
PARAMETERS = tuple(own_parameter(name, "1", 0.0, 2.0) for name in NAMES)
GROUPED = Inputs({"both": ("b", "d")})


def test_factors_stand_where_they_begin():
    assert GROUPED.factors(NAMES) == {"a": (0,), "both": (1, 3), "c": (2,)}
    assert Inputs().factors(NAMES) == {name: (j,) for j, name in enumerate(NAMES)}


@given(st.floats(0.0, 2.0), st.floats(0.2, 5.0))
def test_values_follow_the_distribution_within_the_range(mean, sd):
    inputs = Inputs(distributions={"b": Normal(mean, sd)})
    share = np.random.default_rng(1).random((500, 4))
    values = inputs.values(PARAMETERS, share)
    known = truncnorm((0.0 - mean) / sd, (2.0 - mean) / sd, loc=mean, scale=sd)
    np.testing.assert_allclose(values[:, 1], known.ppf(share[:, 1]), atol=1e-6)
    np.testing.assert_allclose(values[:, 0], 2.0 * share[:, 0])


@pytest.mark.parametrize("scrambles", [1, 4])
@pytest.mark.parametrize("second_order", [False, True])
def test_rows_of_a_group_differ_in_all_of_its_parameters_and_in_no_other(scrambles, second_order):
    model = Model()
    inputs = Inputs({"times": ("tau_1f", "tau_2f")}, {"E_f": Normal(205.0, 27.0)})
    design = saltelli(model, 128, second_order, 3, scrambles, inputs)
    assert len(design.names) == len(model.free) - 1
    assert design.block == (2 if second_order else 1) * len(design.names) + 2
    blocks = design.free_rows.reshape(128, design.block, -1)
    for number, places in enumerate(design.members):
        changed = (blocks[:, 1 + number] != blocks[:, 0]).all(axis=0)
        np.testing.assert_array_equal(np.flatnonzero(changed), places)
        np.testing.assert_array_equal(blocks[:, 1 + number][:, list(places)], blocks[:, -1][:, list(places)])
    at = [parameter.name for parameter in model.free].index("E_f")
    known = truncnorm((160 - 205) / 27, (275 - 205) / 27, loc=205, scale=27)
    assert kstest(blocks[:, [0, -1], at].ravel(), known.cdf).pvalue > 0.01
    features = design.features()
    assert np.isnan(features[..., design.names.index("times")]).all()
    assert np.isfinite(np.delete(features, design.names.index("times"), axis=-1)).all()


@pytest.mark.parametrize("scrambles", [1, 8])
def test_indices_of_groups_and_of_normal_inputs_are_the_shares_of_their_variances(scrambles):
    model = Model()
    normal = Normal(215.0, 10.0)
    inputs = Inputs({"both": ("g_2f", "g_2m")}, {"E_f": normal})
    design = saltelli(model, 1024, False, 5, scrambles, inputs)
    free = [parameter.name for parameter in model.free]
    value = {name: design.free_rows[:, free.index(name)] for name in ("E_f", "g_2f", "g_2m", "E_m")}
    outcomes = value["E_f"] + 10.0 * (value["g_2f"] + value["g_2m"]) + 0.3 * value["E_m"]
    found = estimator(design, design.features(), np.ones(len(outcomes), dtype=bool), Intervals(20, 0.95, 1)).analysis(
        outcomes
    )
    variance = {
        "E_f": truncnorm((160 - 215) / 10, (275 - 215) / 10, scale=10).var(),
        "both": 2 * 100 * 1.3**2 / 12,
        "E_m": 0.09 * 59**2 / 12,
    }
    total = sum(variance.values())
    for name, one in variance.items():
        j = design.names.index(name)
        assert found.S1[j] == pytest.approx(one / total, abs=0.02), name
        assert found.ST[j] == pytest.approx(one / total, abs=0.02), name


def test_where_rows_fail_a_group_has_no_first_order_index():
    model = Model()
    design = saltelli(model, 512, False, 5, 8, Inputs({"both": ("g_2f", "g_2m")}))
    outcomes = design.free_rows[:, 0] + np.random.default_rng(1).normal(size=len(design.rows))
    ok = np.random.default_rng(2).random(len(outcomes)) > 0.02
    found = estimator(design, design.features(), ok, Intervals(20, 0.95, 1)).analysis(np.where(ok, outcomes, np.nan))
    both = design.names.index("both")
    assert np.isnan(found.S1[both])
    assert np.isfinite(np.delete(found.S1, both)).all()
