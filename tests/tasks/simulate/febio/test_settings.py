"""What a study may say of FEBio, and that every mistake is told in one line before anything runs."""

import copy
import re
import shutil
from pathlib import Path

import pytest
import yaml

from sinew.runner.errors import BadInput
from sinew.tasks.model.effects import named
from sinew.tasks.simulate.build import febio_of, simulator_of, solver_request
from sinew.tasks.simulate.settings import SolverMissing
from sinew.tasks.study import pipeline
from sinew.tasks.study.cohort import cohort_of
from sinew.tasks.study.model import model_of
from sinew.tasks.study.resources import resource
from sinew.tasks.study.study import read_study
from sinew.tasks.study.trust import allow
from tests.tasks.simulate.febio.dogbone import stand_in


@pytest.fixture
def settings(tmp_path: Path) -> dict:
    """The example's study, with the stand-in for its solver."""
    shutil.copytree(resource("configs/dogbone"), tmp_path / "dogbone")
    found = yaml.safe_load(resource("configs/dogbone.yaml").read_text())
    found["simulator"]["executable"] = str(stand_in(tmp_path))
    return found


def checked(folder: Path, settings: dict, simulator: str | None = None):
    """The simulator of a study, after all that a run checks before it."""
    (folder / "study.yaml").write_text(yaml.safe_dump(settings, sort_keys=False))
    study = read_study(folder / "study.yaml")
    allow([request] if (request := solver_request(study)) else [])
    pipeline.check(study, folder / "out", study.tasks)
    cohort_of(study)
    return simulator_of(study, simulator, folder / "attempts")


def changed(settings: dict, field: str, value: object) -> dict:
    *way, last = field.split(".")
    inner = settings
    for name in way:
        inner = inner.setdefault(name, {})
    if value is None:
        inner.pop(last, None)
    else:
        inner[last] = value
    return settings


WRONG = {
    "no file": ("simulator.file", None, "simulator.file: missing"),
    "file above": ("simulator.file", "../x.feb", "lies outside the study's folder"),
    "no outputs": ("simulator.outputs", {}, "simulator.outputs"),
    "unknown force": ("simulator.force", "grip", "simulator.force: 'grip'; expected one of the outputs force"),
    "force in kN": ("simulator.outputs.force.unit", "kN", "the force is in 'kN'; expected 'N', with a scale"),
    "force that is none": ("simulator.force", "narrowing", "outputs.force: is not said to be the force"),
    "set and ids": ("simulator.outputs.force.ids", [1], "ids: beside set; expected either ids or the name of a set"),
    "neither": ("simulator.outputs.force.set", None, "ids: missing; expected either"),
    "ids twice": ("simulator.outputs.q", {"data": "node_data", "item": "uz", "ids": [1, 1]}, "each id once"),
    "unknown data": ("simulator.outputs.force.data", "face_data", "expected one of 'node_data', 'element_data'"),
    "two items": ("simulator.outputs.force.item", "Rz;Rx", "'Rz;Rx'"),
    "unknown set": ("simulator.outputs.force.set", "crip", "simulator.outputs.force: no set 'crip' of nodes in dogb"),
    "missing node": ("simulator.outputs.q", {"data": "node_data", "item": "uz", "ids": [9999]}, "node 9999 is not in"),
    "many for one": ("simulator.outputs.force.reduce", "single", "set grip has 12 items; expected one, or reduce"),
    "name of an output": ("simulator.outputs.a-b", {"data": "node_data", "item": "uz", "ids": [1]}, "cannot be a name"),
    "taken output": ("simulator.outputs.time", {"data": "node_data", "item": "uz", "ids": [1]}, "cannot be a name"),
    "no range": ("model.parameters.nu", {"min": 0.1}, "model.parameters.nu.max: missing; expected min and max"),
    "name of a parameter": ("model.parameters.E m", {"fixed": 1.0}, "cannot be a name"),
    "taken parameter": ("model.parameters.time_s", {"fixed": 1.0}, "is taken"),
    "unused parameter": ("model.parameters.G", {"min": 0.1, "max": 0.2}, "model.parameters.G: not used in dogbone"),
    "unused fixed one": ("model.parameters.G", {"fixed": 0.2}, "model.parameters.G: not used in dogbone"),
    "unknown variable": ("model.parameters.nu", None, "dogbone.feb.j2: unknown variable nu; expected some of E_matrix"),
    "no parameters": ("model.parameters", {}, "no parameter with min and max"),
    "tissue's constant": ("model.beta", 3.0, "model.beta: with a template"),
    "tissue's effect": ("model.effects", ["rupture"], "model.effects: 'rupture' with a template; expected effects"),
    "effect of nothing": ("model.effects", ["toe-exponent"], "model.effects: toe-exponent: tissue.elastic (neo"),
    "no such material": ("simulator.fibre", "tendon", "simulator.fibre: no material 'tendon' in dogbone.feb.j2; expec"),
    "law": ("model.effects", ["fibres * (1 - a)"], "model.effects: "),
    "effect twice": ("model.effects", ["time-lag", "time-lag/filter"], "time-lag is a duplicate"),
    "range of an effect": ("model.parameters.force_lag", {"min": 0.1, "max": 0.2}, "parameters.force_lag: not used"),
    "no size": ("specimen", None, "unknown variable specimen"),
    "protocol backwards": ("protocols.relaxation.time_s", [0, 9, 5], "times do not increase"),
    "uneven protocol": ("protocols.relaxation.time_s", [0, 9], "3 numbers beside 2 of time_s"),
    "name of a protocol": ("protocols.a/b", {"time_s": [0, 1], "displacement_mm": [0, 1]}, "cannot be a name"),
    "both": ("cohort", "cohort", "protocols: given beside cohort"),
    "nothing to follow": ("protocols", None, "given without protocols"),
    "unknown sobol output": ("sobol.output", "stretch", "sobol.output: no output 'stretch'; expected one of force"),
    "output like a protocol": (
        "simulator.outputs.relaxation",
        {"data": "node_data", "item": "uz", "ids": [1]}, "two things are called relaxation"
    ),
    "discover": ("tasks", ["discover"], "missing, and discover needs measured curves"),
    "calibrate nothing": ("tasks", ["calibrate"], "missing, and calibrate needs measured curves"),
    "two of a name": (
        "simulator.outputs",
        {name: {"data": "node_data", "item": "Rz", "ids": [n]} for n, name in enumerate(("gap", "gap_a"), 1)},
        "two things are called gap_a_b in the store",
    ),
}  # fmt: skip


