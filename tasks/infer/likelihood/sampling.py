"""The chains of a site: as many blocks of sweeps as it takes until they have converged, computed on the cluster.

Blocks are kept in ``infer/`` until the result is committed, so an interrupted run goes on.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np

from sinew.runner.errors import BadInput
from sinew.runner.evaluation.adaptive import AdaptiveRun, Session
from sinew.tasks.infer.likelihood.chains import Block, State, begun, swept
from sinew.tasks.infer.likelihood.discrepancy import ModelError
from sinew.tasks.infer.likelihood.explore import Explored
from sinew.tasks.infer.likelihood.kept import read_block, write_block
from sinew.tasks.infer.likelihood.result import Misfit, Runs
from sinew.tasks.infer.likelihood.summary import Chains, Convergence, chains_of, convergence
from sinew.tasks.infer.likelihood.target import Squares, Target
from sinew.tasks.infer.settings import Settings
from sinew.tasks.model import Specimen
from sinew.tasks.study import streams
from sinew.tasks.study.workspace import Workspace

ENSEMBLES = 2  # independent ones: two of them can agree or not
BLOCK = 100  # sweeps
LATER = 1.1  # times as many sweeps as chains had when they were judged, until they are judged again
SWEEPING = "chains of likelihood"  # random stream

Ensembles = Sequence[Sequence[Block]]
NONE: Ensembles = ((),) * ENSEMBLES


@dataclass(frozen=True, eq=False)
class Site:
    """What is needed to sample the posterior of site ``number``: likelihoods of its specimens, and these explored.

    ``inputs``: key of the result. ``errors``: the model's, by specimen.
    """

    workspace: Workspace
    settings: Settings
    inputs: str
    number: int
    targets: Sequence[Target]
    explored: Sequence[Explored]
    errors: Mapping[str, ModelError]

    @property
    def name(self) -> str:
        return self.targets[0].measured.specimen.site or "all"

    @property
    def heavy(self) -> bool:
        return self.settings.tails == "heavy"

    def enough(self, found: Convergence) -> bool:
        """Whether chains have converged."""
        assert self.settings.ess is not None, "it is filled in"
        return found.smallest_ess >= self.settings.ess and found.largest_rhat <= self.settings.rhat

    @property
    def specimens(self) -> list[Specimen]:
        return [target.measured.specimen for target in self.targets]


@dataclass(frozen=True, eq=False)
class Sampled:
    """The chains of a site, whether they have converged, and of how many ``sweeps`` each of them is.

    ``runs``: of the model by specimen, where each of them takes time.
    """

    site: Site
    chains: Chains
    found: Convergence
    sweeps: int
    runs: Mapping[str, Runs] = field(default_factory=dict)

    @property
    def misfit(self) -> dict[str, Misfit]:
        """What the best fit leaves of each specimen."""
        site, found = self.site, {}
        for known, target, specimen in zip(site.explored, site.targets, site.specimens, strict=True):
            left = float(np.sqrt(known.least / target.points))
            error = site.errors.get(specimen.name)
            names = target.measured.quantities
            each = dict(zip(names, known.left.tolist(), strict=True)) if len(names) > 1 else None
            bare, size = (error.misfit, error.size) if error else (left, 0.0)
            found[specimen.name] = Misfit(bare, size, left, each)
        return found


def sampled(site: Site) -> Sampled:
    """The posterior of a site whose model is quick. Raises :class:`BadInput` for chains that do not converge."""
    blocks, found = converged(site, site.targets)
    chains = chains_of(blocks, site.targets[0].varied, heavy=site.heavy)
    return Sampled(site, chains, found, chains.mean.shape[1])


def converged(
    site: Site, likelihoods: Sequence[Squares], tag: str = "", begun: Ensembles = NONE, least: int = 0
) -> tuple[Ensembles, Convergence]:
    """The blocks of all ensembles when they have converged, as :func:`swept_until`.

    Raises :class:`BadInput` for chains that have not after ``infer.sweeps``.
    """
    settings = site.settings
    blocks, found = swept_until(site, likelihoods, max(settings.sweeps, least), tag, begun, least)
    if not site.enough(found):
        raise BadInput(
            f"{site.workspace.study.path}: infer.sweeps",
            f"{site.name}: the chains have not converged after {len(blocks[0]) * BLOCK} sweeps: effective sample size "
            f"{found.smallest_ess:.0f} of {settings.ess}, R-hat {found.largest_rhat:.3f} (at most {settings.rhat:g})",
            "more sweeps, a smaller infer.ess, or fixed values for parameters that the curves do not determine",
        )
    return blocks, found


def swept_until(
    site: Site, likelihoods: Sequence[Squares], most: int, tag: str = "", begun: Ensembles = NONE, least: int = 0
) -> tuple[Ensembles, Convergence]:
    """Blocks of all ensembles, until they have converged: after ``begun`` ones, and of ``least`` to ``most`` sweeps.

    Files of blocks have a ``tag`` in their names.
    """
    workspace, ensembles = site.workspace, [list(blocks) for blocks in begun]

    def work(ensemble: int, session: Session) -> None:
        blocks = ensembles[ensemble]
        path = folder(workspace) / f"{site.number}-{ensemble}{tag}-{len(blocks)}.block.safetensors"
        block = read_block(path, site.inputs, len(site.targets), site.targets[0].size)
        if block is None:
            seed = streams.key(workspace.seed, SWEEPING, site.number, ensemble)
            before = blocks[-1].state if blocks else None
            block = session.compute(_block, likelihoods, site.explored, before, seed, site.heavy)
            write_block(path, site.inputs, block)
        blocks.append(block)

    first, last, judged = len(ensembles[0]), -(-most // BLOCK), 0
    with workspace.progress(f"infer: chains of {site.name}", last * BLOCK, of="sweeps", done=first * BLOCK) as report:
        while True:
            count = len(ensembles[0])
            if count >= min(max(judged * LATER, least / BLOCK, 1), last):
                judged, found = count, convergence(chains_of(ensembles, site.targets[0].varied, heavy=site.heavy))
                report(count * BLOCK, 0, 0)
                words = f"effective sample size {found.smallest_ess:.0f}, R-hat {found.largest_rhat:.3f}"
                workspace.note("infer", site.name, words, value=found.smallest_ess, sweeps=count * BLOCK)
                if count >= last or site.enough(found):
                    workspace.counted["sweeps"] -= (last - count) * BLOCK  # that were not needed
                    return ensembles, found
            workspace.run_adaptive([AdaptiveRun([], 0, partial(work, one)) for one in range(ENSEMBLES)], "infer")


def _block(
    likelihoods: Sequence[Squares],
    known: Sequence[Explored],
    before: State | None,
    seed: tuple[int, ...],
    heavy: bool,
) -> Block:
    """The next block of an ensemble; the first begins at draws of each specimen alone."""
    state = before if before is not None else begun(likelihoods, known, (*seed, 2**32), heavy=heavy)
    return swept(likelihoods, known, state, BLOCK, seed, heavy=heavy)


def folder(workspace: Workspace) -> Path:
    """Where an unfinished inference keeps what it has."""
    return workspace.out / "infer"
