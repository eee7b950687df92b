"""PAWN indices from the rows of the Sobol study: no new simulations. The store keeps ``pawn``.

Of each base sample the two independent rows are used, A and B; the rows in between share coordinates with them.
"""

from functools import partial

import numpy as np
import xarray as xr

from sinew.runner.errors import BadInput
from sinew.tasks.pawn.method import FEWEST_ROWS_OF_A_SLIDE, pawn_indices
from sinew.tasks.pawn.result import KEYS, PawnResult
from sinew.tasks.pawn.settings import Settings
from sinew.tasks.sobol.rows import sobol_rows
from sinew.tasks.sobol.settings import Settings as SobolSettings
from sinew.tasks.study.cached import cached, commit, key
from sinew.tasks.study.workspace import Workspace


def run(workspace: Workspace, settings: Settings) -> PawnResult:
    """PAWN indices for the total objective, each protocol's, and each of a template's outputs."""
    studied = workspace.study.section(SobolSettings).output
    found = sobol_rows(workspace)
    design = found.design
    inputs = key(PawnResult, settings.model_dump(), workspace.seed, found.keys, found.ok, design.rows, studied)
    if (known := cached(workspace, PawnResult, inputs, ["pawn"])) is not None:
        return known
    place = np.arange(len(design.rows)) % design.block
    names = [parameter.name for parameter in workspace.model.free]
    independent = (place == 0) | (place == design.block - 1)
    used = np.flatnonzero(independent & found.ok)
    if used.size < FEWEST_ROWS_OF_A_SLIDE * settings.slides:
        problem = f"{used.size} independent rows for {settings.slides} slides"
        raise BadInput(workspace.out, problem, f"{FEWEST_ROWS_OF_A_SLIDE} for each slide: a larger sobol design")
    indices_of = partial(
        pawn_indices, design.free_rows[used], slides=settings.slides, resamples=settings.resamples,
        confidence=settings.confidence, seed=workspace.seed,
    )  # fmt: skip
    objectives, outputs = (
        workspace.each(title, "analyses", indices_of, {name: values[used] for name, values in outcomes.items()})
        for title, outcomes in (("pawn", found.objectives()), ("pawn for outputs", found.outputs()))
    )
    result = PawnResult(
        names=names,
        **vars(objectives["total"]),
        slides=settings.slides,
        confidence=settings.confidence,
        rows=used.size,
        failed=int((independent & ~found.ok).sum()),
        objective=found.words,
        field=found.studied,
        protocols={name: one for name, one in objectives.items() if name != "total"},
        inputs=inputs,
        outputs=outputs or None,
    )
    every = objectives | outputs
    dataset = xr.Dataset(
        {name: (("output", "parameter"), np.stack([getattr(one, name) for one in every.values()])) for name in KEYS},
        {"parameter": np.array(names, dtype=str), "output": list(every)},
    )
    commit(workspace, result, {"pawn": dataset})
    return result
