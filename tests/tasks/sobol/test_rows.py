"""The rows of a finished Sobol study: all of them, in the order of the design, with what failed."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

import sinew
from sinew.runner.cluster.local import Local
from sinew.runner.errors import BadInput
from sinew.runner.store.schema import STATUSES
from sinew.tasks.data.cohort import write_cohort
from sinew.tasks.model import Curve, Model, Protocol, Specimen
from sinew.tasks.simulate.evaluation import SpecimenEvaluation
from sinew.tasks.simulate.saltelli import saltelli
from sinew.tasks.sobol import task
from sinew.tasks.sobol.result import Surrogate
from sinew.tasks.sobol.rows import SobolRows, sobol_rows
from sinew.tasks.sobol.settings import Settings
from sinew.tasks.study.workspace import Workspace, open_workspace
from tests.tasks.few_parameters import held_but
from tests.tasks.sobol.results import sobol_result

FIXED = held_but(Model().names[:2])
STUDY = f"""
name: small
seed: 4
cohort: cohort
sobol: {{base_samples: 4, second_order: true}}
model:
  parameters:
{FIXED}"""
BAD = 5  # the row that fails


@dataclass(frozen=True, eq=False)
class Failing:
    """An evaluation that fails one parameter set."""

    inner: SpecimenEvaluation
    bad: np.ndarray

    def __call__(self, parameters):
        outcome = self.inner(parameters)
        status = outcome.status.copy()
        status[(parameters == self.bad).all(axis=1)] = STATUSES.index("diverged")
        values = {name: np.where((status > 0)[:, np.newaxis], np.nan, one) for name, one in outcome.values.items()}
        return replace(outcome, values=values, status=status, messages=tuple("it broke" for _ in status))


@pytest.fixture
def workspace(tmp_path, specimen):
    (pull,) = specimen.curves
    stiffer = replace(specimen, name="s02", curves=(replace(pull, force_N=2.0 * pull.force_N),))
    write_cohort(tmp_path / "cohort", [specimen, stiffer])
    (tmp_path / "study.yaml").write_text(STUDY)
    study = sinew.read_study(tmp_path / "study.yaml")
    with open_workspace(study, out=tmp_path / "out", cluster=Local(workers=1), quiet=True) as opened:
        yield opened


def evaluate(workspace: Workspace, count: int | None = None, base: int = 4) -> None:
    """Evaluate the design, of the second specimen only ``count`` rows."""
    rows = saltelli(workspace.model, base, True, 4).rows
    for number, specimen in enumerate(workspace.cohort.specimens):
        evaluation = workspace.evaluation(specimen)
        table, at = workspace.plan(evaluation, rows)
        call = Failing(evaluation, rows[BAD]) if number else evaluation
        workspace.evaluate(call, table, at[:count] if number else at, "", here=True)


def refused(workspace: Workspace) -> str:
    with pytest.raises(BadInput) as error:
        sobol_rows(workspace)
    return str(error.value)


def test_the_rows_of_a_finished_study_are_there(workspace):
    evaluate(workspace)
    sobol_result().write(workspace.out)
    found = sobol_rows(workspace)
    design = saltelli(workspace.model, 4, True, 4)
    assert np.array_equal(found.design.rows, design.rows)
    assert found.design.second_order
    assert np.flatnonzero(~found.ok).tolist() == [BAD], "no specimen may have failed it"
    assert found.specimens == workspace.cohort.specimens
    assert (found.studied, found.words) == ("objective", "sum over protocols of the RMSE in N")
    assert found.output_names == ()
    assert len(set(found.keys)) == 2
    assert found.keys == [workspace.evaluation(one).table().key for one in found.specimens]
    direct = [workspace.evaluation(one)(design.rows).values["objective"] for one in found.specimens]
    total = found.objectives()["total"]
    assert np.isnan(total[BAD])
    assert np.allclose(np.delete(total, BAD), np.delete(np.mean(direct, axis=0).sum(axis=1), BAD))


def test_a_study_that_is_not_finished_is_refused(workspace):
    words = (
        f"{workspace.out / 'sobol.json'}: no finished Sobol study; expected `sinew sobol` on this study first"
    )  # fmt: skip
    assert refused(workspace) == words
    evaluate(workspace, count=23)
    assert refused(workspace) == words, "there is no result"
    sobol_result().write(workspace.out)
    assert refused(workspace) == words, "one row has no outcome"
    evaluate(workspace)
    sobol_rows(workspace)
    sobol_result(base_samples=8).write(workspace.out)
    assert refused(workspace) == words, "the last study had more rows"


@pytest.mark.parametrize(
    "changed",
    [
        {"base_samples": 2**24, "surrogate": Surrogate(0.02, True, {})},
        {"base_samples": 2**18, "scrambles": 2**18},
        {"base_samples": 2**27},
        {"base_samples": 4, "scrambles": 3},
        {"base_samples": 0, "base_samples_used": 0},
    ],
)
def test_a_design_that_no_study_draws_is_refused_before_it_is_drawn(workspace, changed, monkeypatch):
    def draw(*_, **__):
        pytest.fail("it was drawn")

    monkeypatch.setattr("sinew.tasks.sobol.rows.saltelli", draw)
    monkeypatch.setattr("sinew.tasks.sobol.rows.plain_design", draw)
    monkeypatch.setattr("sinew.tasks.sobol.task.saltelli", draw)
    sobol_result(**changed).write(workspace.out)
    assert "no finished Sobol study" in refused(workspace)
    with pytest.raises(BadInput, match="what `sinew sobol` writes"):
        task.run(workspace, workspace.study.section(Settings), extend=True)


@dataclass(frozen=True)
class Summaries:
    """A table of a template's output, ``[rows, protocols]``."""

    values: np.ndarray
    key: str = ""

    def read(self, name, rows):
        assert name == "summary_stretch"
        return self.values[rows]


def test_an_output_is_summed_over_protocols_and_averaged_over_specimens():
    history = Protocol("pull", np.arange(3.0), np.arange(3.0))
    curves = (Curve(history, None), Curve(replace(history, name="hold"), None))
    specimens = tuple(Specimen(name, 10.0, 8.0, 4.0, curves) for name in ("s01", "s02"))
    first, second = np.array([[1.0, 2.0], [3.0, 4.0]]), np.array([[10.0, 20.0], [30.0, 40.0]])
    evaluated = ((Summaries(first), np.array([0, 1])), (Summaries(second), np.array([1, 0])))
    rows = SobolRows(None, np.ones(2, bool), specimens, evaluated, "summary_stretch", "words", ("stretch",))
    assert rows.outputs()["stretch"].tolist() == [36.5, 18.5]
    by_protocol = {name: values.tolist() for name, values in rows.objectives().items()}
    assert by_protocol == {"total": [36.5, 18.5], "pull": [15.5, 6.5], "hold": [21.0, 12.0]}


def test_specimens_may_be_chosen(workspace, tmp_path):
    evaluate(workspace)
    sobol_result().write(workspace.out)
    chosen = STUDY.replace("second_order: true", "second_order: true, specimens: [s02]")
    Path(tmp_path / "chosen.yaml").write_text(chosen)
    workspace.study = sinew.read_study(tmp_path / "chosen.yaml")
    assert [one.name for one in sobol_rows(workspace).specimens] == ["s02"]
    workspace.study = sinew.read_study(_named(tmp_path, chosen.replace("s02", "s03")))
    assert refused(workspace).startswith(f"{tmp_path / 'wrong.yaml'}: sobol.specimens")


def _named(folder: Path, text: str) -> Path:
    (folder / "wrong.yaml").write_text(text)
    return folder / "wrong.yaml"
