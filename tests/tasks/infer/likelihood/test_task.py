"""`sinew infer` by likelihood in a result folder: what it leaves, how it goes on, and what it refuses."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest

import sinew as sinew_package
from sinew.runner.store.store import open_store
from sinew.tasks.data.cohort import read_cohort, write_cohort
from sinew.tasks.data.virtual import virtual_cohort
from sinew.tasks.infer.library import arviz
from sinew.tasks.infer.likelihood import sampling, task
from sinew.tasks.infer.likelihood.summary import WARM_UP
from sinew.tasks.infer.result import LikelihoodResult, read_posteriors
from sinew.tasks.study import pipeline
from sinew.tasks.study.workspace import Workspace
from tests.runner.stores import contents
from tests.tasks.study.test_pipeline import sinew

FIXED = ("g_1f", "g_2f", "g_3f", "tau_1f", "tau_2f", "tau_3f", "g_1m", "g_2m", "g_3m", "tau_1m", "tau_2m", "tau_3m")
TRUTH = {
    "distal/1": {"E_f": 190.0, "alpha_f": 1500.0, "E_m": 50.0},
    "distal/2": {"E_f": 225.0, "alpha_f": 3500.0, "E_m": 30.0},
    "proximal/1": {"E_f": 240.0, "alpha_f": 2500.0, "E_m": 35.0},
    "proximal/2": {"E_f": 205.0, "alpha_f": 4500.0, "E_m": 55.0},
}
VALUES = {name: 1.2 if name[0] == "g" else {"1": 1.0, "2": 8.0, "3": 60.0}[name[4]] for name in FIXED} | {"g_1f": 0.9}
STUDY = f"""
name: by-likelihood
seed: 5
cohort: cohort
tasks: [infer, predict, compare]
model:
  parameters: {json.dumps({name: {"fixed": value} for name, value in VALUES.items()})}
infer: {{ess: 100, sweeps: 1000}}
predict: {{draws: 5}}
"""


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """Two sites of two specimens each that are described by the study's model, with known parameters."""
    from sinew.tasks.data import virtual

    folder = tmp_path_factory.mktemp("by-likelihood")
    table = virtual.published()
    for name, value in VALUES.items():
        table[name] = value
    names = table["site"] + "/" + table["specimen"]
    for specimen, values in TRUTH.items():
        for name, value in values.items():
            table.loc[names == specimen, name] = value
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(virtual, "published", lambda: table)
        specimens, truth = virtual_cohort(seed=1, per_site=2, rate_hz=2.0)
    write_cohort(folder / "cohort", [one for one in specimens if one.site != "middle"], truth)
    (folder / "study.yaml").write_text(STUDY)
    return folder / "study.yaml"


@pytest.fixture(scope="module")
def inferred(study, drawing):
    """The study with its inference and what builds upon it, drawn; in ``kept``, what it had before a fourth block."""
    calls, swept = [], sampling.swept

    def noted(*arguments, **options):
        calls.append("swept")
        if len(calls) == 4:
            (study.parent / "kept").mkdir()
            for path in (study.parent / "out" / "infer").glob("*.safetensors"):
                shutil.copy(path, study.parent / "kept")
        return swept(*arguments, **options)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sampling, "swept", noted)
        patch.setattr(Workspace, "client", lambda self: None)
        for name, function in drawing.items():
            patch.setattr(pipeline, name, function)
        draw = drawing["_draw"]
        patch.setattr(pipeline, "_draw", lambda work, name, result: name == "infer" and draw(work, name, result))
        sinew("run", study, "--out", study.parent / "out", "--quiet")
    return study.parent / "out"


def test_true_values_are_in_the_intervals(inferred):
    found = read_posteriors(inferred)
    assert isinstance(found, LikelihoodResult)
    assert found.blind == ["nu_m"]
    assert set(found.specimens) == set(TRUTH)
    for specimen, values in TRUTH.items():
        for name, value in values.items():
            marginal = found.specimens[specimen][name]
            assert marginal.determined
            assert abs(marginal.mean - value) < 4 * marginal.sd
    for site in found.sites.values():
        assert site.smallest_ess >= 100
        assert site.largest_rhat <= 1.05
        assert all(0.8 < one.bare < 1.2 and 0.8 < one.left < 1.2 for one in site.misfit.values())
        for name in ("E_f", "alpha_f", "E_m"):
            mean = np.mean([TRUTH[specimen][name] for specimen in site.specimens])
            assert site.population[name].low < mean < site.population[name].high


def test_the_file_holds_populations_and_specimens_under_their_names(inferred):
    content = json.loads((inferred / "infer.json").read_text())
    population = content["sites"]["distal"]["population"]["E_f"]
    assert set(population) == {"mean", "low", "high", "spread", "spread_low", "spread_high", "ess", "rhat"}
    assert set(content["specimens"]["distal/1"]["E_f"]) == {"mean", "sd", "low", "high", "determined"}
    assert content["specimens"]["distal/1"]["nu_m"]["determined"] is False


