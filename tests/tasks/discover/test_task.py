"""`sinew discover` from end to end: a hidden effect is named and added, and where nothing is hidden, nothing is."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr
import yaml

from sinew.tasks.data.cohort import write_cohort
from sinew.tasks.data.virtual import autoregressive, virtual_cohort
from sinew.tasks.discover import task
from sinew.tasks.discover.judge.scores import Score
from sinew.tasks.model import Curve, Model, Specimen
from sinew.tasks.model.effects import library
from sinew.tasks.model.protocols import cyclic, one_step
from sinew.tasks.report.folder import read_folder
from sinew.tasks.simulate.effects import simulate_with
from sinew.tasks.study import pipeline
from sinew.tasks.study.study import read_study
from sinew.tasks.study.workspace import Workspace
from tests.conftest import SHARED
from tests.tasks.discover import few
from tests.tasks.study.test_pipeline import new_simulations, sinew

STUDY = f"""
name: hidden
seed: 3
cohort: cohort
tasks: [discover]
discover: {{effects: [force-drift, time-lag, toe-slack], starts: 1, laws: false}}
{few.SECTION}"""
ONE = STUDY.replace("starts: 1", "starts: 1, specimens: [distal/1]")


def pulled(bare: Specimen, truth: dict[str, float], slack: float | None, seed: int, wrong: float = 0.0) -> Specimen:
    """The specimen pulled anew at 2 Hz, with slack fibres if wanted, and noise.

    ``wrong``: newtons of an error that follows the strain and that no effect describes.
    """
    model, rng = Model(), np.random.default_rng(seed)
    effects = () if slack is None else (library()["toe-slack"],)
    values = np.zeros((1, 0)) if slack is None else np.array([[slack]])
    parameters = few.row(truth)
    curves = []
    for make in (one_step, cyclic):
        protocol = make(bare.length_mm, 2.0)
        force = simulate_with(model, effects, bare, protocol, parameters, values)[0]
        force += wrong * np.sin(250.0 * protocol.displacement_mm / bare.length_mm)
        curves.append(Curve(protocol, force + 1.5 * autoregressive(rng, force.size, 0.3)))
    return Specimen(bare.name, bare.length_mm, bare.width_mm, bare.thickness_mm, tuple(curves))


@pytest.fixture
def study(tmp_path):
    def make(slack, wrong=0.0):
        specimens, truth = virtual_cohort(seed=1, per_site=1, rate_hz=1.0)
        told = [truth["specimens"][one.name]["parameters"] for one in specimens[:2]]
        pairs = zip(specimens[:2], told, strict=True)
        write_cohort(tmp_path / "cohort", [pulled(o, t, slack, i, wrong) for i, (o, t) in enumerate(pairs)])
        (tmp_path / "study.yaml").write_text(STUDY)
        return tmp_path / "study.yaml"

    return make


@pytest.fixture
def here(monkeypatch):
    """Evaluates in this process, and draws nothing."""
    monkeypatch.setattr(Workspace, "client", lambda _: None)
    monkeypatch.setattr(pipeline, "_draw", lambda *_: None)


@pytest.mark.figures
@pytest.mark.thorough
def test_a_hidden_effect_is_named_added_and_shown(study, tmp_path, capsys, monkeypatch):
    path, out = study(0.99), tmp_path / "out"
    sinew("discover", path, "--out", out, "--workers", 2)
    monkeypatch.setattr(Workspace, "client", lambda _: None)  # what follows is little work
    printed = capsys.readouterr().out
    assert "NAMED toe-slack" in printed
    assert "such verdicts were true in the blind benchmark of virtual specimens" in " ".join(printed.split())
    for figure in ("discover_cells", "discover_distal_1", "discover_middle_1"):
        assert (out / "figures" / f"{figure}.png").stat().st_size > 5000
    result = json.loads((out / "verdict.json").read_text())
    check_verdict(result)
    check_added_model(result["model"], out)
    check_stored_curves(out)
    check_simulation(out / result["model"]["path"], tmp_path)
    check_nothing_is_repeated(path, out)
    check_a_moved_study(tmp_path)


def check_verdict(result):
    assert (result["verdict"], result["effects"], result["set"]) == ("NAMED", ["toe-slack"], [])
    assert result["confidence"]["interval"][0] > 0.5
    best = result["candidates"][0]
    assert best["effects"] == ["toe-slack"]
    for estimates in best["parameters"].values():
        low, high = estimates["slack_stretch"]["interval"]
        assert low - 0.0005 < 0.99 < high + 0.0005
    assert set(best["splits"]) == {"protocol", "later cycles", "specimen"}
    assert all(split["gain"] > 2 * split["error"] for split in best["splits"].values())
    assert result["gap"]["closed"] > 0.9
    assert any(abs(cell["z"]) > cell["limit"] for cells in result["cells"].values() for cell in cells)
    after = [abs(cell["z"]) > cell["limit"] for cells in result["after"].values() for cell in cells]
    assert np.mean(after) < 0.05


def check_added_model(model, out):
    assert yaml.safe_load((out / model["path"]).read_text())["model"]["effects"] == ["toe-slack"]
    assert "+  - toe-slack" in model["difference"]
    checks, solver = model["checks"], model["febio"]
    assert checks["at_null_N"] == 0.0
    assert checks["not_inert"]
    assert len(solver["inputs"]) == 2
    assert all("prestrain" in (out / path).read_text() for path in solver["inputs"])
    if solver["ran"]:
        assert all(run["deviation"] < 1e-6 < 0.01 < run["change"] for run in solver["runs"].values())
    else:
        assert "not on the PATH" in solver["why"]


def check_stored_curves(out):
    kept = xr.open_datatree(out / "store.zarr", engine="zarr", consolidated=False)["discover/distal_1"]
    left = {name: np.std((kept["measured_cyclic"] - kept[f"{name}_cyclic"]).to_numpy()) for name in ("bare", "having")}
    assert left["having"] < 1.7 < 2.5 < left["bare"], "noise of 1.5 N is left"
    measured = read_folder(out).measured["distal/1"]
    assert sorted(measured) == ["cyclic", "one_step"]
    for protocol, curve in measured.items():
        assert np.isin(curve.displacement_mm, kept[f"displacement_{protocol}"].to_numpy()).all()
        assert curve.displacement_mm.max() == kept[f"displacement_{protocol}"].max() > 0.1


def check_simulation(added, folder):
    rows = folder / "rows.csv"
    rows.write_text("E_f,slack_stretch\n200,1.0\n200,0.985\n")
    sinew("simulate", added, "--parameters", rows, "--out", folder / "simulated", "--quiet")
    forces = np.loadtxt(folder / "simulated" / "distal" / "1.one_step.csv", delimiter=",", skiprows=1)
    assert np.abs(forces[:, 2] - forces[:, 3]).max() > 10.0, "the added effect changes the force"


def check_nothing_is_repeated(path, out):
    """Without its copy a verdict is made from the fits that are kept; with it, fits are not even looked for."""
    first = (out / "verdict.json").read_bytes()
    (out / "verdict.json").unlink()
    sinew("discover", path, "--out", out, "--quiet")
    assert new_simulations(out)[-1] == 0
    assert (out / "verdict.json").read_bytes() == first
    fitted = sorted((out / "discover").glob("*.jsonl"))
    for checkpoint in fitted[:2]:  # numbers that no fit can have are made again
        head, *lines = checkpoint.read_text().splitlines()
        odd = [json.dumps([-9e14] * len(json.loads(line))) for line in lines]
        checkpoint.write_text("\n".join([head, *odd, ""]))
    (out / "verdict.json").unlink()
    sinew("discover", path, "--out", out, "--quiet")
    assert (out / "verdict.json").read_bytes() == first
    for checkpoint in fitted:
        checkpoint.unlink()
    sinew("discover", path, "--out", out, "--quiet")
    assert not any(checkpoint.exists() for checkpoint in fitted)


def check_a_moved_study(folder):
    """In another place too, nothing is made again: the study with the effect refers to the cohort beside it."""
    moved = folder / "moved"
    moved.mkdir()
    for name in ("study.yaml", "cohort", "out"):
        (folder / name).rename(moved / name)
    files = ("discover.json", "verdict.json", "discover/model.yaml")
    before = [(moved / "out" / name).read_bytes() for name in files]
    sinew("discover", moved / "study.yaml", "--out", moved / "out", "--quiet")
    assert not list((moved / "out" / "discover").glob("*.jsonl"))
    assert [(moved / "out" / name).read_bytes() for name in files] == before
    again = read_study(moved / "out" / "discover" / "model.yaml")
    assert again.cohort_path.resolve() == (moved / "cohort").resolve()


def test_where_nothing_is_hidden_nothing_is_named(study, tmp_path, here):
    path, out = study(None), tmp_path / "out"
    path.write_text(ONE)
    sinew("discover", path, "--out", out, "--quiet")
    result = json.loads((out / "verdict.json").read_text())
    assert (result["verdict"], result["effects"], result["set"]) == ("NONE", [], [])
    assert result["model"] is None


def test_an_effect_is_named_beside_what_no_effect_explains(study, tmp_path, here, capsys):
    out, path = tmp_path / "out", study(0.995, wrong=12.0)
    path.write_text(ONE.replace("force-drift, ", ""))
    sinew("discover", path, "--out", out)
    result = json.loads((out / "verdict.json").read_text())
    assert (result["verdict"], result["effects"]) == ("PARTLY", ["toe-slack"])
    left, (part, *others) = result["remainder"], result["parts"]
    assert left["beyond_noise"]
    assert left["interval"][0] < left["share"] < left["interval"][1] < 0.5
    assert 1.0 < left["newtons"] < 12.0 / np.sqrt(2.0), "a part of the error is in the parameters"
    assert part["effect"] == "toe-slack" and part["doubt"] is None and part["ratio"] > 2.0
    assert all(other["doubt"] for other in others)
    assert 1.0 - left["share"] == pytest.approx(result["explained"], abs=1e-6)
    added = yaml.safe_load((out / result["model"]["path"]).read_text())
    assert [name.split("/")[0] for name in added["model"]["effects"]] == ["toe-slack"]
    assert result["gap"]["after"] < result["gap"]["before"]
    assert "Toe slack explains" in " ".join(capsys.readouterr().out.split())


def test_an_error_that_no_effect_describes_gets_no_name(study, tmp_path, here):
    path = study(None, wrong=12.0)
    path.write_text(ONE.replace("force-drift, ", ""))
    sinew("discover", path, "--out", tmp_path / "out")
    result = json.loads((tmp_path / "out" / "verdict.json").read_text())
    assert (result["verdict"], result["effects"], result["model"], result.get("remainder")) == (
        "OUTSIDE",
        [],
        None,
        None,
    )
    assert all(part["doubt"] for part in result["parts"])


@pytest.mark.shared
@pytest.mark.parametrize(("case", "effects"), [("case_18", ["toe-slack"]), ("case_07", [])])
@pytest.mark.thorough
def test_cohorts_that_others_made(tmp_path, here, case, effects):
    """One specimen of a development case whose truth comes from another integration."""
    path = tmp_path / "study.yaml"
    text = ONE.replace("cohort: cohort", f"cohort: {SHARED}/hidden/dev-1/{case}").replace("time-lag, ", "")
    path.write_text(text.replace("distal/1", "s01").replace(few.SECTION, ""))
    sinew("discover", path, "--out", tmp_path / "out", "--quiet")
    result = json.loads((tmp_path / "out" / "verdict.json").read_text())
    assert result["effects"] == effects
    assert result["verdict"] == ("NAMED" if effects else "NONE")


@pytest.mark.febio
def test_the_real_solver_names_a_hidden_effect(study, tmp_path):
    path, out = study(0.99), tmp_path / "out"
    path.write_text(ONE.replace("[force-drift, time-lag,", "[softening,").replace("tasks:", "simulator: febio\ntasks:"))
    sinew("discover", path, "--out", out, "--quiet")
    result = json.loads((out / "verdict.json").read_text())
    assert (result["verdict"], result["effects"]) == ("NAMED", ["toe-slack"])
    assert result["model"]["checks"]["at_null_N"] < 1e-3, "an effect at its null value changes nothing in the solver"
    (run, *_) = result["model"]["febio"]["runs"].values()
    assert run["deviation"] < 1e-5
    first = (out / "verdict.json").read_bytes()
    sinew("discover", path, "--out", out, "--quiet")
    assert (out / "verdict.json").read_bytes() == first, "its fits are kept"


@pytest.mark.febio
def test_effects_that_the_real_solver_does_not_have_are_one_line(study, tmp_path, capsys):
    path = study(None)
    path.write_text(STUDY.replace("time-lag", "rupture"))
    with pytest.raises(SystemExit) as ended:
        sinew("discover", path, "--out", tmp_path / "out", "--simulator", "febio")
    assert ended.value.code == 2
    assert "discover.effects: rupture: not in FEBio; expected effects that FEBio has" in capsys.readouterr().err


def test_a_model_that_has_effects_already_is_one_line(study, tmp_path, capsys):
    path = study(None)
    path.write_text(STUDY.replace("model:\n", "model:\n  effects: [softening]\n"))
    with pytest.raises(SystemExit) as ended:
        sinew("discover", path, "--out", tmp_path / "out")
    assert ended.value.code == 2
    assert "model.effects" in capsys.readouterr().err
    path.write_text(STUDY.replace("time-lag", "magic"))
    with pytest.raises(SystemExit):
        sinew("discover", path, "--out", tmp_path / "out")
    assert "'magic' is no effect" in capsys.readouterr().err


def test_a_cohort_with_an_effect_that_is_told_in_its_truth_only(tmp_path, capsys):
    for name, options in (("bare", ()), ("slack", ("--effect", "toe-slack"))):
        sinew("cohort", "--out", tmp_path / name, "--per-site", 1, "--rate", 2, *options)
    told = [json.loads((tmp_path / name / "truth.json").read_text()) for name in ("bare", "slack")]
    assert "effects" not in told[0]
    assert told[1]["effects"] == {"toe-slack": {"slack_stretch": 0.99}}
    assert told[0]["specimens"].keys() == told[1]["specimens"].keys()
    forces = [np.loadtxt(tmp_path / name / "distal" / "1" / "one_step.csv", delimiter=",", skiprows=1)[:, 2]
              for name in ("bare", "slack")]  # fmt: skip
    assert forces[1].max() < 0.9 * forces[0].max()
    with pytest.raises(SystemExit) as ended:
        sinew("cohort", "--out", tmp_path / "magic", "--effect", "magic")
    assert ended.value.code == 2
    assert "--effect: 'magic' is no effect; expected one of area-error" in capsys.readouterr().err
    assert not (tmp_path / "magic").exists()


def test_a_form_that_is_only_compared_with_a_pair_needs_no_score(monkeypatch):
    """A pair is compared with its better effect alone; a form with more parameters fits better and scores worse."""
    slack, drift = library()["toe-slack"], library()["force-drift"]
    spread = next(form for form in slack.other_forms if len(form.parameters) > len(slack.parameters))
    scored = {effects: Score(tuple(one.slug for one in effects), 1.0, 1.0) for effects in ((slack,), (slack, drift))}
    fits = {effects: [None] for effects in [*scored, (spread,)]}
    candidates = SimpleNamespace(scored=scored, fits=fits, bare=[None])
    monkeypatch.setattr(task, "_bare_fits", lambda *_: [[None]])
    monkeypatch.setattr(task, "search", lambda *_: candidates)
    monkeypatch.setattr(task, "hold_out", lambda *_: dict.fromkeys([(), *fits]))
    monkeypatch.setattr(task, "conflicts", lambda *_: None)
    monkeypatch.setattr(task, "misfits", lambda *_: [()])
    monkeypatch.setattr(task, "located_part", lambda *_: 0.5)
    one = SimpleNamespace(measured=None, candidate=lambda effects: None)
    found = task._findings(SimpleNamespace(seed=1), SimpleNamespace(chance=0.05), [one])
    assert list(found.after) == list(scored)
    assert {each.in_place for each in candidates.scored.values()} == {0.5}
