"""How long the comparison of sites will take."""

from math import comb

from sinew.tasks.compare.settings import Settings
from sinew.tasks.data.sites import by_site
from sinew.tasks.infer.settings import Settings as InferSettings
from sinew.tasks.study.work import Given, Work

FIT_S = 5e-4  # for each classifier


def work(given: Given, settings: Settings) -> Work:
    """A classifier for each fold, repeat and permutation of every pair of sites."""
    sites = by_site(given.specimens(given.study.section(InferSettings).specimens))
    fits = settings.folds * (settings.repeats + settings.permutations)
    return Work(here_s=FIT_S * fits * comb(len(sites), 2))
