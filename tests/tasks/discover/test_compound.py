"""Effects that are certain among several: not those in whose place another does better."""

from dataclasses import dataclass
from types import SimpleNamespace

import pytest

from sinew.tasks.discover import compound as module
from sinew.tasks.discover.compound import compound
from sinew.tasks.discover.follow_up import Part
from sinew.tasks.discover.judge.scores import Score, Scores


@dataclass(frozen=True)
class Form:
    slug: str


def part(effect, doubt=None):
    return Part(effect, effect, 0.5, (0.4, 0.6), 900.0, 4.0, None, None, None, doubt)


SLIP, LAG, DRIFT = (Form(name) for name in ("grip-slip", "time-lag", "force-drift"))
ALONE = (Score(("grip-slip",), 0.0, 3000.0), Score(("time-lag",), 0.0, 3500.0))
BOTH = Score(("grip-slip", "time-lag"), 0.0, 2000.0)


@pytest.mark.parametrize(
    ("others", "fitted", "certain", "doubts"),
    [
        ((), [(SLIP, LAG)], (SLIP, LAG), [None, None, "why"]),
        ((Score(("grip-slip", "creep"), 0.0, 1500.0),), [(SLIP, LAG), (SLIP,)], (SLIP,),
         [None, "creep explains more in its place", "why"]),
        ((Score(("grip-slip", "creep"), 0.0, 1500.0), Score(("friction",), 0.0, 2500.0)), [(SLIP, LAG), (SLIP,)], (),
         ["friction explains more in its place", "creep explains more in its place", "why"]),
    ],
)  # fmt: skip
def test_effects_that_are_outdone_are_not_certain_and_the_rest_is_looked_at_again(
    others, fitted, certain, doubts, monkeypatch
):
    members = [SimpleNamespace(form=form) for form in (SLIP, LAG, DRIFT)]
    found = {"grip-slip": part("grip-slip"), "time-lag": part("time-lag"), "force-drift": part("force-drift", "why")}
    done = []
    monkeypatch.setattr(module, "asked", lambda *_: [])
    monkeypatch.setattr(module, "stepwise", lambda *_: SimpleNamespace(members=members, fits=[]))
    monkeypatch.setattr(module, "_part", lambda _, __, ___, member: found[member.form.slug])
    monkeypatch.setattr(module, "_added", lambda _, __, ___, effects, ____: done.append(effects) or effects)
    scores = Scores(Score((), 9000.0, 9000.0), (*ALONE, BOTH, *others), 1000.0)
    result = compound(None, None, [None], SimpleNamespace(scores=scores))
    assert result.certain == certain
    assert [one.doubt for one in result.parts] == doubts
    assert done == fitted