def test_effects_of_which_one_input_cannot_have_all_are_refused(tmp_path, settings):
    """Each needs a term of the Prony series, which has a single one left."""
    template = tmp_path / "dogbone" / "dogbone.feb.j2"
    taken = "".join(f"<g{n}>0</g{n}><t{n}>1</t{n}>" for n in range(2, 6))
    template.write_text(template.read_text().replace("<t1>", f"{taken}<t1>"))
    for effects in (["rate-viscosity"], ["relaxation-mode"]):
        checked(tmp_path, changed(settings, "model.effects", effects))
    with pytest.raises(BadInput) as wrong:
        checked(tmp_path, changed(settings, "model.effects", ["rate-viscosity", "relaxation-mode"]))
    expected = "model.effects: one input cannot have rate-viscosity, relaxation-mode; expected fewer of them at once"
    assert expected in str(wrong.value)


@pytest.mark.parametrize("name", WRONG)
def test_what_is_wrong_is_told_in_one_line(tmp_path, settings, name):
    field, value, told = WRONG[name]
    if name == "force that is none":
        settings["simulator"]["outputs"]["narrowing"]["unit"] = "N"
    if name == "two of a name":
        history = settings["protocols"].pop("relaxation")
        settings["protocols"] |= {"b": history, "a_b": copy.deepcopy(history)}
        del settings["simulator"]["force"]
    with pytest.raises(BadInput) as wrong:
        checked(tmp_path, changed(settings, field, value))
    assert told in str(wrong.value)
    assert "\n" not in str(wrong.value)


def test_measured_curves_need_a_force(tmp_path, settings):
    del settings["simulator"]["force"]
    settings["simulator"]["outputs"]["pull"] = settings["simulator"]["outputs"].pop("force")
    settings |= {"tasks": ["calibrate"], "cohort": "cohort"}
    del settings["protocols"], settings["specimen"]
    with pytest.raises(BadInput, match=r"simulator.force: missing, and calibrate needs it"):
        checked(tmp_path, settings)


