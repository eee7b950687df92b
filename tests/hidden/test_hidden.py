"""The generator of hidden cohorts: its bare bar is the project's, and what it hides can be seen where it should be."""

import json

import numpy as np
import pytest
from click.testing import CliRunner

from sinew.tasks.benchmark.answers import read_answers
from sinew.tasks.data.cohort import read_cohort
from sinew.tasks.model import Model, Specimen
from sinew.tasks.model.effects import library
from sinew.tasks.model.protocols import STANDARD, cyclic, one_step
from sinew.tasks.simulate.effects import simulate_with
from sinew.tasks.simulate.uniaxial import Uniaxial
from tests.hidden.__main__ import main
from tests.hidden.bar import BARE, both, pull
from tests.hidden.forms import FORMS, OUTSIDE, PAIRS
from tests.hidden.make import SMALL, SOFTEST_TOE, Plan, hidden_in, plans, write

SIZE = (10.1, 8.2, 3.9)
LOUDEST = 0.006  # noise, in parts of the peak
EVERY = {**FORMS, **OUTSIDE}


def drawn(seed: int, **fixed: float) -> dict[str, float]:
    rng = np.random.default_rng(seed)
    return {p.name: rng.uniform(p.minimum, p.maximum) for p in Model().parameters} | fixed


def forces(material, physics, rate_hz=1.0, substeps=4, makes=STANDARD):
    found = []
    for make in makes:
        protocol = make(SIZE[0], rate_hz)
        found.append(pull(material, SIZE, protocol.time_s, protocol.displacement_mm, physics, substeps))
    return found


@pytest.mark.parametrize("alpha", [0.0, 500.0, 4000.0])
@pytest.mark.parametrize("make", STANDARD)
def test_the_bare_bar_is_that_of_the_project(make, alpha):
    """Up to what linear elastic stresses between samples cost; with as few steps, both agree to rounding."""
    material, protocol, model = drawn(3, alpha_f=alpha), make(SIZE[0], 10.0), Model()
    row = np.array([[material[name] for name in model.names]])
    project = Uniaxial().simulate(model, Specimen("a", *SIZE), protocol, row).force_N[0]
    fine, coarse = (pull(material, SIZE, protocol.time_s, protocol.displacement_mm, BARE, count) for count in (8, 1))
    assert np.abs(fine - project).max() < 1e-4 * project.max()
    assert np.abs(coarse - project).max() < 1e-11 * project.max()


@pytest.mark.parametrize("name", EVERY)
def test_what_is_hidden_changes_the_force_as_much_as_it_should(name):
    material = drawn(5, alpha_f=900.0)
    bare = forces(material, BARE)
    peak = max(force.max() for force in bare)

    def change(size):
        physics = EVERY[name].make(np.random.default_rng(8), size).physics
        return max(np.abs(force - its).max() / peak for force, its in zip(forces(material, physics), bare, strict=True))

    if not EVERY[name].seen:
        assert change(1.0) == 0.0
        return
    clear = change(1.0)
    assert clear > LOUDEST
    assert 0.0 < change(SMALL) < 0.05 * clear


@pytest.mark.parametrize("pair", PAIRS)
def test_pairs_can_be_hidden_together(pair):
    hidden = hidden_in(Plan(pair), np.random.default_rng(1))
    changed = [force[-1] for force in forces(drawn(5), hidden.physics, makes=(one_step,), substeps=2)]
    assert np.isfinite(changed).all()
    assert len({FORMS[name].truth for name in pair}) == 2


def test_two_forms_of_one_thing_cannot_be_hidden_together():
    first, second = (FORMS[name].make(np.random.default_rng(1), 1.0).physics for name in ("slack-gauss", "toe-fung"))
    with pytest.raises(ValueError, match="both change fibre"):
        both(first, second)
    assert both(BARE, first) == first


@pytest.mark.parametrize("name", ["compliance-linear", "drift-linear", "area"])
def test_true_values_of_the_librarys_own_form_give_its_force(name):
    hidden, effect = FORMS[name].make(np.random.default_rng(2), 1.0), library()[FORMS[name].truth]
    material, model = drawn(6, alpha_f=700.0), Model()
    parameters = np.array([[material[each] for each in model.names]])
    values = np.array([[hidden.same_form[each] for each in effect.names]])
    for make in (one_step, cyclic):
        protocol = make(SIZE[0], 5.0)
        theirs = simulate_with(model, (effect,), Specimen("a", *SIZE), protocol, parameters, values)[0]
        mine = pull(material, SIZE, protocol.time_s, protocol.displacement_mm, hidden.physics)
        assert np.abs(mine - theirs).max() < 1e-3 * theirs.max()


