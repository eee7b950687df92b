"""The effects that were named in FEBio: its input regenerated with them and, where the solver is at hand, run.

An added material that changes nothing would be no addition, so the solver runs twice: with the effects as fitted, which
must give the embedded force, and at their null values, which must give another.
"""

import shutil
from typing import Any

import numpy as np

from runner.ensemble import Desk
from tasks.discover.explore import Effects, Explorer, each_for_all
from tasks.discover.fit import Candidate, Fitted
from tasks.model import Curve, file_name
from tasks.model.effect import model_with
from tasks.simulate import Array
from tasks.workspace import Workspace, attempts_folder, write_text


def in_febio(workspace: Workspace, one: Explorer, effects: Effects, fitted: Fitted) -> dict[str, Any]:
    """Write the solver's input for every curve of a specimen; run it, if the solver is on the PATH.

    The inputs are in ``discover/febio``. Of each run: the largest deviation from the embedded force and the largest
    change by the effects, as parts of the peak, or why there is none.
    """
    missing = [f"{effect.slug}: {effect.no_febio}" for effect in effects if not effect.febio]
    if missing:
        return {"inputs": [], "ran": False, "why": "; ".join(missing)}
    solver = workspace.study.solver_with(effects, attempts_folder(workspace.out))
    specimen, candidate = one.measured.specimen, Candidate(one.model, effects)
    model = model_with(one.model, effects)
    null = np.concatenate([fitted.at[: fitted.at.size - candidate.null().size], candidate.null()])
    rows = np.concatenate(candidate.rows(np.array([fitted.at, null])), axis=1)
    folder = workspace.out / "discover" / "febio"
    folder.mkdir(parents=True, exist_ok=True)
    inputs = []
    for curve in specimen.curves:
        path = folder / f"{file_name(specimen.name)}.{curve.name}.feb"
        write_text(path, solver.rendered(model, specimen, curve.protocol, rows[0]))
        inputs.append(str(path.relative_to(workspace.out)))
    if shutil.which(solver.executable) is None:
        return {"inputs": inputs, "ran": False, "why": f"{solver.executable} is not on the PATH"}

    def run(_: int, curve: Curve, desk: Desk) -> tuple[Array, tuple[str, ...]]:
        done = desk.compute(solver.simulate, model, specimen, curve.protocol, rows)
        return done.force_N, done.messages

    runs = {}
    for curve, ((force, messages),) in zip(
        specimen.curves, each_for_all(workspace, [one], "the effect in FEBio", specimen.curves, run), strict=True
    ):
        if any(messages):
            runs[curve.name] = {"failed": next(message for message in messages if message)}
            continue
        embedded = candidate.forces(specimen, curve.protocol, fitted.at[np.newaxis])[0]
        peak = float(np.abs(embedded).max())
        runs[curve.name] = {
            "deviation": float(np.abs(force[0] - embedded).max()) / peak,
            "change": float(np.abs(force[0] - force[1]).max()) / peak,
        }
    return {"inputs": inputs, "ran": True, "version": solver.version, "runs": runs}
