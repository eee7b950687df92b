"""Posteriors of what is measured beside the force: a camera that sees the width determines Poisson's ratio."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest

from sinew.tasks.data.cohort import write_cohort
from sinew.tasks.data.noise import Noise
from sinew.tasks.data.virtual import autoregressive, virtual_specimen
from sinew.tasks.fitting.measured import Measured
from sinew.tasks.infer.likelihood import prose
from sinew.tasks.infer.likelihood.best import best_fit
from sinew.tasks.infer.likelihood.discrepancy import model_error
from sinew.tasks.infer.likelihood.explore import explored
from sinew.tasks.infer.likelihood.kept import read_model_error, write_model_error
from sinew.tasks.infer.likelihood.result import Misfit
from sinew.tasks.infer.likelihood.scores import places, scores_of
from sinew.tasks.infer.likelihood.target import Target
from sinew.tasks.infer.result import LikelihoodResult, read_posteriors
from sinew.tasks.model import Model
from sinew.tasks.model.parameters import bounds
from sinew.tasks.model.protocols import cyclic, one_step
from sinew.tasks.simulate.lateral import lateral
from sinew.tasks.simulate.uniaxial import Uniaxial
from sinew.tasks.study.workspace import Workspace
from tests.tasks.study.test_pipeline import sinew

MODEL = Model()
VARIED = {"E_m": 30.0, "nu_m": 0.35}
SD = 5e-4  # of the lateral strain
STUDY = f"""
name: quantities
seed: 5
cohort: cohort
tasks: [infer]
model:
  parameters: {json.dumps({p.name: {"fixed": p.reference} for p in MODEL.parameters if p.name not in VARIED})}
measured: {{force: {{}}, lateral_strain: {{}}}}
infer: {{method: likelihood, discrepancy: false, ess: 400}}
"""


def specimen(wrong=0.0, makes=(one_step, cyclic), seed=8):
    """A virtual specimen whose width is seen at every third point; ``wrong``: of a wave on it that no model has."""
    rng = np.random.default_rng(seed)
    values = np.array([VARIED.get(p.name, p.reference) for p in MODEL.parameters])
    one = virtual_specimen(rng, "distal/1", MODEL, values, makes, rate_hz=2.0, noise=0.003, ar1=0.3)[0]
    curves = []
    for curve in one.curves:
        strain = 0.5 * (one.stretch(curve.protocol) ** 2 - 1.0)
        seen = lateral("lateral_strain", MODEL, one, values[np.newaxis], strain)[0]
        seen = seen + SD * autoregressive(rng, seen.size, 0.0) + wrong * np.sin(curve.protocol.time_s / 7.0)
        seen[np.arange(seen.size) % 3 > 0] = np.nan
        curves.append(replace(curve, others={"lateral_strain": seen}))
    return replace(one, curves=tuple(curves), noise={"force": 1.0, "lateral_strain": SD})


def target(wrong=0.0, *, force_noise=0.003):
    """Its likelihood, and the true scores."""
    one = specimen(wrong)
    free = tuple(p for p in MODEL.free if p.name in VARIED)
    low, high = bounds(free)
    peak = max(curve.force_N.max() for curve in one.curves)
    measured = Measured(one, Noise(force_noise * peak, 0.3), {"lateral_strain": Noise(SD, 0.0)})
    values = np.array([VARIED[p.name] for p in free])
    return Target(MODEL, free, Uniaxial(compared=("lateral_strain",)), measured), scores_of(
        (values - low) / (high - low)
    )


def test_the_width_determines_what_the_force_does_not_depend_on():
    both, truth = target()
    alone = replace(both, measured=Measured(both.measured.specimen, both.measured.noise))
    number = [parameter.name for parameter in both.varied].index("nu_m")
    assert alone.blind()[number]
    assert not both.blind().any()
    best = best_fit(both, np.random.default_rng(1))
    deviations = np.sqrt(np.diag(best.covariance))
    assert (np.abs(best.at - truth) < 4.0 * deviations).all()
    assert deviations[number] < 0.02, "of a uniform prior it would be 1"


def test_squares_are_those_of_the_errors_of_all_quantities():
    one, truth = target()
    at = places(np.array([truth, truth + 0.1]))
    np.testing.assert_allclose(one.squares(at), np.square(one.errors(at)).sum(axis=1), rtol=1e-9)
    assert one.errors(at).shape[1] == one.points


def test_an_error_of_the_model_in_one_quantity_is_none_of_the_other():
    one, _ = target(wrong=4.0 * SD)
    found = model_error(one, (1,))
    force, width = (np.sqrt(each.rough.size**2 + _expected(each)) for each in found.each)
    assert force < 0.5
    assert width > 1.5
    assert found.misfit > 1.2
    white = replace(one, whitening=found.white)
    best = best_fit(white, np.random.default_rng(1))
    assert best.squares / one.points == pytest.approx(1.0, abs=0.1)


def _expected(error) -> float:
    """The mean square of the smooth part of an error."""
    spread = 1.0 / (1.0 - error.taken) ** 2 - 1.0
    return float(spread.sum() / len(error.directions))


def test_errors_of_all_quantities_are_read_as_they_were_written(tmp_path):
    one, _ = target(wrong=4.0 * SD)
    found = model_error(one, (1,))
    write_model_error(tmp_path / "error", "inputs", found)
    again = read_model_error(tmp_path / "error", "inputs", one)
    errors = np.random.default_rng(2).standard_normal((3, one.points))
    np.testing.assert_array_equal(again.white(errors), found.white(errors))
    alone = replace(one, measured=Measured(one.measured.specimen, one.measured.noise))
    assert read_model_error(tmp_path / "error", "inputs", alone) is None


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    folder = tmp_path_factory.mktemp("quantities")
    write_cohort(folder / "cohort", [replace(specimen(makes=(one_step,)), noise={})], None)
    (folder / "study.yaml").write_text(STUDY)
    return folder / "study.yaml"


def inferred(study, out):
    sinew("infer", study, "--out", out, "--quiet")
    found = read_posteriors(out)
    assert isinstance(found, LikelihoodResult)
    return found.specimens["distal/1"]


@pytest.fixture(scope="module")
def calls(study):
    """The result folder of an inference whose simulator is called."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Workspace, "client", lambda self: None)
        inferred(study, study.parent / "calls")
    return study.parent / "calls"


