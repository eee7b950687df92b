"""What an inference left, as other tasks read it: posteriors of something else, and numbers that are none."""

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

import sinew
from sinew.runner.cluster.local import Local
from sinew.runner.errors import BadInput
from sinew.tasks.data.cohort import write_cohort
from sinew.tasks.data.virtual import virtual_cohort
from sinew.tasks.infer import reading
from sinew.tasks.infer.likelihood.result import PopulationMarginal, SitePosterior, SpecimenMarginal
from sinew.tasks.infer.reading import draws_of, draws_of_sites, posteriors_of
from sinew.tasks.infer.result import LikelihoodResult, particles_group
from sinew.tasks.study.workspace import open_workspace
from tests.tasks.posteriors import posterior_of, write_inference

NAMES, MEAN = ["E_f", "E_m"], [200.0, 5.0]
SITES = ("distal", "proximal")
INSIDE = (200.0, 40.0)  # of the ranges
VALUES, EQUAL = np.full((2, 4, 2), 7.0), np.full((2, 4), 0.25)


@pytest.fixture(scope="module")
def workspace(tmp_path_factory):
    folder = tmp_path_factory.mktemp("reading")
    specimens, truth = virtual_cohort(seed=1, per_site=1, rate_hz=1.0)
    write_cohort(folder / "cohort", [one for one in specimens if one.site in SITES], truth)
    (folder / "study.yaml").write_text("name: sites\nseed: 4\ncohort: cohort\n")
    study = sinew.read_study(folder / "study.yaml")
    with open_workspace(study, out=folder / "out", cluster=Local(workers=1), quiet=True) as opened:
        yield opened


def left(workspace, particles=None, names=NAMES, **changed):
    """What an inference leaves: of two sites with a specimen each, or as ``changed`` says."""
    sites = {site: posterior_of([f"{site}/1"], names, MEAN[: len(names)]) for site in SITES}
    kept = {} if names is not NAMES else dict.fromkeys(SITES, particles or (VALUES, EQUAL))
    result = write_inference(workspace, names, sites, kept)
    found = replace(result, **changed)
    found.write(workspace.out)
    return found


def site(*specimens):
    return posterior_of(list(specimens), NAMES, MEAN)


def told(**changed):
    one = site("distal/1")
    changed = {"sd": 1e200, **changed}  # so that any mean may belong to any interval
    return replace(one, parameters={**one.parameters, "E_f": replace(one.parameters["E_f"], **changed)})


def test_posteriors_of_the_study_are_read(workspace):
    left(workspace)
    found = posteriors_of(workspace)
    assert list(found.sites) == list(SITES)
    draws = draws_of_sites(workspace, found)
    assert {name: one.sizes["particle"] for name, one in draws.items()} == dict.fromkeys(SITES, 4)


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"names": ["E_f", "tau"]}, "is of the parameters E_f, tau"),
        ({"units": ["MPa", "kPa"]}, "has E_m in kPa"),
        ({"names": []}, r"is of the parameters \(none\)"),
        ({"sites": {}}, "names no site"),
        ({"sites": {"distal": site()}}, "names no specimen of the site distal"),
        ({"sites": {"distal": site("distal/9")}}, "no specimen 'distal/9'"),
        ({"sites": {"=cmd": site("distal/1")}}, "has distal/1 at the site =cmd"),
        ({"sites": {"distal": site("distal/1", "distal/1")}}, "names distal/1 twice"),
        ({"sites": {"distal": told(mean=-1.0)}}, "gives E_f a value that the model cannot have, at the site distal"),
        ({"sites": {"distal": told(mean=np.nan)}}, "gives E_f a value that the model cannot have"),
        ({"sites": {"distal": told(hdi=np.array([4.0, 1e200]))}}, "gives E_f a value that the model cannot have"),
        ({"sites": {"distal": told(hdi=np.array([4.0, np.nan]))}}, "gives E_f a value that the model cannot have"),
    ],
)
def test_posteriors_of_something_else_are_refused(workspace, changed, words):
    left(workspace, **changed)
    with pytest.raises(BadInput, match=words):
        posteriors_of(workspace)


def weights(*last):
    return VALUES, np.array([EQUAL[0], last])


@pytest.mark.parametrize(
    ("particles", "words"),
    [
        (
            (np.where(np.arange(4)[:, np.newaxis] == 3, np.nan, VALUES), EQUAL),
            "parameters holds values that are not finite",
        ),
        ((1e200 * VALUES, EQUAL), "parameters holds values that are not finite numbers"),
        (weights(0.5, 0.5, np.nan, 0.0), "weight holds values that are not finite numbers"),
        (weights(0.0, 0.0, 0.0, 0.0), "do not sum to 1"),
        (weights(-1.0, 1.0, 0.5, 0.5), "do not sum to 1"),
        (weights(1.0, 1.0, 1.0, 1.0), "do not sum to 1"),
    ],
)
def test_particles_that_no_inference_leaves_are_refused(workspace, particles, words):
    found = left(workspace, particles)
    with pytest.raises(ValueError, match=words):
        draws_of(workspace, found, "distal")


