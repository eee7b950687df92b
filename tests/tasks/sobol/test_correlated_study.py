"""`sinew sobol` of parameters that depend on each other, what builds upon it, and how it is shown."""

import json
from pathlib import Path

import numpy as np
import pytest

from sinew.interop import salib_result, salib_samples
from sinew.runner.errors import BadInput
from sinew.tasks.sobol.prose import methods
from sinew.tasks.sobol.result import SobolResult
from sinew.tasks.sobol.show import headline, table
from tests.tasks.study.test_pipeline import sinew
from tests.whole_runs import drawn_in_this_process, study_of_one

STUDY = """
name: correlated
seed: 3
cohort: cohort
tasks: [sobol, pawn]
sobol:
  base_samples: 32
  scrambles: 1
  resamples: 20
  groups: {fibre_times: [tau_1f, tau_2f, tau_3f], matrix: [E_m, g_1m, g_2m, g_3m, tau_1m, tau_2m, tau_3m, nu_m]}
  correlations: {E_f: {alpha_f: -0.6, E_m: 0.3}, tau_1f: {tau_2f: 0.5}}
pawn: {slides: 4}
store: {points_per_curve: 12}
"""


@pytest.fixture(scope="module")
def out(tmp_path_factory, drawing):
    study = study_of_one(tmp_path_factory.mktemp("correlated"), STUDY)
    with drawn_in_this_process(drawing):
        sinew("run", study, "--out", study.parent / "out", "--quiet")
    return study.parent / "out"


@pytest.fixture(scope="module")
def result(out) -> SobolResult:
    return SobolResult.read(out)


def test_shapley_effects_share_out_all_of_the_variance(out, result):
    assert result.rows == 32 * (3 * 7 - 1)
    found = json.loads((out / "sobol.json").read_text())
    assert found["correlations"] == {"E_f": {"alpha_f": -0.6, "E_m": 0.3}, "tau_1f": {"tau_2f": 0.5}}
    assert result.Sh.sum() == pytest.approx(1.0)
    for each in (*result.protocols.values(), *result.specimens.values()):
        assert each.Sh.sum() == pytest.approx(1.0)
        assert each.Sh_conf.shape == (7,)


def test_they_lead_in_all_that_is_shown(out, result):
    assert result.leading == "Sh"
    assert "largest Shapley effects:" in headline(result)
    assert list(table(result).columns) == ["S1", "S1_conf", "ST", "ST_conf", "Sh", "Sh_conf"]
    words = methods(result)
    assert "E_f and alpha_f -0.6, E_f and E_m 0.3, tau_1f and tau_2f 0.5" in words
    assert "Shapley effects [@owen, @goda]" in words
    page = (out / "report.html").read_text()
    assert "Shapley effects:" in page
    assert "Rank correlations of parameters: E_f and alpha_f -0.6" in page
    assert "Sh,Sh_conf" in (out / "figures" / "sobol.csv").read_text().splitlines()[0]
    along = next((out / "figures").glob("sobol_time_*.csv")).read_text().splitlines()[0]
    assert along.endswith("Sh,Sh_conf")


def test_it_is_read_back(out, result):
    study = out.parent / "study.yaml"
    before = (out / "sobol.json").read_bytes()
    sinew("sobol", study, "--out", out, "--quiet")
    assert (out / "sobol.json").read_bytes() == before


def test_salib_has_indices_but_no_design(out, result):
    assert np.isfinite(salib_result(result)["ST"]).all()
    with pytest.raises(BadInput, match="its parameters are correlated"):
        salib_samples(result, Path(out), next(iter(result.tables)))


@pytest.mark.parametrize("change", ["correlations", "Sh"])
def test_effects_and_correlations_go_together(out, change):
    content = json.loads((out / "sobol.json").read_text())
    del content[change]
    (out.parent / change).mkdir()
    (out.parent / change / "sobol.json").write_text(json.dumps(content))
    with pytest.raises(BadInput, match="Shapley effects go with correlations"):
        SobolResult.read(out.parent / change)
