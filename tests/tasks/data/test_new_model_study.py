"""A study of a FEBio model: the same model at its own values, and one that follows a measured displacement."""

import re
import shutil
import subprocess
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest

from sinew.runner.errors import BadInput
from sinew.tasks.data.new_model_study import Choices, init_model
from sinew.tasks.model import Protocol
from sinew.tasks.simulate.febio.model_file.contents import contents_of
from sinew.tasks.simulate.febio.settings import TemplateSettings
from sinew.tasks.simulate.febio.simulator import FEBio
from sinew.tasks.simulate.settings import Purpose
from sinew.tasks.study.cohort import cohort_of
from sinew.tasks.study.model import model_of
from sinew.tasks.study.study import read_study
from tests.tasks.simulate.febio.model_file.cube import CUBE, SOLVABLE, in_format_3
from tests.tasks.simulate.febio.model_file.test_source import read

CHOICES = Choices(["gel ä.elastic.E", "gel ä.g1=0.1:1"], "pull", measure=["side=ux@cube:max", "stress=sz@part"])


class Made:
    """A study of the cube, with all that is needed to render its input."""

    def __init__(self, folder, text: str = CUBE, choices: Choices = CHOICES) -> None:
        self.source = read(folder, text)
        self.made = init_model(self.source, contents_of(self.source), choices, folder / "study")
        self.study = read_study(self.made.study)
        self.model = model_of(self.study.model, "template")
        (self.specimen,) = cohort_of(self.study).specimens
        self.protocol = self.specimen.curves[0].protocol
        settings = self.study.simulator
        assert isinstance(settings, TemplateSettings)
        template = settings.read_template(Purpose(self.made.study, "", self.model, (), False, folder))
        self.simulator = settings.with_solver(template, shutil.which("febio4") or "febio4", "test", folder / "runs")

    def rendered(self, protocol: Protocol, **values: float) -> ElementTree.Element:
        row = self.model.reference.copy()
        for name, value in values.items():
            row[self.model.names.index(name)] = value
        return ElementTree.fromstring(self.simulator.rendered(self.model, self.specimen, protocol, row))


def flat(root: ElementTree.Element) -> list[tuple]:
    """What a solver reads, numbers as numbers."""

    def text(one):
        words = (one.text or "").split()
        try:
            return [float(part) for part in "".join(words).split(",")]
        except ValueError:
            return words

    return [(one.tag, one.attrib, text(one)) for one in root.iter()]


@pytest.mark.parametrize("text", [CUBE, in_format_3(CUBE)])
def test_at_its_own_values_the_study_is_the_model(tmp_path, text):
    made = Made(tmp_path, text)
    root = made.rendered(made.protocol)
    assert made.protocol.name == "as_saved"
    root.remove(root.find("Output"))
    mesh = root.find("Mesh")
    added = [one for one in mesh.findall("NodeSet") if one.get("name") == "nodes of top"]
    assert len(added) == 1
    mesh.remove(added[0])
    assert flat(root) == flat(ElementTree.fromstring(text.encode("latin-1")))


def test_a_parameter_changes_its_number_and_nothing_else(tmp_path):
    made = Made(tmp_path)
    one, other = flat(made.rendered(made.protocol)), flat(made.rendered(made.protocol, gel_elastic_E=12.5))
    differences = [(a, b) for a, b in zip(one, other, strict=True) if a != b]
    assert differences == [(("E", {"lc": "1"}, [10.0]), ("E", {"lc": "1"}, [12.5]))]


def test_with_measured_curves_the_model_follows_them_and_stops_where_a_value_is_needed(tmp_path):
    made = Made(tmp_path, choices=replace(CHOICES, factor=-0.5))
    root = made.rendered(Protocol("relax", np.array([0.0, 1.0, 3.0]), np.array([0.0, 0.2, 0.2])))
    control = root.find("Control")
    assert [control.findtext(tag) for tag in ("time_steps", "final_time", "step_size")] == ["-1", "3.0", "1.0"]
    assert len(control.findall("time_steps")) == 1
    assert control.find("time_stepper/dtmax").get("lc") == "4"
    value = root.find("Boundary/bc[@name='pull']/value")
    assert (value.get("lc"), value.text) == ("3", "-0.5")
    (curve,) = root.findall("LoadData/load_controller[@id='3']")
    assert [point.text for point in curve.iter("pt")] == ["0.0,0.0", "1.0,0.2", "3.0,0.2"]
    assert made.study.simulator.outputs["force"].scale == -1, "a pull in the other direction"


