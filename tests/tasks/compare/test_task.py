"""A comparison in a result folder: what it reads, what it leaves, and what it refuses."""

import io
import json

import numpy as np
import pytest
import xarray as xr
from matplotlib import pyplot as plt
from rich.console import Console

from sinew.runner.cluster.local import Local
from sinew.runner.errors import BadInput
from sinew.tasks.compare import figures, show
from sinew.tasks.compare.result import CompareResult
from sinew.tasks.compare.settings import Settings
from sinew.tasks.compare.task import FEWEST, _particles, run
from sinew.tasks.data.cohort import write_cohort
from sinew.tasks.data.virtual import virtual_cohort
from sinew.tasks.study.study import read_study
from sinew.tasks.study.workspace import open_workspace
from tests.tasks.posteriors import posterior_of, write_inference

NAMES = ["E_f", "E_m", "alpha_f"]
MEAN, SD = np.array([200.0, 40.0, 5000.0]), np.array([10.0, 5.0, 900.0])


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    folder = tmp_path_factory.mktemp("study")
    specimens, truth = virtual_cohort(seed=1, per_site=1, rate_hz=1.0)
    write_cohort(folder / "cohort", specimens, truth)
    (folder / "study.yaml").write_text("name: sites\nseed: 4\ncohort: cohort\ncompare: {permutations: 60}\n")
    return read_study(folder / "study.yaml")


@pytest.fixture
def workspace(study, tmp_path):
    with open_workspace(study, out=tmp_path / "out", cluster=Local(workers=1), quiet=True) as opened:
        yield opened


@pytest.fixture
def settings(study):
    return study.section(Settings)


def posteriors(workspace, shifts, *, weights=None):
    """What an inference leaves: two generations, of which the first must not matter."""
    rng = np.random.default_rng(9)
    particles = {}
    for site, shift in shifts.items():
        last = rng.normal(MEAN, SD, (40, 3)) + shift * SD
        weight = rng.dirichlet(np.full(40, 3.0)) if weights is None else weights
        particles[site] = np.stack([np.zeros((40, 3)), last]), np.stack([np.full(40, 1 / 40), weight])
    sites = {site: posterior_of([f"{site}/1"], NAMES, MEAN) for site in shifts}
    write_inference(workspace, NAMES, sites, particles)


def test_sites_are_compared_in_pairs(workspace, settings):
    posteriors(workspace, {"distal": 0.0, "middle": 0.0, "proximal": 3.0})
    run(workspace, settings)
    result = CompareResult.read(workspace.out)
    pairs = {tuple(pair.sites): pair for pair in result.pairs}
    assert list(pairs) == [("distal", "middle"), ("distal", "proximal"), ("middle", "proximal")]
    same, apart = pairs["distal", "middle"], pairs["distal", "proximal"]
    assert same.interval[0] < 0.5 < same.interval[1]
    assert same.all_parameters.p_value > 0.02
    assert apart.auc > 0.97, "proximal is higher in all parameters, and so is a component with positive loadings"
    assert apart.all_parameters.interval[0] > 0.9
    assert np.trapezoid(apart.roc.true_positive, apart.roc.false_positive) == pytest.approx(apart.auc, abs=1e-9)
    for density in result.densities.sites.values():
        assert np.trapezoid(density, result.densities.component) == pytest.approx(1.0, abs=0.05)
    kept = workspace.store.read_result("compare")
    assert kept.sizes["particle"] == 120
    assert float(kept["weight"].sum()) == pytest.approx(3.0)
    figures.draw(workspace, result)
    assert (workspace.out / "figures" / "compare.png").stat().st_size > 5000


def test_an_unchanged_comparison_is_read_back_while_its_arrays_are_there(workspace, settings):
    posteriors(workspace, {"distal": 0.0, "proximal": 3.0})
    run(workspace, settings)
    path = CompareResult.path(workspace.out)

    def mark():
        path.write_text(json.dumps(json.loads(path.read_text()) | {"note": "kept"}))

    mark()
    assert run(workspace, settings).note == "kept"
    del workspace.store.root["compare"]
    assert run(workspace, settings).note != "kept", "its arrays are gone"
    assert "compare" in workspace.store.root
    mark()
    posteriors(workspace, {"distal": 0.1, "proximal": 3.0})
    assert run(workspace, settings).note != "kept", "the particles are others"


def test_what_cannot_be_compared_is_refused(workspace, settings):
    with pytest.raises(BadInput, match="sinew infer"):
        run(workspace, settings)
    posteriors(workspace, {"distal": 0.0})
    with pytest.raises(BadInput, match="one site only"):
        run(workspace, settings)


def test_weights_that_are_none_are_refused_in_one_line(workspace, settings):
    posteriors(workspace, {"distal": 0.0, "middle": 2.0}, weights=np.append(-18.9, np.full(39, 19.9 / 39)))
    with pytest.raises(BadInput, match="the weights of the particles do not sum to 1"):
        run(workspace, settings)


def test_a_posterior_that_is_one_particle_has_wide_intervals(workspace, settings):
    """What 40 particles in 16 dimensions can come to: all the weight is on one."""
    posteriors(workspace, {"distal": 0.0, "middle": 2.0}, weights=np.eye(40)[3])
    result = run(workspace, settings)
    (pair,) = result.pairs
    for area in (pair, pair.all_parameters):
        low, high = area.interval
        assert high - low > 0.6
    assert pair.all_parameters.p_value is None
    said = io.StringIO()
    show.summary(result, workspace.out, Console(file=said, width=200))
    assert "distal: 40 particles are worth 1.0" in said.getvalue()
    assert result.densities.sites == {"distal": None, "middle": None}
    json.loads((workspace.out / "compare.json").read_text(), parse_constant=pytest.fail)
    plt.close(figures.separation(result))

    heavy = np.full(40, 0.03 / 39)
    heavy[3] = 0.97
    posteriors(workspace, {"distal": 0.0, "middle": 0.5}, weights=heavy)
    low, high = run(workspace, settings).pairs[0].interval
    assert high - low > 0.6, "DeLong's variance alone would take the heaviest particle for certain"


def test_draws_of_chains_count_as_many_as_they_are_worth():
    """Those that follow each other are alike, and copies of one draw are one particle with its weight."""
    drawn = np.repeat(np.arange(60.0), 10).reshape(2, 300, 1)
    draws = xr.Dataset({"mean": (("chain", "draw", "parameter"), drawn)}, {"parameter": ["E_f"]})
    few = _particles(draws, ["E_f"], worth=20.7)
    assert len(few.weights) == 20
    assert few.effective == pytest.approx(20.0)
    every = _particles(draws, ["E_f"], worth=1e9)
    assert every.values[:, 0].tolist() == list(range(60)), "of 600 draws, 60 are different"
    assert every.weights == pytest.approx(1 / 60)
    assert len(_particles(draws, ["E_f"], worth=1.0).weights) == FEWEST
