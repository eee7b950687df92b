"""Posteriors with a simulator whose runs take time and are rows of the store: near those of calls, whatever happens."""

import json
from contextlib import redirect_stdout
from io import StringIO
from types import SimpleNamespace

import numpy as np
import pytest

import sinew as sinew_package
from sinew.runner.cluster.local import Local
from sinew.tasks.data.cohort import write_cohort
from sinew.tasks.data.virtual import virtual_specimen
from sinew.tasks.infer.likelihood import by_rows, effort, explore, prose, sampling, task
from sinew.tasks.infer.likelihood.effort import Effort
from sinew.tasks.infer.result import LikelihoodResult, read_posteriors
from sinew.tasks.model import Model
from sinew.tasks.model.protocols import one_step
from sinew.tasks.simulate import Capabilities
from sinew.tasks.simulate.uniaxial import Uniaxial
from sinew.tasks.study.workspace import Workspace, open_workspace
from tests.tasks.study.test_pipeline import sinew

VARIED = {"E_f": (180.0, 210.0), "alpha_f": (1500.0, 2500.0)}
MODEL = Model()
STUDY = f"""
name: by-rows
seed: 5
cohort: cohort
tasks: [infer]
model:
  parameters: {json.dumps({p.name: {"fixed": p.reference} for p in MODEL.parameters if p.name not in VARIED})}
infer: {{method: likelihood, discrepancy: false, ess: 400}}
"""


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """Two specimens, one test each, that differ in two parameters."""
    folder = tmp_path_factory.mktemp("by-rows")
    specimens = []
    for number in range(2):
        rng = np.random.default_rng([8, number])
        values = [VARIED[p.name][number] if p.name in VARIED else p.reference for p in MODEL.parameters]
        named = (rng, f"distal/{number + 1}", MODEL, np.array(values), (one_step,))
        specimens.append(virtual_specimen(*named, rate_hz=2.0, noise=0.003, ar1=0.3)[0])
    write_cohort(folder / "cohort", specimens, None)
    (folder / "study.yaml").write_text(STUDY)
    return folder / "study.yaml"


