"""How long the inference of all sites will take."""

from sinew.tasks.data.sites import by_site
from sinew.tasks.infer.settings import Settings
from sinew.tasks.model import Specimen
from sinew.tasks.study.work import Given, Work

PROPOSALS = 13  # for each particle, mean of the generations
PROPOSAL_S = 5e-4
START_S = 2.0  # pyABC is imported


def sites_of(given: Given) -> dict[str, tuple[Specimen, ...]]:
    """The specimens that the study infers, by site."""
    return by_site(given.specimens(given.study.section(Settings).specimens))


def work(given: Given, settings: Settings) -> Work:
    """Proposals for all particles of all generations, each of which is an evaluation of every specimen of a site."""
    sites = sites_of(given)
    proposals = settings.generations * settings.population * PROPOSALS
    rows = {one.name: proposals for members in sites.values() for one in members}
    return Work(rows, here_s=START_S + PROPOSAL_S * proposals * len(sites))
