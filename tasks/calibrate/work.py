"""How long calibrations will take."""

from sinew.tasks.calibrate.method import most_evaluations
from sinew.tasks.calibrate.result import SEARCHES
from sinew.tasks.calibrate.settings import Settings
from sinew.tasks.study.work import Given, Work

PROPOSE_S = 0.075  # for each point of a Bayesian search: a Gaussian process is fitted and searched


def work(given: Given, settings: Settings) -> Work:
    """As many evaluations as each specimen may take, and the proposals of its Bayesian search."""
    specimens = given.specimens(settings.specimens)
    rows = most_evaluations(settings, len(given.model.free))
    proposed = settings.bayesian.evaluations if SEARCHES & set(settings.methods) else 0
    return Work({one.name: rows for one in specimens}, shared_s=PROPOSE_S * proposed * len(specimens))
