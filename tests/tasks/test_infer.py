"""`sinew infer` from end to end: posteriors that pyABC and ArviZ read, resumed in mid-generation, clear refusals."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time

import numpy as np
import pyabc
import pytest
import xarray as xr

from tasks.cohort import virtual_cohort, write_cohort
from tasks.infer import draws
from tasks.model import Curve, Protocol
from tasks.model.protocols import cyclic
from tasks.observations import first_cycle
from tests.runner.test_store import contents
from tests.tasks.test_pipeline import new_simulations, sinew

STUDY = """
name: inferred
seed: 5
cohort: cohort
tasks: [calibrate, infer, predict, compare]
calibrate: {methods: [least_squares], evaluations: 60, starts: 1}
infer: {population: 12, generations: 3, epsilon: 0.5, pending: 16}
"""


@pytest.fixture(scope="module")
def calibrated(tmp_path_factory):
    """A study whose cohort is calibrated in ``out``."""
    folder = tmp_path_factory.mktemp("calibrated")
    specimens, truth = virtual_cohort(seed=1, per_site=2, rate_hz=1.0)
    write_cohort(folder / "cohort", [s for s in specimens if s.site != "middle"], truth)
    (folder / "study.yaml").write_text(STUDY)
    sinew("calibrate", folder / "study.yaml", "--out", folder / "out", "--quiet")
    return folder


@pytest.fixture
def study(calibrated, tmp_path):
    """A copy of it: a test may change what it likes."""
    shutil.copytree(calibrated, tmp_path, dirs_exist_ok=True)
    return tmp_path / "study.yaml"


def test_the_tail_of_the_pipeline_runs_and_its_results_open(study, tmp_path, capsys):
    out = tmp_path / "out"
    sinew("run", study, "--out", out, "--workers", 1)
    told = capsys.readouterr().out
    result = json.loads((out / "infer.json").read_text())
    assert set(result["sites"]) == {"distal", "proximal"}
    for site, found in result["sites"].items():
        assert site in told
        assert found["epsilon"] == sorted(found["epsilon"], reverse=True)
        assert found["epsilon"][0] == 0.5
        assert len(found["generations"]) == 3
        assert [generation["accepted"] for generation in found["generations"]] == [12, 12, 12]
        asked, judged = (np.cumsum([g[what] for g in found["generations"]]) for what in ("asked", "judged"))
        assert ((judged <= asked) & (asked <= judged + 16)).all()
        particles = xr.open_zarr(out / "store.zarr", group=f"infer/{site}", consolidated=False).load()
        assert particles["parameters"].dims == ("generation", "particle", "parameter")
        assert particles["weight"].sum("particle").values == pytest.approx(1.0)
        assert (particles["distance"] <= particles["epsilon"]).all()
        mean = float(particles["weight"].values[-1] @ particles["parameters"].sel(parameter="E_f").values[-1])
        assert found["parameters"]["E_f"]["mean"] == pytest.approx(mean)
        low, high = found["parameters"]["E_f"]["hdi"]
        assert low <= high

        history = pyabc.History(f"sqlite:///{out}/infer/{site}.db", create=False)
        frame, _ = history.get_distribution(m=0)
        assert len(frame) == 12
        assert sorted(frame["E_f"]) == pytest.approx(sorted(particles["parameters"].sel(parameter="E_f").values[-1]))
        history.done()
        with xr.open_dataset(out / "infer" / f"{site}.nc", group="posterior", engine="h5netcdf") as posterior:
            assert posterior["E_f"].dims == ("chain", "draw")
            assert float(posterior["E_f"].mean()) == pytest.approx(mean, rel=0.02)
    for name in ("infer_distal_marginals", "infer_distal_joint", "infer_proximal_thresholds"):
        assert (out / "figures" / f"{name}.png").stat().st_size > 5000
    for name in ("predict", "compare"):
        assert (out / f"{name}.json").is_file()
    table = (out / "infer.csv").read_text().splitlines()
    assert table[0].startswith("parameter,unit,distal_mean,distal_sd,distal_hdi_low,distal_hdi_high,proximal_mean")
    assert len(table) == 17

    first = (out / "infer.json").read_bytes()
    (out / "infer.json").unlink()
    sinew("infer", study, "--out", out, "--quiet")
    assert new_simulations(out)[-1] == 0, "its rows are in the store"
    assert (out / "infer.json").read_bytes() == first

    study.write_text(STUDY.replace("population: 12, generations: 3", "sampler: dask, population: 6, generations: 2"))
    sinew("infer", study, "--out", out, "--quiet")
    assert new_simulations(out)[-1] == 0, "pyABC's own sampler stores no rows"
    theirs = json.loads((out / "infer.json").read_text())
    assert (result["sampler"], theirs["sampler"]) == ("store", "dask")
    for site, found in theirs["sites"].items():
        assert [generation["accepted"] for generation in found["generations"]] == [6, 6]
        assert all(g["judged"] <= g["asked"] for g in found["generations"])
        mean, known = found["parameters"]["E_f"]["mean"], result["sites"][site]["parameters"]["E_f"]
        assert mean == pytest.approx(known["prior_mean"], abs=3 * known["prior_sd"])


def test_killed_in_mid_generation_it_ends_with_the_same_bytes(study, tmp_path):
    study.write_text(STUDY.replace(", predict, compare", ""))
    cut = tmp_path / "out"
    shutil.copytree(cut, tmp_path / "whole")
    sinew("run", study, "--out", tmp_path / "whole", "--quiet")
    command = [sys.executable, "-m", "tasks.cli", "run", str(study), "--out", str(cut), "--quiet"]
    process = subprocess.Popen(command, start_new_session=True)
    journal = cut / "journal"
    until = time.monotonic() + 120
    while sum(len(list(folder.glob("rows-*"))) for folder in journal.iterdir()) < 5:
        assert process.poll() is None, "it ended before it was struck"
        assert time.monotonic() < until
        time.sleep(0.02)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    assert not (cut / "infer.json").exists()
    sinew("run", study, "--out", cut, "--quiet")
    assert (cut / "infer.json").read_bytes() == (tmp_path / "whole" / "infer.json").read_bytes()
    assert contents(cut / "store.zarr") == contents(tmp_path / "whole" / "store.zarr")


@pytest.mark.parametrize(
    ("change", "out", "words"),
    [
        (("epsilon: 0.5", "epsilon: 0.0001"), "out", ["infer.epsilon", "the closest was at", "a larger epsilon"]),
        (("population: 12", "population: 12, protocols: [creep]"), "out", ["infer.protocols", "no curve of"]),
        (("[calibrate, infer, predict, compare]", "[infer]"), "new", ["calibrate.json", "`sinew calibrate`"]),
        (("[calibrate, infer, predict, compare]", "[infer, calibrate]"), "new", ["calibrate first"]),
    ],
)
def test_bad_input_is_one_line(study, tmp_path, capsys, change, out, words):
    study.write_text(STUDY.replace(*change))
    with pytest.raises(SystemExit) as ended:
        sinew("run", study, "--out", tmp_path / out, "--quiet")
    assert ended.value.code == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    for word in words:
        assert word in said


def test_pyabcs_adaptive_distance_works_and_is_kept(study, tmp_path):
    study.write_text(STUDY.replace("epsilon: 0.5", "distance: adaptive").replace(", predict, compare", ""))
    out = tmp_path / "out"
    sinew("run", study, "--out", out, "--quiet")
    first = json.loads((out / "infer.json").read_text())
    weights = first["sites"]["distal"]["distance_weights"]
    assert set(weights) == {"0", "1", "2"}
    assert weights["0"] != weights["2"], "it adapts"
    (out / "infer.json").unlink()
    sinew("run", study, "--out", out, "--quiet")
    assert json.loads((out / "infer.json").read_text()) == first


@pytest.mark.febio
@pytest.mark.timeout(900)
def test_both_simulators_lead_to_the_same_posterior(study, tmp_path):
    study.write_text(
        STUDY.replace("evaluations: 60", "evaluations: 30")
        + "compare: {permutations: 20}\nsimulator: {name: febio, time_steps: {hold_growth: 0.1}}\n"
    )
    results = []
    for engine in ("uniaxial", "febio"):
        out = tmp_path / engine
        sinew("calibrate", study, "--out", out, "--simulator", engine, "--quiet")
        found = json.loads((out / "calibrate.json").read_text())["specimens"]
        assert all(0 < told["total_N"] < np.inf for told in found.values())
        # few evaluations lead to fits that differ with the last digits of a force: priors are those of one of them
        (out / "calibrate.json").write_bytes((tmp_path / "uniaxial" / "calibrate.json").read_bytes())
        for task in ("infer", "predict", "compare"):
            sinew(task, study, "--out", out, "--simulator", engine, "--quiet")
        results.append({name: json.loads((out / f"{name}.json").read_text()) for name in ("infer", "predict")})
    embedded, solver = results
    for site, found in embedded["infer"]["sites"].items():
        for name, told in found["parameters"].items():
            beside = solver["infer"]["sites"][site]["parameters"][name]
            assert beside["mean"] == pytest.approx(told["mean"], abs=0.05 * told["prior_sd"]), (site, name)
    assert solver["predict"]["coverage"]["draws"]["all"] == pytest.approx(
        embedded["predict"]["coverage"]["draws"]["all"], abs=0.05
    )


@pytest.mark.parametrize("noise", [0.0, 0.002])
def test_the_first_cycle_ends_where_the_second_begins(noise):
    protocol = cyclic(10.0, 20.0)
    moved = protocol.displacement_mm + noise * np.random.default_rng(1).standard_normal(protocol.time_s.size)
    curve = Curve(Protocol("cyclic", protocol.time_s, moved), np.zeros(moved.size))
    cut = first_cycle(curve)
    assert cut.protocol.time_s[-1] == pytest.approx(2 * 0.02 / 0.006, abs=0.4)
    assert cut.protocol.displacement_mm.max() == pytest.approx(0.2, abs=0.01)
    hold = Curve(Protocol("hold", np.arange(10.0), np.minimum(np.arange(10.0), 3.0)), np.zeros(10))
    assert first_cycle(hold) is hold


def test_draws_of_equal_weight_have_the_weighted_mean():
    values = np.arange(5.0)[:, np.newaxis]
    weight = np.array([0.0, 0.5, 0.25, 0.25, 0.0])
    particles = xr.Dataset(
        {
            "parameters": (("generation", "particle", "parameter"), values[np.newaxis]),
            "weight": (("generation", "particle"), weight[np.newaxis]),
        }
    )
    drawn = draws(particles, 400, (1,))[:, 0]
    assert np.bincount(drawn.astype(int), minlength=5).tolist() == [0, 200, 100, 100, 0]
