"""Posteriors of specimens and populations by likelihood: explore each specimen, run chains, summarise, commit.

The model's error in each specimen is found on the cluster, if one is expected, and specimens are explored there. Then
the ensembles of chains of all sites run, block by block, until they have converged. What was computed is kept in
``infer/`` until the result is committed, so an interrupted run goes on.
The store keeps ``infer/SITE``, draws of the population and of all specimens.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Generic, TypeVar

import numpy as np

from sinew.runner.errors import BadInput
from sinew.runner.evaluation.adaptive import AdaptiveRun, Session
from sinew.tasks.data.noise import noise_of_each
from sinew.tasks.data.sites import by_site
from sinew.tasks.fitting.measured import Measured
from sinew.tasks.infer.likelihood import files
from sinew.tasks.infer.likelihood.chains import CHAINS, Block, State, begun, swept
from sinew.tasks.infer.likelihood.discrepancy import ModelError, model_error
from sinew.tasks.infer.likelihood.explore import Explored, explored
from sinew.tasks.infer.likelihood.kept import (
    read_block,
    read_explored,
    read_model_error,
    write_block,
    write_explored,
    write_model_error,
)
from sinew.tasks.infer.likelihood.result import INTERVAL, LikelihoodResult, Misfit
from sinew.tasks.infer.likelihood.summary import (
    Chains,
    Convergence,
    chains_of,
    convergence,
    dataset,
    prior_population,
    site_posterior,
    specimen_marginals,
)
from sinew.tasks.infer.likelihood.target import Target
from sinew.tasks.infer.result import particles_group
from sinew.tasks.infer.settings import Settings
from sinew.tasks.model import Specimen, file_name
from sinew.tasks.study import streams
from sinew.tasks.study.cached import cached, commit, key
from sinew.tasks.study.workspace import Workspace

ENSEMBLES = 2  # independent ones: two of them can agree or not
BLOCK = 100  # sweeps
LATER = 1.1  # times as many sweeps as chains had when they were judged, until they are judged again
ERRORS, EXPLORING = "errors of the model", "explored specimens"  # random streams
SWEEPING, PRIOR = "chains of likelihood", "prior of populations"

Found = TypeVar("Found")


@dataclass(frozen=True)
class Step(Generic[Found]):
    """What is computed of each specimen alone, with random numbers of ``stream``, and kept in files with ``suffix``."""

    title: str
    suffix: str
    stream: str
    compute: Callable[[Target, tuple[int, ...]], Found]
    read: Callable[[Path, str, Target], Found | None]
    write: Callable[[Path, str, Found], None]


@dataclass(frozen=True, eq=False)
class Sampled:
    """The explored specimens of a site, its chains, whether they have converged, and the model's errors."""

    targets: Sequence[Target]
    explored: Sequence[Explored]
    chains: Chains
    found: Convergence
    errors: Mapping[str, ModelError]

    @property
    def misfit(self) -> dict[str, Misfit]:
        """What the best fit leaves of each specimen."""
        found = {}
        for known, target, specimen in zip(self.explored, self.targets, self.specimens, strict=True):
            left = float(np.sqrt(known.least / target.points))
            error = self.errors.get(specimen.name)
            found[specimen.name] = Misfit(error.misfit, error.size, left) if error else Misfit(left, 0.0, left)
        return found

    @property
    def specimens(self) -> list[Specimen]:
        return [target.measured.specimen for target in self.targets]


