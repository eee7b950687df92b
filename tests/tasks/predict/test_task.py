"""A prediction in a result folder: coverage of specimens that were left out, what it leaves, and what it refuses."""

import json

import numpy as np
import pandas as pd
import pytest
from matplotlib import pyplot as plt

from sinew.runner.cluster.local import Local
from sinew.runner.console import Console
from sinew.runner.errors import BadInput
from sinew.tasks.data.cohort import write_cohort
from sinew.tasks.data.virtual import virtual_cohort
from sinew.tasks.infer.abc.result import AbcResult, draws
from sinew.tasks.model import Model
from sinew.tasks.predict import figures, task
from sinew.tasks.predict.method import next_curve, noise_level
from sinew.tasks.predict.result import Coverage, PredictResult
from sinew.tasks.predict.settings import Settings
from sinew.tasks.predict.show import summary
from sinew.tasks.predict.task import run
from sinew.tasks.simulate import Capabilities
from sinew.tasks.simulate.uniaxial import Uniaxial
from sinew.tasks.study.files import write_json
from sinew.tasks.study.streams import Stream, key
from sinew.tasks.study.study import read_study
from sinew.tasks.study.workspace import open_workspace
from tests.tasks.calibrations import calibration_of, fit_of
from tests.tasks.measured import study_of, write_measured
from tests.tasks.posteriors import posterior_of, write_inference

MODEL = Model()
FEW_DRAWS = Settings(draws=6)


def open_study(folder, *, per_site, sites=("distal", "middle", "proximal"), rate_hz=1.0):
    specimens, truth = virtual_cohort(seed=2503, per_site=per_site, rate_hz=rate_hz)
    specimens = [specimen for specimen in specimens if specimen.site in sites]
    write_cohort(folder / "cohort", specimens, truth)
    (folder / "study.yaml").write_text("name: bands\nseed: 4\ncohort: cohort\n")
    study = read_study(folder / "study.yaml")
    return open_workspace(study, out=folder / "out", cluster=Local(workers=1), quiet=True), truth["specimens"]


def inferred(workspace, truth, *, spread=0.01):
    """What calibration and inference leave, from the truth: each specimen's own, and a narrow posterior of the mean."""
    rng = np.random.default_rng(3)
    names = [parameter.name for parameter in MODEL.free]
    members: dict[str, list[str]] = {}
    for specimen in workspace.cohort.specimens:
        members.setdefault(specimen.site, []).append(specimen.name)
    sites, particles = {}, {}
    for site, specimens in members.items():
        mean = np.mean([[truth[name]["parameters"][p] for p in names] for name in specimens], axis=0)
        values = mean * (1 + spread * rng.standard_normal((2, 30, len(names))))
        particles[site] = values, rng.dirichlet(np.ones(30), 2)
        sites[site] = posterior_of(specimens, names, mean)
    write_inference(workspace, names, sites, particles)
    calibrated = {s.name: fit_of(truth[s.name]["parameters"]) for s in workspace.cohort.specimens}
    calibration_of(calibrated).write(workspace.out)


def test_the_band_of_a_new_specimen_covers_those_left_out(tmp_path):
    """All 12 virtual specimens with their true parameters: 85 to 99 % of the measured points, each once."""
    opened, truth = open_study(tmp_path, per_site=4)
    with opened as workspace:
        inferred(workspace, truth)
        found = run(workspace, FEW_DRAWS)
    assert found.coverage["new"].points == 12 * 3 * 96
    assert 0.85 <= found.coverage["new"].all <= 0.99
    for prediction in found.sites.values():
        assert 0.75 <= prediction.coverage["new"].all <= 1.0
    assert found.coverage["draws"].all < 0.5, "the posterior of a mean is not about single tendons"
    assert found.failed == 0


