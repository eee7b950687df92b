"""The posterior of a site whose model takes time: rows of the store in place of calls of the simulator.

Chains run on the specimens' emulators alone. Some of their draws are then computed by the model, and their weights
(:mod:`sinew.tasks.infer.likelihood.correction`) say how far the emulators' posterior may be from the model's own. Where
that is too far, emulators are trained once more with these draws, and chains run again. Where it stays so, more draws
are computed, and the posterior is that of the weighted draws, which is exact in the limit of many.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from sinew.runner.errors import BadInput
from sinew.runner.evaluation.adaptive import AdaptiveRun, Session
from sinew.runner.store.table import Table
from sinew.tasks.infer.likelihood.correction import Draws, Weighted, draws_of, resampled, weighted
from sinew.tasks.infer.likelihood.effort import SPARING
from sinew.tasks.infer.likelihood.explore import Explored, explored
from sinew.tasks.infer.likelihood.fine import FineEmulator, fine_emulator
from sinew.tasks.infer.likelihood.kept import read_explored, write_explored
from sinew.tasks.infer.likelihood.result import Runs
from sinew.tasks.infer.likelihood.sampling import ENSEMBLES, Ensembles, Sampled, Site, converged, folder, swept_until
from sinew.tasks.infer.likelihood.scores import places
from sinew.tasks.infer.likelihood.summary import chains_of, chains_of_draws, warm_up
from sinew.tasks.infer.likelihood.target import RowTarget, Target
from sinew.tasks.model import Specimen, file_name
from sinew.tasks.simulate import Array
from sinew.tasks.simulate.evaluation import SpecimenEvaluation
from sinew.tasks.study import streams
from sinew.tasks.study.workspace import Workspace

BY_ROWS_VERSION = 2  # of such posteriors
EARLY = 200  # sweeps, after which emulators are judged
FIRST = 100  # draws that are computed first
CLOSE = 0.1  # standard deviations by which posterior means may be off, without weights
TRAININGS = 4  # of emulators, at most
ENOUGH = 400  # draws of equal weight that weighted ones are to be worth
SPARE = 1.15  # times as many draws as seem to be needed
LEAST_EFFICIENT = 0.25  # where draws are worth less, they are too few
BROAD_TAIL, ALIKE = 0.7, 0.9  # Pareto's k of weights, beyond which few decide, unless draws are worth as much
CHOOSING, RESAMPLING, TRAINING = "draws of emulators", "weighted draws", "emulators trained again"  # random streams


def planned(workspace: Workspace, specimen: Specimen) -> tuple[Table, SpecimenEvaluation]:
    """The table for rows of a specimen: with forces at all measured points, as its likelihood needs them."""
    evaluation = SpecimenEvaluation(workspace.model, specimen, workspace.simulator, "all")
    return workspace.plan(evaluation, np.empty((0, len(workspace.model.names))))[0], evaluation


def reopen_failed(workspace: Workspace, specimens: Sequence[Specimen]) -> None:
    """Have failed rows of specimens computed once more where they are asked for."""
    for specimen in specimens:
        table, _ = planned(workspace, specimen)
        table.reopen(np.flatnonzero(table.status))


def asking(target: Target, session: Session) -> RowTarget:
    """The same likelihood, which asks a session for rows."""
    own = (target.model, target.varied, target.simulator, target.measured, target.whitening, target.near)
    return RowTarget(*own, session=session)


def of_each(
    workspace: Workspace, targets: Sequence[Target], rows: int, work: Callable[[int, RowTarget], Any]
) -> list[Any]:
    """What ``work`` finds of each specimen with at most so many rows of it; all of them share the cluster."""

    def one(number: int, session: Session) -> Any:
        return work(number, asking(targets[number], session))

    tables = [planned(workspace, target.measured.specimen) for target in targets]
    runs = [AdaptiveRun([each], rows, partial(one, number)) for number, each in enumerate(tables)]
    return workspace.run_adaptive(runs, "infer")


def sampled_by_rows(site: Site) -> Sampled:
    """The posterior of a site. Raises :class:`BadInput` for emulators that do not come near the model."""
    for training in range(TRAININGS):
        likelihoods, tag = _emulated(site), f"-{training}"
        # on a poor emulator, chains might never converge
        blocks, found = swept_until(site, likelihoods, min(EARLY, site.settings.sweeps), tag)
        draws, judged = _checked(site, training, blocks)
        if judged.apart <= CLOSE:
            early = found
            blocks, found = converged(site, likelihoods, tag, blocks)
            if early.largest_rhat > site.settings.rhat:  # these were not yet draws of the emulators' posterior
                draws, judged = _checked(site, TRAININGS + training, blocks)
            if judged.apart <= CLOSE:
                chains = chains_of(blocks, site.targets[0].varied, heavy=site.heavy)
                return Sampled(site, chains, found, chains.mean.shape[1], _runs(site, judged.apart, 0))
        if training + 1 < TRAININGS:
            site = replace(site, explored=_trained_again(site, training, draws))
    blocks, _ = converged(site, likelihoods, tag, blocks)
    return _of_weighted_draws(site, likelihoods, tag, blocks, judged)


def _checked(site: Site, number: int, blocks: Ensembles) -> tuple[Draws, Weighted]:
    """Some draws of chains, and their weights by the model. Raises :class:`BadInput` where it fails for all of them."""
    draws = _chosen(site, number, blocks, FIRST)
    judged = weighted(_exact(site, draws), draws.squares)
    if not judged.efficiency:
        what = f"{site.name}: the simulator failed for all of {FIRST} draws, in one specimen or another"
        raise BadInput(
            f"{site.workspace.study.path}: infer", what, "`sinew status`, which tells why; then --retry-failed"
        )
    return draws, judged


def _of_weighted_draws(
    site: Site, likelihoods: Sequence[FineEmulator], tag: str, blocks: Ensembles, first: Weighted
) -> Sampled:
    """The posterior by draws that the model has computed: so many that they are worth ``ENOUGH`` of equal weight.

    ``first``: weights of a first sample. Chains go on after their ``blocks`` where these have too few draws.
    """
    enough = min(ENOUGH, site.settings.ess or ENOUGH)
    most = int(SPARE * enough / LEAST_EFFICIENT)
    blocks, found = converged(site, likelihoods, tag, blocks, 2 * most // ENSEMBLES)
    draws, exact = _chosen(site, 2 * TRAININGS, blocks, most), np.empty((0, len(site.targets)))
    efficiency = first.efficiency
    while True:
        count = min(most, max(len(exact) + FIRST, int(SPARE * enough / max(efficiency, LEAST_EFFICIENT))))
        exact = np.concatenate([exact, _exact(site, draws.at(np.arange(len(exact), count)))])
        judged = weighted(exact, draws.squares[:count])
        worth, efficiency = count * judged.efficiency, judged.efficiency
        if worth >= enough and (judged.tail <= BROAD_TAIL or efficiency >= ALIKE):
            break
        if count == most:
            raise BadInput(
                f"{site.workspace.study.path}: infer",
                f"{site.name}: emulators of the model are not good enough: {count} draws are worth {worth:.0f} of the "
                f"model's posterior, expected {enough} (Pareto's k of their weights is {judged.tail:.2f}, expected at "
                f"most {BROAD_TAIL})",
                "narrower ranges, or fixed values for parameters that the curves do not determine",
            )
    rng = streams.generator(site.workspace.seed, RESAMPLING, site.number)
    same = replace(draws.at(np.arange(count)), squares=exact).at(resampled(rng, judged.weights))
    sweeps = sum(len(block.mean) for block in blocks[0])
    chains = chains_of_draws(same, site.targets[0].varied, heavy=site.heavy)
    return Sampled(site, chains, found.of_draws(count, efficiency), sweeps - warm_up(sweeps), _runs(site, 0.0, count))


def _emulated(site: Site) -> list[FineEmulator]:
    """What stands for the likelihood of each specimen: trained with the points at which it was explored."""

    def work(number: int, target: RowTarget) -> FineEmulator:
        at = places(site.explored[number].seen)
        errors = target.errors(at)
        found: FineEmulator = target.session.compute(fine_emulator, at, errors)
        return found

    return of_each(site.workspace, site.targets, max(len(one.seen) for one in site.explored), work)


def _chosen(site: Site, training: int, blocks: Ensembles, count: int) -> Draws:
    """``count`` draws of chains."""
    draws = draws_of(blocks)
    rng = streams.generator(site.workspace.seed, CHOOSING, site.number, training)
    return draws.at(rng.permutation(len(draws))[:count])


def _runs(site: Site, apart: float, draws: int) -> dict[str, Runs]:
    """The runs of each specimen."""
    return {one.name: Runs(planned(site.workspace, one)[0].finished(), apart, draws) for one in site.specimens}


def _exact(site: Site, draws: Draws) -> Array:
    """The sums of squares ``[m, n]`` of draws, as the model has them."""

    def work(number: int, target: RowTarget) -> Array:
        return target.squares(places(draws.scores[:, number]))

    return np.stack(of_each(site.workspace, site.targets, len(draws), work), axis=1)


def _trained_again(site: Site, training: int, draws: Draws) -> list[Explored]:
    """Specimens explored with emulators that know some draws as well."""

    def work(number: int, target: RowTarget) -> Explored:
        name = file_name(target.measured.specimen.name)
        path = folder(site.workspace) / f"{name}.explored-{training + 1}.safetensors"
        found = read_explored(path, site.inputs, target)
        if found is None:
            known = np.concatenate([site.explored[number].seen, draws.scores[:, number]])
            seed = streams.key(site.workspace.seed, TRAINING, site.number, number, training)
            found = explored(target, seed, SPARING, target.session.compute, known)
            least = min(found.least, site.explored[number].least)
            found = replace(found, least=least)
            write_explored(path, site.inputs, found)
        return found

    most = SPARING.checked + len(site.explored[0].seen) + len(draws)
    return of_each(site.workspace, site.targets, most, work)
