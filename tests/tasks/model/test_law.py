"""Laws as data: the grammar takes what is admissible and nothing else; a compiled law does what its equation says."""

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sinew.tasks.model import Model, Protocol, Specimen
from sinew.tasks.model.effects import effect_named, library
from sinew.tasks.model.lagging import lagging
from sinew.tasks.model.law import ADMISSIBLE, LOSS, SHAPES, Term, compiled, is_law, law, shaped, terms
from sinew.tasks.model.protocols import cyclic
from sinew.tasks.simulate.effects import bars_with, simulate_with

UNITS = {"strain": 0.04, "rate": 0.01, "path": 0.1, "time": 100.0, "force": 1000.0}
EVERY = list(terms(UNITS))
SIZE = Specimen("one", 10.0, 8.0, 4.0)


def row():
    return np.array([[parameter.reference for parameter in Model().parameters]])


def pulled(effect, values, protocol=None):
    return simulate_with(Model(), (effect,), SIZE, protocol or cyclic(10.0, 4.0), row(), np.array([values]))[0]


@pytest.mark.parametrize("term", EVERY, ids=lambda term: term.name)
def test_every_admissible_law_is_read_back_from_its_name_and_does_nothing_at_its_null(term):
    effect = law(term.name)
    assert (effect.name, effect.equation) == (term.name, compiled(term).equation)
    assert is_law(effect.name) and effect_named(effect.name) is effect
    bare = simulate_with(Model(), (), SIZE, cyclic(10.0, 4.0), row(), np.zeros((1, 0)))[0]
    np.testing.assert_allclose(pulled(effect, effect.null_values), bare, atol=1e-6)
    changed = pulled(effect, effect.typical)
    assert np.isfinite(changed).all()
    for parameter, null in zip(effect.parameters, effect.null_values, strict=True):
        assert parameter.minimum <= null <= parameter.maximum and parameter.possible(parameter.maximum)


def test_laws_that_only_lose_cannot_gain():
    for term in EVERY:
        size = compiled(term).parameters[0]
        if term.sign == LOSS:
            assert size.maximum == 0.0 > size.minimum
        elif term.part == "series":
            assert size.minimum == 0.0


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("law/fibres/strain/power", "not of the form"),
        ("law/bone/strain:0.1/power", "bone is no part; expected one of fibres, matrix, series, parallel"),
        ("law/fibres/force:1000/power", "force is no driver; expected one of strain, largest-strain"),
        ("law/fibres/strain:0.1/__import__", "not of the form"),
        ("law/fibres/strain:0.1/sine", "sine is no form; expected one of power"),
        ("law/fibres/time:100/exponential", "exponential is no form; expected one of power, logarithm"),
        ("law/fibres/strain:0/power", "the unit of the driver is 0"),
        ("law/fibres/strain:1e-9/power", "not of the form"),
        ("law/fibres/strain:0.1/power\n", "not of the form"),
        ("law/", "not of the form"),
    ],
)
def test_what_is_no_law_is_one_line(name, words):
    with pytest.raises(ValueError, match=re.escape(words)):
        law(name)


@given(st.text(max_size=60))
def test_no_text_is_taken_for_a_law_by_accident(text):
    with pytest.raises(ValueError):
        law("law/" + text)


@given(
    st.sampled_from(sorted(SHAPES)),
    st.lists(st.floats(0.0, 10.0), min_size=2, max_size=6).map(sorted),
    st.floats(0.0, 1.0),
)
def test_forms_begin_at_nothing_and_never_fall(form, x, part):
    low, high, _ = SHAPES[form]
    values = shaped(form, np.array([[0.0, *x]]), np.array([[low + part * (high - low)]]))[0]
    assert values[0] == 0.0
    assert (np.diff(values) >= 0.0).all()


@pytest.mark.parametrize("form", [form for form in SHAPES if form != "threshold"])
def test_a_form_is_one_at_the_unit_of_its_driver(form):
    assert shaped(form, np.array([[1.0]]), np.array([[SHAPES[form][2]]])) == pytest.approx(1.0)


def test_damage_by_the_largest_strain_is_what_its_equation_says():
    effect = law("law/fibres/largest-strain:0.04/power")
    protocol, values = cyclic(10.0, 4.0), np.array([[-0.5, 2.0]])
    bars = bars_with(Model(), (effect,), SIZE, protocol, row(), values)
    bare = bars_with(Model(), (), SIZE, protocol, row(), np.zeros((1, 0)))
    x = np.maximum.accumulate(np.abs(bars.fibre_strain[0])) / 0.04
    np.testing.assert_allclose(bars.fibre_MPa[0], bare.fibre_MPa[0] * np.maximum(1.0 - 0.5 * x**2, 0.0), rtol=1e-12)


