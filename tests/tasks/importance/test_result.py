"""Results of random forest importance whose numbers contradict each other are refused."""

import numpy as np
import pytest

from sinew.tasks.importance.result import Forest, ImportanceResult
from tests.tasks.changed_results import refused

ONE = tuple(np.array(each) for each in ([60.0, 40.0], [3.0, 2.0], [0.9, -0.01], [0.1, 0.0]))


def result() -> ImportanceResult:
    return ImportanceResult(
        ["a", "b"], *ONE, 0.9, "the error", "objective", {"relax": Forest(*ONE, 0.8)}, 75, 25, 0, 0, "inputs"
    )


def test_a_result_is_read_as_it_was_written(tmp_path):
    result().write(tmp_path)
    found = ImportanceResult.read(tmp_path)
    assert found is not None
    np.testing.assert_array_equal(found.protocols["relax"].permutation, [0.9, -0.01])


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"impurity_percent": [900.0, 40.0]}, "impurity_percent: 940 % in all"),
        ({"impurity_percent": [-40.0, 40.0]}, "impurity_percent: .*expected at least 0"),
        ({"impurity_sd": [-1.0, 0.0]}, "impurity_sd: .*expected at least 0"),
        ({"permutation_sd": [0.1]}, "permutation_sd: 1 numbers for 2 names"),
        ({"names": ["a", "a"]}, "names: a, a, of which one comes twice"),
    ],
)
def test_numbers_that_cannot_be_are_refused(tmp_path, change, told):
    refused(tmp_path, result(), change, told)