def test_a_prediction_is_simulated_once_and_drawn(tmp_path):
    opened, truth = open_study(tmp_path, per_site=4, sites=("distal",))
    with opened as workspace:
        inferred(workspace, truth)
        result = run(workspace, FEW_DRAWS)
        done = workspace.simulations
        assert done == result.rows - _repeated(workspace)
        assert result.coverage["whole"].all is None and not result.from_population, "seven others are too few"
        first = (workspace.out / "predict.json").read_bytes()
        dataset = workspace.store.read_result("predict/distal")
        specimen = workspace.cohort.specimens[1]
        mine = dataset.isel(point=np.flatnonzero(
            (dataset["specimen"] == specimen.name) & (dataset["protocol"] == "one_step")
        ))  # fmt: skip
        curve = next(curve for curve in specimen.curves if curve.name == "one_step")
        keep = np.searchsorted(curve.protocol.time_s, mine["time"])
        assert mine["measured"].to_numpy() == pytest.approx(curve.force_N[keep])
        others = [s.name for s in workspace.cohort.specimens if s.name != specimen.name]
        rows = np.array([[truth[name]["parameters"][p] for p in MODEL.names] for name in others])
        alone = Uniaxial().simulate(MODEL, specimen, curve.protocol, rows).force_N[:, keep]
        noise = noise_level([one for one in workspace.cohort.specimens if one is not specimen], "one_step")
        for bound, known in zip(("low", "high"), next_curve(alone, noise, 0.95), strict=True):
            assert mine[f"new_{bound}"].to_numpy() == pytest.approx(known), "of the others, none of its own"

        stress = {name: dataset[f"stress_{name}"].to_numpy() for name in ("matrix_draws_low", "fibre_draws_high")}
        assert np.isfinite(stress["matrix_draws_low"]).all()
        prediction = result.sites["distal"]
        assert prediction.stresses_of == prediction.typical
        peak = dataset.isel(point=np.flatnonzero(dataset["specimen"] == prediction.typical))["draws_high"].max()
        area = next(s for s in workspace.cohort.specimens if s.name == prediction.typical).area_mm2
        both = float(dataset["stress_matrix_draws_high"].max() + dataset["stress_fibre_draws_high"].max())
        assert both * area * 1.04 == pytest.approx(float(peak), rel=0.05), "force = A0 stretch (S_m + S_f)"

        figures.draw(workspace, result)
        for name in ("predict_distal", "predict_distal_specimens", "predict_distal_stresses"):
            assert (workspace.out / "figures" / f"{name}.png").stat().st_size > 5000

        (workspace.out / "predict.json").unlink()
        run(workspace, FEW_DRAWS)
        assert workspace.simulations == done, "its rows are in the store"
        assert (workspace.out / "predict.json").read_bytes() == first


def _repeated(workspace):
    """Rows that were asked for twice: equal draws."""
    particles = workspace.store.read_result("infer/distal")
    drawn = draws(particles.isel(generation=-1), FEW_DRAWS.draws, key(workspace.seed, Stream.PREDICTION, 0))
    return (FEW_DRAWS.draws - len(np.unique(drawn, axis=0))) * len(workspace.cohort.specimens)


def test_three_specimens_of_a_site_are_too_few_for_a_new_one_and_failed_rows_are_left_out(tmp_path):
    opened, truth = open_study(tmp_path, per_site=3, sites=("middle",))
    with opened as workspace:
        inferred(workspace, truth)
        content = json.loads((workspace.out / "infer.json").read_text())
        content["sites"]["middle"]["parameters"]["tau_1f"]["hdi"][0] = -1.0  # cannot be simulated
        write_json(workspace.out / "infer.json", content)
        result = run(workspace, FEW_DRAWS)
        prediction = result.sites["middle"]
        assert "3 specimens" in prediction.no_new
        protocols = dict.fromkeys(("cyclic", "one_step", "two_step"))
        specimens = dict.fromkeys(f"middle/{number}" for number in (1, 2, 3))
        assert prediction.coverage["new"] == Coverage(None, 0, protocols, specimens, None)
        assert result.failed == 3
        assert prediction.coverage["hdi"].points == 0, "it needs all three of its simulations"
        assert "NaN" not in (workspace.out / "predict.json").read_text()
        dataset = workspace.store.read_result("predict/middle")
        for draw in (figures.site_bands, figures.each_specimen):
            figure = draw(dataset, prediction, "middle")
            assert len(figure.axes) in (3, 9), "no band of the site, and draws of each specimen"
            plt.close(figure)


def test_an_unchanged_prediction_is_read_back_while_its_arrays_are_there(tmp_path):
    opened, truth = open_study(tmp_path, per_site=1, sites=("distal",))
    with opened as workspace:
        inferred(workspace, truth)
        path = PredictResult.path(workspace.out)
        run(workspace, FEW_DRAWS)
        path.write_text(json.dumps(json.loads(path.read_text()) | {"draws": 7}))
        assert run(workspace, FEW_DRAWS).draws == 7
        del workspace.store.root["predict/distal"]
        assert run(workspace, FEW_DRAWS).draws == FEW_DRAWS.draws, "its bands are gone"
        assert "predict/distal" in workspace.store.root


def test_what_cannot_be_predicted_is_refused(tmp_path):
    opened, truth = open_study(tmp_path, per_site=1, sites=("distal",))
    with opened as workspace:
        with pytest.raises(BadInput, match="sinew infer"):
            run(workspace, FEW_DRAWS)
        inferred(workspace, truth)
        path = AbcResult.path(workspace.out)
        content = json.loads(path.read_text())
        write_json(path, content | {"names": content["names"][1:]})
        with pytest.raises(BadInput, match="again"):
            run(workspace, FEW_DRAWS)


