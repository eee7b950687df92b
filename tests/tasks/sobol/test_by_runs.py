"""Studies of a model with cheaper versions, from the study to its page."""

import json

import pytest
import yaml

from sinew.runner.store.store import open_store
from sinew.tasks.simulate.febio.simulator import FEBio
from sinew.tasks.sobol import by_chaos
from sinew.tasks.study.workspace import Workspace
from tests.tasks.simulate.febio.test_own_model import command, settings, written

__all__ = ["settings"]

BAR = {"E_m": "E_matrix", "nu_m": "nu", "g_1m": "g_1", "tau_1m": "tau_1"}


@pytest.fixture(autouse=True)
def few_components(monkeypatch):
    """Curves of two principal components: polynomials of each take most of the time."""
    monkeypatch.setattr(by_chaos, "COMPONENTS", 2)


def cheaper(found: dict, names: list[str], outputs: tuple[str, ...] = ("force",)) -> dict:
    """A study whose model has these cheaper versions, and these outputs."""
    found["simulator"] |= {"fidelities": [*names, "fine"]}
    if "bar" in names:
        found["simulator"]["bar"] = dict(BAR)
    if "coarse" in names:
        found["simulator"]["coarse"] = {"time_steps": {"ramp_s": 5.0, "hold_growth": 0.5}, "rows": 2}
    found["simulator"]["outputs"] = {name: found["simulator"]["outputs"][name] for name in outputs}
    found["tasks"] = ["sobol"]
    found["sobol"] = {"method": "multifidelity", "error": 0.05, "runs": 64, "first": 16}
    return found


def read(out):
    return json.loads((out / "sobol.json").read_text())


@pytest.mark.page
@pytest.mark.thorough
def test_bar_and_coarse_version_save_runs_and_none_is_repeated(tmp_path, settings, capsys, monkeypatch):
    study = written(tmp_path, cheaper(settings, ["bar", "coarse"], ("force", "gauge_stress")))
    out = tmp_path / "out"
    command("run", study, "--out", out)
    said = " ".join(capsys.readouterr().out.split())
    found = read(out)
    assert found["rows"] == 16 and found["surrogate"]["reached"]
    assert found["surrogate"]["versions"] == {"bar": {"runs": 2048, "failed": 0}, "coarse": {"runs": 64, "failed": 0}}
    assert found["surrogate"]["unexplained"]["total"] < 0.1 * found["surrogate"]["alone"]["total"]
    assert "of the total's variance is unexplained with bar and coarse" in said
    assert "64 runs of coarse, 2,048 of bar" in (out / "report.html").read_text()
    along = open_store(out).read_result("sobol_time/" + found["tables"]["dogbone"])
    assert along["ST_gauge_stress_relaxation"].sizes["parameter"] == 4

    before = (out / "sobol.json").read_bytes()
    with monkeypatch.context() as patch:
        patch.setattr(FEBio, "compare", lambda *_: pytest.fail("a row is run again"))
        command("sobol", study, "--out", out, "--quiet")
        (out / "sobol.json").unlink()
        command("sobol", study, "--out", out, "--quiet")
    assert (out / "sobol.json").read_bytes() == before

    alone = tmp_path / "alone"
    settings["simulator"].pop("fidelities"), settings["simulator"].pop("bar"), settings["simulator"].pop("coarse")
    settings["sobol"] = {"base_samples": 16}
    command("sobol", written(tmp_path, settings), "--out", alone, "--quiet")
    known = read(alone)
    for key in ("S1", "ST"):
        for j in range(4):
            assert abs(known[key][j] - found[key][j]) <= known[f"{key}_conf"][j] + found[f"{key}_conf"][j]


@pytest.mark.thorough
def test_more_runs_of_a_version_are_another_result(tmp_path, settings):
    found = cheaper(settings, ["coarse"])
    found["sobol"] |= {"error": 0.5, "runs": 32}
    found["simulator"]["coarse"]["rows"] = 5
    command("sobol", written(tmp_path, found), "--out", tmp_path / "out", "--quiet")
    before = read(tmp_path / "out")["surrogate"]["versions"]["coarse"]["runs"]
    found["simulator"]["coarse"]["rows"] = 6
    command("sobol", written(tmp_path, found), "--out", tmp_path / "out", "--quiet")
    after = read(tmp_path / "out")
    assert before == 5 * after["rows"] and after["surrogate"]["versions"]["coarse"]["runs"] == 6 * after["rows"]


