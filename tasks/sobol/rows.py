"""The finished rows of a Sobol study, for tasks that analyse them in another way: no new simulations."""

from dataclasses import dataclass

import numpy as np

from sinew.runner.errors import BadInput
from sinew.runner.store.table import Table
from sinew.tasks.model import Specimen
from sinew.tasks.simulate import Array
from sinew.tasks.simulate.plain_design import plain_design
from sinew.tasks.simulate.saltelli import Design, saltelli
from sinew.tasks.simulate.studied_quantity import objectives_by_output, quantity
from sinew.tasks.sobol.result import SobolResult
from sinew.tasks.sobol.settings import Settings
from sinew.tasks.study.workspace import Workspace


@dataclass(frozen=True, eq=False)
class SobolRows:
    """The design of the last Sobol study, and where its outcomes are.

    ``ok`` ``[n]``: rows that no specimen failed. ``evaluated`` holds each specimen's table and the row in it of each
    row of the design. ``studied`` is what the store calls the quantity under study, and ``words`` what it is;
    ``output_names`` are a template's outputs.
    """

    design: Design
    ok: Array
    specimens: tuple[Specimen, ...]
    evaluated: tuple[tuple[Table, Array], ...]
    studied: str
    words: str
    output_names: tuple[str, ...]

    @property
    def keys(self) -> list[str]:
        """The keys of the tables in the store."""
        return [table.key for table, _ in self.evaluated]

    def objectives(self) -> dict[str, Array]:
        """The outcome ``[n]`` in total (``total``) and by protocol, NaN where a row failed."""
        return objectives_by_output(self.specimens, [table.read(self.studied, at) for table, at in self.evaluated])

    def outputs(self) -> dict[str, Array]:
        """The summary ``[n]`` of each of a template's outputs, summed over the protocols, mean of the specimens."""
        found = {}
        for name in self.output_names:
            sums = [table.read(f"summary_{name}", at).sum(axis=1) for table, at in self.evaluated]
            found[name] = np.mean(sums, axis=0)
        return found


def sobol_rows(workspace: Workspace) -> SobolRows:
    """The rows of the last Sobol study. Raises :class:`BadInput` when they are not all there."""
    settings = workspace.study.section(Settings)
    last = SobolResult.read(workspace.out)
    missing = BadInput(SobolResult.path(workspace.out), "no finished Sobol study", "`sinew sobol` on this study first")
    if last is None or not last.has_design:
        raise missing
    if last.surrogate is None:
        design = saltelli(
            workspace.model, last.base_samples, settings.second_order, workspace.seed, last.scrambles, settings.inputs
        )
    else:
        design, _ = plain_design(workspace.model, last.base_samples, workspace.seed, last.scrambles, settings.inputs)
    specimens = workspace.specimens(settings.specimens, "sobol.specimens")
    evaluated = tuple(_found(workspace, specimen, design, missing) for specimen in specimens)
    studied, words = quantity(workspace.evaluation(specimens[0]), settings.output)
    return SobolRows(
        design=design,
        ok=np.asarray((np.stack([table.status[at] for table, at in evaluated]) == 0).all(axis=0)),
        specimens=specimens,
        evaluated=evaluated,
        studied=studied,
        words=words,
        output_names=tuple(output.name for output in workspace.simulator.capabilities.outputs),
    )


def _found(workspace: Workspace, specimen: Specimen, design: Design, missing: BadInput) -> tuple[Table, Array]:
    """The table of a specimen, and where in it the rows of the design are."""
    table = workspace.store.table(workspace.evaluation(specimen).table())
    at = table.find(design.rows)
    if (at < 0).any() or table.pending(at).size:
        raise missing
    return table, at
