"""Effects that are certain among several: not those in whose place another does better."""

from dataclasses import dataclass
from types import SimpleNamespace

import pytest

from sinew.tasks.discover import compound as module
from sinew.tasks.discover import task
from sinew.tasks.discover.compound import compound
from sinew.tasks.discover.follow_up import Part
from sinew.tasks.discover.judge import partly
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
    monkeypatch.setattr(module, "stepwise", lambda *_: SimpleNamespace(members=members, fits=[]))
    monkeypatch.setattr(module, "_part", lambda _, __, ___, ____, member: found[member.form.slug])
    monkeypatch.setattr(module, "_added", lambda _, __, ___, effects, ____: done.append(effects) or effects)
    scores = Scores(Score((), 9000.0, 9000.0), (*ALONE, BOTH, *others), 1000.0)
    result = compound(None, [None], SimpleNamespace(scores=scores, fits={}))
    assert result.certain == certain
    assert [one.doubt for one in result.parts] == doubts
    assert done == fitted


@pytest.mark.parametrize(
    ("losing", "left", "expected"),
    [
        (("creep", "slip"), {"creep": 3000.0, "slip": 1400.0}, partly.Form("creep", pytest.approx(0.1, rel=0.1))),
        (("creep", "slip"), {"creep": 1300.0, "slip": 1400.0}, None),  # it is the one that matters more
        (("slip",), {"creep": 3000.0, "slip": 1400.0}, None),
        (("creep",), {"creep": 3000.0, "slip": 1400.0}, None),
    ],
)
def test_only_an_effect_that_loses_displacement_may_mend_the_form_of_one_that_does(losing, left, expected):
    members = [
        SimpleNamespace(
            form=SimpleNamespace(slug=slug, displacement=print if slug in losing else None),
            without=(SimpleNamespace(loss=loss),),
        )
        for slug, loss in left.items()
    ]
    candidates = SimpleNamespace(bare=(SimpleNamespace(loss=5000.0),), floor=1000.0)
    found = module._form_that_it_may_mend(SimpleNamespace(members=members), members[1], candidates)
    assert found == expected


@pytest.mark.parametrize(
    ("named", "mends", "covered"),
    [
        ((), {}, True),
        (("creep",), {}, True),
        (("creep", "slip"), {}, False),
        (("creep", "slip"), {"slip": "creep"}, True),
        (("lag",), {}, False),
    ],
)
def test_what_may_only_mend_the_form_of_another_need_not_be_certain(named, mends, covered):
    parts = [SimpleNamespace(effect=effect, mends=mends.get(effect)) for effect in ("creep", "slip")]
    assert task.covers((Form("creep"),), parts, named) == covered
