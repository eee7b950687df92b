"""Results of a screening whose numbers contradict each other are refused."""

import numpy as np
import pytest

from sinew.tasks.morris.result import Effects, MorrisResult
from tests.tasks.changed_results import refused


def result() -> MorrisResult:
    one = (np.array([-1.0, 0.5]), np.array([2.0, 0.5]), np.array([0.1, np.nan]), np.array([1.0, 0.0]))
    return MorrisResult(
        ["a", "b"], [[0.0, 1.0], [2, 3]], *one, 30, 3, 10, 9, 4, 0.95, "the error", "N", "objective",
        {"relax": Effects(*one)}, {}, "inputs",
    )  # fmt: skip


def test_a_result_is_read_as_it_was_written(tmp_path):
    result().write(tmp_path)
    found = MorrisResult.read(tmp_path)
    assert found is not None
    np.testing.assert_array_equal(found.protocols["relax"].mu, [-1.0, 0.5])


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"mu_star": [-0.5, 0.5]}, "mu_star: .*expected at least 0"),
        ({"sigma": [-1.0, 0.5]}, "sigma: .*expected at least 0"),
        ({"mu": [9.0, 0.5]}, "mu: larger than mu_star"),
        ({"mu": [1.0]}, "mu: 1 numbers for 2 names"),
        ({"names": ["a", "a"]}, "names: a, a, of which one comes twice"),
        ({"bounds": [[1, 0], [2, 3]]}, "bounds: not two numbers in order"),
        ({"bounds": [[0, 1]]}, "bounds: not two numbers in order"),
        ({"failed": 99}, "9 of 10 trajectories are used, 99 of 30 rows failed"),
        ({"trajectories_used": 11}, "11 of 10 trajectories"),
        ({"trajectories": 10**15}, "rows: 30 of 1,000,000,000,000,000 trajectories of 3 each"),
        ({"levels": 3}, "3 levels, confidence 0.95"),
        ({"confidence": 0.0}, "4 levels, confidence 0"),
    ],
)
def test_numbers_that_cannot_be_are_refused(tmp_path, change, told):
    refused(tmp_path, result(), change, told)
