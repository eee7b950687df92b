"""``calibrate.json``: everything that is written is read again."""

import json
from dataclasses import replace

import pytest

from sinew.runner.errors import BadInput
from sinew.tasks.calibrate.result import CalibrateResult, ConfoundedPair, Correlations, PairCorrelation
from sinew.tasks.model.parameters import own_parameter
from sinew.tasks.study.result import plain
from tests.tasks.calibrations import calibration_of, fit_of, method_of

PAIRS = [
    PairCorrelation(parameters=["E_f", "E_m"], r=0.5, dof=4, p=0.1, interval=[0.1, 0.8], p_holm=0.2, determined=True),
    PairCorrelation(parameters=["E_m", "nu_m"], reason="nu_m does not vary within donors", determined=False),
]
FIT = fit_of(
    {"E_f": 200.0, "E_m": 30.0},
    confounded=[ConfoundedPair(["E_f", "E_m"], 0.97)],
    methods={"bayesian": method_of([(1, 9.0), (4, 2.0)])},
    noise_N=None,
    above_noise=None,
)


@pytest.mark.parametrize("correlations", [None, Correlations(["x"], ["1"], 3, ["E_f"], {"E_f": 1.0}, 1, PAIRS)])
def test_what_is_written_is_read(tmp_path, correlations):
    result = calibration_of({"x/1": FIT}, **({"correlations": correlations} if correlations else {}))
    result.write(tmp_path)
    again = CalibrateResult.read(tmp_path)
    assert plain(again) == plain(result)
    assert type(again.correlations) is type(result.correlations)
    assert again.specimens["x/1"].methods["bayesian"].steps.tolist() == [[1.0, 9.0], [4.0, 2.0]]


def test_a_pair_without_a_number_has_only_its_reason(tmp_path):
    found = Correlations(["x"], ["1"], 3, ["E_f"], {"E_f": 1.0}, 1, PAIRS)
    calibration_of({"x/1": FIT}, correlations=found).write(tmp_path)
    written = json.loads((tmp_path / "calibrate.json").read_text())["correlations"]["pairs"]
    assert list(written[0]) == ["parameters", "r", "dof", "p", "interval", "determined", "p_holm"]
    assert list(written[1]) == ["parameters", "reason", "determined"]


def test_a_fit_without_its_parameters_is_refused_with_the_field(tmp_path):
    calibration_of({"x/1": FIT}).write(tmp_path)
    path = tmp_path / "calibrate.json"
    content = json.loads(path.read_text())
    del content["specimens"]["x/1"]["parameters"]
    path.write_text(json.dumps(content))
    with pytest.raises(BadInput, match=r"calibrate\.json: specimens\.x/1\.parameters: missing"):
        CalibrateResult.read(tmp_path)


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ({"free": ["E_f", "E_f"]}, "free parameters that are named twice, or are no parameters"),
        ({"free": ["E_f", "E_x"]}, "free parameters that are named twice, or are no parameters"),
        ({"names": ["E_f", "E_m", "E_m"]}, "parameters that are named twice"),
        ({"free": ["E_f"], "bounds": [(100.0, 300.0)]}, "E_m, which is not free, is 30 and 40"),
    ],
)
def test_a_calibration_that_contradicts_itself_is_refused(change, problem):
    other = replace(FIT, parameters={"E_f": 210.0, "E_m": 40.0})
    assert calibration_of({"x/1": FIT, "x/2": other}).free == ["E_f", "E_m"]
    with pytest.raises(ValueError, match=problem):
        calibration_of({"x/1": FIT, "x/2": other}, **change)


def test_other_ranges_than_those_of_the_study_are_refused(tmp_path):
    found = calibration_of({"x/1": FIT}, free=["E_f", "E_m"], bounds=[(160.0, 275.0), (11.0, 70.0)])
    stiff, matrix = (own_parameter(name, "MPa", *ends) for name, ends in zip(found.free, found.bounds, strict=True))
    found.refuse_other_ranges(tmp_path, [stiff, matrix])
    for free, named in (
        ([stiff], "E_m"),
        ([replace(stiff, maximum=280.0), matrix], "E_f"),
        ([stiff, replace(matrix, name="g_1m")], "g_1m"),
    ):
        with pytest.raises(BadInput, match=f"{named}: another range than now; expected `sinew calibrate` again"):
            found.refuse_other_ranges(tmp_path, free)