@pytest.mark.parametrize(
    ("name", "values", "same", "theirs"),
    [
        ("law/series/force:1000/power", [0.05, 1.0], "machine-compliance", [0.05 / 1000.0]),
        ("law/series/largest-force:1000/power", [0.05, 1.0], "grip-slip", [0.05 / 1000.0, 0.0]),
        ("law/parallel/time:100/power", [30.0, 1.0], "force-drift", [0.0, 0.3]),
    ],
)
def test_a_law_that_is_an_effect_of_the_library_gives_its_forces(name, values, same, theirs):
    protocol = cyclic(10.0, 4.0)
    expected = simulate_with(Model(), (library()[same],), SIZE, protocol, row(), np.array([theirs]))[0]
    np.testing.assert_allclose(pulled(law(name), values, protocol), expected, atol=1e-3)


def test_what_lags_behind_a_ramp_is_late_by_its_time():
    time = np.linspace(0.0, 60.0, 601)
    ramp = np.minimum(time, 100.0)[np.newaxis]
    late = lagging(time, ramp, np.array([[5.0]]))[0]
    np.testing.assert_allclose(late, time - 5.0 * -np.expm1(-time / 5.0), atol=1e-9)


def test_a_law_in_series_that_lags_gives_way_slowly():
    time = np.array([0.0, 1.0, *np.linspace(1.5, 200.0, 400)])
    hold = Protocol("hold", time, np.where(time >= 1.0, 0.3, 0.3 * time))
    name = "law/series/lagging-force:1000/power"
    slow = law(name)
    forces = pulled(slow, [0.1, 1.0, 20.0], hold)
    spring = pulled(law("law/series/force:1000/power"), [0.1, 1.0], hold)
    bare = simulate_with(Model(), (), SIZE, hold, row(), np.zeros((1, 0)))[0]
    assert spring[1] < forces[1] < bare[1]
    assert forces[-1] == pytest.approx(spring[-1], rel=0.02)


def test_a_term_says_what_it_is():
    term = Term("series", "lagging-force", 1000.0, "logarithm")
    assert (term.of, term.memory, term.name) == ("force", "lagging", "law/series/lagging-force:1000/logarithm")
    assert term.own("lag") == "series_lagging_force_lag"
    assert set(ADMISSIBLE) == {one.part for one in EVERY}


@pytest.mark.parametrize("term", [term for term in EVERY if term.part in ("fibres", "matrix")], ids=lambda t: t.name)
@pytest.mark.parametrize("end", ["minimum", "maximum"])
def test_no_law_of_the_tissue_gives_back_more_work_than_was_put_in(term, end):
    """Over strains there and back, with either end of the range of its size."""
    time = np.linspace(0.0, 80.0, 801)
    moved = np.interp(time, [0.0, 20.0, 40.0, 60.0, 80.0], [0.0, 0.35, 0.0, 0.35, 0.0])
    effect = compiled(term)
    values = np.array([[getattr(effect.parameters[0], end), *effect.typical[1:]]])
    bars = bars_with(Model(), (effect,), SIZE, Protocol("twice", time, moved), row(), values)
    stress = (bars.fibre_MPa if term.part == "fibres" else bars.matrix_MPa)[0]
    work = np.sum(0.5 * (stress[1:] + stress[:-1]) * np.diff(bars.strain[0]))
    put_in = np.sum(0.5 * np.abs(stress[1:] + stress[:-1]) * np.abs(np.diff(bars.strain[0])))
    assert work >= -1e-9 * put_in


@pytest.mark.parametrize("driver", ["force", "largest-force", "lagging-force"])
def test_what_a_law_in_series_loses_is_lost_under_load_only(driver):
    effect = law(f"law/series/{driver}:1000/power")
    values = np.array([effect.typical])
    bars = bars_with(Model(), (effect,), SIZE, cyclic(10.0, 4.0), row(), values)
    lost = bars.grips_mm[0] - bars.displacement_mm[0]
    assert lost.max() > 0.001
    if driver != "force":
        assert (lost >= -1e-9).all()
    if driver == "largest-force":
        assert (np.diff(lost) >= -1e-9).all()
