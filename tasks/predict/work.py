"""How long predictions will take."""

from sinew.tasks.infer.work import sites_of
from sinew.tasks.predict.settings import Settings
from sinew.tasks.study.work import Given, Work

HDI = 3  # rows: a posterior's mean and both ends of its interval
BANDS_S = 0.25  # for each specimen, with its figure


def work(given: Given, settings: Settings) -> Work:
    """Evaluations of the draws for each specimen, and of the other specimens of its site."""
    sites = sites_of(given)
    rows = {one.name: HDI + settings.draws + len(members) - 1 for members in sites.values() for one in members}
    return Work(rows, here_s=BANDS_S * len(rows))
