"""The library of effects as data: complete, consistent, found by itself, and described in the docs."""

import re
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sinew.tasks.model import TENDON, Model, effects, fibre
from sinew.tasks.model.effect import PHASES, PLACES, Effect, in_order, model_with
from sinew.tasks.model.effects import library

SLUGS = [
    *("area-error", "buckling", "creep", "cyclic-fatigue", "fiber-compression", "fluid-flow", "force-drift"),
    *("friction", "grip-slip", "machine-compliance", "matrix-stiffening", "permanent-set", "preload"),
    *("rate-viscosity", "relaxation-mode", "rupture", "softening"),
    *("strain-dependent-relaxation", "time-lag", "toe-exponent", "toe-slack"),
]
FORMS = [form for effect in library().values() for form in (effect, *effect.other_forms)]
DOCS = Path(__file__).parents[3] / "docs" / "effects.md"


def test_the_library_holds_these_effects():
    assert list(library()) == SLUGS


def test_each_effect_is_one_file():
    files = {path.stem.replace("_", "-") for path in Path(effects.__file__).parent.glob("*.py")} - {"--init--"}
    assert files == set(library())


@pytest.mark.parametrize("effect", FORMS, ids=lambda effect: effect.title)
def test_an_effect_is_described(effect):
    for text in (effect.title, effect.description, effect.equation, effect.reference):
        assert text.strip()
    assert effect.seen_by
    assert effect.confounded_with
    known = {*library(), *(parameter.name for parameter in TENDON)} - {effect.slug}
    assert set(effect.confounded_with) <= known
    assert all(effect.confounded_with.values())


@pytest.mark.parametrize("effect", FORMS, ids=lambda effect: effect.title)
def test_parameters_have_units_bounds_and_a_possible_null(effect):
    for parameter, null in zip(effect.parameters, effect.null_values, strict=True):
        assert parameter.unit
        assert parameter.minimum < parameter.maximum
        for value in (parameter.minimum, parameter.maximum, parameter.reference, null):
            assert parameter.minimum <= value <= parameter.maximum
            assert parameter.possible(value)
    assert not np.array_equal(effect.typical, effect.null_values)


def test_no_two_effects_share_a_parameter():
    names = [name for effect in library().values() for name in effect.names]
    assert len({*names, *Model().names}) == len(names) + len(TENDON)


def test_a_file_adds_an_effect(tmp_path, monkeypatch):
    text = DOCS.read_text().split("```python\n")[1].split("```")[0]
    (tmp_path / "documented_example.py").write_text(text)
    monkeypatch.setattr(effects, "__path__", [*effects.__path__, str(tmp_path)])
    try:
        found = library.__wrapped__()
    finally:
        sys.modules.pop("sinew.tasks.model.effects.documented_example", None)
    assert set(found) > set(SLUGS)
    assert list(found) == sorted(found)


@pytest.mark.parametrize(
    ("text", "error", "words"),
    [
        ("", ImportError, "has no EFFECT"),
        ("from sinew.tasks.model.effects.time_lag import EFFECT", ValueError, "another effect time-lag"),
    ],
)
def test_a_file_that_is_no_new_effect_is_refused(tmp_path, monkeypatch, text, error, words):
    (tmp_path / "zz_refused.py").write_text(text)
    monkeypatch.setattr(effects, "__path__", [*effects.__path__, str(tmp_path)])
    try:
        with pytest.raises(error, match=words):
            library.__wrapped__()
    finally:
        sys.modules.pop("sinew.tasks.model.effects.zz_refused", None)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"null": {"lag": 0.0}}, "null has"),
        ({"null": {}}, "needs null values"),
        ({"shared": ("lag",)}, "shared has"),
        ({"seen_by": ("noon",)}, "seen_by has"),
        ({"febio": {"somewhere": "<a/>"}, "no_febio": ""}, "febio has"),
        ({"no_febio": ""}, "either febio or no_febio"),
        ({"other_forms": (library()["preload"],)}, "have its slug"),
    ],
)
def test_an_effect_that_contradicts_itself_is_refused(change, words):
    with pytest.raises(ValueError, match=words):
        replace(library()["time-lag"], **change)


def test_order_and_model_with_effects():
    chosen = (library()["time-lag"], library()["area-error"])
    assert [effect.slug for effect in in_order(chosen)] == ["area-error", "time-lag"]
    assert model_with(Model(), chosen).names == (*Model().names, "force_lag", "area_factor")
    with pytest.raises(ValueError, match="there twice"):
        in_order((chosen[0], chosen[0]))


@pytest.mark.parametrize("alpha", [0.0, 1500.0])
@pytest.mark.parametrize("beta", [2.0, 3.5])
def test_the_fibres_stress_is_the_slope_of_their_energy(alpha, beta):
    material = {
        name: np.array([[value]])
        for name, value in {"E_f": 200.0, "alpha_f": alpha, "beta": beta, "lambda_0": 1.01}.items()
    }
    stretch = np.linspace(0.98, 1.05, 300)[np.newaxis]
    step = 1e-7
    slope = (fibre.energy(stretch + step, material) - fibre.energy(stretch - step, material)) / (2 * step)
    assert np.allclose(stretch * fibre.stress(stretch, material), slope, atol=1e-5)


def test_the_docs_name_every_effect_place_and_phase():
    text = DOCS.read_text()
    for word in (*library(), *PLACES, *PHASES, *(name for effect in FORMS for name in effect.names)):
        assert word in text, word
    for effect in library().values():
        (row,) = (line for line in text.splitlines() if line.startswith(f"| `{effect.slug}` |"))
        for one in effect.parameters:
            ranged = f"({one.unit}): {one.minimum:g} to {one.maximum:g}, {one.reference:g}"
            assert re.search(rf"`{one.name}`\*? {re.escape(ranged)}", row), f"{one.name} {ranged}"
    assert isinstance(library()["preload"], Effect)
