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

from sinew.runner.errors import BadInput
from sinew.runner.evaluation.adaptive import AdaptiveRun, Session
from sinew.tasks.data.noise import refuse_none, remark_on_others
from sinew.tasks.data.sites import by_site
from sinew.tasks.fitting.measured import measured_of_each, remark_on_few
from sinew.tasks.infer.likelihood import files
from sinew.tasks.infer.likelihood.by_rows import BY_ROWS_VERSION, of_each, reopen_failed, sampled_by_rows
from sinew.tasks.infer.likelihood.chains import CHAINS
from sinew.tasks.infer.likelihood.compute import Compute, directly
from sinew.tasks.infer.likelihood.discrepancy import ModelError, model_error
from sinew.tasks.infer.likelihood.effort import FULL, SPARING, Effort, most_rows
from sinew.tasks.infer.likelihood.explore import Explored, explored
from sinew.tasks.infer.likelihood.kept import read_explored, read_model_error, write_explored, write_model_error
from sinew.tasks.infer.likelihood.result import INTERVAL, LikelihoodResult, PopulationMarginal, SitePosterior
from sinew.tasks.infer.likelihood.sampling import ENSEMBLES, Sampled, Site, folder, sampled
from sinew.tasks.infer.likelihood.summary import dataset, marginal, prior_population, specimen_marginals
from sinew.tasks.infer.likelihood.target import RowTarget, Target
from sinew.tasks.infer.result import particles_group
from sinew.tasks.infer.settings import Settings
from sinew.tasks.model import Specimen, file_name
from sinew.tasks.study import streams
from sinew.tasks.study.cached import cached, commit, key
from sinew.tasks.study.measured import key_of_quantities
from sinew.tasks.study.same_data import data_of
from sinew.tasks.study.workspace import Workspace

ERRORS, EXPLORING = "errors of the model", "explored specimens"  # random streams
PRIOR = "prior of populations"

Found = TypeVar("Found")


@dataclass(frozen=True)
class Step(Generic[Found]):
    """What is computed of each specimen alone, with random numbers of ``stream``, and kept in files with ``suffix``."""

    title: str
    suffix: str
    stream: str
    compute: Callable[[Target, tuple[int, ...], Effort, Compute], Found]
    read: Callable[[Path, str, Target], Found | None]
    write: Callable[[Path, str, Found], None]


def run(workspace: Workspace, settings: Settings) -> LikelihoodResult:
    """The posteriors of all sites. Raises :class:`BadInput` for chains that do not converge."""
    specimens = _chosen(workspace, settings)
    data = data_of(workspace, workspace.cohort.choose([one.name for one in specimens], "infer.specimens"))
    inputs = key(
        LikelihoodResult,
        settings.of("likelihood"),
        workspace.seed,
        [specimen.identity() for specimen in specimens],
        data,
        workspace.simulator.identity(),
        *([] if _quick(workspace) else [BY_ROWS_VERSION]),
        *key_of_quantities(workspace.study.compared, workspace.study.force_noise),
    )
    grouped = by_site(specimens)
    arrays = [particles_group(site) for site in grouped]
    if (known := cached(workspace, LikelihoodResult, inputs, arrays, files.names(grouped))) is not None:
        return known
    if workspace.retry_failed and not _quick(workspace):
        reopen_failed(workspace, specimens)
    targets, blind = _targets(workspace, specimens)
    errors = _model_errors(workspace, targets, inputs) if settings.discrepancy else {}
    beside = {name: replace(targets[name], whitening=one.white, near=one.near) for name, one in errors.items()}
    targets |= beside
    seen = _explored(workspace, targets, inputs)
    found = {}
    for number, (name, members) in enumerate(grouped.items()):
        likelihoods, specimens_seen = [targets[one.name] for one in members], [seen[one.name] for one in members]
        site = Site(workspace, settings, inputs, number, likelihoods, specimens_seen, errors)
        found[name] = sampled(site) if _quick(workspace) else sampled_by_rows(site)
    result = replace(_result(workspace, settings, inputs, found, blind), data=data)
    stored = {name: dataset(one.chains, one.site.specimens, one.site.targets[0].varied) for name, one in found.items()}
    files.write(workspace.out, result, stored, streams.key(workspace.seed, PRIOR))
    commit(workspace, result, dict(zip(arrays, stored.values(), strict=True)))
    for path in folder(workspace).glob("*.safetensors"):
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
    measured = measured_of_each(specimens, workspace.study.force_noise)
    free = workspace.model.free
    for one in measured:
        refuse_none(one.noise, workspace.cohort.folder / one.specimen.name)
    if remark := remark_on_others(specimens, [one.noise for one in measured]):
        workspace.say(f"infer: {remark}")
    if remark := remark_on_few(measured, workspace.study.noise_given):
        workspace.say(f"infer: {remark}")
    every = [Target(workspace.model, free, workspace.simulator, one) for one in measured]
    if _quick(workspace):
        blind = [target.blind() for target in every]
    else:
        blind = of_each(workspace, every, len(free) + 1, lambda _, target: target.blind())
    names = [parameter.name for j, parameter in enumerate(free) if all(each[j] for each in blind)]
    varied = tuple(parameter for parameter in free if parameter.name not in names)
    if not varied:
        expected = "a free parameter that the measured curves depend on"
        raise BadInput(f"{workspace.study.path}: model.parameters", "no curve depends on any", expected)
    return {one.measured.specimen.name: replace(one, varied=varied) for one in every}, names


