"""Coverage and ranks of posteriors whose worth is known."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sinew.runner.errors import BadInput
from sinew.tasks.benchmark.infer.result import CohortResult, Ranked
from sinew.tasks.benchmark.infer.score import _ranks, band, covered, nearer, rank, summary, uniform
from sinew.tasks.study.result import plain
from tests.effort import at_most

COHORTS, SIZE, DRAWS = 300, 3, 500


def cohorts(width):
    """Posteriors of normal means by one observation each; ``width`` times as wide as they should be."""
    rng = np.random.default_rng(7)
    for number in range(COHORTS):
        truth = rng.standard_normal(SIZE)
        centre = (truth + rng.standard_normal(SIZE)) / 2
        draws = centre + width * np.sqrt(0.5) * rng.standard_normal((DRAWS, SIZE))
        low, high = np.quantile(draws, [0.025, 0.975], axis=0)
        ranked = [
            Ranked(number, "mean", "first", f"p{j}", rank(draws[:, j], truth[j]), bool(low[j] <= truth[j] <= high[j]))
            for j in range(SIZE)
        ]
        tarp = {"mean": [nearer(draws, truth, rng.standard_normal(SIZE))]}
        yield CohortResult(number, "likelihood", ranked, tarp, SIZE, int(number % 10 == 0), 1.0, None, "")


def test_right_posteriors_hold_what_they_should():
    found = summary(list(cohorts(1.0)))
    every = found["coverage"][0]
    assert every["parameter"] == "all" and every["of"] == COHORTS * SIZE
    for level, share in (("50 %", 0.5), ("80 %", 0.8), ("95 %", 0.95), ("reported 95 %", 0.95)):
        low, high = every["shares"][level]["interval"]
        assert low <= share <= high
        assert high - low < 0.1
    assert all(row["p"] > 0.01 for row in [*found["ranks"], *found["tarp"]])
    for row in found["ranks"]:
        assert sum(row["counts"]) == COHORTS
        assert all(row["band"][0] <= count <= row["band"][1] for count in row["counts"])
    assert found["contrasts"]["share"] == pytest.approx(0.1 / SIZE)


@pytest.mark.parametrize("width", [0.7, 1.4])
def test_posteriors_that_are_too_narrow_or_too_wide_are_seen(width):
    found = summary(list(cohorts(width)))
    low, high = found["coverage"][0]["shares"]["80 %"]["interval"]
    assert high < 0.8 if width < 1 else low > 0.8
    assert all(row["p"] < 0.01 for row in found["ranks"])
    assert found["tarp"][0]["p"] < 0.01


def test_what_was_refused_is_counted():
    refused = CohortResult(2, "likelihood", [], {}, 0, 0, 9.0, "no convergence", "")
    found = summary([*list(cohorts(1.0))[:1], refused])
    assert found["cohorts"] == 2
    assert found["refused"] == [{"cohort": 2, "error": "no convergence"}]
    assert found["coverage"][0]["of"] == SIZE
    nothing = summary([refused])
    assert nothing["coverage"] == [] and nothing["contrasts"] is None and nothing["seconds"] is None


def test_parameters_that_miss_together_widen_the_interval():
    rng = np.random.default_rng(1)
    together = [(n, held) for n, held in enumerate(rng.random(100) < 0.9) for _ in range(10)]
    apart = [(n // 10, held) for n, held in enumerate(rng.random(1000) < 0.9)]
    wide, narrow = (covered(each).interval for each in (together, apart))
    assert wide[1] - wide[0] > 2 * (narrow[1] - narrow[0])


@given(st.lists(st.tuples(st.integers(0, 5), st.booleans()), min_size=1, max_size=60))
def test_the_interval_of_a_share_holds_it(held):
    found = covered(held)
    assert 0.0 <= found.interval[0] <= found.share <= found.interval[1] <= 1.0
    assert covered([]) is None


def test_independent_cohorts_are_covered_by_the_interval_of_their_share():
    """In 95 % of samples; of 400, with a standard deviation of 1.1 %."""
    rng = np.random.default_rng(3)
    holds = 0
    for _ in range(400):
        chance = rng.beta(18, 2, 40)  # of each cohort: 0.9 on average
        sample = [(n, bool(rng.random() < p)) for n, p in enumerate(chance) for _ in range(5)]
        low, high = covered(sample).interval
        holds += low <= 0.9 <= high
    assert 0.92 <= holds / 400 <= 0.99


def test_ties_count_half():
    assert rank(np.array([0.0, 1.0, 1.0, 2.0]), 1.0) == 0.5
    low, high = band(100)
    assert low < 10 < high
    assert uniform([0.5]) is None


def test_very_many_parameters_take_no_more_time_than_they_are():
    ranked = [Ranked(1, "mean", "first", f"p{number}", 0.5, True) for number in range(3_000)]
    with at_most(10):
        found = _ranks(ranked)
        cohort = CohortResult(1, "likelihood", ranked, {}, 0, 0, 1.0, None, "key")
    assert len(found) == 3_000
    with pytest.raises(BadInput, match=r"ranked\.0\.level"):
        CohortResult.parse(plain(cohort) | {"ranked": [{**plain(ranked[0]), "level": "l1"}]}, Path("cohort.json"))