@pytest.mark.thorough
def test_another_version_is_another_result(tmp_path, settings):
    found = cheaper(settings, ["bar"])
    found["sobol"] |= {"error": 0.5, "runs": 32}
    study = written(tmp_path, found)
    command("sobol", study, "--out", tmp_path / "out", "--quiet")
    before = read(tmp_path / "out")
    settings["simulator"]["bar"] = BAR | {"g_1m": 0.1}
    command("sobol", written(tmp_path, settings), "--out", tmp_path / "out", "--quiet")
    after = read(tmp_path / "out")
    assert before["inputs"] != after["inputs"]
    assert before["surrogate"]["unexplained"] != after["surrogate"]["unexplained"]


def test_a_version_that_does_not_help_is_run_no_more(tmp_path, settings, capsys, monkeypatch):
    plan, planned = Workspace.plan, []
    monkeypatch.setattr(Workspace, "plan", lambda self, one, rows: planned.append(len(rows)) or plan(self, one, rows))
    found = cheaper(settings, ["coarse"])
    lateral = {"data": "node_data", "item": "ux", "set": "edge", "reduce": "mean"}
    found["simulator"]["coarse"]["outputs"] = {"force": found["simulator"]["outputs"]["force"] | lateral}
    found["sobol"] |= {"error": 0.0001, "runs": 32}
    command("sobol", written(tmp_path, found), "--out", tmp_path / "out")
    said = " ".join(capsys.readouterr().out.split())
    result = read(tmp_path / "out")
    assert result["rows"] == 32 and result["surrogate"]["versions"]["coarse"]["runs"] == 64
    assert "they do not help" in said
    assert planned == [16, 64, 8, 8], "no row is asked for twice: with --retry-failed, each would fail again"


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda s: s["sobol"].update(method="surrogate"), "first: given with method: surrogate"),
        (lambda s: s["simulator"].update(fidelities=[]), "bar: not among the fidelities"),
        (lambda s: s["simulator"].update(fidelities=["coarse", "bar", "fine"]), "expected some of [bar, coarse, fine]"),
        (lambda s: s["simulator"].update(fidelities=["bar", "coarse"]), "expected some of [bar, coarse, fine]"),
        (lambda s: s["simulator"].pop("coarse"), "coarse: missing; expected what is different in it"),
        (lambda s: s["simulator"].update(coarse={"rows": 3}), "coarse.file: missing"),
        (lambda s: s["simulator"]["coarse"].update(file="../x.feb.j2"), "a template in the folder of file"),
        (lambda s: s["simulator"]["coarse"].update(outputs={"x": {"data": "node_data", "item": "ux", "ids": [1]}}),
         "coarse.outputs.x: no output"),
        (lambda s: s["simulator"]["bar"].update(E_x=3.0), "simulator.bar.E_x: no parameter of the bar"),
        (lambda s: s["simulator"]["bar"].update(E_m="modulus"), "simulator.bar.E_m: 'modulus'; expected a number"),
        (lambda s: s["simulator"]["bar"].update(beta="nu"), "simulator.bar.beta: 'nu'; expected a number"),
        (lambda s: s["simulator"]["bar"].pop("E_m"), "simulator.bar: a bar without stiffness; expected E_m or E_f"),
        (lambda s: s["simulator"].update(force=None), "fidelities: bar without a force"),
        (lambda s: s["simulator"]["coarse"].update(file="dogbone/none.feb.j2"), "none.feb.j2"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_refused_in_one_line(tmp_path, settings, capsys, change, said):
    found = cheaper(settings, ["bar", "coarse"])
    change(found)
    study = tmp_path / "study.yaml"
    study.write_text(yaml.safe_dump(found, sort_keys=False))
    command("sobol", study, "--out", tmp_path / "out", "--quiet", expect=2)
    line = capsys.readouterr().err
    assert said in line and line.count("\n") == 1
    assert not (tmp_path / "out" / "sobol.json").exists()


def test_fidelities_are_for_templates(tmp_path, settings, capsys):
    settings["sobol"] = {"method": "multifidelity"}
    study = tmp_path / "study.yaml"
    study.write_text(yaml.safe_dump(settings, sort_keys=False))
    command("sobol", study, "--out", tmp_path / "out", "--quiet", expect=2)
    assert "sobol.method: multifidelity; expected simulator.fidelities" in capsys.readouterr().err