def test_draws_are_left_for_arviz_and_in_the_store(inferred):
    data = arviz().from_netcdf(inferred / "infer" / "distal.nc")
    assert {"posterior", "prior", "log_likelihood", "posterior_predictive"} <= set(data.groups())
    found = read_posteriors(inferred)
    drawn = data.posterior["specimens"].sel(specimen="distal/1", parameter="E_f").values
    assert drawn.mean() == pytest.approx(found.specimens["distal/1"]["E_f"].mean, rel=0.01)
    kept = open_store(inferred).read_result("infer/distal")
    assert kept["new"].dims == ("chain", "draw", "parameter")
    assert not list((inferred / "infer").glob("*.safetensors"))


def test_figures_are_drawn_one_at_a_time(inferred):
    found = sinew_package.results(inferred).infer
    assert found.plots == {"populations": [], "specimens": ["distal", "proximal"]}
    assert found.plot().axes
    assert found.plot("specimens", "proximal").axes


def test_predictions_and_comparisons_build_upon_it(inferred):
    predicted = json.loads((inferred / "predict.json").read_text())
    assert predicted["from_population"]
    for band in ("new", "whole"):
        assert predicted["coverage"][band]["all"] > 0.8
    assert predicted["coverage"]["whole"]["curves"] >= predicted["coverage"]["new"]["curves"]
    assert predicted["sites"]["distal"]["no_new"] is None
    compared = json.loads((inferred / "compare.json").read_text())
    assert compared["names"] == ["E_f", "alpha_f", "E_m"]
    assert [one["parameter"] for one in compared["contrasts"]] == compared["names"]
    table = (inferred / "compare.csv").read_text().splitlines()
    assert table[0].startswith("first,second,parameter,paired,difference,difference_low")
    assert len(table) == 4
    assert (inferred / "figures" / "infer_populations.png").is_file()
    assert (inferred / "figures" / "infer_distal_specimens.png").is_file()
    page = (inferred / "report.html").read_text()
    assert "Populations: mean" in page
    assert "Differences between populations: second site less first" in page
    assert "of 3 contrasts about 0 would be called different by chance" in page


def test_an_interrupted_inference_goes_on_and_ends_with_the_same_bytes(study, inferred, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(Workspace, "client", lambda self: None)
    shutil.copytree(study.parent / "cohort", tmp_path / "cohort")
    shutil.copy(study, tmp_path / "study.yaml")
    shutil.copytree(study.parent / "kept", tmp_path / "out" / "infer")
    kept = [path.name for path in (tmp_path / "out" / "infer").iterdir()]
    assert sum(name.endswith(".explored.safetensors") for name in kept) == len(TRUTH)
    assert any(name.endswith(".block.safetensors") for name in kept)
    monkeypatch.setattr(task, "explored", lambda *_: pytest.fail("a specimen is explored again"))

    def interrupted(*arguments, **options):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(sampling, "swept", interrupted)
        with pytest.raises(SystemExit):
            sinew("infer", tmp_path / "study.yaml", "--out", tmp_path / "out", "--quiet")
    sinew("infer", tmp_path / "study.yaml", "--out", tmp_path / "out")
    sweeps = round(sum(site.sweeps for site in read_posteriors(inferred).sites.values()) / (1 - WARM_UP))
    assert f"{sweeps:,} sweeps in" in capsys.readouterr().out, "those that were asked for at most do not count"
    assert (tmp_path / "out" / "infer.json").read_bytes() == (inferred / "infer.json").read_bytes()
    assert (tmp_path / "out" / "infer" / "distal.nc").read_bytes() == (inferred / "infer" / "distal.nc").read_bytes()


def test_what_is_unchanged_is_not_inferred_again(study, inferred, monkeypatch):
    monkeypatch.setattr(task, "measured_of_each", lambda *_: pytest.fail("inferred again"))
    before = contents(inferred / "store.zarr" / "infer")
    sinew("infer", study, "--out", inferred, "--quiet")
    assert contents(inferred / "store.zarr" / "infer") == before


def test_chains_that_do_not_converge_are_refused(study, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(Workspace, "client", lambda self: None)
    shutil.copytree(study.parent / "cohort" / "distal", tmp_path / "cohort" / "distal")
    text = study.read_text().replace("{ess: 100, sweeps: 1000}", "{ess: 100000, sweeps: 100, discrepancy: false}")
    (tmp_path / "study.yaml").write_text(text)
    with pytest.raises(SystemExit) as ended:
        sinew("infer", tmp_path / "study.yaml", "--out", tmp_path / "out", "--quiet")
    assert ended.value.code == 2
    assert "the chains have not converged after 100 sweeps" in capsys.readouterr().err
    assert not (tmp_path / "out" / "infer.json").exists()


def test_curves_in_which_no_noise_can_be_seen_are_refused(study, tmp_path, capsys):
    specimens = read_cohort(study.parent / "cohort").specimens
    still = [replace(curve, force_N=0.0 * curve.force_N) for curve in specimens[1].curves]
    write_cohort(tmp_path / "cohort", [specimens[0], replace(specimens[1], curves=tuple(still))])
    (tmp_path / "study.yaml").write_text(study.read_text())
    with pytest.raises(SystemExit) as ended:
        sinew("infer", tmp_path / "study.yaml", "--out", tmp_path / "out", "--quiet")
    assert ended.value.code == 2
    assert "distal/2: no noise can be seen in its curves" in capsys.readouterr().err
