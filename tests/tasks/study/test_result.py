"""Results from elsewhere: no more than any task writes."""

import json
from pathlib import Path

import pytest

from sinew.runner.errors import BadInput
from sinew.tasks.sobol.result import SobolResult
from sinew.tasks.study import result


@pytest.mark.parametrize(
    ("field", "value", "most"),
    [
        ("names", ["a"] * (result.MOST_NAMES + 1), "1,000"),
        ("tables", {f"s{i}": "t" for i in range(result.MOST_ENTRIES + 1)}, "20,000"),
        ("protocols", dict.fromkeys(map(str, range(result.MOST_ENTRIES + 1))), "20,000"),
    ],
)
def test_more_than_any_task_writes_is_refused(field, value, most):
    with pytest.raises(BadInput, match=rf"sobol\.json: {field}: [0-9,]+ entries; expected at most {most}"):
        SobolResult.parse({field: value}, Path("sobol.json"))


@pytest.mark.parametrize(
    ("field", "value", "length"),
    [
        ("names", ["a", "b" * (result.LONGEST_NAME + 1)], "301"),
        ("specimens", {"b" * 301: {}}, "301"),
        ("specimens", {"a": {"E_f": [{"b" * 301: 1.0}]}}, "301"),
        ("rule", "b" * (result.LONGEST_TEXT + 1), "5,001"),
        ("specimens", {"a": {"why": ["b" * 5001]}}, "5,001"),
        ("b" * 301, 1.0, "301"),
    ],
)
def test_names_and_sentences_that_nobody_reads_are_refused(field, value, length):
    with pytest.raises(BadInput, match=rf"sobol\.json: .*: a text of {length} characters; expected names and sent"):
        SobolResult.parse({field: value}, Path("sobol.json"))
    longest = "b" * int(length.replace(",", ""))
    allowed = json.loads(json.dumps({field: value}).replace(longest, longest[1:]))
    with pytest.raises(BadInput) as refused:  # for all that is missing
        SobolResult.parse(allowed, Path("sobol.json"))
    assert "a text of" not in str(refused.value)


@pytest.mark.parametrize("version", [99, "1", True, None, 0])
def test_a_result_of_another_version_is_refused(version):
    with pytest.raises(BadInput, match=r"sobol\.json: version: .*; expected at most 3, that of this sinew"):
        SobolResult.parse({"version": version}, Path("sobol.json"))
