"""`sinew infer` in a result folder: posteriors that pyABC and ArviZ read, resumed in mid-generation, clear refusals."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pyabc
import pytest
import xarray as xr

from sinew.runner.store.store import open_store
from sinew.tasks.calibrate.result import CalibrateResult
from sinew.tasks.data.cohort import write_cohort
from sinew.tasks.data.virtual import virtual_cohort
from sinew.tasks.infer.abc.result import AbcResult
from sinew.tasks.infer.abc.sampler import StoreSampler
from sinew.tasks.study import pipeline
from sinew.tasks.study.workspace import Workspace
from tests.runner.stores import contents
from tests.tasks.study.test_pipeline import new_simulations, sinew

STUDY = """
name: inferred
seed: 5
cohort: cohort
tasks: [calibrate, infer, predict, compare]
calibrate: {methods: [least_squares], evaluations: 60, starts: 1}
infer: {paper: true, population: 12, generations: 2, epsilon: 0.5, pending: 16}
"""


NO_TAIL = STUDY.replace(", predict, compare", "")
SHORT = STUDY.replace("population: 12, generations: 2", "population: 4, generations: 1")  # where it only has to go


@pytest.fixture(scope="module")
def calibrated(tmp_path_factory):
    """A study whose cohort is calibrated in ``out``."""
    folder = tmp_path_factory.mktemp("calibrated")
    specimens, truth = virtual_cohort(seed=1, per_site=2, rate_hz=1.0)
    write_cohort(folder / "cohort", [s for s in specimens if s.site != "middle"], truth)
    (folder / "study.yaml").write_text(STUDY)
    with pytest.MonkeyPatch.context() as patch:
        in_this_process(patch)
        sinew("calibrate", folder / "study.yaml", "--out", folder / "out", "--quiet")
    return folder


@pytest.fixture
def study(calibrated, tmp_path):
    """A copy of it: a test may change what it likes."""
    shutil.copytree(calibrated, tmp_path, dirs_exist_ok=True)
    return tmp_path / "study.yaml"


@pytest.fixture(scope="module")
def inferred(calibrated, tmp_path_factory, drawing):
    """A copy of it with an inference and what builds upon it, drawn."""
    folder = tmp_path_factory.mktemp("inferred")
    shutil.copytree(calibrated, folder, dirs_exist_ok=True)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Workspace, "client", lambda self: None)

        def of_one_site(work, name, result):
            if name == "infer":
                drawing["_draw"](work, name, replace(result, sites={"distal": result.sites["distal"]}))

        patch.setattr(pipeline, "_draw", of_one_site)
        sinew("run", folder / "study.yaml", "--out", folder / "out", "--quiet")
    return folder


def in_this_process(patch):
    """No cluster, no figures, no page."""
    patch.setattr(Workspace, "client", lambda self: None)
    patch.setattr(pipeline, "_draw", lambda *_: None)
    patch.setattr("sinew.tasks.study.pipeline.report", lambda folder, console, **_: None)


@pytest.fixture
def here(monkeypatch):
    in_this_process(monkeypatch)


def test_the_posteriors_open_in_xarray_pyabc_and_arviz(inferred):
    out = inferred / "out"
    result = AbcResult.read(out)
    assert set(result.sites) == {"distal", "proximal"}
    for site, posterior in result.sites.items():
        assert list(posterior.epsilon) == sorted(posterior.epsilon, reverse=True)
        assert posterior.epsilon[0] == 0.5
        assert [generation.accepted for generation in posterior.generations] == [12, 12]
        asked, judged = (np.cumsum([getattr(g, what) for g in posterior.generations]) for what in ("asked", "judged"))
        assert ((judged <= asked) & (asked <= judged + 16)).all()
        particles = xr.open_zarr(out / "store.zarr", group=f"infer/{site}", consolidated=False).load()
        assert particles["parameters"].dims == ("generation", "particle", "parameter")
        assert particles["weight"].sum("particle").values == pytest.approx(1.0)
        assert (particles["distance"] <= particles["epsilon"]).all()
        mean = float(particles["weight"].values[-1] @ particles["parameters"].sel(parameter="E_f").values[-1])
        marginal = posterior.parameters["E_f"]
        assert marginal.mean == pytest.approx(mean)
        assert marginal.hdi[0] <= marginal.hdi[1]

        history = pyabc.History(f"sqlite:///{out}/infer/{site}.db", create=False)
        frame, _ = history.get_distribution(m=0)
        assert len(frame) == 12
        assert sorted(frame["E_f"]) == pytest.approx(sorted(particles["parameters"].sel(parameter="E_f").values[-1]))
        history.done()
        with xr.open_dataset(out / "infer" / f"{site}.nc", group="posterior", engine="h5netcdf") as drawn:
            assert drawn["E_f"].dims == ("chain", "draw")
            assert float(drawn["E_f"].mean()) == pytest.approx(mean, rel=0.02)
    for name in ("infer_distal_marginals", "infer_distal_joint", "infer_distal_thresholds"):
        assert (out / "figures" / f"{name}.png").stat().st_size > 5000
    for name in ("predict", "compare"):
        assert (out / f"{name}.json").is_file()
    table = (out / "infer.csv").read_text().splitlines()
    assert table[0].startswith("parameter,unit,distal_mean,distal_sd,distal_hdi_low,distal_hdi_high,proximal_mean")
    assert len(table) == 17


SOUND = "infer: {priors: others, population: 20, ess: 100, generations: 2, smallest_acceptance: 0.01, pending: 16}"


def test_outside_the_papers_mode_priors_are_of_others_within_the_ranges_and_particles_are_enough(study, tmp_path, here):
    old = next(line for line in NO_TAIL.splitlines() if line.startswith("infer:"))
    study.write_text(NO_TAIL.replace(old, SOUND))
    sinew("run", study, "--out", tmp_path / "out", "--quiet")
    result = AbcResult.read(tmp_path / "out")
    assert (result.paper, result.priors) == (False, "others")
    calibrated = CalibrateResult.read(tmp_path / "out")
    bounds = dict(zip(calibrated.free, calibrated.bounds, strict=True))
    for site, posterior in result.sites.items():
        particles = open_store(tmp_path / "out").read_result(f"infer/{site}")
        values = particles["parameters"].values
        low, high = np.array([bounds[name] for name in result.names]).T
        assert (values >= low).all()
        assert (values <= high).all()
        weight = particles["weight"].values
        assert weight.sum(axis=1) == pytest.approx(1.0)
        assert weight.shape[1] > 20, "the second generation is larger"
        assert (weight[0] > 0).sum() == 20
        assert posterior.effective_sample_size > 50
        other = "proximal" if site == "distal" else "distal"
        of_others = [fit.parameters["E_f"] for fit in calibrated.specimens.values() if fit.site == other]
        assert posterior.parameters["E_f"].prior in ("normal", "uniform")
        if posterior.parameters["E_f"].prior == "normal":
            assert posterior.parameters["E_f"].prior_mean == pytest.approx(np.mean(of_others))


def test_bands_are_drawn_without_a_calibration_where_none_is_needed(study, tmp_path, here):
    old = next(line for line in STUDY.splitlines() if line.startswith("infer:"))
    text = STUDY.replace(old, "infer: {method: abc, population: 20, generations: 2, pending: 16}")
    assert text != STUDY
    study.write_text(text.replace("tasks: [calibrate, infer, predict, compare]", "tasks: [infer, predict]"))
    sinew("run", study, "--out", tmp_path / "new", "--quiet")
    result = AbcResult.read(tmp_path / "new")
    assert (result.priors, result.paper) == ("ranges", False)
    assert json.loads((tmp_path / "new" / "predict.json").read_text())["coverage"]["draws"]["all"] is not None
    first = (tmp_path / "new" / "infer.json").read_bytes()
    wider = "model: {parameters: {E_f: {min: 150, max: 285}}}\n"  # around the same middle
    study.write_text(study.read_text() + wider)
    sinew("infer", study, "--out", tmp_path / "new", "--quiet")
    assert (tmp_path / "new" / "infer.json").read_bytes() != first, "other ranges are another prior"


def test_without_another_site_there_are_no_others(study, tmp_path, here, capsys):
    old = next(line for line in NO_TAIL.splitlines() if line.startswith("infer:"))
    study.write_text(NO_TAIL.replace(old, "infer: {priors: others}"))
    for folder in (tmp_path / "cohort").glob("proximal*"):
        shutil.rmtree(folder)
    with pytest.raises(SystemExit):
        sinew("run", study, "--out", tmp_path / "new", "--quiet")
    said = capsys.readouterr().err
    assert "infer.priors: no specimen of a site other than distal is calibrated; expected ranges" in said


def test_what_is_gone_is_made_again_without_a_simulation(inferred, tmp_path, here):
    """The result, its files, its arrays: whatever is missing, the same inference is run on the stored rows."""
    shutil.copytree(inferred, tmp_path, dirs_exist_ok=True)
    study, out = tmp_path / "study.yaml", tmp_path / "out"
    first = (out / "infer.json").read_bytes()
    kept = contents(out / "store.zarr")
    for gone in ("infer.json", "infer.csv", "infer/distal.db", "infer/proximal.nc", "store.zarr/infer/distal"):
        path = out / gone
        shutil.rmtree(path) if path.is_dir() else path.unlink()
        sinew("infer", study, "--out", out, "--quiet")
        assert new_simulations(out)[-1] == 0, "its rows are in the store"
        assert path.exists(), gone
        assert (out / "infer.json").read_bytes() == first
    assert contents(out / "store.zarr") == kept


CHANGED = "its curves or sizes, the model, its ranges or its solver have changed since"


def edited(folder, specimen, **changes):
    path = folder / "cohort" / specimen / "specimen.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | changes))


def test_what_was_inferred_of_other_data_is_refused(inferred, tmp_path, here, capsys):
    shutil.copytree(inferred, tmp_path, dirs_exist_ok=True)
    study, out = tmp_path / "study.yaml", tmp_path / "out"
    for task in ("predict", "compare"):
        sinew(task, study, "--out", out, "--quiet")
    edited(tmp_path, "distal/1", thickness_mm=3.0)
    for task in ("predict", "compare"):
        with pytest.raises(SystemExit) as ended:
            sinew(task, study, "--out", out, "--quiet")
        assert ended.value.code == 2
        assert f"infer.json: distal/1: {CHANGED}; expected `sinew infer` again" in capsys.readouterr().err
    study.write_text(SHORT)
    for again in ("calibrate", "infer", "predict", "compare"):
        sinew(again, study, "--out", out, "--quiet")


@pytest.mark.thorough
def test_a_curve_that_was_not_inferred_from_may_change_and_the_inference_is_made_anew(study, tmp_path, here, capsys):
    out = tmp_path / "out"
    study.write_text(SHORT.replace("infer: {paper: true", "infer: {paper: true, protocols: [one_step]"))
    for task in ("infer", "predict"):
        sinew(task, study, "--out", out, "--quiet")
    curve = tmp_path / "cohort" / "distal" / "1" / "two_step.csv"
    curve.write_text("\n".join(curve.read_text().splitlines()[:-1]) + "\n")
    with pytest.raises(SystemExit):
        sinew("predict", study, "--out", out, "--quiet")
    assert f"infer.json: distal/1: {CHANGED}" in capsys.readouterr().err
    for again in ("calibrate", "infer", "predict"):
        sinew(again, study, "--out", out, "--quiet")


@pytest.mark.parametrize("change", ["model: {effects: [preload]}", "model: {parameters: {nu_m: {reference: 0.41}}}"])
def test_another_model_than_was_inferred_is_refused(inferred, tmp_path, here, capsys, change):
    shutil.copytree(inferred, tmp_path, dirs_exist_ok=True)
    (tmp_path / "study.yaml").write_text(f"{STUDY}{change}\n")
    with pytest.raises(SystemExit) as ended:
        sinew("compare", tmp_path / "study.yaml", "--out", tmp_path / "out", "--quiet")
    assert ended.value.code == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_what_was_calibrated_of_other_data_is_no_prior(study, tmp_path, here, capsys):
    study.write_text(SHORT)
    edited(tmp_path, "distal/1", thickness_mm=3.0)
    with pytest.raises(SystemExit) as ended:
        sinew("infer", study, "--out", tmp_path / "out", "--quiet")
    assert ended.value.code == 2
    assert f"calibrate.json: distal/1: {CHANGED}; expected `sinew calibrate` again" in capsys.readouterr().err
    for again in ("calibrate", "infer"):
        sinew(again, study, "--out", tmp_path / "out", "--quiet")


def test_digests_that_are_of_nothing_are_made_anew(study, tmp_path, here, capsys):
    study.write_text(SHORT)
    path = CalibrateResult.path(tmp_path / "out")
    content = json.loads(path.read_text())
    path.write_text(json.dumps(content | {"data": dict.fromkeys(content["data"], "0"), "inputs": "0"}))
    with pytest.raises(SystemExit):
        sinew("infer", study, "--out", tmp_path / "out", "--quiet")
    for again in ("calibrate", "infer"):
        sinew(again, study, "--out", tmp_path / "out", "--quiet")


def test_a_specimen_that_is_called_otherwise_is_so_in_all_results(inferred, tmp_path, here):
    shutil.copytree(inferred, tmp_path, dirs_exist_ok=True)
    study, out = tmp_path / "study.yaml", tmp_path / "out"
    (tmp_path / "cohort" / "distal" / "1").rename(tmp_path / "cohort" / "distal" / "1b")
    sinew("run", study, "--out", out, "--quiet")
    assert AbcResult.read(out).sites["distal"].specimens[0] == "distal/1b"
    assert "distal/1b" in CalibrateResult.read(out).specimens


def test_donors_that_become_known_are_those_of_the_correlations(study, tmp_path, here):
    before = CalibrateResult.read(tmp_path / "out")
    for number, name in enumerate(("distal/1", "distal/2", "proximal/1", "proximal/2")):
        edited(tmp_path, name, donor=str(number % 2))
    sinew("calibrate", study, "--out", tmp_path / "out", "--quiet")
    after = CalibrateResult.read(tmp_path / "out")
    assert [one.donor for one in after.specimens.values()] == ["0", "1", "0", "1"]
    assert new_simulations(tmp_path / "out")[-1] == 0, "fits do not depend on them"
    fits = [{name: dict(one.parameters) for name, one in found.specimens.items()} for found in (before, after)]
    assert fits[0] == fits[1]


def test_pyabcs_own_sampler_infers_the_same_sites(study, tmp_path, monkeypatch):
    monkeypatch.setattr(pipeline, "_draw", lambda *_: None)
    study.write_text(
        STUDY.replace(
            "population: 12, generations: 2", "specimens: [distal/1], sampler: dask, population: 4, generations: 1"
        )
    )
    out = tmp_path / "out"
    sinew("infer", study, "--out", out, "--workers", 1, "--quiet")
    assert new_simulations(out)[-1] == 0, "pyABC's own sampler stores no rows"
    result = AbcResult.read(out)
    assert result.sampler == "dask"
    (posterior,) = result.sites.values()
    assert [generation.accepted for generation in posterior.generations] == [4]
    assert all(g.judged <= g.asked for g in posterior.generations)
    marginal = posterior.parameters["E_f"]
    assert marginal.mean == pytest.approx(marginal.prior_mean, abs=4 * marginal.prior_sd)


class Killed(Exception):
    pass


def test_interrupted_in_mid_generation_it_ends_with_the_same_bytes(study, tmp_path, here, monkeypatch):
    study.write_text(NO_TAIL)
    cut = tmp_path / "out"
    shutil.copytree(cut, tmp_path / "whole")
    sinew("run", study, "--out", tmp_path / "whole", "--quiet")
    judged, judge = 0, StoreSampler._judge

    def dies(self, *arguments):
        nonlocal judged
        judged += 1
        if judged == 60:
            raise Killed
        return judge(self, *arguments)

    monkeypatch.setattr(StoreSampler, "_judge", dies)
    with pytest.raises(Killed):
        sinew("run", study, "--out", cut, "--quiet")
    monkeypatch.setattr(StoreSampler, "_judge", judge)
    assert not (cut / "infer.json").exists()
    sinew("run", study, "--out", cut, "--quiet")
    assert (cut / "infer.json").read_bytes() == (tmp_path / "whole" / "infer.json").read_bytes()
    assert contents(cut / "store.zarr") == contents(tmp_path / "whole" / "store.zarr")
    assert any(table.title.startswith("site ") for table in open_store(cut).tables())


UNREACHABLE = ("12, generations: 2, epsilon: 0.5", "4, generations: 1, epsilon: 0.0001")
OTHER_RANGES = (
    "tasks: [calibrate, infer, predict, compare]",
    "tasks: [infer]\nmodel: {parameters: {E_f: {min: 150, max: 280}}}",
)


@pytest.mark.parametrize(
    ("change", "out", "words"),
    [
        (UNREACHABLE, "out", ["infer.epsilon", "the closest was at", "a larger epsilon"]),
        (("population: 12", "population: 12, protocols: [creep]"), "out", ["infer.protocols", "no curve of"]),
        (("[calibrate, infer, predict, compare]", "[infer]"), "new", ["calibrate.json", "`sinew calibrate`"]),
        (OTHER_RANGES, "out", ["calibrate.json", "E_f: another range than now; expected `sinew calibrate` again"]),
        (("[calibrate, infer, predict, compare]", "[infer, calibrate]"), "new", ["calibrate first"]),
    ],
)
def test_bad_input_is_one_line(study, tmp_path, capsys, here, change, out, words):
    study.write_text(STUDY.replace(*change))
    with pytest.raises(SystemExit) as ended:
        sinew("run", study, "--out", tmp_path / out, "--quiet")
    assert ended.value.code == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    for word in words:
        assert word in said


def test_pyabcs_adaptive_distance_works_and_is_kept(study, tmp_path, here):
    study.write_text(NO_TAIL.replace("2, epsilon: 0.5", "3, distance: adaptive, specimens: [distal/1]"))
    out = tmp_path / "out"
    sinew("run", study, "--out", out, "--quiet")
    first = (out / "infer.json").read_bytes()
    weights = json.loads(first)["sites"]["distal"]["distance_weights"]
    assert set(weights) == {"0", "1", "2"}
    assert weights["0"] != weights["2"], "it adapts"
    (out / "infer.json").unlink()
    sinew("run", study, "--out", out, "--quiet")
    assert (out / "infer.json").read_bytes() == first


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