def _quick(workspace: Workspace) -> bool:
    """Whether simulations take so little time that they are no rows of the store."""
    return workspace.simulator.capabilities.quick


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
    every = list(targets.values())

    def kept(number: int, compute: Callable[[tuple[int, ...]], Found]) -> Found:
        name = every[number].measured.specimen.name
        path = folder(workspace) / f"{file_name(name)}.{step.suffix}.safetensors"
        found = step.read(path, inputs, every[number])
        if found is None:
            found = compute(streams.key(workspace.seed, step.stream, number))
            step.write(path, inputs, found)
        return found

    def by_rows(number: int, target: RowTarget) -> Found:
        return kept(number, lambda seed: step.compute(target, seed, SPARING, target.session.compute))

    if not _quick(workspace):
        most = most_rows(every[0].size, discrepancy=True)
        return dict(zip(targets, of_each(workspace, every, most, by_rows), strict=True))
    with workspace.progress(step.title, len(targets), of="specimens") as report:
        finished = 0

        def work(number: int, session: Session) -> Found:
            nonlocal finished
            found = kept(number, lambda seed: session.compute(step.compute, every[number], seed, FULL, directly))
            finished += 1
            report(finished, 0, 0)
            return found

        runs = [AdaptiveRun([], 0, partial(work, number)) for number in range(len(every))]
        return dict(zip(targets, workspace.run_adaptive(runs, "infer"), strict=True))


def _result(
    workspace: Workspace, settings: Settings, inputs: str, found: dict[str, Sampled], blind: list[str]
) -> LikelihoodResult:
    free = workspace.model.free
    rng = streams.generator(workspace.seed, PRIOR)
    heavy = settings.tails == "heavy"
    prior, prior_specimens = prior_population([one for one in free if one.name in blind], rng, heavy=heavy)
    specimens = {
        specimen.name: {
            **specimen_marginals(one.chains, number, one.site.explored[number], one.site.targets[0].varied),
            **prior_specimens,
        }
        for one in found.values()
        for number, specimen in enumerate(one.site.specimens)
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
        sites={name: _site_posterior(one, prior) for name, one in found.items()},
        specimens=specimens,
        inputs=inputs,
        compared=workspace.study.compared or None,
    )


def _site_posterior(one: Sampled, prior: Mapping[str, PopulationMarginal]) -> SitePosterior:
    """The posterior of a site's population; ``prior``: of the parameters that no curve depends on."""
    chains, found = one.chains, one.found
    population = {}
    for j, parameter in enumerate(one.site.targets[0].varied):
        ess, rhat = float(found.ess[:, j].min()), float(found.rhat[:, j].max())
        population[parameter.name] = marginal(chains.mean[..., j], chains.spread[..., j], ess, rhat)
    return SitePosterior(
        specimens=[specimen.name for specimen in one.site.specimens],
        population={**population, **prior},
        smallest_ess=found.smallest_ess,
        largest_rhat=found.largest_rhat,
        sweeps=one.sweeps,
        emulator_sd=max(known.error for known in one.site.explored),
        misfit=one.misfit,
        runs=one.runs,
    )
