"""Cohorts drawn from the prior."""

from dataclasses import replace

import numpy as np
import pytest

from sinew.runner.errors import BadInput
from sinew.tasks.benchmark.infer.drawn import Conditions, drawn
from sinew.tasks.benchmark.infer.drawn import tests_of as chosen
from sinew.tasks.model import Model
from sinew.tasks.model.parameters import to_unit
from sinew.tasks.simulate.uniaxial import Uniaxial

FEW = Conditions(per_site=2, tests=("one_step",), rate_hz=1.0, noise=0.01)


@pytest.mark.parametrize("heavy", [False, True])
def test_specimens_are_within_the_ranges_and_follow_from_the_seed(heavy):
    model = Model()
    specimens, truth = drawn(np.random.default_rng(1), model, FEW, by_likelihood=True, heavy=heavy)
    again, same = drawn(np.random.default_rng(1), model, FEW, by_likelihood=True, heavy=heavy)
    assert [one.name for one in specimens] == ["first/1", "first/2", "second/1", "second/2"]
    np.testing.assert_array_equal(truth.mean, same.mean)
    np.testing.assert_array_equal(specimens[0].curves[0].force_N, again[0].curves[0].force_N)
    at = np.array(list(truth.specimens.values()))
    assert at.shape == (4, len(model.free)) and (at >= 0).all() and (at <= 1).all()
    assert (truth.spread > 0).all()
    assert truth.further.shape == (2, len(model.free)) and (truth.further >= 0).all() and (truth.further <= 1).all()
    assert not np.isin(truth.further[:, 0], at[:, 0]).any()


@pytest.mark.parametrize("more", [{"effect": "force-drift"}, {"screw": 0.02}])
def test_specimens_may_have_more_than_the_model(more):
    model = Model()
    bare, truth = drawn(np.random.default_rng(2), model, FEW, by_likelihood=True, heavy=False)
    conditions = replace(FEW, **more)
    found, same = drawn(np.random.default_rng(2), model, conditions, by_likelihood=True, heavy=False)
    np.testing.assert_array_equal(truth.specimens["first/1"], same.specimens["first/1"])
    apart = np.abs(found[0].curves[0].force_N - bare[0].curves[0].force_N)
    assert apart.max() > 0.01 * bare[0].curves[0].force_N.max()


def test_an_effect_is_of_the_library():
    with pytest.raises(BadInput, match="--effect: 'moonlight' is no effect"):
        Conditions(effect="moonlight")


def test_curves_are_those_of_the_truth_with_noise():
    model = Model()
    specimens, truth = drawn(np.random.default_rng(2), model, FEW, by_likelihood=True, heavy=False)
    specimen = specimens[0]
    low = np.array([p.minimum for p in model.parameters])
    width = np.array([p.maximum for p in model.parameters]) - low
    values = (low + width * truth.specimens[specimen.name])[np.newaxis]
    np.testing.assert_allclose(to_unit(model, values)[0], truth.specimens[specimen.name])
    curve = specimen.curves[0]
    force = Uniaxial().simulate(model, specimen, curve.protocol, values).force_N[0]
    apart = (curve.force_N - force) / force.max()
    assert 0.005 < apart.std() < 0.02


def test_without_a_population_all_specimens_are_alike():
    _, truth = drawn(np.random.default_rng(3), Model(), FEW, by_likelihood=False, heavy=False)
    for at in truth.specimens.values():
        np.testing.assert_array_equal(at, truth.mean)
    assert not truth.spread.any()


def test_an_unknown_protocol_is_refused():
    assert chosen(()) == ("one_step", "two_step", "cyclic")
    with pytest.raises(BadInput, match=r"--protocol: no protocol three_step; expected one of one_step"):
        Conditions(tests=chosen(("three_step",)))
