"""What ``surrogate.json`` may hold."""

import numpy as np
import pytest

from sinew.tasks.surrogate.result import OfComponent, OfCourse, OfSpecimen, SurrogateResult

COMPONENT = OfComponent("process", 3, np.zeros(4), 0.01)


def result(**changed):
    course = OfCourse("force", "pull", "N", 2.0, 0.01, 1.1, 0.02, 0.96)
    values = {
        "table": "a", "runs": 96, "failed": 1, "sizes": [64, 96], "errors": np.array([0.1, 0.01]),
        "courses": {"force_pull": course}, "components": [COMPONENT], "caught": np.nan, "mistaken": np.nan,
    }  # fmt: skip
    one = OfSpecimen(**values | {key: value for key, value in changed.items() if key in values})
    top = {"names": ["a", "b"], "bounds": [[0.0, 1.0], [2.0, 3.0]], "asked": 0.02, "growth": "active",
           "specimens": {"s": one}, "inputs": "x"}  # fmt: skip
    return SurrogateResult(**top | {key: value for key, value in changed.items() if key in top})


def test_it_is_read_as_it_was_written(tmp_path):
    assert result().reached
    result().write(tmp_path)
    before = (tmp_path / "surrogate.json").read_bytes()
    SurrogateResult.read(tmp_path).write(tmp_path)
    assert (tmp_path / "surrogate.json").read_bytes() == before


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"failed": 97}, "97 of 96 runs failed"),
        ({"sizes": [64]}, "sizes"),
        ({"runs": 64}, "sizes"),
        ({"bounds": [[0.0, 1.0]]}, "bounds"),
        ({"bounds": [[1.0, 1.0], [2.0, 3.0]]}, "bounds"),
        ({"components": [COMPONENT] * 13}, "13 components"),
        ({"components": [OfComponent("forest", 3, np.zeros(4), 0.01)]}, "kind 'forest'"),
        ({"components": [OfComponent("chaos", 3, np.zeros(3), 0.01)]}, "with 3 numbers"),
        ({"components": [OfComponent("chaos", 0, np.zeros(4), 0.01)]}, "with 4 numbers"),
        ({"components": [OfComponent("chaos", 200, np.zeros(4), 0.01)]}, "with 4 numbers"),
        ({"sizes": [96, 96]}, "sizes"),
        ({"sizes": [-1, 96]}, "sizes"),
        ({"errors": np.full((2, 2), 0.01)}, "sizes"),
        ({"courses": {}}, "no courses"),
        ({"specimens": {}}, "no specimens"),
        ({"runs": 2001, "sizes": [64, 2001]}, "1 of 2001 runs failed"),
        ({"components": [OfComponent("chaos", 3, np.full(4, np.inf), 0.01)]}, "not finite"),
    ],
)
def test_numbers_that_contradict_each_other_are_refused(changed, words):
    with pytest.raises(ValueError, match=words):
        result(**changed)
