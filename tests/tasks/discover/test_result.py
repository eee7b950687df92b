"""``discover.json`` is written and read without loss, and a damaged one is one clear line."""

import json

import numpy as np
import pytest

from sinew.runner.errors import BadInput
from sinew.tasks.discover.follow_up import SolverCheck, SolverRun
from sinew.tasks.discover.misfit_map import NoiseLevel
from sinew.tasks.discover.result import DiscoverResult, Gain, Gap
from sinew.tasks.discover.show import noise_words
from sinew.tasks.study.result import plain
from tests.tasks.discover.results import MODEL, candidate, discovery


def test_what_is_written_is_read_and_its_copy_is_the_same(tmp_path):
    slack = candidate("toe-slack", loss=1010.0, held_out=50.0, slack_stretch=(0.98, 0.99))
    found = discovery("NAMED", effects=("toe-slack",), shown=("toe-slack",), model=MODEL, candidates=(slack,))
    found.write(tmp_path)
    read = DiscoverResult.read(tmp_path)
    assert plain(read) == plain(found)
    assert read.judged.parameters["s01"]["slack_stretch"].interval == (0.98, 0.99)
    assert (tmp_path / "verdict.json").read_bytes() == (tmp_path / "discover.json").read_bytes()


def test_what_does_not_apply_is_left_out(tmp_path):
    discovery("NONE", gap=Gap()).write(tmp_path)
    content = json.loads((tmp_path / "discover.json").read_text())
    assert list(content)[-3:] == ["inputs", "parts", "version"], "no cells after: there are no effects"
    assert "splits" not in content["gap"]
    assert content["model"] is None
    assert plain(SolverCheck((), ran=True, version="4", runs={"a": SolverRun(failed="no")})) == {
        "inputs": [], "ran": True, "version": "4", "runs": {"a": {"failed": "no"}},
    }  # fmt: skip


def test_an_error_that_is_not_known_is_read_back(tmp_path):
    one = candidate("toe-slack", loss=1010.0, held_out=50.0)
    one.splits["protocol"] = Gain(50.0, np.inf)
    discovery(candidates=(one,)).write(tmp_path)
    assert np.isnan(DiscoverResult.read(tmp_path).candidates[0].splits["protocol"].error)


@pytest.mark.parametrize(
    ("path", "value", "words"),
    [
        (("verdict",), "MAYBE", "discover.json: verdict: 'MAYBE'"),
        (("null", "loss"), None, "discover.json: null.loss: None"),
        (("candidates", 0, "gain"), "much", "discover.json: candidates.0.gain: 'much'"),
        (("cells",), 7, "discover.json: cells: 7"),
        (("gap",), None, "discover.json: gap: None"),
        (("confidence", "true"), 1_000, "confidence: 1000 of "),
        (("confidence", "share"), 1.5, "discover.json: confidence.share: 1.5: expected 0 to 1"),
        (("confidence", "interval"), [0.9, 0.1], "(0.9 to 0.1); expected"),
        (("confidence", "share"), 0.01, ", 0.01 ("),
        (("confidence", "share"), 0.9, "confidence: 30 of 31, 0.9 ("),
        (("verdict",), "NAMED", "a verdict NAMED with effects () and set ()"),
        (("effects",), ["toe-slack"], "a verdict NONE with effects ('toe-slack',) and set ()"),
        (("set",), ["toe-slack"], "a verdict NONE with effects () and set ('toe-slack',)"),
        (("shown",), ["creep"], "shown: creep, which is no candidate"),
        (("explained",), 1.3, "explained: 1.3 of a misfit of 4000"),
    ],
)
def test_a_damaged_result_is_one_clear_line(tmp_path, path, value, words):
    discovery(candidates=(candidate("toe-slack", loss=1010.0),)).write(tmp_path)
    content = json.loads((tmp_path / "discover.json").read_text())
    part = content
    for key in path[:-1]:
        part = part[key]
    part[path[-1]] = value
    (tmp_path / "discover.json").write_text(json.dumps(content))
    with pytest.raises(BadInput) as wrong:
        DiscoverResult.read(tmp_path)
    assert words in str(wrong.value)
    assert "run it again" in str(wrong.value)


def test_noise_is_told_with_what_it_grows_by():
    assert noise_words(NoiseLevel(0.000133, 0.4, 0.0166)) == "0.000133 N and 1.7 % of the force"
    assert noise_words(NoiseLevel(0.02, 0.4, 0.0)) == "0.02 N"
