"""Draws from the particles that an inference leaves."""

import json
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

from sinew.runner.errors import BadInput, StoreError
from sinew.runner.store.store import Store
from sinew.tasks.infer.abc.result import AbcResult, GenerationCounts, draws, stored_particles
from sinew.tasks.infer.abc.show import apart_from_fits, far_off, sizes, too_short
from tests.tasks.calibrations import calibration_of, fit_of
from tests.tasks.posteriors import posterior_of


def test_draws_of_equal_weight_have_the_weighted_mean():
    values = np.arange(5.0)[:, np.newaxis]
    weight = np.array([0.0, 0.5, 0.25, 0.25, 0.0])
    particles = xr.Dataset(
        {
            "parameters": (("generation", "particle", "parameter"), values[np.newaxis]),
            "weight": (("generation", "particle"), weight[np.newaxis]),
        }
    )
    drawn = draws(particles.isel(generation=-1), 400, (1,))[:, 0]
    assert np.bincount(drawn.astype(int), minlength=5).tolist() == [0, 200, 100, 100, 0]


def test_particles_worth_less_than_was_asked_for_are_told():
    counts = [GenerationCounts(300, 100, 0, 300), GenerationCounts(900, 250, 0, 900)]
    one = replace(posterior_of(["d/1"], ["E_f"], [200.0]), effective_sample_size=154.0, generations=counts)
    result = AbcResult("store", ["E_f"], ["MPa"], [""], False, "ranges", 300, 0.95, {"d": one}, "known", ess=400)
    assert too_short(result).startswith("d: the effective sample size is below the 400 that infer.ess asks for")
    assert sizes(result) == "d 154 of 250"
    for enough in (replace(result, ess=100), replace(result, ess=None)):
        assert too_short(enough) == ""
    few = replace(result, sites={"d": replace(one, effective_sample_size=50.0)})
    assert (few.few, few.short) == (["d"], [])
    assert replace(result, ess=170).short == [], "about as many as were asked for"


def test_simulations_that_describe_nothing_are_told():
    one = posterior_of(["d/1"], ["E_f"], [200.0])
    result = AbcResult("store", ["E_f"], ["MPa"], [""], False, "ranges", 300, 0.95, {"d": one}, "known")

    def told(epsilon, **changed):
        site = replace(one, epsilon=np.array([9.0, epsilon]), **changed)
        return far_off(replace(result, sites={"d": site}))

    (line,) = told(6.8)
    assert line.startswith("d: accepted simulations differ from the measured curves by up to 680 % (root mean square)")
    assert told(0.5) == []
    assert len(told(0.51)) == 1
    assert told(6.8, distance_weights={"force": np.ones(2)}) == [], "an adaptive distance is in other units"


def test_calibrated_values_far_outside_the_intervals_are_told():
    sites = {"d": posterior_of(["d/1", "d/2"], ["E_f", "E_m"], [200.0, 5.0])}  # E_f 180 to 220, E_m 4.5 to 5.5
    result = AbcResult("store", ["E_f", "E_m"], ["MPa"] * 2, ["", ""], True, "calibrated", 40, 0.95, sites, "known")

    def told(*values, determined=("E_f", "E_m")):
        fits = {f"d/{i}": fit_of(dict(zip(("E_f", "E_m"), each, strict=True)), determined=list(determined))
                for i, each in enumerate(values, 1)}  # fmt: skip
        return apart_from_fits(result, calibration_of(fits))

    assert told((229.0, 4.3), (229.0, 4.3)) == []
    (line,) = told((240.0, 4.2), (230.0, 4.1))
    assert line.startswith("d: calibrated values of E_f, E_m lie far outside the posterior's intervals")
    assert told((260.0, 9.0), (140.0, 1.0)) == [], "specimens that differ"
    assert told((240.0, 4.2), (230.0, 4.1), determined=()) == []
    assert apart_from_fits(result, None) == []


