"""How well laws predict a test that was not fitted, where the library does not have what is hidden.

``python -m tests.hidden.laws --out FOLDER --seed 5`` hides each form in turn, looks for laws beside the bare model in
two of three tests of each specimen, and predicts the third. The library of effects is not used. Errors are in units of
the noise: a true model comes to 1.
"""

import json
import statistics
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import click
import numpy as np

from sinew.runner.evaluation.adaptive import Session
from sinew.tasks.cluster.spec import cluster_of
from sinew.tasks.data.cohort import write_cohort
from sinew.tasks.discover.fit.fit import Fitted, errors
from sinew.tasks.discover.fit.laws import find_law
from sinew.tasks.discover.fit.specimen_fits import Effects, SpecimenFits, each_for_all, fits_of_each
from sinew.tasks.fitting.measured import Measured
from sinew.tasks.model import Specimen
from sinew.tasks.study.study import read_study
from sinew.tasks.study.workspace import Workspace, open_workspace
from tests.hidden.forms import FORMS, OUTSIDE
from tests.hidden.make import Plan, own_case

STARTS = 4
GOOD = 2.0  # times the noise: a good prediction
STUDY = "name: laws\nseed: {seed}\ncohort: {cohort}\nsimulator: uniaxial\ncluster: {{name: local}}\ntasks: [discover]\n"


@click.command()
@click.option("--out", type=click.Path(path_type=Path), required=True, help="Folder to write.")
@click.option("--seed", type=click.IntRange(0, 2**32 - 1), default=0, show_default=True)
@click.option("--workers", type=click.IntRange(1), default=2, show_default=True)
@click.option("--form", "forms", multiple=True, help="Only these forms.")
def main(out: Path, seed: int, workers: int, forms: tuple[str, ...]) -> None:
    """Write ``laws.json``: a row for each form, and how many tests were predicted."""
    every = [*FORMS, *OUTSIDE]
    if unknown := [form for form in forms if form not in every]:
        raise click.BadParameter(f"no form {unknown[0]}")
    rows = []
    for number, form in enumerate(every):
        if not forms or form in forms:
            rows.append(judged(out / form, form, [seed, number], number % 3, workers))
            print(json.dumps(rows[-1]), flush=True)
            (out / "laws.json").write_text(json.dumps(rows, indent=1) + "\n", "utf-8")
    hard = [row for row in rows if row["without"] > GOOD]
    good = [row for row in hard if row["with"] <= GOOD]
    print(f"{len(good)} of {len(hard)} that the bare model does not predict within {GOOD:g} times the noise")
    print(f"median error {statistics.median(row['with'] for row in rows):.2f} times the noise")


def judged(folder: Path, form: str, seed: Sequence[int], left_out: int, workers: int) -> dict[str, object]:
    """The laws that were found for one form, and the errors of predictions of the test that was left out."""
    whole, _ = own_case(Plan((form,)), np.random.default_rng(seed), 10.0)
    seen = [replace(one, curves=tuple(curve for i, curve in enumerate(one.curves) if i != left_out)) for one in whole]
    write_cohort(folder / "cohort", seen)
    path = folder / "study.yaml"
    path.write_text(STUDY.format(seed=seed[0], cohort=folder.resolve() / "cohort"), "utf-8")
    study = read_study(path)
    with open_workspace(study, out=folder / "out", cluster=cluster_of(study, workers), quiet=True) as workspace:
        cohort = fits_of_each(workspace, workspace.specimens("all", "discover.specimens"))
        bare = _bare(workspace, cohort)
        found = find_law(workspace, cohort, (), bare)
    return {
        "form": form,
        "left_out": whole[0].curves[left_out].name,
        "laws": [law.name for law in found.laws],
        "without": _error(cohort, whole, (), bare, left_out),
        "with": _error(cohort, whole, found.effects, found.fits, left_out),
    }


def _bare(workspace: Workspace, cohort: Sequence[SpecimenFits]) -> list[Fitted]:
    def work(i: int, _: None, session: Session) -> Fitted:
        return cohort[i].bare(session, STARTS, (1, i))[0]

    (fits,) = each_for_all(workspace, cohort, "the model as it is", [None], work)
    return fits


def _error(
    cohort: Sequence[SpecimenFits],
    whole: Sequence[Specimen],
    effects: Effects,
    fits: Sequence[Fitted],
    left_out: int,
) -> float:
    """Root mean square of the errors of the test that was left out, of all specimens, in units of the noise."""
    squares = [
        errors(one.candidate(effects), Measured(true, one.measured.noise), fitted.at[None], [true.curves[left_out]])
        for one, true, fitted in zip(cohort, whole, fits, strict=True)
    ]
    return float(np.sqrt(np.mean(np.concatenate(squares, axis=1) ** 2)))


if __name__ == "__main__":
    main()
