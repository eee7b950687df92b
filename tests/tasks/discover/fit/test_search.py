"""What a candidate's score takes note of."""

from dataclasses import replace

import numpy as np
import pytest

from sinew.tasks.discover.fit.fit import Fitted
from sinew.tasks.discover.fit.search import MAX_PAIRS, Candidates, _criterion, _promising, _score
from sinew.tasks.discover.fit.sizes import Size, sized
from sinew.tasks.discover.result import Gain
from sinew.tasks.model.effects import library

PRESSED = 100.0  # the loss would fall by so much beyond a bound


def fitted(effect, **ends: float) -> Fitted:
    """A fit of two parameters of the tissue and those of an effect, in the middle of their ranges but for ``ends``."""
    at = np.array([0.5, 0.5, *(ends.get(parameter.name, 0.5) for parameter in effect.parameters)])
    pull = np.where((at == 0.0) | (at == 1.0), PRESSED, 0.0)
    return Fitted(at, 90.0, 100, np.full(at.size, 0.1), pull)


@pytest.mark.parametrize(
    ("slug", "ends", "expected"),
    [
        ("permanent-set", {"yield_stress": 1.0}, ("yield_stress",)),
        ("permanent-set", {"yield_spread": 1.0}, ("yield_spread",)),
        ("permanent-set", {"yield_spread": 0.0}, ()),  # all bonds yield at once: a limit of the law
        ("permanent-set", {"yielding_part": 0.0}, ()),  # its null
        ("permanent-set", {"yielding_part": 1.0}, ("yielding_part",)),
        ("toe-slack", {"slack_stretch": 1.0}, ()),  # its null
        ("toe-slack", {"slack_stretch": 0.0}, ("slack_stretch",)),
        ("softening", {"softening_shape": 0.0, "softening_strain": 1.0}, ("softening_shape", "softening_strain")),
    ],
)
@pytest.mark.parametrize("stress", [1.0, 0.1, 10.0])
def test_a_bound_counts_unless_it_is_a_null_or_a_limit_of_the_law(slug, ends, expected, stress):
    effect = sized(library()[slug], Size(stress=stress))
    null = Fitted(np.full(2, 0.5), 200.0, 100, np.full(2, 0.1), np.zeros(2))
    one = fitted(effect)
    assert _score((effect,), [one, one], [null, null]).on_bound == ()
    assert _score((effect,), [one, fitted(effect, **ends)], [null, null]).on_bound == expected


def test_a_pair_with_more_parameters_must_promise_more():
    slack, lag, flow = (library()[slug] for slug in ("toe-slack", "time-lag", "fluid-flow"))
    pairs, points = [(slack, flow), (slack, lag), (lag, slack)], [1000, 1000]
    worth = float(np.log(1000.0) * 2)
    for gain, first in ((0.9 * worth, lag), (1.1 * worth, flow)):
        promises = [_criterion(pair, 500.0 - gain * (flow in pair), points) for pair in pairs]
        found = _promising(pairs, promises)
        assert found[0] == (slack, first)
        assert len(found) == 2, "in one order only"
    others = [(slack, effect) for slug, effect in library().items() if slug != "toe-slack"]
    assert _promising(others, list(range(len(others), 0, -1))) == others[: -MAX_PAIRS - 1 : -1]


def test_one_more_candidate_leaves_what_is_known_of_others():
    """Of the same effects in two forms the better one is kept, whichever came first."""
    slack, spread = library()["toe-slack"], library()["toe-slack"].other_forms[0]
    lag = library()["time-lag"]

    def fits(effect, loss):
        return [replace(fitted(effect), loss=loss, points=1000) for _ in range(2)]

    bare = [Fitted(np.full(3, 0.5), 5000.0, 1000, np.full(3, 0.1), np.zeros(3)) for _ in range(2)]
    found = Candidates(bare, {(slack,): fits(slack, 2000.0), (lag,): fits(lag, 3000.0)}, 2000.0)
    found.score()
    held = {"protocol": Gain(10.0, 1.0)}
    found.scored[(lag,)] = replace(found.scored[(lag,)], held=held)
    assert found.add((spread,), fits(spread, 2100.0)) == (slack,)
    assert found.add((spread,), fits(spread, 1900.0)) == (spread,)
    assert found.add((slack,), fits(slack, 1950.0)) == (spread,)
    assert found.add((spread, lag), fits(spread, 1800.0)) == (spread, lag)
    assert set(found.scored) == {(lag,), (spread,), (spread, lag)}
    assert found.scored[(lag,)].held == held
