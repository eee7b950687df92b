"""Results of a PAWN analysis whose numbers contradict each other are refused."""

import numpy as np
import pytest

from sinew.tasks.pawn.result import Pawn, PawnResult
from tests.tasks.changed_results import refused

ONE = tuple(np.array(each) for each in ([0.4, 0.1], [0.3, 0.1], [0.5, 0.2], [0.7, 0.2], [0.45, 0.1], [0.3, 0.2]))


def result() -> PawnResult:
    return PawnResult(
        ["a", "b"], *ONE, 0.05, 10, 0.95, 100, 3, "the error", "objective", {"relax": Pawn(*ONE, 0.05)}, "inputs"
    )


def test_a_result_is_read_as_it_was_written(tmp_path):
    result().write(tmp_path)
    found = PawnResult.read(tmp_path)
    assert found is not None
    np.testing.assert_array_equal(found.protocols["relax"].maximum, [0.7, 0.2])


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"median": [7.0, 0.1]}, "median: .*expected 0 to 1"),
        ({"CV": [-3.0, 0.1]}, "CV: .*expected at least 0"),
        ({"median_low": [0.9, 0.1]}, "median: outside median_low to median_high"),
        ({"maximum": [0.42, 0.2]}, "maximum: below the median or the mean"),
        ({"no_influence": -5.0}, "no_influence: -5.0: expected 0 to 1"),
        ({"failed": 1000}, "failed: 1000 of 100 rows"),
        ({"mean": [0.1]}, "mean: 1 numbers for 2 names"),
    ],
)
def test_numbers_that_cannot_be_are_refused(tmp_path, change, told):
    refused(tmp_path, result(), change, told)