@pytest.fixture(scope="module")
def by_calls(study):
    """The result with a simulator that is called."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Workspace, "client", lambda self: None)
        return inferred(study, study.parent / "calls")


def taking_time(patch):
    """The embedded simulator as one that takes time."""
    patch.setattr(Workspace, "client", lambda self: None)
    can = Uniaxial().capabilities
    slow = Capabilities(can.batch_multiple, quick=False, stresses=can.stresses, effects=can.effects)
    patch.setattr(Uniaxial, "capabilities", property(lambda self: slow))


@pytest.fixture
def slow(monkeypatch):
    taking_time(monkeypatch)


@pytest.fixture(scope="module")
def by_rows_once(study):
    """The result folder ``out`` with that simulator, to be read only, what was ``told``, and ``calls`` on the way."""
    out, calls, told = study.parent / "rows", [], StringIO()
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(told):
        taking_time(patch)
        for name in ("_checked", "_trained_again"):
            of = getattr(by_rows, name)
            patch.setattr(by_rows, name, lambda *given, of=of, name=name: calls.append(name) or of(*given))
        sinew("infer", study, "--out", out)
    return SimpleNamespace(out=out, calls=calls, told=told.getvalue())


def inferred(study, out):
    sinew("infer", study, "--out", out, "--quiet")
    found = read_posteriors(out)
    assert isinstance(found, LikelihoodResult)
    return found


def assert_alike(one, other, within):
    """Means within so many standard deviations of each other, and those within a tenth."""
    for specimen, marginals in other.specimens.items():
        for name in VARIED:
            here, there = one.specimens[specimen][name], marginals[name]
            assert abs(here.mean - there.mean) < within * there.sd, (specimen, name)
            assert here.sd == pytest.approx(there.sd, rel=0.1), (specimen, name)


def test_rows_give_the_posterior_of_calls(by_calls, by_rows_once):
    found = read_posteriors(by_rows_once.out)
    assert_alike(found, by_calls, 0.2)
    runs = found.sites["distal"].runs
    assert set(runs) == set(found.specimens)
    assert by_calls.sites["distal"].runs == {}
    for one in runs.values():
        assert 100 < one.rows < 700
        assert 0.0 < one.apart <= by_rows.CLOSE
    told = " ".join(by_rows_once.told.split())
    rows = sorted(one.rows for one in runs.values())
    assert f"{rows[0]} to {rows[-1]} runs of the simulator for each specimen" in told
    paragraph = prose.methods(found)
    assert "on emulators of each specimen's errors" in paragraph
    assert "accepted or refused by the model itself" not in paragraph
    assert "accepted or refused by the model itself" in prose.methods(by_calls)


def test_an_interrupted_inference_asks_for_no_row_twice(study, by_rows_once, slow, tmp_path, monkeypatch):
    whole = by_rows_once.out
    calls, swept, evaluated = [], sampling.swept, Uniaxial.compare
    parts = tmp_path / "parts"

    def interrupted(*arguments, **options):
        calls.append("swept")
        if len(calls) == 2:
            raise KeyboardInterrupt
        return swept(*arguments, **options)

    asked = []

    def counted(self, model, specimen, curve, parameters, keep):
        asked.extend((specimen.name, *row) for row in parameters)
        return evaluated(self, model, specimen, curve, parameters, keep)

    monkeypatch.setattr(Uniaxial, "compare", counted)
    with monkeypatch.context() as patch:
        patch.setattr(sampling, "swept", interrupted)
        with pytest.raises(SystemExit):
            sinew("infer", study, "--out", parts, "--quiet")
    assert asked
    monkeypatch.setattr(task, "explored", lambda *_: pytest.fail("a specimen is explored again"))
    inferred(study, parts)
    assert len(asked) == len(set(asked))
    assert (parts / "infer.json").read_bytes() == (whole / "infer.json").read_bytes()
    assert (parts / "infer" / "distal.nc").read_bytes() == (whole / "infer" / "distal.nc").read_bytes()


@pytest.mark.thorough
def test_a_poor_emulator_is_trained_again(study, by_calls, slow, tmp_path, monkeypatch):
    trained, again = [], by_rows.explored
    poor = Effort(candidates=12, starts=1, again=0, steps=8, few=False, rounds=1, fewest=21, ratio=1.0, checked=4)
    monkeypatch.setattr(task, "SPARING", poor)
    monkeypatch.setattr(explore, "WIDE", 4.0)  # points are far from where the posterior is
    monkeypatch.setattr(by_rows, "explored", lambda *given: trained.append(given[4]) or again(*given))
    found = inferred(study, tmp_path / "out")
    assert trained
    assert min(len(known) for known in trained) > by_rows.FIRST
    assert_alike(found, by_calls, 0.2)
    for one in found.sites["distal"].runs.values():
        assert (one.apart <= by_rows.CLOSE, one.weighted) == (True, 0), "in the end, they are good enough"


@pytest.mark.thorough
def test_an_emulator_that_stays_wrong_is_made_up_for_by_weights(study, by_calls, slow, tmp_path, monkeypatch):
    squares = by_rows.FineEmulator.squares
    for name, value in (("TRAININGS", 2), ("LEAST_EFFICIENT", 0.6)):
        monkeypatch.setattr(by_rows, name, value)
    monkeypatch.setattr(by_rows.FineEmulator, "squares", lambda self, at: squares(self, at) + 200.0 * at[:, 0])
    found = inferred(study, tmp_path / "out")
    site = found.sites["distal"]
    assert {one.weighted >= by_rows.ENOUGH for one in site.runs.values()} == {True}
    assert by_rows.ENOUGH <= site.smallest_ess < site.runs["distal/1"].rows
    assert_alike(found, by_calls, 0.3)


def test_an_emulator_that_is_no_good_is_refused(study, slow, tmp_path, monkeypatch, capsys):
    squares = by_rows.FineEmulator.squares
    for name, value in (("TRAININGS", 1), ("ENOUGH", 100), ("LEAST_EFFICIENT", 0.5)):
        monkeypatch.setattr(by_rows, name, value)
    monkeypatch.setattr(by_rows.FineEmulator, "squares", lambda self, at: 9.0 * squares(self, at))
    with pytest.raises(SystemExit) as ended:
        sinew("infer", study, "--out", tmp_path / "out", "--quiet")
    assert ended.value.code == 2
    assert "distal: emulators of the model are not good enough" in capsys.readouterr().err
    assert not (tmp_path / "out" / "infer.json").exists()


@pytest.mark.thorough
def test_where_all_draws_fail_there_is_no_posterior(study, slow, tmp_path, monkeypatch, capsys):
    exact = by_rows._exact
    monkeypatch.setattr(by_rows, "_exact", lambda site, draws: np.full_like(exact(site, draws), np.inf))
    with pytest.raises(SystemExit) as ended:
        sinew("infer", study, "--out", tmp_path / "out", "--quiet")
    assert ended.value.code == 2
    assert "the simulator failed for all of 100 draws" in capsys.readouterr().err
    assert not (tmp_path / "out" / "infer.json").exists()


def test_failed_rows_are_computed_again_if_that_is_asked_for(study, slow, tmp_path, monkeypatch):
    compare = Uniaxial.compare

    def failing(self, model, specimen, curve, parameters, keep):
        found = compare(self, model, specimen, curve, parameters, keep)
        found.status[::2] = 1
        return found

    opened = open_workspace(sinew_package.read_study(study), out=tmp_path / "out", cluster=Local(workers=1), quiet=True)
    with opened as workspace:
        specimen = workspace.cohort.specimens[0]
        table, evaluation = by_rows.planned(workspace, specimen)
        rows = table.plan(np.array([[p.reference * (1 + 0.01 * i) for p in MODEL.parameters] for i in range(4)]))
        monkeypatch.setattr(Uniaxial, "compare", failing)
        workspace.evaluate(evaluation, table, rows, "some", here=True)
        failed = int((table.status > 0).sum())
        assert 0 < failed < 4
        by_rows.reopen_failed(workspace, [specimen])
        assert by_rows.planned(workspace, specimen)[0].pending(rows).size == failed


@pytest.mark.parametrize("size", [2, 15])
def test_estimates_of_rows_grow_with_the_parameters(size):
    without, beside = (effort.most_rows(size, discrepancy=each) for each in (False, True))
    assert without < beside < 2000
    assert without > effort.most_rows(size - 1, discrepancy=False)


def test_a_sparing_exploration_takes_no_more_rows_than_are_told(by_rows_once):
    """Beside those that judge the emulators; one that is trained again explores again."""
    found, calls = read_posteriors(by_rows_once.out), by_rows_once.calls
    explored = 1 + calls.count("_trained_again")
    for one in found.sites["distal"].runs.values():
        exploring = explored * (effort.most_rows(len(VARIED), discrepancy=False) + len(VARIED) + 1)
        assert one.rows <= exploring + calls.count("_checked") * by_rows.FIRST
    assert explored <= 2


@pytest.mark.febio
def test_the_real_solver_gives_the_posterior_of_calls(study, by_calls):
    solver = study.parent / "febio.yaml"
    solver.write_text(STUDY + "simulator: {name: febio}\n")
    found = inferred(solver, study.parent / "febio")
    assert_alike(found, by_calls, 0.2)
    assert {one.rows < 700 for one in found.sites["distal"].runs.values()} == {True}
