"""`sinew sobol` of groups and of normal parameters, what builds upon it, and how it is shown."""

import json

import numpy as np
import pytest

from tests.tasks.study.test_pipeline import sinew
from tests.whole_runs import drawn_in_this_process, study_of_one

STUDY = """
name: grouped
seed: 3
cohort: cohort
tasks: [sobol, importance, pawn]
sobol:
  base_samples: 64
  resamples: 50
  groups: {fibre_times: [tau_1f, tau_2f, tau_3f], matrix: [E_m, g_1m, g_2m, g_3m, tau_1m, tau_2m, tau_3m, nu_m]}
  distributions: {E_f: {mean: 205, sd: 20}}
importance: {trees: 10, repeats: 2}
pawn: {slides: 4}
store: {points_per_curve: 12}
"""


@pytest.fixture(scope="module")
def out(tmp_path_factory, drawing):
    study = study_of_one(tmp_path_factory.mktemp("grouped"), STUDY)
    with drawn_in_this_process(drawing):
        sinew("run", study, "--out", study.parent / "out", "--quiet")
    return study.parent / "out"


def test_groups_have_indices_and_parameters_have_importance(out):
    found = json.loads((out / "sobol.json").read_text())
    assert found["names"] == ["E_f", "alpha_f", "g_1f", "g_2f", "g_3f", "fibre_times", "matrix"]
    assert found["rows"] == 64 * 9
    assert found["groups"]["fibre_times"] == ["tau_1f", "tau_2f", "tau_3f"]
    assert found["distributions"] == {"E_f": {"mean": 205, "sd": 20}}
    assert np.nansum(found["ST"]) > 0.9
    for task in ("importance", "pawn"):
        assert len(json.loads((out / f"{task}.json").read_text())["names"]) == 16


def test_page_and_table_name_the_groups(out):
    page = (out / "report.html").read_text()
    assert "fibre_times" in page
    assert (out / "figures" / "sobol.png").is_file()
    assert "fibre_times" in (out / "figures" / "sobol.csv").read_text()
