"""Posterior of each site's parameters by approximate Bayesian computation: plan, sample, summarise, commit.

The store keeps a row for every evaluation, and ``infer/SITE`` with the particles of all generations. All sites share
the cluster. A run that was interrupted asks again for the same rows, finds them in the store, and goes on.
"""

import numpy as np

from sinew.runner.errors import BadInput
from sinew.tasks.calibrate.result import CalibrateResult
from sinew.tasks.data.sites import by_site
from sinew.tasks.infer.abc import files
from sinew.tasks.infer.abc.noise import noise_of_site
from sinew.tasks.infer.abc.observations import SiteEvaluation, observed
from sinew.tasks.infer.abc.prior import Prior, calibrated, of_others, of_ranges
from sinew.tasks.infer.abc.result import INTERVAL, AbcResult, particles_group
from sinew.tasks.infer.abc.site import Site
from sinew.tasks.infer.settings import Settings
from sinew.tasks.model import Specimen
from sinew.tasks.study.cached import cached, commit, key
from sinew.tasks.study.result import believed
from sinew.tasks.study.same_data import data_of, refuse_other_data
from sinew.tasks.study.workspace import Workspace


def run(workspace: Workspace, settings: Settings) -> AbcResult:
    """The posterior of each site, by ``settings`` of which nothing but the first threshold may be left open.

    Raises :class:`BadInput` when there is no calibration to take priors from, or no draw came within ``epsilon``.
    """
    grouped = by_site(workspace.specimens(settings.specimens, "infer.specimens"))
    evaluations = {site: _evaluation(workspace, settings, site, members) for site, members in grouped.items()}
    noise = {name: None if settings.paper else noise_of_site(one) for name, one in evaluations.items()}
    sites = [
        Site(name, members, evaluations[name], _prior(workspace, settings, name, members), noise[name])
        for name, members in grouped.items()
    ]
    tables = [site.evaluation.table().key for site in sites]
    priors = [
        [one.names, *(values.tolist() for values in (one.mean, one.sd, one.low, one.high))]
        for one in (site.prior for site in sites)
    ]
    fixed = [[p.name, p.reference] for p in workspace.model.parameters if p not in workspace.model.free]
    data = data_of(workspace, [one for members in grouped.values() for one in members])
    inputs = key(AbcResult, settings.of("abc"), workspace.seed, tables, data, priors, fixed)
    arrays = [particles_group(site) for site in grouped]
    if (known := cached(workspace, AbcResult, inputs, arrays, files.names(grouped))) is not None:
        return known
    from sinew.tasks.infer.abc import sampling  # pyABC takes seconds to import

    infer_all = sampling.on_the_store if settings.sampler == "store" else sampling.by_the_stock_sampler
    inferred = infer_all(workspace, settings, sites)
    free = workspace.model.free
    result = AbcResult(
        sampler=settings.sampler,
        names=[parameter.name for parameter in free],
        units=[parameter.unit for parameter in free],
        meanings=[parameter.description for parameter in free],
        paper=bool(settings.paper),
        priors=settings.priors or "calibrated",
        population=max(one.particles.sizes["particle"] for one in inferred),
        interval=INTERVAL,
        sites={site.name: sampling.summarised(workspace, site, one) for site, one in zip(sites, inferred, strict=True)},
        inputs=inputs,
        ess=settings.ess,
        data=data,
    )
    files.write_table(workspace.out, result)
    commit(workspace, result, {name: one.particles for name, one in zip(arrays, inferred, strict=True)})
    return result


def _evaluation(workspace: Workspace, settings: Settings, site: str, members: tuple[Specimen, ...]) -> SiteEvaluation:
    protocols = None if settings.protocols == "all" else tuple(settings.protocols)
    cut = tuple(observed(specimen, protocols, tuple(settings.single_cycle)) for specimen in members)
    missing = [specimen.name for specimen in cut if not specimen.curves]
    if missing:
        raise BadInput(
            f"{workspace.study.path}: infer.protocols", f"no curve of {missing[0]} is among them", "protocols it has"
        )
    return SiteEvaluation(workspace.model, cut, workspace.simulator, workspace.study.store.points_per_curve, site)


def _prior(workspace: Workspace, settings: Settings, site: str, members: tuple[Specimen, ...]) -> Prior:
    free = workspace.model.free
    if settings.priors == "ranges":
        return of_ranges(free)
    path = CalibrateResult.path(workspace.out)
    calibration = CalibrateResult.read(workspace.out)
    if calibration is None:
        raise BadInput(path, "is not there", "`sinew calibrate` on this study first")
    calibration.refuse_other_ranges(path, free)
    found = calibration.specimens
    if settings.priors == "others":
        names = [one.name for one in workspace.specimens("all", "infer.priors") if (one.site or "all") != site]
        names = [name for name in names if name in found]
        if not names:
            where = f"{workspace.study.path}: infer.priors"
            raise BadInput(where, f"no specimen of a site other than {site} is calibrated", "ranges")
    else:
        names = [one.name for one in members]
        if missing := [name for name in names if name not in found]:
            raise BadInput(path, f"{missing[0]} is not calibrated", "`sinew calibrate` with this specimen")
    chosen = workspace.cohort.choose(names, str(path))
    refuse_other_data(workspace, path, calibration.data, chosen, "`sinew calibrate` again")
    with believed(path):
        values = np.array([found[name].values([p.name for p in free]) for name in names], dtype=float)
        return (of_others if settings.priors == "others" else calibrated)(free, values, settings.widening)