def test_a_folder_can_be_read_and_is_the_same_for_the_same_seed(tmp_path):
    chosen = [Plan(("slack-gauss",)), Plan(()), Plan(("hum",)), Plan(("slack-gauss", "drift-linear"), SMALL)]
    for name in ("first", "second"):
        write(tmp_path / name, chosen, seed=4, rate_hz=0.5)
    files = sorted(path.relative_to(tmp_path / "first") for path in (tmp_path / "first").rglob("*") if path.is_file())
    assert len(files) == 4 * 2 * 4 + 1
    assert all((tmp_path / "first" / f).read_bytes() == (tmp_path / "second" / f).read_bytes() for f in files)
    answers = read_answers(tmp_path / "first")
    assert [one.truth for one in answers] == [("toe-slack",), (), ("OUTSIDE",), ("toe-slack", "force-drift")]
    assert set(answers[3].same_form) == {"force_offset", "force_slope"}
    for answer in answers:
        specimens = read_cohort(tmp_path / "first" / answer.case).specimens
        assert [one.name for one in specimens] == ["s01", "s02"]
        assert {curve.name for one in specimens for curve in one.curves} == {"one_step", "two_step", "cyclic"}
    told = json.loads((tmp_path / "first" / "answers.json").read_text())["case_02"]
    assert 0.001 <= told["noise_fraction_of_peak"] <= 0.006
    assert 0.0 <= told["noise_ar1"] <= 0.9
    for truth in told["specimens"].values():
        assert truth["alpha_f"] <= SOFTEST_TOE
        assert all(p.minimum <= truth[p.name] <= p.maximum for p in Model().parameters)


def test_cases_are_of_all_kinds():
    chosen = plans(24, np.random.default_rng(7))
    assert [plan.forms for plan in chosen] == [plan.forms for plan in plans(24, np.random.default_rng(7))]
    singles = [plan for plan in chosen if len(plan.forms) == 1 and plan.forms[0] in FORMS]
    assert sum(not plan.forms for plan in chosen) == 3
    assert sum(plan.forms[:1] in [(name,) for name in OUTSIDE] for plan in chosen) == 3
    assert sum(len(plan.forms) == 2 for plan in chosen) == 3
    assert sum(plan.size < 1 for plan in singles) == 2
    assert len({plan.forms for plan in singles if plan.size == 1}) == 13
    assert len(plans(99, np.random.default_rng(1))) == 99


def test_the_command_writes_what_was_asked(tmp_path):
    done = CliRunner().invoke(
        main, ["--out", str(tmp_path / "a"), "--rate", "0.5", "--form", "none", "--form", "hum:small"]
    )
    assert done.exit_code == 0, done.output
    told = json.loads((tmp_path / "a" / "answers.json").read_text())
    assert [(one["case"], one["size"]) for one in told.values()] == [("none", 1.0), ("hum", SMALL)]
    assert CliRunner().invoke(main, ["--out", str(tmp_path / "b"), "--form", "magic"]).exit_code == 2


@pytest.mark.febio
def test_the_solver_can_make_the_truth(tmp_path):
    write(tmp_path / "a", [Plan(("slack-gauss",)), Plan(("lag-two-filters",))], seed=3, rate_hz=1.0, simulator="febio")
    slack, nothing = read_answers(tmp_path / "a")
    assert (slack.truth, nothing.truth) == (("toe-slack",), ())
    told = json.loads((tmp_path / "a" / "answers.json").read_text())["case_01"]
    model, effect = Model(), library()["toe-slack"]
    for one in read_cohort(tmp_path / "a" / "case_01").specimens:
        parameters = np.array([[told["specimens"][one.name][name] for name in model.names]])
        values = np.array([[slack.same_form["slack_stretch"]]])
        for curve in one.curves:
            force = simulate_with(model, (effect,), one, curve.protocol, parameters, values)[0]
            assert np.sqrt(np.mean((force - curve.force_N) ** 2)) < 2 * LOUDEST * force.max()
