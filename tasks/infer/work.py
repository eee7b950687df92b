"""How long the inference of all sites will take."""

from collections.abc import Sequence

from sinew.tasks.data.sites import by_site
from sinew.tasks.infer.likelihood.effort import most_rows
from sinew.tasks.infer.settings import Settings
from sinew.tasks.model import Specimen
from sinew.tasks.study.work import Given, Work

PROPOSALS = 13  # for each particle, mean of the generations
PROPOSAL_S = 2.5e-4
USUAL = 0.5  # of the generations that a study allows: most inferences stop before
START_S = 2.0  # pyABC is imported
DRAWS = 200  # that a slow simulator computes to check the emulators of a likelihood
NOISE_S = 0.8  # of a likelihood, for each specimen
EXPLORED_S, EXPLORED_POINT_S = 5.6, 8.7e-4  # for each specimen, and for each of its measured points
SWEEP_S, SWEEP_POINT_S = 0.021, 5.3e-7  # the same, of a sweep
SWEEPS, SWEEPS_ALONE = 200, 1800  # of an ensemble: at least, and of a site with one specimen; with more, they are fewer
USUAL_ESS = 1000  # that they lead to


def sites_of(given: Given) -> dict[str, tuple[Specimen, ...]]:
    """The specimens that the study infers, by site."""
    return by_site(given.specimens(given.study.section(Settings).specimens))


def _chains_s(members: Sequence[Specimen], settings: Settings) -> float:
    """How long (s) it takes to explore the specimens of a site and to sweep two ensembles of chains."""
    every, chosen = settings.protocols == "all", settings.protocols
    curves = [curve for one in members for curve in one.curves if every or curve.name in chosen]
    points = sum(curve.force_N.size for curve in curves)
    explored = EXPLORED_S * len(members) + EXPLORED_POINT_S * points
    sweep = SWEEP_S * len(members) + SWEEP_POINT_S * points
    sweeps = max(SWEEPS, SWEEPS_ALONE / len(members)) * (settings.ess or USUAL_ESS) / USUAL_ESS
    return explored + 2 * min(sweeps, settings.sweeps) * sweep


def work(given: Given, settings: Settings) -> Work:
    """By ABC, proposals for all particles, each of which is an evaluation of every specimen of a site.

    By likelihood, all specimens are explored, and chains run on emulators: rows of the store are only those of a
    simulator that takes time.
    """
    sites = sites_of(given)
    if settings.chosen(quick=given.can.quick) == "likelihood":
        names = [one.name for members in sites.values() for one in members]
        rows = (
            {}
            if given.can.quick
            else dict.fromkeys(names, most_rows(len(given.model.free), discrepancy=settings.discrepancy) + DRAWS)
        )
        chains_s = sum(_chains_s(members, settings.by_likelihood()) for members in sites.values())
        return Work(rows, here_s=NOISE_S * len(names), shared_s=chains_s)
    filled = settings.by_abc(quick=given.can.quick)
    assert filled.population is not None and filled.generations is not None, "they are filled in"
    proposals = max(1, round(USUAL * filled.generations)) * filled.population * PROPOSALS
    rows = {one.name: proposals for members in sites.values() for one in members}
    return Work(rows, here_s=START_S + PROPOSAL_S * proposals * len(sites))