def run(workspace: Workspace, settings: Settings) -> LikelihoodResult:
    """The posteriors of all sites. Raises :class:`BadInput` for chains that do not converge."""
    specimens = _chosen(workspace, settings)
    inputs = key(
        LikelihoodResult,
        settings.of("likelihood"),
        workspace.seed,
        [specimen.identity() for specimen in specimens],
        [specimen.name for specimen in specimens],
        workspace.model.identity(),
        [[p.name, p.minimum, p.maximum, p.reference] for p in workspace.model.parameters],
        workspace.simulator.identity(),
    )
    grouped = by_site(specimens)
    arrays = [particles_group(site) for site in grouped]
    if (known := cached(workspace, LikelihoodResult, inputs, arrays, files.names(grouped))) is not None:
        return known
    workspace.say_what_is_left_out("infer")
    targets, blind = _targets(workspace, specimens)
    errors = _model_errors(workspace, targets, inputs) if settings.discrepancy else {}
    targets = {**targets, **{name: replace(targets[name], whitening=one.white) for name, one in errors.items()}}
    seen = _explored(workspace, targets, inputs)
    sampled = {
        site: _sampled(workspace, settings, inputs, number, [targets[one.name] for one in members], seen, errors)
        for number, (site, members) in enumerate(grouped.items())
    }
    result = _result(workspace, settings, inputs, sampled, blind)
    stored = {site: dataset(one.chains, one.specimens, one.targets[0].varied) for site, one in sampled.items()}
    files.write(workspace.out, result, stored, streams.key(workspace.seed, PRIOR))
    commit(workspace, result, dict(zip(arrays, stored.values(), strict=True)))
    for path in _folder(workspace).glob("*.safetensors"):
        path.unlink()
    return result


def _chosen(workspace: Workspace, settings: Settings) -> tuple[Specimen, ...]:
    """The specimens with the curves that are inferred from."""
    specimens = workspace.specimens(settings.specimens, "infer.specimens")
    if settings.protocols == "all":
        return specimens
    cut = [replace(one, curves=tuple(c for c in one.curves if c.name in settings.protocols)) for one in specimens]
    missing = [specimen.name for specimen in cut if not specimen.curves]
    if missing:
        where = f"{workspace.study.path}: infer.protocols"
        raise BadInput(where, f"no curve of {missing[0]} is among them", "protocols it has")
    return tuple(cut)


def _targets(workspace: Workspace, specimens: Sequence[Specimen]) -> tuple[dict[str, Target], list[str]]:
    """The likelihood of each specimen, by its name, and the parameters that no curve depends on."""
    noise = noise_of_each([one.curves for one in specimens])
    free = workspace.model.free
    make = partial(Target, workspace.model)
    measured = [Measured(one, level) for one, level in zip(specimens, noise, strict=True)]
    blind = [make(free, workspace.simulator, one).blind() for one in measured]
    names = [parameter.name for j, parameter in enumerate(free) if all(each[j] for each in blind)]
    varied = tuple(parameter for parameter in free if parameter.name not in names)
    if not varied:
        expected = "a free parameter that the measured curves depend on"
        raise BadInput(f"{workspace.study.path}: model.parameters", "no curve depends on any", expected)
    return {one.specimen.name: make(varied, workspace.simulator, one) for one in measured}, names


def _folder(workspace: Workspace) -> Path:
    return workspace.out / "infer"


def _model_errors(workspace: Workspace, targets: dict[str, Target], inputs: str) -> dict[str, ModelError]:
    """The model's error in every specimen."""
    step = Step("infer: errors of the model", "model_error", ERRORS, model_error, read_model_error, write_model_error)
    return _of_each(workspace, targets, inputs, step)


def _explored(workspace: Workspace, targets: dict[str, Target], inputs: str) -> dict[str, Explored]:
    """Every specimen explored."""
    step = Step("infer: specimens", "explored", EXPLORING, explored, read_explored, write_explored)
    return _of_each(workspace, targets, inputs, step)


def _of_each(workspace: Workspace, targets: dict[str, Target], inputs: str, step: "Step[Found]") -> dict[str, Found]:
    """What a step finds of each specimen by its name, on the cluster or before."""
    with workspace.progress(step.title, len(targets), of="specimens") as report:
        finished = 0

        def work(number: int, name: str, session: Session) -> Found:
            nonlocal finished
            path = _folder(workspace) / f"{file_name(name)}.{step.suffix}.safetensors"
            found = step.read(path, inputs, targets[name])
            if found is None:
                found = session.compute(step.compute, targets[name], streams.key(workspace.seed, step.stream, number))
                step.write(path, inputs, found)
            finished += 1
            report(finished, 0, 0)
            return found

        runs = [AdaptiveRun([], 0, partial(work, number, name)) for number, name in enumerate(targets)]
        return dict(zip(targets, workspace.run_adaptive(runs, "infer"), strict=True))