@pytest.mark.parametrize(
    ("section", "keep", "told"),
    [
        ({"effects": ["time-lag", "creep"]}, "nothing", "discover.effects: creep: not with this template;"),
        ({}, "fields", "discover: with keep: fields; expected keep: nothing"),
    ],
)
def test_a_discovery_is_refused_what_cannot_act_around_a_template(tmp_path, settings, section, keep, told):
    settings |= {"tasks": ["discover"], "cohort": "cohort", "discover": section}
    settings["simulator"]["keep"] = keep
    del settings["protocols"], settings["specimen"]
    with pytest.raises(BadInput, match=re.escape(told)):
        checked(tmp_path, settings)


def test_other_simulators_cannot_run_a_template(tmp_path, settings):
    with pytest.raises(BadInput, match="--simulator: uniaxial cannot run a study with a template"):
        checked(tmp_path, settings, "uniaxial")


def test_the_settings_reach_the_simulator(tmp_path, settings):
    settings["simulator"] |= {"timeout_s": 7.0, "max_file_mb": 2, "keep_failed": 3, "settle_s": 4.0, "restart_s": 30}
    simulator = checked(tmp_path, settings)
    assert simulator.restart_s == 30.0
    assert simulator.capabilities.restarts
    assert (simulator.timeout_s, simulator.max_file_bytes, simulator.keep_failed) == (7.0, 2 * 2**20, 3)
    assert simulator.identity()["time_steps"] == [0.5, 0.2, 0.0, 4.0]
    assert [output.name for output in simulator.capabilities.outputs] == list(settings["simulator"]["outputs"])
    assert simulator.capabilities.force == "force"


def test_a_plot_file_does_not_go_on(tmp_path, settings):
    settings["simulator"] |= {"keep": "fields", "restart_s": 30}
    with pytest.raises(BadInput, match=r"simulator\.restart_s: given with keep: fields; expected one of them"):
        checked(tmp_path, settings)


def test_effects_of_the_machine_act_around_a_template(tmp_path, settings):
    settings["model"]["effects"] = ["machine-compliance", "time-lag"]
    settings["model"]["parameters"]["force_lag"] = {"min": 0, "max": 0.1, "unit": "s"}
    simulator = checked(tmp_path, settings)
    assert [effect.name for effect in simulator.effects] == ["machine-compliance", "time-lag"]
    assert "compliance" not in simulator.inner.template.files[simulator.inner.template.main]
    model = model_of(read_study(tmp_path / "study.yaml").model, "template")
    assert model.names == ("E_matrix", "nu", "g_1", "tau_1", "compliance", "force_lag")
    assert (model.parameters[-1].maximum, model.parameters[-1].unit) == (0.1, "s")
    settings["simulator"] |= {"keep": "fields"}
    with pytest.raises(BadInput, match=r"model\.effects: with keep: fields; expected keep: nothing"):
        checked(tmp_path, settings)
    settings["simulator"] |= {"keep": "nothing"}
    del settings["simulator"]["force"]
    settings["simulator"]["outputs"]["pull"] = settings["simulator"]["outputs"].pop("force")
    with pytest.raises(BadInput, match=r"model\.effects: without a force; expected simulator\.force"):
        checked(tmp_path, settings)


def test_an_input_with_effects_has_all_of_them(tmp_path):
    (tmp_path / "study.yaml").write_text("name: a\ncohort: cohort\ntasks: [calibrate]\n")
    study = read_study(tmp_path / "study.yaml")
    found = febio_of(study, (named()["softening"],), tmp_path)
    assert found.template != febio_of(study, (), tmp_path).template
    with pytest.raises(BadInput, match="effect machine-compliance: not in FEBio: the template prescribes"):
        febio_of(study, (named()["machine-compliance"],), tmp_path)


def test_a_template_is_checked_before_the_solver_is_looked_for(tmp_path, settings):
    settings["simulator"]["executable"] = "no-such-solver"
    with pytest.raises(SolverMissing, match="'no-such-solver' was not found"):
        checked(tmp_path, settings)
    template = tmp_path / "dogbone" / "dogbone.feb.j2"
    template.write_text(template.read_text().replace("{{ nu }}", "0.3"))
    with pytest.raises(BadInput, match="nu: not used"):
        checked(tmp_path, settings)
