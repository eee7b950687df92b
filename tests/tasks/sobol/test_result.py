"""What a Sobol result offers by name: panels, outputs, courses along time, and what failed rows could change."""

import json

import numpy as np
import pytest

from sinew.runner.errors import BadInput
from sinew.tasks.sobol.result import Convergence, Failures, Indices, OfOutput, OfProtocol, OfSpecimen, SobolResult
from tests.tasks.changed_results import refused
from tests.tasks.sobol.results import ZEROS, of_output, sobol_result


def test_indices_are_found_by_the_name_of_what_they_are_of():
    pull, stretch = OfProtocol(**ZEROS), of_output()
    result = sobol_result(protocols={"pull": pull}, outputs={"stretch": stretch})
    assert result.by_output() == {"total": result, "pull": pull, "stretch": stretch}
    assert list(sobol_result().by_output()) == ["total", "pull"]


def test_a_person_sees_each_of_them_once():
    measured = sobol_result()
    assert list(measured.panels()) == ["total objective", "pull"]
    assert measured.panels()["total objective"] is measured
    assert measured.total == "total objective"
    words = "largest force in N"
    unmeasured = sobol_result(
        outputs={"force": of_output(is_force=True), "stretch": of_output()}, field="summary_force", objective=words
    )
    assert list(unmeasured.panels()) == [words, "stretch"], "the one protocol and the force are the same"
    assert unmeasured.total == words


def test_courses_of_the_force_are_called_by_the_specimen_alone():
    assert sobol_result().courses() == {"s01": ("s01", None)}
    two = sobol_result(tables={"s01": "a", "s02": "b"})
    assert two.courses() == {"s01": ("s01", None), "s02": ("s02", None)}


def test_courses_of_outputs_are_called_by_their_name_and_the_specimen_where_there_are_several():
    outputs = {"pull_force": of_output(is_force=True), "stretch": of_output()}
    one = sobol_result(outputs=outputs)
    assert one.courses() == {"pull_force": ("s01", None), "stretch": ("s01", "stretch")}
    two = sobol_result(outputs=outputs, tables={"s01": "a", "s02": "b"})
    assert two.courses() == {
        "s01: pull_force": ("s01", None),
        "s01: stretch": ("s01", "stretch"),
        "s02: pull_force": ("s02", None),
        "s02: stretch": ("s02", "stretch"),
    }


def test_what_failed_rows_could_change_is_there_for_each_assumption():
    smallest, mean, largest = (np.full(2, float(i)) for i in range(3))
    some = Failures("", 1, 1, {}, ST_if_smallest=smallest, ST_if_mean=mean, ST_if_largest=largest, S1_if_mean=mean)
    assert [values[0] for values in some.outcomes("ST")] == [0.0, 1.0, 2.0]
    assert [values[0] for values in some.outcomes("S1")] == [1.0]
    assert Failures("", 0, 0, {}).outcomes("ST") == []


@pytest.mark.parametrize(
    ("field", "value", "problem"),
    [("rows", -5, "-5: expected at least 0"), ("failed", -1, "-1: expected at least 0"),
     ("scrambles", -1, "-1: expected at least 0"), ("confidence", 42.0, "42.0: expected 0 to 1")],
)  # fmt: skip
def test_numbers_that_cannot_be_are_refused(tmp_path, field, value, problem):
    assert sobol_result().rows == 16
    refused(tmp_path, sobol_result(), {field: value}, rf"sobol\.json: {field}: {problem}")


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"base_samples_used": 999}, "base_samples_used: 999 of "),
        ({"failed": 999}, "failed: 999 of "),
        ({"bounds": [[2.0, 1.0]]}, "bounds: not two numbers in order"),
        ({"bounds": [[1.0]]}, "bounds: not two numbers in order"),
        ({"bounds": []}, "names, 0 ranges"),
    ],
)
def test_counts_that_contradict_each_other_are_refused(changed, words):
    with pytest.raises(ValueError, match=words):
        sobol_result(**changed)


THREE = dict.fromkeys(ZEROS, np.zeros(3))


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"ST": np.zeros(3)}, "ST: 3 numbers for 2 names"),
        ({"protocols": {"pull": OfProtocol(**THREE)}}, "S1: 3 numbers for 2 names"),
        ({"specimens": {"s": OfSpecimen(**THREE, failed={}, protocols={})}}, "S1: 3 numbers for 2 names"),
        ({"specimens": {"s": OfSpecimen(**ZEROS, failed={}, protocols={"p": Indices(**THREE)})}}, "S1: 3 numbers"),
        ({"outputs": {"o": OfOutput("max", "N", False, **THREE, protocols={})}}, "S1: 3 numbers for 2 names"),
        ({"outputs": {"o": OfOutput("max", "N", False, **ZEROS, protocols={"p": Indices(**THREE)})}}, "S1: 3 numbers"),
        ({"convergence": Convergence([4], *(np.zeros((1, 3)),) * 4)}, "convergence: not one number for each"),
        ({"convergence": Convergence([4], *(np.empty(0),) * 4)}, "convergence: not one number for each"),
        ({"failures": Failures("", 0, 0, {}, ST_if_mean=np.zeros(3))}, "failures: not 2 numbers"),
    ],
)
def test_indices_of_other_parameters_than_the_names_are_refused(changed, words):
    with pytest.raises(ValueError, match=words):
        sobol_result(**changed)


@pytest.mark.parametrize("field", ["ST", "ST_conf", "S1_conf"])
def test_half_widths_and_total_indices_below_zero_are_refused(tmp_path, field):
    sobol_result().write(tmp_path)
    path = SobolResult.path(tmp_path)
    content = json.loads(path.read_text())
    content[field][0] = -0.5
    path.write_text(json.dumps(content))
    with pytest.raises(BadInput, match=rf"sobol\.json: {field}: .*: expected at least 0"):
        SobolResult.read(tmp_path)
