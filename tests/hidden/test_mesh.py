"""The generator of cohorts through a mesh, with the analytic stand-in for the solver."""

import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest
import yaml
from click.testing import CliRunner

from sinew.tasks.benchmark.answers import read_answers
from sinew.tasks.data.cohort import read_cohort
from sinew.tasks.study.study import read_study
from tests.hidden import mesh
from tests.tasks.simulate.febio.dogbone import BAR, DOGBONE, OWN, RELAX, dogbone


@pytest.fixture
def made(tmp_path, monkeypatch):
    monkeypatch.setattr(mesh, "simulator_of", lambda *_: dogbone(tmp_path))
    monkeypatch.setattr(mesh.shutil, "which", lambda _: "febio4")

    def make(name, seed=3):
        words = ("--out", tmp_path / name, "--effect", "none", "--effect", "machine-compliance", "--seed", seed)
        done = CliRunner().invoke(mesh.main, [str(word) for word in words], catch_exceptions=False)
        assert done.exit_code == 0, done.output
        return tmp_path / name

    return make


def test_cases_have_answers_and_a_study_that_does_not_know_them(made):
    folder = made("one")
    null, given = read_answers(folder / "cases")
    assert (null.truth, given.truth) == ((), ("machine-compliance",))
    assert given.magnitude["compliance"] > 0
    bars = [read_cohort(folder / "cases" / case).specimens[0] for case in ("case_01", "case_02")]
    for bar in bars:
        assert [curve.name for curve in bar.curves] == ["cycles", "relaxation"]
    study = read_study(folder / "study.yaml")
    assert study.simulator.constituents == {"fibre": "tissue", "matrix": "tissue"}
    assert study.model.effects == []
    fine = read_study(folder / "fine" / "study.yaml")
    assert "set fineness = 2" in (folder / "fine" / "dogbone" / "dogbone.feb.j2").read_text()
    assert fine.simulator.time_steps.ramp_s < study.simulator.time_steps.ramp_s


def test_same_seed_same_bytes(made):
    def content(folder):
        return {str(p.relative_to(folder)): p.read_bytes() for p in (folder / "cases").rglob("*") if p.is_file()}

    first = content(made("one"))
    assert content(made("two")) == first
    assert content(made("three", seed=4)) != first


def test_what_is_hidden_is_in_the_curves(made):
    folder = made("one")
    truth = yaml.safe_load((folder / "cases" / "answers.json").read_text())["case_02"]
    (bar,) = read_cohort(folder / "cases" / "case_02").specimens
    own = np.array(list(truth["specimens"][bar.name].values()))
    rng = np.random.default_rng(0)
    model = mesh.model_of(read_study(folder / "study.yaml").model, "template")
    plain = mesh.pulled(dogbone(folder), model, bar, own, rng)
    peaks = [{curve.name: curve.force_N.max() for curve in one.curves} for one in (bar, plain)]
    lower = [peaks[0][name] / peaks[1][name] for name in peaks[1]]
    assert all(0.5 < ratio < 0.98 for ratio in lower)


def test_the_points_of_a_camera_are_at_the_same_places_in_both_meshes(tmp_path):
    seen = []
    for fineness, text in ((1, DOGBONE.read_text()), (2, DOGBONE.read_text().replace(*mesh.FINER))):
        rendered = dogbone(tmp_path, text).rendered(OWN, BAR, RELAX, OWN.reference)
        nodes = {int(node.get("id")): node.text for node in ElementTree.fromstring(rendered).iter("node")}
        outputs = mesh.outputs_of_points(fineness)
        assert list(outputs) == [f"dic_{number}_mm" for number in range(1, mesh.POINTS + 1)]
        seen.append([np.fromstring(nodes[output["ids"][0]], sep=",") for output in outputs.values()])
    np.testing.assert_allclose(seen[0], seen[1], atol=1e-9)
    x, y, z = np.transpose(seen[0])
    assert set(x.round(6)) == {0.0, BAR.width_mm / 2} and (y == BAR.thickness_mm / 2).all()
    assert (np.unique(z).size, z.max()) == (5, BAR.length_mm / 2)


def test_strength_is_what_the_model_cannot_imitate(made, tmp_path):
    folder = made("one")
    bare = mesh.model_of(read_study(folder / "study.yaml").model, "template")

    def strength(slug, noise=mesh.NOISE):
        (effect,) = mesh.by_name([slug], read_cohort(folder / "cases" / "case_01").specimens)
        row = np.concatenate([bare.reference, [parameter.reference for parameter in effect.parameters]])
        plain = np.concatenate([bare.reference, effect.null_values])
        simulator = dogbone(tmp_path).with_effects((effect,))
        return mesh.strength(simulator, mesh.model_with(bare, (effect,)), BAR, plain, row, noise)

    assert strength("area-error") < 0.05, "a stiffer material does the same"
    assert strength("time-lag") > 5.0
    np.testing.assert_allclose(strength("time-lag", mesh.NOISE / 2), 2 * strength("time-lag"), rtol=1e-6)
    told = yaml.safe_load((folder / "cases" / "answers.json").read_text())
    assert told["case_01"]["strength"] == {} and told["case_02"]["strength"]["machine-compliance"] > 0
