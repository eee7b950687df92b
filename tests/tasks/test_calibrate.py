"""`sinew calibrate` from end to end: down to the noise, resumed for nothing, the same every time."""

import csv
import json

import pytest

from tasks.cohort import virtual_cohort, write_cohort
from tests.tasks.test_pipeline import new_simulations, sinew

STUDY = """
name: fitted
seed: 11
cohort: cohort
tasks: [calibrate]
calibrate: {starts: 2, evaluations: 500}
"""


@pytest.fixture
def study(tmp_path):
    specimens, truth = virtual_cohort(seed=1, per_site=1, rate_hz=10.0)
    write_cohort(tmp_path / "cohort", specimens[::2], truth)
    (tmp_path / "study.yaml").write_text(STUDY)
    return tmp_path / "study.yaml"


def test_specimens_are_calibrated_down_to_their_noise(study, tmp_path, capsys):
    out = tmp_path / "out"
    sinew("run", study, "--out", out, "--workers", 1)
    told = capsys.readouterr().out
    result = json.loads((out / "calibrate.json").read_text())
    assert set(result["specimens"]) == {"distal/1", "proximal/1"}
    for name, found in result["specimens"].items():
        assert name in told
        assert found["above_noise"] < 0.1
        assert found["total_N"] == pytest.approx(sum(found["rmse_N"].values()))
        assert "nu_m" not in found["determined"], "the force says nothing of it"
        assert "E_f" in found["determined"]
        assert len(found["starts"]) == 2
        assert found["total_N"] == min(start["total_N"] for start in found["starts"])
        used = [trace[-1][0] for trace in found["traces"]]
        assert max(used) <= 250
        for suffix in ("png", "pdf"):
            assert (out / "figures" / f"calibrate_{name.replace('/', '_')}.{suffix}").stat().st_size > 5000
    rows = list(csv.DictReader((out / "calibrate.csv").read_text().splitlines()))
    assert [row["specimen"] for row in rows] == list(result["specimens"])
    assert float(rows[0]["E_f"]) == pytest.approx(result["specimens"]["distal/1"]["parameters"]["E_f"], rel=1e-5)
    first = (out / "calibrate.json").read_bytes()

    sinew("calibrate", study, "--out", out, "--quiet")
    assert new_simulations(out)[-1] == 0
    (out / "calibrate.json").unlink()
    sinew("calibrate", study, "--out", out, "--quiet")
    assert new_simulations(out)[-1] == 0, "its rows are in the store"
    assert (out / "calibrate.json").read_bytes() == first


def test_a_specimen_that_is_not_there_is_one_line(study, tmp_path, capsys):
    study.write_text(STUDY.replace("{starts: 2", "{specimens: [distal/7], starts: 2"))
    with pytest.raises(SystemExit) as ended:
        sinew("calibrate", study, "--out", tmp_path / "out")
    assert ended.value.code == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "calibrate.specimens" in said
    assert not (tmp_path / "out").exists()
