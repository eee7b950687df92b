"""How long the comparison of sites will take."""

from math import comb

from sinew.tasks.compare.settings import Settings
from sinew.tasks.infer.work import sites_of
from sinew.tasks.study.work import Given, Work

FIT_S = 5e-4  # for each classifier


def work(given: Given, settings: Settings) -> Work:
    """A classifier for each fold, repeat and permutation of every pair of sites."""
    sites = sites_of(given)
    fits = settings.folds * (settings.repeats + settings.permutations)
    return Work(here_s=FIT_S * fits * comb(len(sites), 2))
