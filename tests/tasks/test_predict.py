"""Bands of the force: known answers, coverage of specimens that were left out, and what a run leaves behind."""

import json

import numpy as np
import pytest
import xarray as xr
from matplotlib import pyplot as plt

from runner.cluster import Local
from tasks.cohort import virtual_cohort, write_cohort
from tasks.infer import draws
from tasks.model import Model
from tasks.predict import coverage, next_curve, noise_of_others, pointwise, predict
from tasks.problems import BadInput
from tasks.report import prediction
from tasks.simulate.uniaxial import Uniaxial
from tasks.study import read_study
from tasks.workspace import open_workspace, write_json

MODEL = Model()


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
    sites: dict[str, list[str]] = {}
    for specimen in workspace.cohort.specimens:
        sites.setdefault(specimen.site, []).append(specimen.name)
    told = {}
    for site, members in sites.items():
        mean = np.mean([[truth[name]["parameters"][p] for p in names] for name in members], axis=0)
        particles = mean * (1 + spread * rng.standard_normal((2, 30, len(names))))
        weight = rng.dirichlet(np.ones(30), 2)
        dataset = xr.Dataset(
            {
                "parameters": (("generation", "particle", "parameter"), particles),
                "weight": (("generation", "particle"), weight),
            },
            coords={"parameter": names},
        )
        workspace.store.write_result(f"infer/{site}", dataset)
        low, high = 0.9 * mean, 1.1 * mean
        parameters = {p: {"mean": m, "hdi": [a, b]} for p, m, a, b in zip(names, mean, low, high, strict=True)}
        told[site] = {"specimens": members, "parameters": parameters}
    calibrated = {s.name: {"parameters": truth[s.name]["parameters"]} for s in workspace.cohort.specimens}
    write_json(workspace.out / "infer.json", {"names": names, "sites": told})
    write_json(workspace.out / "calibrate.json", {"specimens": calibrated})


def test_the_band_of_a_new_curve_is_the_textbook_one_where_asinh_is_a_line():
    """Mean 0 and values far below the bend: t(0.975, 4) = 2.7764 for five curves."""
    curves = np.zeros((5, 2))
    curves[:, 0] = 1000.0
    curves[:, 1] = np.array([-0.2, -0.1, 0.0, 0.1, 0.2])
    low, high = next_curve(curves, 0.0, 0.95)
    reach = 2.776445 * np.std(curves[:, 1], ddof=1) * np.sqrt(1.2)
    assert (low[1], high[1]) == pytest.approx((-reach, reach), rel=1e-4)
    assert (low[0], high[0]) == pytest.approx((1000.0, 1000.0)), "curves that agree leave nothing but noise"
    low, high = next_curve(curves, 2.0, 0.95)
    assert (low[0], high[0]) == pytest.approx((1000 - 3.919928, 1000 + 3.919928))
    assert high[1] == pytest.approx(np.hypot(reach, 3.919928), rel=1e-4)


@pytest.mark.parametrize("members", [3, 5, 8])
@pytest.mark.parametrize("kind", ["factors", "newtons"])
def test_the_band_of_a_new_curve_holds_as_many_as_it_says(members, kind):
    """Tendons that differ by factors, or by a force; one is left out, and measured with noise."""
    rng = np.random.default_rng(5)
    along = np.abs(np.sin(np.linspace(0.3, 9.0, 40))) * 800.0 + 20.0
    held = []
    for _ in range(500):
        by = rng.normal(0, 0.25, (members + 1, 1))
        curves = along * np.exp(by) if kind == "factors" else along + 150.0 * by
        measured = curves[0] + rng.normal(0, 5.0, 40)
        low, high = next_curve(curves[1:], 5.0, 0.95)
        held.append(np.mean((measured >= low) & (measured <= high)))
    assert 0.925 <= np.mean(held) <= 0.975


def test_pointwise_bounds_leave_out_the_same_on_both_sides():
    low, high = pointwise(np.arange(101.0)[:, np.newaxis] * [1.0, -2.0], 0.95)
    assert (low[0], high[0]) == pytest.approx((2.5, 97.5))
    assert (low[1], high[1]) == pytest.approx((-195.0, -5.0))


def test_each_point_counts_once_and_a_band_that_is_not_given_not_at_all():
    nothing = np.full(4, np.nan)
    bands = {"hdi_low": np.zeros(4), "hdi_high": np.array([1.0, 1.0, 1.0, 0.4]), "draws_low": nothing}
    bands |= {"draws_high": nothing, "new_low": np.array([0, 0, 0, np.nan]), "new_high": np.array([9, 9, 0.1, np.nan])}
    dataset = xr.Dataset(
        {"measured": ("point", np.full(4, 0.5)), **{name: ("point", values) for name, values in bands.items()}},
        {"protocol": ("point", ["pull", "pull", "hold", "hold"]), "specimen": ("point", ["a", "b", "a", "b"])},
    )
    found = coverage(dataset)
    assert found["hdi"]["all"] == 0.75
    assert found["hdi"]["protocols"] == {"pull": 1.0, "hold": 0.5}
    assert found["hdi"]["specimens"] == {"a": 1.0, "b": 0.5}
    assert (found["draws"]["all"], found["draws"]["points"]) == (None, 0)
    assert (found["new"]["all"], found["new"]["points"]) == (pytest.approx(2 / 3), 3)


