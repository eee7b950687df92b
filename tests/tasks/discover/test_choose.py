"""Verdicts on made-up candidates: each rule alone turns a name into something more modest."""

from dataclasses import replace

import numpy as np
import pytest

from tasks.discover.choose import Scored, criterion, held_out_gain, verdict

FLOOR = 1000.0
NULL = Scored((), 5000.0, 5000.0)
GOOD = Scored(("softening",), 1120.0, 1100.0, 3000.0, 200.0)
OTHER = Scored(("time-lag",), 3000.0, 2980.0, 500.0, 200.0)


def told(*candidates, located=True, null=NULL):
    found = verdict(null, candidates, FLOOR, located)
    return found.word, found.effects or found.alike


def test_a_clear_effect_is_named():
    assert told(GOOD, OTHER) == ("NAMED", ("softening",))


def test_a_pair_is_named_only_when_it_is_clearly_better_than_one_alone():
    pair = Scored(("softening", "time-lag"), 1110.0, 1060.0, 3000.0, 200.0)
    assert told(GOOD, pair) == ("NAMED", ("softening",))
    assert told(GOOD, replace(pair, criterion=1050.0)) == ("NAMED", ("softening", "time-lag"))


def test_nothing_is_named_where_nothing_is_wrong():
    small = replace(GOOD, criterion=4990.0, loss=4970.0)
    assert told(small, located=False) == ("NONE", ())


def test_what_the_library_does_not_explain_is_outside_of_it():
    assert told(replace(GOOD, criterion=4990.0, loss=4970.0)) == ("OUTSIDE", ())
    assert told(replace(GOOD, criterion=3020.0, loss=3000.0), replace(OTHER, criterion=4000.0)) == ("OUTSIDE", ())


def test_what_fits_alike_is_ambiguous():
    alike = replace(OTHER, criterion=1130.0, loss=1110.0)
    assert told(GOOD, alike) == ("AMBIGUOUS", ("softening", "time-lag"))


@pytest.mark.parametrize("change", [{"held_out": 300.0}, {"on_bound": ("softening_loss",)}])
def test_what_does_not_predict_or_ends_on_a_bound_is_not_named(change):
    assert told(replace(GOOD, **change), OTHER) == ("AMBIGUOUS", ("softening",))


def test_more_parameters_cost_more_with_more_points():
    assert criterion(10.0, 2, [100, 1000]) == pytest.approx(10.0 + 2 * np.log(100 * 1000))


def test_the_error_of_a_gain_counts_blocks():
    rng = np.random.default_rng(3)
    gains, errors = [], []
    for _ in range(300):
        shared = np.repeat(rng.standard_normal(40), 50)
        gain, error = held_out_gain({"curve": (shared, np.zeros(2000))}, 50)
        gains.append(gain)
        errors.append(error)
    assert np.median(errors) == pytest.approx(np.std(gains), rel=0.15)
