"""Emulators of a study: what is run, what is left, what is done again, and what they say."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import zarr

import sinew
from sinew.runner.store.store import Store, open_store
from sinew.tasks.data.cohort import write_cohort
from sinew.tasks.data.virtual import virtual_cohort
from sinew.tasks.fitting.emulator import Emulator
from sinew.tasks.report.page import build
from sinew.tasks.simulate.uniaxial import Uniaxial
from sinew.tasks.study.model import model_of
from sinew.tasks.study.workspace import Workspace
from sinew.tasks.surrogate import task
from sinew.tasks.surrogate.result import SurrogateResult
from tests.tasks.few_parameters import held_but

FREE = ("E_f", "tau_1f", "E_m", "alpha_f")
FIXED = held_but(FREE)
STUDY = f"""
name: emulated
seed: 4
cohort: cohort
cluster: {{name: local, workers: 1}}
tasks: [surrogate]
surrogate: {{error: 0.009, runs: 144, specimens: [distal/1]}}
store: {{points_per_curve: 16}}
model:
  parameters:
{FIXED}"""


@pytest.fixture(scope="module")
def home(tmp_path_factory):
    here = tmp_path_factory.mktemp("surrogate")
    specimens, _ = virtual_cohort(seed=2, per_site=1, rate_hz=0.5)
    write_cohort(here / "cohort", specimens[:2])
    (here / "study.yaml").write_text(STUDY)
    return here


@pytest.fixture(autouse=True)
def _here(monkeypatch):
    monkeypatch.setattr(Workspace, "client", lambda self: None)


def run(home, out, text=STUDY, **settings):
    study = home / f"{out.name}.yaml"
    study.write_text(text)
    return sinew.run(sinew.read_study(study), "surrogate", out=out, **settings)


@pytest.fixture(scope="module")
def folder(home):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Workspace, "client", lambda self: None)
        run(home, home / "out")
    return home / "out"


def new_rows(folder):
    events = [json.loads(line) for line in (folder / "log.jsonl").read_text().splitlines()]
    return [event["new_simulations"] for event in events if event["message"] == "task finished"]


def test_runs_are_added_until_errors_are_as_asked(folder):
    result = SurrogateResult.read(folder)
    one = result.specimens["distal/1"]
    assert result.reached
    assert one.sizes == [64, 96]
    assert one.errors[-1] <= 0.009 < one.errors[0]
    assert (one.runs, one.failed) == (one.sizes[-1], 0)
    assert new_rows(folder)[0] == one.runs


def test_its_courses_are_those_of_the_model(folder):
    """At points that no run was at: errors as told, and 95 % of the points inside their intervals, or more."""
    emulator = sinew.surrogate(folder)
    low, high = emulator.lower, emulator.upper
    at = low + (high - low) * np.random.default_rng(1).random((200, 4))
    study = sinew.read_study(folder.parent / "study.yaml")
    specimen = sinew.read_cohort(folder.parent / "cohort").choose(["distal/1"], "")[0]
    model = model_of(study.model, "tendon")
    said = emulator.courses(at)
    for curve in specimen.curves:
        forces = Uniaxial().simulate(model, specimen, curve.protocol, model.full(emulator.names, at)).force_N
        one = said[f"force_{curve.name}"]
        truth = forces[:, np.searchsorted(curve.protocol.time_s, one.time_s)]
        spread = np.sqrt(np.mean(np.var(truth, axis=0)))
        assert np.sqrt(np.mean((truth - one.mean) ** 2)) < 2 * 0.009 * spread
        assert np.mean(np.abs(truth - one.mean) <= 1.96 * one.sd + 1e-9 * spread) > 0.85
        assert one.unit == "N"
    assert not emulator.failing(at).any()


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ([200.0, 30.0], "shape (2,); expected [m, 4]: a value of each of E_f, "),
        ({"E_f": 1e6}, "row 0, E_f: 1e+06; expected 160 to 275, where the emulator was trained"),
        ({"E_f": np.nan}, "row 0, E_f: nan; expected 160 to 275"),
    ],
)
def test_values_outside_are_refused(folder, values, words):
    emulator = sinew.surrogate(folder)
    if isinstance(values, dict):
        values = [values.get(name, low) for name, low in zip(emulator.names, emulator.lower, strict=True)]
    with pytest.raises(sinew.BadInput) as refused:
        emulator.courses(np.array(values))
    assert words in str(refused.value)


@pytest.mark.thorough
def test_an_emulator_that_is_made_again_is_the_one_that_was_trained(home, folder, monkeypatch):
    told, trained = task._told, []
    monkeypatch.setattr(task, "_told", lambda *given: trained.append(given[-1]) or told(*given))
    run(home, home / "trained")
    (last,) = trained
    again = sinew.surrogate(folder)
    at = np.random.default_rng(3).random((20, 4))
    mean, sd = Emulator(last.share[last.ok], last.courses, last.fits).predict(at)
    said = again.courses(again.lower + (again.upper - again.lower) * at)
    parts = task.split(mean, last.values), task.split(sd, last.values), last.factors
    for one, means, sds, factor in zip(said.values(), *parts, strict=True):
        np.testing.assert_allclose(one.mean, means, rtol=1e-6, atol=1e-6 * np.abs(means).max())
        np.testing.assert_allclose(one.sd, factor * sds, rtol=1e-3, atol=1e-9)


@pytest.mark.parametrize("harm", ["pending", "other rows", "of another result", "floats"])
def test_an_emulator_of_a_store_that_has_changed_is_refused(folder, tmp_path, harm):
    out = Path(shutil.copytree(folder, tmp_path / "out"))
    if harm == "pending":  # as `sinew repair` leaves rows whose numbers are gone
        path = open_store(out).tables()[0].group.path
        zarr.open_group(out / "store.zarr")[f"{path}/status"][:10] = -1
    else:
        arrays = open_store(out).read_result("surrogate/distal/1").load()
        if harm == "other rows":
            arrays = arrays.isel(run=slice(0, 70))
        elif harm == "floats":
            arrays["row"] = arrays["row"].astype(float)
        else:
            arrays.attrs["inputs"] = "of another"
        with Store.writing(out, "emulated") as store:
            store.write_result("surrogate/distal/1", arrays)
    with pytest.raises(sinew.BadInput, match=r"surrogate\.json: contradicts itself, or the store"):
        sinew.surrogate(out)


def test_a_specimen_that_is_not_there_is_refused(folder, tmp_path):
    with pytest.raises(sinew.BadInput, match="specimen 'distal/2'; expected one of distal/1"):
        sinew.surrogate(folder, "distal/2")
    with pytest.raises(sinew.BadInput, match="is not there; expected a finished `sinew surrogate`"):
        sinew.surrogate(tmp_path)


def test_what_is_unchanged_is_not_done_again(home, folder, monkeypatch):
    monkeypatch.setattr("sinew.tasks.surrogate.task.trained", lambda *_: pytest.fail("trained again"))
    before = (folder / "surrogate.json").read_bytes()
    run(home, folder)
    assert new_rows(folder)[-1] == 0
    assert (folder / "surrogate.json").read_bytes() == before


@pytest.mark.thorough
def test_an_interrupted_run_ends_with_the_same_bytes(home, folder):
    """A run that is stopped after the first batch asks for no row twice; the result and the arrays are the same."""
    out = home / "interrupted"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sinew.tasks.surrogate.task._fresh", lambda *_: (_ for _ in ()).throw(KeyboardInterrupt()))
        with pytest.raises(KeyboardInterrupt):
            run(home, out)
    assert sum(table.finished() for table in open_store(out).tables()) == 96
    run(home, out)
    one = SurrogateResult.read(folder).specimens["distal/1"]
    assert new_rows(out)[-1] == one.runs - 96
    for name in ("surrogate.json", "store.zarr/surrogate/distal/1/error_force_cyclic/c/0"):
        assert (out / name).read_bytes() == (folder / name).read_bytes()


def test_fewer_runs_than_errors_need_are_said(home, capsys):
    out = home / "few"
    run(home, out, STUDY.replace("runs: 144", "runs: 32"))
    result = SurrogateResult.read(out)
    assert not result.reached
    assert np.isnan(next(iter(result.specimens["distal/1"].courses.values())).fresh_error)
    page = build(out).path.read_text()
    assert "not as small as asked (0.9 %)" in page


def fail_above(monkeypatch, **limits):
    """The simulator fails where a parameter is above its limit."""
    compare = Uniaxial.compare

    def failing(self, model, specimen, curve, parameters, keep):
        found = compare(self, model, specimen, curve, parameters, keep)
        for name, most in limits.items():
            found.status[parameters[:, model.names.index(name)] > most] = 1
        return found

    monkeypatch.setattr(Uniaxial, "compare", failing)


@pytest.mark.thorough
def test_where_the_model_fails_is_learned_and_left_alone(home, monkeypatch):
    fail_above(monkeypatch, E_m=55.0)  # of fewer failures, another processor's rounding lets it learn less
    out = home / "failing"
    run(home, out, STUDY.replace("error: 0.009", "error: 0.002"))
    one = SurrogateResult.read(out).specimens["distal/1"]
    assert one.caught > 0.5
    assert one.mistaken < 0.1
    rows = open_store(out).read_result("surrogate/distal/1")["row"].to_numpy()
    status = open_store(out).tables()[0].status[rows]
    assert (status[64:] > 0).mean() < 0.3 * (status[:64] > 0).mean()
    emulator = sinew.surrogate(out)
    both = np.tile((emulator.lower + emulator.upper) / 2, (2, 1))
    both[:, emulator.names.index("E_m")] = 30.0, 69.0
    chance = emulator.failing(both)
    assert chance[0] < 0.4 < 0.6 < chance[1]


def test_a_model_that_mostly_fails_is_refused(home, monkeypatch):
    fail_above(monkeypatch, E_m=20.0)
    with pytest.raises(sinew.BadInput, match="of the first 64 runs of distal/1 failed; expected a model"):
        run(home, home / "mostly")


def test_too_few_runs_are_refused_before_any(home):
    text = STUDY.replace(FIXED, "").replace("model:\n  parameters:\n", "").replace("runs: 144", "runs: 32")
    with pytest.raises(sinew.BadInput, match=r"surrogate\.runs: 32; expected at least 40 for 16 free parameters"):
        run(home, home / "none", text)
    assert not (home / "none").exists()


def test_the_page_shows_errors_and_growth(folder):
    built = build(folder)
    assert built.trouble == ()
    page = built.path.read_text()
    assert 'id="surrogate"' in page
    assert "Emulators" in page


def _course(content, name):
    return content["specimens"]["distal/1"]["courses"][name]


CONTRADICTIONS = {
    "another table": lambda content: content["specimens"]["distal/1"].update(table="0" * 32),
    "names in another order": lambda content: content["names"].reverse(),
    "wider ranges": lambda content: content["bounds"].__setitem__(0, [0, 10_000]),
    "another protocol": lambda content: _course(content, "force_cyclic").update(protocol="one_step"),
    "another unit": lambda content: _course(content, "force_cyclic").update(unit="kN"),
    "another error": lambda content: _course(content, "force_cyclic").update(error=1e-5),
    "a course from elsewhere": lambda content: content["specimens"]["distal/1"]["courses"].update(
        {"../x": _course(content, "force_cyclic")}
    ),
    "a course that is gone": lambda content: content["specimens"]["distal/1"]["courses"].pop("force_cyclic"),
}


@pytest.mark.parametrize("change", CONTRADICTIONS.values(), ids=CONTRADICTIONS)
def test_a_result_that_contradicts_the_store_is_refused(folder, tmp_path, change):
    shutil.copytree(folder, tmp_path / "out")
    path = tmp_path / "out" / "surrogate.json"
    content = json.loads(path.read_text())
    change(content)
    path.write_text(json.dumps(content))
    with pytest.raises(sinew.BadInput, match=r"contradicts itself, or the store .*; expected what `sinew surrogate`"):
        sinew.surrogate(tmp_path / "out")


@pytest.mark.parametrize("parameters", ["x", [[200.0, 20.0], [200.0]], {"E_f": 1}, [10**400, 20.0]])
def test_what_is_no_array_of_numbers_is_refused(folder, parameters):
    with pytest.raises(sinew.BadInput, match=r"parameters: "):
        sinew.surrogate(folder).courses(parameters)
    with pytest.raises(sinew.BadInput, match=r"specimen \['distal/1', 1\]; expected one of distal/1"):
        sinew.surrogate(folder, ["distal/1", 1])