def test_the_band_of_a_new_specimen_covers_those_left_out(tmp_path):
    """All 27 virtual specimens with their true parameters: 90 to 99 % of the measured points, each once."""
    opened, truth = open_study(tmp_path, per_site=9)
    with opened as workspace:
        inferred(workspace, truth)
        found = predict(workspace)
    assert found["coverage"]["new"]["points"] == 27 * 3 * 96
    assert 0.90 <= found["coverage"]["new"]["all"] <= 0.99
    for told in found["sites"].values():
        assert 0.85 <= told["coverage"]["new"]["all"] <= 1.0
    assert found["coverage"]["draws"]["all"] < 0.5, "the posterior of a mean is not about single tendons"
    assert found["failed"] == 0


def test_a_prediction_is_simulated_once_and_drawn(tmp_path):
    opened, truth = open_study(tmp_path, per_site=4, sites=("distal",))
    with opened as workspace:
        inferred(workspace, truth)
        result = predict(workspace)
        done = workspace.simulations
        assert done == result["rows"] - _repeated(workspace)
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
        noise = noise_of_others(workspace.cohort.specimens, specimen, "one_step")
        for bound, known in zip(("low", "high"), next_curve(alone, noise, 0.95), strict=True):
            assert mine[f"new_{bound}"].to_numpy() == pytest.approx(known), "of the others, none of its own"

        stress = {name: dataset[f"stress_{name}"].to_numpy() for name in ("matrix_draws_low", "fibre_draws_high")}
        assert np.isfinite(stress["matrix_draws_low"]).all()
        told = result["sites"]["distal"]
        assert told["stresses_of"] == told["typical"]
        peak = dataset.isel(point=np.flatnonzero(dataset["specimen"] == told["typical"]))["draws_high"].max()
        area = next(s for s in workspace.cohort.specimens if s.name == told["typical"]).area_mm2
        both = float(dataset["stress_matrix_draws_high"].max() + dataset["stress_fibre_draws_high"].max())
        assert both * area * 1.04 == pytest.approx(float(peak), rel=0.05), "force = A0 stretch (S_m + S_f)"

        prediction.draw(workspace, result)
        for name in ("predict_distal", "predict_distal_specimens", "predict_distal_stresses"):
            assert (workspace.out / "figures" / f"{name}.png").stat().st_size > 5000

        assert predict(workspace)["inputs"] == result["inputs"]
        (workspace.out / "predict.json").unlink()
        predict(workspace)
        assert workspace.simulations == done, "its rows are in the store"
        assert (workspace.out / "predict.json").read_bytes() == first


def _repeated(workspace):
    """Rows that were asked for twice: equal draws."""
    particles = workspace.store.read_result("infer/distal")
    drawn = draws(particles, 40, (workspace.seed, 7, 0))
    return (40 - len(np.unique(drawn, axis=0))) * len(workspace.cohort.specimens)


def test_three_specimens_of_a_site_are_too_few_for_a_new_one_and_failed_rows_are_left_out(tmp_path):
    opened, truth = open_study(tmp_path, per_site=3, sites=("middle",))
    with opened as workspace:
        inferred(workspace, truth)
        content = json.loads((workspace.out / "infer.json").read_text())
        content["sites"]["middle"]["parameters"]["tau_1f"]["hdi"][0] = -1.0  # cannot be simulated
        write_json(workspace.out / "infer.json", content)
        result = predict(workspace)
        told = result["sites"]["middle"]
        assert "3 specimens" in told["no_new"]
        assert told["coverage"]["new"] == {
            "all": None,
            "points": 0,
            "protocols": dict.fromkeys(("cyclic", "one_step", "two_step")),
            "specimens": dict.fromkeys(f"middle/{number}" for number in (1, 2, 3)),
        }
        assert result["failed"] == 3
        assert told["coverage"]["hdi"]["points"] == 3 * 3 * 96, "two of the three are left"
        assert "NaN" not in (workspace.out / "predict.json").read_text()
        dataset = workspace.store.read_result("predict/middle")
        for draw in (prediction.site_bands, prediction.each_specimen):
            figure = draw(dataset, told, "middle")
            assert len(figure.axes) in (6, 9)
            plt.close(figure)


def test_what_cannot_be_predicted_is_said(tmp_path):
    opened, truth = open_study(tmp_path, per_site=1, sites=("distal",))
    with opened as workspace:
        with pytest.raises(BadInput, match="sinew infer"):
            predict(workspace)
        inferred(workspace, truth)
        content = json.loads((workspace.out / "infer.json").read_text())
        write_json(workspace.out / "infer.json", content | {"names": content["names"][1:]})
        with pytest.raises(BadInput, match="again"):
            predict(workspace)


class Other:
    """A simulator that is not the embedded one, and does not tell stresses."""

    name = "other"
    batch_multiple = 1

    def identity(self):
        return {"name": self.name}

    def compare(self, *arguments):
        return Uniaxial().compare(*arguments)


def test_other_simulators_give_the_same_forces_and_say_why_there_are_no_stresses(tmp_path, monkeypatch):
    opened, truth = open_study(tmp_path, per_site=4, sites=("distal",))
    with opened as workspace:
        inferred(workspace, truth)
        known = predict(workspace)["coverage"]
        monkeypatch.setattr(workspace, "simulator", Other())
        monkeypatch.setattr(type(workspace), "client", lambda _: None)  # in this process, as it is for small work
        result = predict(workspace)
        assert result["coverage"] == known
        assert result["sites"]["distal"]["stresses_of"] is None
        assert "other" in result["sites"]["distal"]["no_stresses"]
        assert not any(str(name).startswith("stress") for name in workspace.store.read_result("predict/distal"))
        done = workspace.simulations
        assert done > 0
        predict(workspace)
        assert workspace.simulations == done
