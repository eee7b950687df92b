"""Which effects are compared with one in its place: those that promise most, and those that were tried before."""

from dataclasses import dataclass, field
from types import SimpleNamespace

from sinew.tasks.discover.fit import stepwise


@dataclass(frozen=True)
class Form:
    slug: str


A, B, TRIED, PROMISING = (Form(name) for name in ("a", "b", "tried", "promising"))


def fits(evidence):
    return [SimpleNamespace(evidence=evidence)]


@dataclass
class Search:
    """Fits beside a discrepancy that are known, and what promises most in the place of any effect."""

    known: dict
    promised: dict = field(default_factory=dict)

    def promising(self, *_, **__):
        return self.promised

    def fitted(self, several, _):
        self.known |= {effects: fits(10.0) for effects in several}


def rivals(search, chosen, form, monkeypatch):
    monkeypatch.setattr(stepwise, "_plain", lambda _, several: {effects: ["fit"] for effects in several})
    return {one.effect: one.gain for one in stepwise._rivals(search, chosen, form)}


class Alone:
    """A specimen whose simulator has any one effect, and none beside ``a``."""

    def candidate(self):
        return self

    def possible(self, effects):
        return len(effects) == 1 or A not in effects

    def promise_beside(self, _, wanted, before, known):
        return float(len(wanted)), before, known


def test_what_a_simulator_cannot_have_at_once_is_not_tried(monkeypatch):
    def each(_, cohort, __, several, work):
        return [[work(i, wanted, None) for i in range(len(cohort))] for wanted in several]

    monkeypatch.setattr(stepwise, "each_for_all", each)
    known = {(): fits(1.0), (A,): fits(1.0), (B,): fits(1.0)}
    search = stepwise._Search(None, [Alone()], SimpleNamespace(fits={}), [A, B, TRIED], known)
    assert set(search.promising((), 3, 1)) == {(A,), (B,), (TRIED,)}
    assert set(search.promising((B,), 3, 1)) == {(B, TRIED)}
    assert not search.promising((A,), 3, 1)


def test_what_was_tried_in_the_place_of_an_effect_is_a_rival(monkeypatch):
    known = {(): fits(100.0), (A,): fits(5.0), (TRIED,): fits(30.0), (B, TRIED): fits(3.0)}
    search = Search(dict(known), {(PROMISING,): None, (A,): None})
    assert rivals(search, (A,), A, monkeypatch) == {"promising": 90.0, "tried": 70.0}
    assert rivals(Search(known), (A,), A, monkeypatch) == {"tried": 70.0}, "also where nothing promises anything"


def test_beside_others_only_what_was_tried_beside_them_counts(monkeypatch):
    known = {(): fits(100.0), (B,): fits(50.0), (TRIED,): fits(30.0), (B, A): fits(5.0), (B, TRIED): fits(20.0)}
    assert rivals(Search(known), (B, A), A, monkeypatch) == {"tried": 30.0}
    assert rivals(Search({(): fits(1.0), (A,): fits(0.0)}), (A,), A, monkeypatch) == {}