def test_posteriors_with_which_nothing_can_be_simulated_are_refused(tmp_path, monkeypatch):
    opened, truth = open_study(tmp_path, per_site=1, sites=("distal",))
    with opened as workspace:
        inferred(workspace, {name: {**one, "parameters": dict.fromkeys(one["parameters"], -1e3)}
                             for name, one in truth.items()})  # fmt: skip
        with pytest.raises(BadInput, match="gives E_f a value that the model cannot have, at the site distal"):
            run(workspace, FEW_DRAWS)
        inferred(workspace, truth)
        with monkeypatch.context() as patched:
            patched.setattr(task, "_evaluate", all_fail)
            with pytest.raises(BadInput, match="every simulation with its parameters failed"):
                run(workspace, FEW_DRAWS)
        assert not PredictResult.path(workspace.out).exists()
        content = json.loads(AbcResult.path(workspace.out).read_text())
        content["sites"]["distal"]["parameters"]["E_f"]["mean"] = None
        write_json(AbcResult.path(workspace.out), content)
        with pytest.raises(BadInput, match="gives E_f a value that the model cannot have"):
            run(workspace, FEW_DRAWS)


def all_fail(_, planned):
    for one in planned:
        one.table.status[one.at] = 1


class Other:
    """A simulator that is not the embedded one, and does not tell stresses."""

    name = "other"
    capabilities = Capabilities()

    def identity(self):
        return {"name": self.name}

    def compare(self, *arguments):
        return Uniaxial().compare(*arguments)


@pytest.mark.thorough
def test_other_simulators_give_the_same_forces_and_say_why_there_are_no_stresses(tmp_path, monkeypatch):
    opened, truth = open_study(tmp_path, per_site=4, sites=("distal",))
    with opened as workspace:
        inferred(workspace, truth)
        known = run(workspace, FEW_DRAWS).coverage
        monkeypatch.setattr(workspace, "simulator", Other())
        monkeypatch.setattr(type(workspace), "client", lambda _: None)  # in this process, as it is for small work
        result = run(workspace, FEW_DRAWS)
        assert result.coverage == known
        assert result.sites["distal"].stresses_of is None
        assert "other" in result.sites["distal"].no_stresses
        assert not any(str(name).startswith("stress") for name in workspace.store.read_result("predict/distal"))
        done = workspace.simulations
        assert done > 0
        run(workspace, FEW_DRAWS)
        assert workspace.simulations == done


@pytest.mark.figures
@pytest.mark.thorough
def test_what_is_measured_beside_the_force_has_bands_of_its_own(tmp_path, capsys):
    truth = write_measured(tmp_path, 4, 2.0, 4)
    study = read_study(study_of(tmp_path, ""))
    with open_workspace(study, out=tmp_path / "out", cluster=Local(workers=1), quiet=True) as workspace:
        inferred(workspace, {name: {"parameters": each} for name, each in truth.items()})
        found = run(workspace, FEW_DRAWS)
        specimens, dataset = workspace.cohort.specimens, workspace.store.read_result("predict/distal")
        assert run(workspace, FEW_DRAWS).others == found.others
        figures.draw(workspace, found)
        plt.close("all")
        summary(found, tmp_path / "out", Console(quiet=False))
    other = found.others["lateral_strain"]
    assert other.unit == "1"
    assert found.sites["distal"].others == found.others, "there is one site"
    measured = dataset["lateral_strain_measured"].to_numpy()
    points = int(np.isfinite(measured).sum())
    seen = [int(np.isfinite(curve.others["lateral_strain"]).sum()) for one in specimens for curve in one.curves]
    assert points >= sum(min(each, 94) for each in seen), "points are kept where the camera saw something"
    assert dataset["lateral_strain_measured"].attrs["units"] == "1"
    assert other.coverage["whole"].all is None, "three others are too few"
    for band, one in other.coverage.items():
        if band == "whole":
            continue
        low, high = (dataset[f"lateral_strain_{band}_{end}"].to_numpy() for end in ("low", "high"))
        inside = (measured >= low) & (measured <= high)
        assert one.points == points
        assert one.all == pytest.approx(inside.sum() / points)
    assert sum(share > 0.99 for share in other.coverage["new"].specimens.values()) >= 3, "of four"
    assert found.coverage["new"].points == 4 * 3 * 96
    table = pd.read_csv(tmp_path / "out" / "figures" / "predict_distal_lateral_strain.csv")
    assert table.columns[:3].to_list() == ["lateral_strain_specimen", "lateral_strain_protocol", "time_s"]
    told = capsys.readouterr().out
    assert "the other quantities" in told
    assert json.loads((tmp_path / "out" / "predict.json").read_text())["others"]["lateral_strain"]["unit"] == "1"