def _sampled(
    workspace: Workspace,
    settings: Settings,
    inputs: str,
    site: int,
    targets: Sequence[Target],
    seen: dict[str, Explored],
    errors: dict[str, ModelError],
) -> Sampled:
    """The chains of a site, as many blocks of them as it takes."""
    name = targets[0].measured.specimen.site or "all"
    known = [seen[target.measured.specimen.name] for target in targets]
    heavy = settings.tails == "heavy"
    ensembles: list[list[Block]] = [[] for _ in range(ENSEMBLES)]

    def work(ensemble: int, session: Session) -> None:
        blocks = ensembles[ensemble]
        path = _folder(workspace) / f"{site}-{ensemble}-{len(blocks)}.block.safetensors"
        block = read_block(path, inputs, len(targets), targets[0].size)
        if block is None:
            seed = streams.key(workspace.seed, SWEEPING, site, ensemble)
            before = blocks[-1].state if blocks else None
            block = session.compute(_block, targets, known, before, seed, heavy)
            write_block(path, inputs, block)
        blocks.append(block)

    most, enough = -(-settings.sweeps // BLOCK), settings.ess
    assert enough is not None, "it is filled in"
    with workspace.progress(f"infer: chains of {name}", most * BLOCK, of="sweeps") as report:
        judged = 0
        for number in range(most):
            workspace.run_adaptive([AdaptiveRun([], 0, partial(work, one)) for one in range(ENSEMBLES)], "infer")
            if number + 1 < min(judged * LATER, most):
                continue
            judged = number + 1
            chains = chains_of(ensembles, targets[0].varied, heavy=heavy)
            found = convergence(chains)
            report((number + 1) * BLOCK, 0, 0)
            words = f"effective sample size {found.smallest_ess:.0f}, R-hat {found.largest_rhat:.3f}"
            workspace.note("infer", name, words, value=found.smallest_ess, sweeps=(number + 1) * BLOCK)
            if found.smallest_ess >= enough and found.largest_rhat <= settings.rhat:
                workspace.counted["sweeps"] -= (most - number - 1) * BLOCK  # that were not needed
                return Sampled(targets, known, chains, found, errors)
    raise BadInput(
        f"{workspace.study.path}: infer.sweeps",
        f"{name}: the chains have not converged after {most * BLOCK} sweeps: effective sample size "
        f"{found.smallest_ess:.0f} of {settings.ess}, R-hat {found.largest_rhat:.3f} (at most {settings.rhat:g})",
        "more sweeps, a smaller infer.ess, or fixed values for parameters that the curves do not determine",
    )


def _block(
    targets: Sequence[Target], known: Sequence[Explored], before: State | None, seed: tuple[int, ...], heavy: bool
) -> Block:
    """The next block of an ensemble; the first begins at draws of each specimen alone."""
    state = before if before is not None else begun(targets, known, (*seed, 2**32), heavy=heavy)
    return swept(targets, known, state, BLOCK, seed, heavy=heavy)


def _result(
    workspace: Workspace, settings: Settings, inputs: str, sampled: dict[str, Sampled], blind: list[str]
) -> LikelihoodResult:
    free = workspace.model.free
    rng = streams.generator(workspace.seed, PRIOR)
    heavy = settings.tails == "heavy"
    prior, prior_specimens = prior_population([one for one in free if one.name in blind], rng, heavy=heavy)
    specimens = {
        specimen.name: {
            **specimen_marginals(one.chains, number, one.explored[number], one.targets[0].varied),
            **prior_specimens,
        }
        for one in sampled.values()
        for number, specimen in enumerate(one.specimens)
    }
    return LikelihoodResult(
        method="likelihood",
        names=[parameter.name for parameter in free],
        units=[parameter.unit for parameter in free],
        meanings=[parameter.description for parameter in free],
        blind=blind,
        interval=INTERVAL,
        tails=settings.tails,
        discrepancy=settings.discrepancy,
        chains=ENSEMBLES * CHAINS,
        sites={
            site: site_posterior(
                one.chains, one.found, one.explored, one.specimens, one.targets[0].varied, prior, one.misfit
            )
            for site, one in sampled.items()
        },
        specimens=specimens,
        inputs=inputs,
    )
