"""The results of the golden study are those that were accepted, and a change of a result raises a version."""

import copy
import json

import pytest

from sinew.tasks.registry import TASKS
from tests.golden import compare as golden


@pytest.mark.parametrize("task", TASKS)
def test_results_are_the_accepted_ones(golden_run, task):
    lines = golden.compare(golden_run).get(task, [])
    assert not lines, "\n".join(["a result changed (see CONTRIBUTING.md, golden results):", *lines[:20]])


def test_what_was_accepted_for_a_version_is_what_stands_there():
    assert golden.edited_by_hand() == []


def test_a_changed_result_needs_another_version(golden_run, tmp_path, monkeypatch):
    monkeypatch.setattr(golden, "EXPECTED", tmp_path / "expected")
    monkeypatch.setattr(golden, "ACCEPTED", tmp_path / "expected" / "accepted.json")
    assert golden.accept(golden_run) == list(TASKS)
    assert golden.accept(golden_run) == []
    content = json.loads((golden_run / "sobol.json").read_text())
    changed = tmp_path / "changed"
    changed.mkdir()
    for task in TASKS:
        (changed / f"{task}.json").write_bytes((golden_run / f"{task}.json").read_bytes())
    content["ST"][0] *= 1.001
    (changed / "sobol.json").write_text(json.dumps(content))
    assert list(golden.compare(changed)) == ["sobol"]
    with pytest.raises(ValueError, match="sobol: the result changed, version 3 did not"):
        golden.accept(changed)
    (changed / "sobol.json").write_text(json.dumps(content | {"version": 4}))
    assert golden.accept(changed) == ["sobol"]
    (changed / "sobol.json").write_text(json.dumps(content | {"version": 5}))  # results of other studies only
    assert golden.accept(changed) == []
    assert list(json.loads(golden.ACCEPTED.read_text())["sobol"]) == ["3", "4", "5"]


A = {"a": [1, 2.0, None, "x"], "b": {"c": True, "factor": 1.0}}


@pytest.mark.parametrize(
    ("change", "line"),
    [
        (lambda new: new["a"].__setitem__(1, 2.0 + 1e-9), None),
        (lambda new: new["a"].__setitem__(1, 2.001), "a[1]: 2.0 became 2.001"),
        (lambda new: new["a"].__setitem__(0, 2), "a[0]: 1 became 2"),
        (lambda new: new["a"].__setitem__(2, 0.0), "a[2]: None became 0.0"),
        (lambda new: new["a"].pop(), "a: 4 items became 3"),
        (lambda new: new["b"].__setitem__("d", 1), "b: keys ['c', 'factor'] became ['c', 'factor', 'd']"),
        (lambda new: new["b"].__setitem__("c", 1), "b.c: True became 1"),
        (lambda new: new["b"].__setitem__("factor", 1.01), None),
        (lambda new: new["b"].__setitem__("factor", 1.03), "b.factor: 1.0 became 1.03"),
        (lambda new: new.__setitem__("b", new.pop("b")), None),
        (lambda new: new.__setitem__("a", new.pop("a")), "top: keys ['a', 'b'] became ['b', 'a']"),
    ],
)
def test_what_counts_as_a_difference(change, line):
    new = copy.deepcopy(A)
    change(new)
    assert list(golden.differences(A, new)) == ([] if line is None else [line])