@pytest.mark.thorough
def test_rows_of_a_solver_give_the_posterior_of_calls(study, calls, tmp_path, monkeypatch):
    monkeypatch.setattr(Workspace, "client", lambda self: None)
    called = read_posteriors(calls).specimens["distal/1"]
    assert called["nu_m"].mean == pytest.approx(VARIED["nu_m"], abs=4.0 * called["nu_m"].sd)
    assert called["nu_m"].sd < 0.02
    can = Uniaxial.capabilities.fget
    monkeypatch.setattr(Uniaxial, "capabilities", property(lambda self: replace(can(self), quick=False)))
    rows = inferred(study, tmp_path / "rows")
    for name in VARIED:
        assert abs(rows[name].mean - called[name].mean) < 0.2 * called[name].sd
        assert rows[name].sd == pytest.approx(called[name].sd, rel=0.12)


def test_a_misfit_of_one_quantity_is_told_though_the_others_have_none():
    one, _ = target(wrong=4.0 * SD)
    found = explored(one, (1,))
    names = list(one.measured.quantities)
    left = dict(zip(names, found.left.tolist(), strict=True))
    assert left["force"] == pytest.approx(1.0, abs=0.1)
    assert left["lateral_strain"] > 2.0
    misfit = Misfit(1.1, 0.0, 1.1, left)
    assert misfit.worst == left["lateral_strain"]
    assert Misfit(1.1, 0.0, 1.1).worst == 1.1


def test_posteriors_of_the_force_alone_are_refused_where_more_is_compared(study, calls, tmp_path, capsys):
    out = tmp_path / "out"
    shutil.copytree(calls, out)
    found = read_posteriors(out)
    assert found.compared == ("lateral_strain",)
    assert set(found.misfit["distal/1"].quantities) == {"force", "lateral_strain"}
    assert "(the force, lateral_strain)" in prose.methods(found)
    replace(found, compared=None).write(out)
    with pytest.raises(SystemExit) as problem:
        sinew("predict", study, "--out", out, "--quiet")
    assert problem.value.code == 2
    assert "was inferred from the force; expected all that the study compares (the force, lateral_strain)" in " ".join(
        capsys.readouterr().err.split()
    )
