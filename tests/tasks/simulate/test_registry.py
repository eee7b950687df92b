"""The registry of simulators, and that a further simulator needs no change anywhere else."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import pytest
from pydantic import Field, create_model

from sinew.runner.cluster.local import Local
from sinew.runner.errors import BadInput
from sinew.tasks.data.cohort import write_cohort
from sinew.tasks.model import Curve, Protocol, Specimen
from sinew.tasks.simulate import Capabilities, Compared, Output, Simulated, impossible
from sinew.tasks.simulate.build import simulator_of
from sinew.tasks.simulate.registry import kinds, of_own_models, of_the_tissue
from sinew.tasks.simulate.rows import simulate_rows
from sinew.tasks.simulate.settings import SimulatorSettings, UniaxialSettings
from sinew.tasks.study import pipeline
from sinew.tasks.study.settings_file import read_settings
from sinew.tasks.study.study import Study, read_study
from sinew.tasks.study.workspace import open_workspace

TIMES = np.linspace(0.0, 2.0, 21)
PULL = Protocol("pull", TIMES, 0.1 * TIMES)
ENERGY = Output("energy", "mJ", "last")


@dataclass(frozen=True)
class Spring:
    """A simulator of its own kind: the force is E_m times the displacement times ``gain``; it also gives an energy."""

    gain: float
    name: str = "spring"
    capabilities = Capabilities(batch_multiple=4, outputs=(ENERGY,))

    def identity(self):
        return {"name": self.name, "gain": self.gain}

    def simulate(self, model, specimen, protocol, parameters, *, stresses=False):
        stiffness = self.gain * parameters[:, [model.names.index("E_m")]]
        wrong = impossible(model, parameters)
        status = np.array([8 if row in wrong else 0 for row in range(len(parameters))], dtype=np.int8)
        return Simulated(stiffness * protocol.displacement_mm, status, ("",) * len(parameters))

    def compare(self, model, specimen, curve, parameters, keep):
        done = self.simulate(model, specimen, curve.protocol, parameters)
        rmse = np.sqrt(np.mean((done.force_N - curve.force_N) ** 2, axis=1))
        energy = 0.5 * done.force_N * curve.protocol.displacement_mm
        outputs, summaries = {"energy": energy[:, keep]}, {"energy": ENERGY.summarised(energy)}
        return Compared(rmse, done.force_N[:, keep], done.status, done.messages, outputs, summaries)


class SpringSettings(SimulatorSettings):
    """The section of a study; it is registered by its place in the union below."""

    name: Literal["spring"] = "spring"
    gain: Annotated[float, Field(gt=0)] = 1.0

    @property
    def output_names(self):
        return ("energy",)

    def build(self, purpose):
        return Spring(self.gain)


AnySimulator = Annotated[UniaxialSettings | SpringSettings, Field(discriminator="name")]
SpringStudy = create_model("Study", __base__=Study, simulator=(AnySimulator, UniaxialSettings()))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A cohort of one spring of 2 x 30 N/mm, and a study of it."""
    write_cohort(tmp_path / "cohort", [Specimen("one", 10.0, 8.0, 4.0, (Curve(PULL, 60.0 * PULL.displacement_mm),))])
    fixed = "".join(f"    {name}: {{fixed: 1}}\n" for name in ("g_1m", "g_1f", "g_2m", "g_2f", "g_3m", "g_3f"))
    (tmp_path / "study.yaml").write_text(
        "name: springs\ncohort: cohort\nsimulator: {name: spring, gain: 2}\nsobol: {base_samples: 64, resamples: 20}\n"
        f"importance: {{trees: 10, repeats: 2}}\nmodel:\n  parameters:\n{fixed}"
    )
    return tmp_path


def spring_study(folder: Path):
    study = read_settings(folder / "study.yaml", SpringStudy, "study")
    study._path = folder / "study.yaml"
    return study


def test_a_further_simulator_runs_tasks_with_its_outputs(folder, monkeypatch):
    study = spring_study(folder)
    with open_workspace(study, out=folder / "out", cluster=Local(1), quiet=True) as workspace:
        monkeypatch.setattr(type(workspace), "client", lambda _: None)  # in this process
        results = pipeline.run(workspace, ["sobol", "importance"], figures=False)
        assert workspace.simulator == Spring(2.0)
        told = simulate_rows(workspace, workspace.model.reference[np.newaxis])
    sobol = results["sobol"]
    assert sobol.names[int(np.argmax(sobol.ST))] == "E_m"
    assert sobol.outputs["energy"].unit == "mJ"
    assert sobol.outputs["energy"].ST[sobol.names.index("E_m")] == pytest.approx(1.0, abs=0.2)
    forest = results["importance"]
    assert forest.names[int(np.argmax(forest.outputs["energy"].impurity_percent))] == "E_m"
    assert told["simulator"] == {"name": "spring", "gain": 2.0}
    assert sorted(told["files"]) == ["one.pull.csv", "one.pull.energy.csv"]


def test_tasks_that_need_what_a_simulator_cannot_do_say_so(folder, monkeypatch):
    with open_workspace(spring_study(folder), out=folder / "out", cluster=Local(1), quiet=True) as workspace:
        monkeypatch.setattr(type(workspace), "client", lambda _: None)
        with pytest.raises(BadInput, match="spring cannot have effects of the library"):
            pipeline.run(workspace, ["discover"], figures=False)


@pytest.mark.parametrize(
    ("field", "told"),
    [
        ("simulator: {name: spring, gain: -1}", "simulator.gain: -1; expected above 0"),
        ("simulator: {name: spring, pain: 1}", "unknown key; expected one of name, gain (did you mean 'gain'?)"),
        ("simulator: sprig", "expected one of 'uniaxial', 'spring'"),
    ],
)
def test_mistakes_in_its_settings_are_told_like_any_other(folder, field, told):
    path = folder / "study.yaml"
    path.write_text(path.read_text().replace("simulator: {name: spring, gain: 2}", field))
    with pytest.raises(BadInput) as wrong:
        spring_study(folder)
    assert told in str(wrong.value)


def test_each_registered_simulator_has_settings_under_its_name():
    assert set(kinds()) == {"uniaxial", "febio", "template"}
    assert (of_the_tissue(), of_own_models()) == (["uniaxial", "febio"], ["template"])
    for name, kind in kinds().items():
        assert kind.model_fields["name"].default == name


def test_a_study_of_the_tissue_takes_another_simulator_of_the_tissue_only(folder):
    path = folder / "study.yaml"
    path.write_text(path.read_text().replace("simulator: {name: spring, gain: 2}", "simulator: febio"))
    study = read_study(path)
    assert simulator_of(study, "uniaxial", folder).name == "uniaxial"
    for name in ("template", "other"):
        with pytest.raises(BadInput, match=r"--simulator: '(template|other)'; expected one of uniaxial, febio"):
            simulator_of(study, name, folder)