def test_a_parameter_that_is_there_twice_is_refused(workspace):
    found = left(workspace)
    dims = ("generation", "particle")
    arrays = {"parameters": ((*dims, "parameter"), VALUES), "weight": (dims, EQUAL)}
    twice = xr.Dataset(arrays, {"parameter": ["E_f", "E_f"]})
    workspace.store.write_result(particles_group("distal"), twice)
    with pytest.raises(ValueError, match="the coordinate parameter has a value twice"):
        draws_of(workspace, found, "distal")


def test_draws_of_another_site_are_refused(workspace):
    particles = {"distal": (VALUES, EQUAL), "proximal": (1.5 * VALUES, EQUAL)}
    sites = {site: posterior_of([f"{site}/1"], NAMES, MEAN) for site in SITES}
    found = write_inference(workspace, NAMES, sites, particles)
    assert set(draws_of_sites(workspace, found)) == set(SITES)
    sites = {"distal": found.sites["proximal"], "proximal": found.sites["distal"]}
    with pytest.raises(ValueError, match=r"distal: the mean E_f is .*, but .* of the draws in the store"):
        draws_of_sites(workspace, replace(found, sites=sites))
    result, dataset = by_likelihood(np.ones((1, 3, 2)))
    for mean, is_one in ((1.1, True), (2.0, False)):
        workspace.store.write_result(particles_group("distal"), dataset.assign(mean=mean * dataset["mean"]))
        if is_one:
            draws_of(workspace, result, "distal")
        else:
            with pytest.raises(ValueError, match="distal: the mean E_f is 1, but 2 of the draws in the store"):
                draws_of(workspace, result, "distal")


def test_sites_together_have_a_limit(workspace, monkeypatch):
    found = left(workspace)
    monkeypatch.setattr(reading, "MOST_BYTES", 150)
    with pytest.raises(ValueError, match="the draws of proximal and the sites before it take more than 150 bytes"):
        draws_of_sites(workspace, found)


def by_likelihood(spread):
    """A result by likelihood, and what the store then holds of a site."""
    population = dict.fromkeys(NAMES, PopulationMarginal(1.0, 0.5, 2.0, 0.2, 0.1, 0.3, 400.0, 1.0))
    sites = {"distal": SitePosterior(["distal/1"], population, 400.0, 1.0, 3, 0.0, {}, {})}
    units = ["MPa"] * 2, ["", ""]
    result = LikelihoodResult("likelihood", NAMES, *units, [], 0.95, "normal", True, 1, sites, {}, "known")
    dims, inside = ("chain", "draw"), np.tile(INSIDE, (1, 3, 1))
    arrays = {"mean": ((*dims, "parameter"), np.ones((1, 3, 2))), "new": ((*dims, "parameter"), inside)}
    arrays |= {"spread": ((*dims, "parameter"), spread)}
    arrays |= {"specimens": ((*dims, "specimen", "parameter"), inside[:, :, np.newaxis])}
    return result, xr.Dataset(arrays, {"parameter": NAMES, "specimen": ["distal/1"]})


@pytest.mark.parametrize(
    ("spread", "is_one"),
    [
        ([[1.0, 1.0], [0.0, 2.0], [1.0, 1.0]], True),
        ([[1.0, 0.0]] * 3, False),
        ([[1.0, 1.0], [-1.0, 2.0], [1.0, 1.0]], False),
    ],
)
def test_a_population_has_a_spread(workspace, spread, is_one):
    """Of a single draw it may be 0, where a population is pressed against an end of a range."""
    result, dataset = by_likelihood(np.array([spread]))
    workspace.store.write_result(particles_group("distal"), dataset)
    if is_one:
        assert draws_of(workspace, result, "distal").sizes["draw"] == 3
    else:
        with pytest.raises(ValueError, match="distal: a population has no spread"):
            draws_of(workspace, result, "distal")


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda draws: draws.assign_coords(specimen=["distal/2"]), "distal: the store has draws of distal/2"),
        (
            lambda draws: draws.assign(specimens=3 * draws["specimens"]),
            "distal/1: the mean E_f is 200, but 600 of",
        ),
        (lambda draws: draws.assign(new=-1e6 * draws["new"]), "distal: new are outside of the ranges of the study"),
        (lambda draws: draws.assign(new=draws["new"].astype(np.int16)), "distal: new holds values that are not finite"),
    ],
)
def test_draws_of_other_specimens_and_outside_of_the_ranges_are_refused(workspace, change, told):
    result, dataset = by_likelihood(np.ones((1, 3, 2)))
    each = zip(NAMES, INSIDE, strict=True)
    marginals = {"distal/1": {name: SpecimenMarginal(x, 0.1, x - 0.2, x + 0.2, True) for name, x in each}}
    result = replace(result, specimens=marginals)
    workspace.store.write_result(particles_group("distal"), dataset)
    draws_of(workspace, result, "distal")
    workspace.store.write_result(particles_group("distal"), change(dataset))
    with pytest.raises(ValueError, match=told):
        draws_of(workspace, result, "distal")