@pytest.mark.parametrize(
    ("stepper", "kept"),
    [
        ('<time_stepper type="default"><dtmax>0.1</dtmax><opt_iter>9</opt_iter></time_stepper>', "9"),
        ('<time_stepper type="default"><dtmax lc="1">0.1</dtmax><opt_iter>9</opt_iter></time_stepper>', "9"),
        ('<time_stepper type="default"><opt_iter>9</opt_iter></time_stepper>', "9"),
        ('<time_stepper type="default"/>', None),
    ],
)
def test_a_models_own_time_stepper_is_kept_but_for_its_longest_step(tmp_path, stepper, kept):
    text = CUBE.replace('<solver type="solid">', f'{stepper}<solver type="solid">')
    made = Made(tmp_path, text)
    saved = made.rendered(made.protocol).find("Control")
    assert flat(saved) == flat(ElementTree.fromstring(text.encode("latin-1")).find("Control"))
    root = made.rendered(Protocol("relax", np.arange(3.0), np.zeros(3)))
    (found,) = root.findall("Control/time_stepper")
    assert [step.get("lc") for step in found.findall("dtmax")] == ["4"]
    assert found.findtext("opt_iter") == kept


def test_the_history_as_saved_and_what_was_chosen_are_told(tmp_path):
    made = Made(tmp_path, choices=replace(CHOICES, factor=0.5))
    history = made.study.protocols["as_saved"]
    assert (history.time_s, history.displacement_mm) == ([0.0, 0.5, 1.0], [0.0, 0.8, 0.8])
    assert made.made.lines == (
        "gel_elastic_E: gel ä.elastic.E, 5 to 20 (10)",
        "gel_g1: gel ä.g1, 0.1 to 1 (0.5)",
        "force: Rz of top (node_data, sum), in N",
        "side: ux of cube (node_data, max), in the model's unit",
        "stress: sz of part (element_data, mean), in the model's unit",
        "units: mm-N-s; loaded as saved for 1 s",
        "moved: pull, 0.5 mm for a displacement of 1 mm, which goes to 0.8 mm as saved",
        "fibre: gel ä.elastic (neo-Hookean), for effects inside the tissue",
        "matrix: gel ä.elastic (neo-Hookean), for effects inside the tissue",
    )
    assert made.study.simulator.constituents == {"fibre": "gel ä.elastic", "matrix": "gel ä.elastic"}


def test_fibre_and_matrix_can_be_chosen(tmp_path):
    made = Made(tmp_path, choices=replace(CHOICES, matrix="gel ä"))
    assert made.study.simulator.constituents == {"matrix": "gel ä"}


def test_in_other_units_displacements_and_forces_are_converted(tmp_path):
    text = CUBE.replace('<Module type="solid"/>', '<Module type="solid"><units>um-nN-s</units></Module>')
    made = Made(tmp_path, text)
    assert made.study.simulator.outputs["force"].scale == 1e-9
    assert made.study.protocols["as_saved"].displacement_mm[-1] == pytest.approx(0.4e-3)
    value = made.rendered(Protocol("relax", np.arange(3.0), np.zeros(3))).find("Boundary/bc[@name='pull']/value")
    assert float(value.text) == 1000


def test_a_model_that_follows_nothing_keeps_its_loading(tmp_path):
    made = Made(tmp_path, choices=Choices(["gel ä.t1"], measure=["side=ux@top"]))
    assert made.study.simulator.force is None
    assert made.study.simulator.constituents == {}, "effects need a force"
    assert made.study.protocols["as_saved"].displacement_mm == [0.0, 0.0]
    assert "nothing is moved" in made.made.lines[-1]


