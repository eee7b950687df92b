"""What the page says of a posterior in one line."""

from dataclasses import replace

import pytest

from sinew.tasks.infer.abc.page import _narrowed
from sinew.tasks.infer.abc.result import AbcResult
from tests.tasks.posteriors import posterior_of


@pytest.mark.parametrize(
    ("sd", "words"),
    [(20.0, "0.1 times as wide as"), (194.0, "as wide as"), (206.0, "as wide as"), (300.0, "1.5 times as wide as")],
)
def test_a_posterior_is_compared_with_its_prior(sd, words):
    one = posterior_of(["d/1"], ["E_f"], [200.0])  # its prior has a standard deviation of 200
    sites = {"d": replace(one, parameters={"E_f": replace(one.parameters["E_f"], sd=sd)})}
    result = AbcResult("store", ["E_f"], ["MPa"], [""], False, "ranges", 300, 0.95, sites, "known")
    assert _narrowed(result) == words
