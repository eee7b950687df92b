"""The virtual cohort: the published one, its noise and its screws."""

import json
from dataclasses import replace

import numpy as np
import pytest

from sinew.runner.store.store import open_store
from sinew.tasks.data.cohort import read_cohort
from sinew.tasks.data.virtual import published, virtual_cohort
from sinew.tasks.model import Model
from sinew.tasks.model.protocols import STANDARD
from sinew.tasks.simulate.uniaxial import Uniaxial
from tests.conftest import SHARED
from tests.tasks.study.test_pipeline import in_this_process, sinew, study

__all__ = ["in_this_process", "study"]


def test_the_virtual_cohort_is_the_published_one(tmp_path, capsys):
    sinew("cohort", "--out", tmp_path / "cohort", "--seed", 4, "--rate", 1)
    cohort = read_cohort(tmp_path / "cohort")
    assert len(cohort.specimens) == 27
    truth = json.loads((tmp_path / "cohort" / "truth.json").read_text())["specimens"]
    table = published()
    for specimen in cohort.specimens:
        site, number = specimen.name.split("/")
        row = table[(table["site"] == site) & (table["specimen"] == number)].iloc[0]
        assert truth[specimen.name]["parameters"]["E_f"] == row["E_f"]
        assert specimen.donor == number
        values = np.array([list(truth[specimen.name]["parameters"].values())])
        for curve in specimen.curves:
            force = Uniaxial().simulate(Model(), specimen, curve.protocol, values).force_N[0]
            residual = curve.force_N - force
            assert residual.std() == pytest.approx(truth[specimen.name]["noise_sd_N"], rel=0.35)


def test_noise_has_the_level_and_the_correlation_that_it_says():
    specimens, truth = virtual_cohort(seed=0, per_site=1, rate_hz=50.0, noise=0.01, ar1=0.6)
    for specimen in specimens:
        known = truth["specimens"][specimen.name]
        values = np.array([list(known["parameters"].values())])
        for curve in specimen.curves:
            residual = curve.force_N - Uniaxial().simulate(Model(), specimen, curve.protocol, values).force_N[0]
            assert residual.std() == pytest.approx(known["noise_sd_N"], rel=0.06)
            assert np.corrcoef(residual[1:], residual[:-1])[0, 1] == pytest.approx(0.6, abs=0.05)


def test_an_uneven_screw_pulls_otherwise_than_it_records():
    (even, *_), _ = virtual_cohort(seed=0, per_site=1, rate_hz=5.0, noise=0.0)
    (uneven, *_), truth = virtual_cohort(seed=0, per_site=1, rate_hz=5.0, noise=0.0, screw=0.01)
    assert truth["screw"] == {"fraction_of_displacement": 0.01, "turns": 5}
    values = np.array([list(truth["specimens"][even.name]["parameters"].values())])
    for curve, same in zip(uneven.curves, even.curves, strict=True):
        recorded = curve.protocol.displacement_mm
        assert np.array_equal(recorded, same.protocol.displacement_mm)
        off = 0.01 * recorded.max() * np.sin(10.0 * np.pi * recorded / recorded.max())
        pulled = replace(curve.protocol, displacement_mm=recorded + off)
        force = Uniaxial().simulate(Model(), even, pulled, values).force_N[0]
        assert np.abs(curve.force_N - force).max() < 1e-9 * force.max()
        assert np.abs(curve.force_N - same.force_N).max() > 0.01 * force.max()


def test_a_smaller_cohort_holds_the_same_specimens():
    few, _ = virtual_cohort(seed=5, per_site=1, rate_hz=1.0)
    many, _ = virtual_cohort(seed=5, per_site=2, rate_hz=1.0)
    names = [specimen.name for specimen in many]
    for specimen in few:
        assert many[names.index(specimen.name)].identity() == specimen.identity()


def test_protocols_of_any_length_keep_their_strain():
    for make in STANDARD:
        short, long = make(5.0, 10.0), make(20.0, 10.0)
        assert np.allclose(short.displacement_mm / 5.0, long.displacement_mm / 20.0)


@pytest.mark.shared
def test_bench_exports_run_like_any_cohort(study, tmp_path, in_this_process, capsys):
    exports = sorted((SHARED / "real" / "rattail-fascicle").glob("*.csv"))
    sinew("import", *exports, "--out", tmp_path / "rats")
    cohort = read_cohort(tmp_path / "rats")
    assert [specimen.name for specimen in cohort.specimens] == ["fresh1_relax", "fresh2_relax", "incubated1_relax"]
    fresh = cohort.specimens[0]
    assert fresh.length_mm == 14.33
    assert fresh.area_mm2 == pytest.approx(np.pi * 0.399**2 / 4, rel=1e-6)
    assert fresh.curves[0].name == "relaxation"
    assert fresh.curves[0].force_N.max() == 2.66469
    sinew("sobol", study, "--data", tmp_path / "rats", "--out", tmp_path / "out", "--quiet")
    sobol = json.loads((tmp_path / "out" / "sobol.json").read_text())
    assert sobol["failed"] == 0
    assert set(sobol["specimens"]) == {specimen.name for specimen in cohort.specimens}
    tables = open_store(tmp_path / "out").tables()
    assert len(tables) == 3
