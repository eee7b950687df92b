"""FEBio inputs with effects: edited text, and, where the solver is there, two checks of every edited input."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sinew.runner.errors import BadInput
from sinew.tasks.model import Model, Protocol, Specimen
from sinew.tasks.model.effect import model_with
from sinew.tasks.model.effects import library
from sinew.tasks.simulate.effects import simulate_with
from sinew.tasks.simulate.febio.attempt import solver_version
from sinew.tasks.simulate.febio.effects import template_with
from sinew.tasks.simulate.febio.simulator import FEBio
from sinew.tasks.simulate.febio.tendon import read_template
from sinew.tasks.simulate.uniaxial import Uniaxial
from tests.effort import at_most

BAR = Specimen("bar", 10.0, 8.0, 4.0)
BUILT_IN = read_template(Path(), None)
TEMPLATE = BUILT_IN.text
LIBRARY = library()
FORMS = [form for effect in LIBRARY.values() for form in (effect, *effect.other_forms) if form.febio]
TIMES = np.linspace(0.0, 30.0, 121)
PULLED = Protocol(
    "pulled", TIMES, 10.0 * np.interp(TIMES, [0, 5, 10, 15, 22, 30], [0, 0.03, 0.03, 0.005, 0.042, 0.042])
)


def rows() -> np.ndarray:
    model = Model()
    return model.full(("alpha_f", "E_m"), np.array([[1500.0, 50.0]]))


# ---- the edited text


def test_without_effects_simulator_and_text_stay_as_they_are():
    simulator = FEBio("febio4", "4.11", BUILT_IN, Path("scratch"))
    assert template_with(TEMPLATE, ()) == TEMPLATE
    assert simulator.with_effects(()).identity() == simulator.identity()


@pytest.mark.parametrize("effect", FORMS, ids=lambda effect: effect.title)
def test_an_edited_template_is_a_template(effect, tmp_path):
    """Saved beside a study, and rendered with the effect's parameters among the model's."""
    text = template_with(TEMPLATE, (effect,))
    (tmp_path / "edited.feb.j2").write_text(text)
    assert read_template(tmp_path, "edited.feb.j2", model_with(Model(), (effect,))).text == text
    with pytest.raises(BadInput, match="|".join(effect.names)):  # the baseline's parameters are not enough
        read_template(tmp_path, "edited.feb.j2")
    simulator = FEBio("febio4", "4.11", BUILT_IN, Path("scratch")).with_effects((effect,))
    assert simulator.template.text == text
    assert "[[" not in text


def test_edits_are_small_and_nested_in_the_order_of_the_laws():
    text = template_with(TEMPLATE, (LIBRARY["softening"], LIBRARY["preload"], LIBRARY["relaxation-mode"]))
    removed = [line for line in TEMPLATE.splitlines() if line.strip() not in text]
    assert removed == []
    kinds = ["<g4>", "prestrain elastic", "elastic damage", "fiber-exp-pow-linear", "<damage", "<prestrain "]
    assert [text.index(kind) for kind in kinds] == sorted(text.index(kind) for kind in kinds)


@pytest.mark.parametrize("slug", [slug for slug, effect in LIBRARY.items() if effect.no_febio])
def test_an_effect_without_partial_says_why(slug):
    with pytest.raises(BadInput, match="not in FEBio"):
        template_with(TEMPLATE, (LIBRARY[slug],))


def test_templates_and_pairs_that_do_not_fit_are_refused():
    with pytest.raises(BadInput, match="0 <elastic> of type fiber-exp-pow-linear"):
        template_with("<febio_spec/>", (LIBRARY["softening"],))
    with pytest.raises(BadInput, match=r"no constants\.beta"):
        template_with(TEMPLATE.replace("constants.beta", "parameters.beta"), (LIBRARY["toe-exponent"],))
    other = replace(LIBRARY["relaxation-mode"], slug="fifth", other_forms=())
    with pytest.raises(BadInput, match="both need fibre_memory g4"):
        template_with(TEMPLATE, (LIBRARY["relaxation-mode"], other))


# ---- the solver


@pytest.fixture
def solver(tmp_path) -> FEBio:
    executable = Path(shutil.which("febio4"))
    return FEBio(str(executable), solver_version(executable), BUILT_IN, tmp_path, timeout_s=60.0, hold_growth=0.0)


def run(solver: FEBio, effects, values: np.ndarray, protocol: Protocol = PULLED) -> np.ndarray:
    parameters = np.concatenate([rows(), values[np.newaxis]], axis=1)
    simulated = solver.with_effects(effects).simulate(model_with(Model(), effects), BAR, protocol, parameters)
    assert simulated.messages == ("",)
    return simulated.force_N[0]


def embedded(effects, values: np.ndarray, protocol: Protocol = PULLED) -> np.ndarray:
    return simulate_with(Model(), effects, BAR, protocol, rows(), values[np.newaxis])[0]


def error(force: np.ndarray, expected: np.ndarray) -> float:
    return float(np.abs(force - expected).max() / np.abs(expected).max())


@pytest.mark.febio
@pytest.mark.parametrize("effect", FORMS, ids=lambda effect: effect.title)
def test_at_null_values_the_solver_gives_the_baseline(solver, effect):
    baseline = Uniaxial().simulate(Model(), BAR, PULLED, rows()).force_N[0]
    assert error(run(solver, (effect,), effect.null_values), baseline) < 1e-9


@pytest.mark.febio
@pytest.mark.parametrize("effect", FORMS, ids=lambda effect: effect.title)
def test_with_the_effect_the_solver_gives_the_embedded_force(solver, effect):
    """Permanent set differs: the solver yields by the von Mises stress in three dimensions."""
    force = run(solver, (effect,), effect.typical)
    baseline = Uniaxial().simulate(Model(), BAR, PULLED, rows()).force_N[0]
    assert error(force, baseline) > 5e-3
    assert error(force, embedded((effect,), effect.typical)) < (0.02 if effect.slug == "permanent-set" else 1e-9)


@pytest.mark.febio
@pytest.mark.parametrize(
    "slugs",
    [
        ("preload", "softening"),
        ("toe-slack", "softening"),
        ("fluid-flow", "rate-viscosity"),
        ("relaxation-mode", "toe-exponent"),
        ("area-error", "softening", "toe-exponent", "toe-slack"),
    ],
)
def test_effects_together_are_the_embedded_ones_together(solver, slugs):
    effects = tuple(LIBRARY[slug] for slug in slugs)
    values = np.concatenate([effect.typical for effect in effects])
    assert error(run(solver, effects, values), embedded(effects, values)) < 1e-9


@pytest.mark.febio
@pytest.mark.parametrize("slug", ["preload", "softening"])
def test_a_test_that_starts_displaced_is_at_rest_in_both(solver, slug):
    protocol = replace(PULLED, displacement_mm=PULLED.displacement_mm + 0.05)
    effects, values = (LIBRARY[slug],), LIBRARY[slug].typical
    assert error(run(solver, effects, values, protocol), embedded(effects, values, protocol)) < 1e-8


@pytest.mark.febio
def test_a_branch_on_a_matrix_that_yields_deviates_as_the_docs_say(solver):
    """In the solver such a branch follows the yielding matrix, in the embedded simulator the strain."""
    effects = (LIBRARY["permanent-set"], LIBRARY["fluid-flow"])
    values = np.concatenate([effect.typical for effect in effects])
    assert 0.01 < error(run(solver, effects, values), embedded(effects, values)) < 0.05


def test_a_template_of_openings_without_an_end_is_read_once():
    """Looking for the end of each of 20,000 openings took minutes."""
    text = '<elastic type="isotropic elastic">\n<elastic type="fiber-exp-pow-linear">\n' * 20_000
    with at_most(5), pytest.raises(BadInput, match="has 20000 <elastic>"):
        template_with(text, (LIBRARY["softening"],))
