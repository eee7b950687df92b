"""The inference of all sites by pyABC, whose simulations are rows of the store or run by pyABC's own sampler."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np
import pyabc

from sinew.runner.errors import BadInput
from sinew.runner.evaluation.adaptive import AdaptiveRun, Session
from sinew.tasks.infer.abc import files
from sinew.tasks.infer.abc.history import keep
from sinew.tasks.infer.abc.method import DRAWS, Inferred, comparison, infer, posterior
from sinew.tasks.infer.abc.pyabc_priors import Normals
from sinew.tasks.infer.abc.result import Posterior, draws
from sinew.tasks.infer.abc.sampler import Generation, StoredModel, StoreSampler
from sinew.tasks.infer.abc.site import Site
from sinew.tasks.infer.abc.stock_sampler import DirectModel, SimulationFailed, stock_sampler
from sinew.tasks.infer.settings import Settings
from sinew.tasks.model import Model
from sinew.tasks.simulate import Array
from sinew.tasks.study import streams
from sinew.tasks.study.streams import Stream
from sinew.tasks.study.workspace import Workspace

EXPECTED_PROPOSALS = 10  # for each particle, where the length of the progress bar is guessed


def on_the_store(workspace: Workspace, settings: Settings, sites: Sequence[Site]) -> list[Inferred]:
    """All sites at once, their evaluations being rows of the store."""
    runs = []
    for number, site in enumerate(sites):
        table, _ = workspace.plan(site.evaluation, np.empty((0, len(workspace.model.names))))
        work = partial(_infer_site, workspace, settings, site, streams.key(workspace.seed, Stream.INFERENCE, number))
        assert settings.generations is not None and settings.population is not None, "they are filled in"
        rows = settings.generations * settings.population * EXPECTED_PROPOSALS
        runs.append(AdaptiveRun([(table, site.evaluation)], rows, work))
    return workspace.run_adaptive(runs, "infer")


def _infer_site(
    workspace: Workspace, settings: Settings, site: Site, seed: tuple[int, ...], session: Session
) -> Inferred:
    sampler = StoreSampler(session, seed, settings.pending)
    compared = comparison(settings.distance, site.evaluation, site.noise)
    row = partial(_full_row, workspace.model, site.prior.names)
    model = StoredModel(site.name, site.prior.names, row=row, describe=compared.describe)

    def on_judged(threshold: float, generation: Generation) -> None:
        _note(workspace, settings, site.name, threshold, generation)

    save = partial(_save, workspace.out / files.database(site.name))
    inferred = infer(settings, Normals.of(site.prior), compared, model, sampler, on_judged=on_judged, save=save)
    if inferred is None:
        last = sampler.generations[-1]
        raise BadInput(
            f"{workspace.study.path}: infer.epsilon",
            f"site {site.name}: {last.accepted:,} of {last.judged:,} draws came within {_first(settings)}, "
            f"the closest was at {last.closest:.3g}, {last.failed} failed",
            "a larger epsilon, or another prior",
        )
    return inferred


def _first(settings: Settings) -> str:
    """The first threshold, in words."""
    return "the first threshold" if settings.epsilon is None else f"{settings.epsilon:g}"


def by_the_stock_sampler(workspace: Workspace, settings: Settings, sites: Sequence[Site]) -> list[Inferred]:
    """One site after the other: pyABC's sampler mixes up inferences that share a scheduler at the same time."""
    done = []
    for site in sites:
        compared = comparison(settings.distance, site.evaluation, site.noise)
        row = partial(_full_row, workspace.model, site.prior.names)
        model = DirectModel(site.name, site.prior.names, site.evaluation, row, compared.describe)
        sampler = stock_sampler(workspace.client())
        save = partial(_save, workspace.out / files.database(site.name))
        prior = Normals.of(site.prior)
        try:
            inferred = infer(settings, prior, compared, model, sampler, on_judged=lambda *_: None, save=save)
        except SimulationFailed as failed:
            raise BadInput(
                f"{workspace.study.path}: infer.sampler", f"a simulation failed ({failed}), and dask ends", "store"
            ) from None
        assert inferred is not None, "it draws until a generation is full"
        done.append(inferred)
    return done


def _full_row(model: Model, names: tuple[str, ...], values: Array) -> Array:
    """All parameters ``[d]`` of the model from values of those that are inferred."""
    full: Array = model.full(names, values[np.newaxis])[0]
    return full


def _note(workspace: Workspace, settings: Settings, site: str, threshold: float, generation: Generation) -> None:
    """Show which generation an inference has reached, and its threshold."""
    if generation.t < 0:
        workspace.note("infer", site, f"learning the distance: {generation.judged:,} draws")
        return
    words = (
        f"generation {generation.t + 1} of at most {settings.generations}, threshold {threshold:.4g}: "
        f"{generation.accepted} accepted, {generation.judged:,} judged"
    )
    numbers = {"accepted": generation.accepted, "judged": generation.judged}
    workspace.note("infer", site, words, generation=int(generation.t) + 1, value=threshold, **numbers)


def _save(path: Path, history: pyabc.History) -> None:
    path.parent.mkdir(exist_ok=True)
    keep(history, path)


def summarised(workspace: Workspace, site: Site, inferred: Inferred) -> Posterior:
    """The posterior of a site, whose equally weighted draws are written for ArviZ."""
    seed = streams.key(workspace.seed, Stream.POSTERIOR_DRAWS)
    drawn = draws(inferred.particles.isel(generation=-1), DRAWS, seed)
    files.write_sample(workspace.out, site.name, workspace.model.free, drawn)
    return posterior(inferred, site.prior, [specimen.name for specimen in site.specimens], seed)