CASES = [
    (replace(CHOICES, fibre="gel"), CUBE, "--fibre: no material 'gel'; expected one of gel ä, ..."),
    (Choices(["gel ä.t1"], measure=["side=ux@top"], matrix="gel ä"), CUBE, "--fibre and --matrix: without --move"),
    (Choices(), CUBE, "--vary: nothing is said to vary; expected at least one number"),
    (Choices(["gel ä.E"]), CUBE, "--vary: no number 'gel ä.E'; expected one of gel ä.t1, gel ä.g1, gel ä.elastic.E"),
    (Choices(["gel ä.t1", "gel ä.t1=1:3"]), CUBE, "'gel ä.t1' is given twice"),
    (Choices(["gel ä.t1=3:1"]), CUBE, "'gel ä.t1=3:1' holds no range; expected gel ä.t1=MIN:MAX"),
    (Choices(["gel ä.t1=3:4"]), CUBE, "'gel ä.t1' is 2.5, outside of 3 to 4; expected a range with the model's own"),
    (Choices(["gel ä.elastic.mat_axis.a[2]"]), CUBE, "is 0; expected its range: gel ä.elastic.mat_axis.a[2]=MIN:MAX"),
    (Choices(["gel ä.elastic.E"]), CUBE.replace(">1e1</E>", ">1e308</E>"), "is 1e+308; expected its range: gel ä"),
    (Choices(["gel ä.t1"], "push"), CUBE, "--move: no prescribed displacement 'push'; expected one of pull"),
    (Choices(["gel ä.t1"]), CUBE, "--measure: nothing is measured; expected --move, which gives"),
    (Choices(["gel ä.t1"], measure=["side"]), CUBE, "'side' cannot be read; expected NAME=ITEM@SET"),
    (Choices(["gel ä.t1"], measure=["force=ux@top"]), CUBE, "'force' cannot be the name of an output"),
    (Choices(["gel ä.t1"], measure=["side=ux@left"]), CUBE, "no set, surface or rigid body 'left'; expected one of"),
    (Choices(["gel ä.t1", "Boundary.pull.value"], "pull"), CUBE, "is the displacement of 'pull', which is moved"),
    (CHOICES, CUBE.replace("<pt>0,0</pt>", "<pt>0,1</pt>"), "'pull' starts displaced, by 0.4 mm"),
    (CHOICES, CUBE.replace("<extend>CONSTANT", "<extend>REPEAT"), "the load curve of 'pull' is 'LINEAR and REPEAT'"),
    (CHOICES, CUBE.replace("<pt>0,0</pt>", "<pt>0;0</pt>"), "the points of 'pull''s load curve cannot be read"),
    (CHOICES, CUBE.replace("<step_size>0.1</step_size>", ""), "its Control section tells no duration"),
    (CHOICES, CUBE.replace("<Module type=\"solid\"/>", "<Module><units>ell</units></Module>"), "units 'ell' are"),
    (CHOICES, re.sub("<Control>.*?</Control>", "", CUBE, flags=re.DOTALL), "has no Control section"),
]  # fmt: skip


@pytest.mark.parametrize(("choices", "text", "words"), CASES)
def test_what_does_not_fit_the_model_is_refused_and_nothing_is_written(tmp_path, choices, text, words):
    with pytest.raises(BadInput, match=re.escape(words)):
        Made(tmp_path, text, choices)
    assert not (tmp_path / "study").exists()


def test_what_is_there_already_stays(tmp_path):
    (tmp_path / "study").mkdir()
    (tmp_path / "study" / "mesh.xml").write_text("mine")
    with pytest.raises(BadInput, match="is there already; expected a new folder for --out"):
        Made(tmp_path)
    assert (tmp_path / "study" / "mesh.xml").read_text() == "mine"


@pytest.mark.febio
def test_the_solver_gives_the_same_log_for_the_model_and_for_its_study(tmp_path):
    made = Made(tmp_path, SOLVABLE, Choices(["gel ä.elastic.E"], "pull"))
    entry = '<node_data data="Rz" name="force" file="sinew-0.txt" delim=",">5,6,7,8</node_data>'
    log = f"<Output><logfile>{entry}</logfile></Output>"
    logs = []
    for name, text in (
        ("saved", SOLVABLE.replace("</febio_spec>", f"{log}</febio_spec>")),
        ("again", made.simulator.rendered(made.model, made.specimen, made.protocol, made.model.reference)),
    ):
        folder = tmp_path / name
        folder.mkdir()
        (folder / "model.feb").write_text(text, "latin-1" if name == "saved" else "utf-8")
        subprocess.run(["febio4", "-i", "model.feb", "-silent"], cwd=folder, check=True, capture_output=True)
        logs.append((folder / "sinew-0.txt").read_bytes())
    assert logs[0] == logs[1]
    assert logs[0].count(b"*Step") == 11


@pytest.mark.febio
@pytest.mark.parametrize("text", [SOLVABLE, in_format_3(SOLVABLE)])
def test_the_solver_follows_a_measured_displacement(tmp_path, text):
    """Along the same history the force is that of the model as saved; pulled on, it grows."""
    made = Made(tmp_path, text, Choices(["gel ä.elastic.E"], "pull"))
    simulator: FEBio = made.simulator
    times = np.linspace(0, 1, 11)
    same = Protocol("measured", times, np.interp(times, [0, 0.5, 1], [0, 0.4, 0.4]))
    parameters = made.model.reference[None]
    saved = simulator.simulate(made.model, made.specimen, made.protocol, parameters)
    followed = simulator.simulate(made.model, made.specimen, same, parameters)
    assert not saved.status.any(), saved.messages
    assert not followed.status.any(), followed.messages
    at = np.searchsorted(made.protocol.time_s, times - 1e-9)
    peak = saved.force_N.max()
    assert peak > 0.5
    assert np.allclose(followed.force_N[0, :6], saved.force_N[0, at][:6], atol=1e-3 * peak), "until the hold"
    further = simulator.simulate(made.model, made.specimen, Protocol("on", times, 0.8 * times), parameters)
    assert further.force_N[0, -1] > 1.3 * peak
