"""The named effects in FEBio: its input with the effects, which is run if the solver is installed.

An added material that changes nothing would be no addition, so the solver runs twice: with the effects as fitted, which
must give the embedded force, and at their null values, which must give another.
"""

import shutil
from dataclasses import replace
from functools import partial
from typing import cast

import numpy as np

from sinew.runner.evaluation.adaptive import Session
from sinew.tasks.discover.fit.fit import Fitted
from sinew.tasks.discover.fit.specimen_fits import Effects, SpecimenFits, each_for_all
from sinew.tasks.discover.follow_up import SolverCheck, SolverRun
from sinew.tasks.model import Curve, Model, Specimen, file_name
from sinew.tasks.model.effect import model_with
from sinew.tasks.simulate import Array
from sinew.tasks.simulate.build import febio_of
from sinew.tasks.simulate.febio.simulator import FEBio
from sinew.tasks.simulate.retrying import simulate_patiently
from sinew.tasks.study.files import write_text
from sinew.tasks.study.workspace import Workspace, attempts_folder


def in_febio(workspace: Workspace, one: SpecimenFits, effects: Effects, fitted: Fitted) -> SolverCheck:
    """Write the solver's input for every curve of a specimen; run it, if the solver is on the PATH.

    The inputs are in ``discover/febio``. Of each run: the largest deviation from the embedded force and the largest
    change by the effects, as parts of the peak, or why there is none.
    """
    if one.model.law != "tendon":
        return _own_model(workspace, one, effects, fitted)
    missing = [f"{effect.slug}: {effect.no_febio}" for effect in effects if not effect.febio]
    if missing:
        return SolverCheck((), ran=False, why="; ".join(missing))
    solver = febio_of(workspace.study, effects, attempts_folder(workspace.out))
    specimen, candidate = one.measured.specimen, replace(one.candidate(effects), solver=None)
    model = model_with(one.model, effects)
    null = np.concatenate([fitted.at[: fitted.at.size - candidate.null().size], candidate.null()])
    rows = np.concatenate(candidate.rows(np.array([fitted.at, null])), axis=1)
    inputs = _written(workspace, solver, model, specimen, rows[0])
    if shutil.which(solver.executable) is None:
        return SolverCheck(inputs, ran=False, why=f"{solver.executable} is not on the PATH")

    def run(_: int, curve: Curve, session: Session) -> tuple[Array, tuple[str, ...]]:
        ask = partial(simulate_patiently, retries=workspace.study.retries)
        done = session.compute(ask, solver, model, specimen, curve.protocol, rows)
        return done.force_N, done.messages

    runs = {}
    for curve, ((force, messages),) in zip(
        specimen.curves, each_for_all(workspace, [one], "the effect in FEBio", specimen.curves, run), strict=True
    ):
        if any(messages):
            runs[curve.name] = SolverRun(failed=next(message for message in messages if message))
            continue
        embedded = candidate.forces(specimen, curve.protocol, fitted.at[np.newaxis])[0]
        peak = float(np.abs(embedded).max())
        runs[curve.name] = SolverRun(
            deviation=float(np.abs(force[0] - embedded).max()) / peak,
            change=float(np.abs(force[0] - force[1]).max()) / peak,
        )
    return SolverCheck(inputs, ran=True, version=solver.version, runs=runs)


def _own_model(workspace: Workspace, one: SpecimenFits, effects: Effects, fitted: Fitted) -> SolverCheck:
    """The inputs of a user's own model with those of the effects that are inside it; all forces are its own anyway."""
    within = tuple(effect for effect in effects if not effect.around)
    if not within:
        return SolverCheck((), ran=False, why="the effects act around the study's own model; all forces are its own")
    solver = cast(FEBio, workspace.simulator)
    candidate = one.candidate(effects)
    own, values = (each[0] for each in candidate.rows(fitted.at[np.newaxis]))
    names = [name for effect in effects for name in effect.names]
    chosen = [values[names.index(name)] for effect in within for name in effect.names]
    having, model = cast(FEBio, solver.with_effects(within)), model_with(one.model, within)
    inputs = _written(workspace, having, model, one.measured.specimen, np.array([*own, *chosen]))
    others = [effect.slug for effect in effects if effect.around]
    verbs = "acts around it and is" if len(others) == 1 else "act around it and are"
    beside = f"; {', '.join(others)} {verbs} not in them" if others else ""
    return SolverCheck(inputs, ran=False, why=f"all forces are those of the study's own model{beside}")


def _written(workspace: Workspace, solver: FEBio, model: Model, specimen: Specimen, values: Array) -> tuple[str, ...]:
    """The solver's inputs for every curve of a specimen at ``values`` ``[d]``, in ``discover/febio``; their paths."""
    folder = workspace.out / "discover" / "febio"
    folder.mkdir(parents=True, exist_ok=True)
    inputs = []
    for curve in specimen.curves:
        path = folder / f"{file_name(specimen.name)}.{curve.name}.feb"
        write_text(path, solver.rendered(model, specimen, curve.protocol, values))
        inputs.append(str(path.relative_to(workspace.out)))
    return tuple(inputs)
