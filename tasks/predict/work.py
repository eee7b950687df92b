"""How long predictions will take."""

from sinew.tasks.infer.settings import Settings as Infer
from sinew.tasks.infer.work import sites_of
from sinew.tasks.predict.settings import HDI, Settings
from sinew.tasks.study.work import Given, Work

BANDS_S = 0.25  # for each specimen, with its figure


def work(given: Given, settings: Settings) -> Work:
    """Evaluations of the draws for each specimen, and of the other specimens of its site or of new ones."""
    sites = sites_of(given)
    by_likelihood = given.study.section(Infer).chosen(quick=given.can.quick) == "likelihood"
    new = settings.of_new(quick=given.can.quick)
    rows = {
        one.name: HDI + settings.draws + (new if by_likelihood else len(members) - 1)
        for members in sites.values()
        for one in members
    }
    return Work(rows, here_s=BANDS_S * len(rows))