def test_posteriors_that_leave_the_ranges_of_the_study_are_named():
    sites = {name: posterior_of([f"{name}/1"], ["E_f", "nu_m"], [mean, 0.2]) for name, mean in (("d", 200), ("p", 240))}
    result = AbcResult("store", ["E_f", "nu_m"], ["MPa", "1"], ["", ""], True, "calibrated", 40, 0.95, sites, "known")
    assert result.beyond(["E_f", "nu_m"], [(160.0, 275.0), (0.0, 0.4)]) == []
    (line,) = result.beyond(["E_f", "tau"], [(160.0, 250.0), (0.0, 0.1)])
    assert line == "p: E_f 216 to 264 leaves the study's range 160 to 250 (the prior is normal, and has no ends)"
    assert len(result.beyond(["E_f", "nu_m"], [(190.0, 300.0), (0.19, 0.4)])) == 3


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ({"sd": -1.0}, "sd: -1.0: expected at least 0"),
        ({"hdi": [9.0, 1.0]}, "hdi: expected two numbers, the lower one first"),
        ({"hdi": [9.0]}, "hdi: expected two numbers, the lower one first"),
        ({"mean": 3e5}, r"a mean of 300000 with a standard deviation of 10 and an interval 180 to 220"),
        ({"mean": 160.0}, r"a mean of 160 with a standard deviation of 10 and an interval 180 to 220"),
    ],
)
def test_a_marginal_that_cannot_be_is_refused(tmp_path, change, problem):
    result = AbcResult(
        sampler="store", names=["E_f"], units=["MPa"], meanings=[""], paper=True, priors="ranges", population=4,
        interval=0.95, sites={"distal": posterior_of(["distal/1"], ["E_f"], [200.0])}, inputs="",
    )  # fmt: skip
    result.write(tmp_path)
    path = tmp_path / "infer.json"
    assert AbcResult.read(tmp_path).population == 4
    content = json.loads(path.read_text())
    content["sites"]["distal"]["parameters"]["E_f"] |= change
    path.write_text(json.dumps(content))
    with pytest.raises(BadInput, match=problem):
        AbcResult.read(tmp_path)


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ({"names": ["E_f", "E_f"], "units": ["MPa"] * 2, "meanings": [""] * 2}, "names: E_f stands twice"),
        ({"names": ["E_m"]}, "distal: E_f is not both a parameter and a marginal"),
        ({"names": ["E_f", "E_m"], "units": ["MPa"] * 2, "meanings": [""] * 2}, "distal: E_m is not both a parameter"),
        ({"units": []}, "units: 0 of 1 parameters"),
        ({"meanings": ["", ""]}, "meanings: 2 of 1 parameters"),
    ],
)
def test_names_units_and_marginals_that_do_not_belong_together_are_refused(change, problem):
    site = {"distal": posterior_of(["distal/1"], ["E_f"], [200.0])}
    result = AbcResult("store", ["E_f"], ["MPa"], [""], True, "ranges", 4, 0.95, site, "known")
    with pytest.raises(ValueError, match=problem):
        replace(result, **change)


@pytest.mark.parametrize(
    ("weight", "names"),
    [([0.5, 0.5], "ab"), ([1.5, -0.5], "ab"), ([0.5, 0.4], "ab"), ([np.nan, 1.0], "ab"), ([0.5, 0.5], "ba")],
)
def test_particles_of_the_store_have_weights_and_the_parameters_of_the_result(tmp_path, weight, names):
    dims = ("generation", "particle", "parameter")
    values = xr.Dataset({"parameters": (dims, np.zeros((1, 2, 2))), "weight": (dims[:2], [weight])})
    with Store.writing(tmp_path, "study") as store:
        store.write_result("infer/site", values.assign_coords(parameter=list(names)))
        if (weight, names) == ([0.5, 0.5], "ab"):
            assert stored_particles(store, "site", ["a", "b"]).identical(store.read_result("infer/site"))
            return
        with pytest.raises(
            StoreError, match=r"its coordinate parameter is not|weights below zero, or that do not sum to 1"
        ):
            stored_particles(store, "site", ["a", "b"])
