"""How long random forests will take."""

import math

from sinew.runner.cluster.client import free_cores
from sinew.tasks.importance.method import TEST_SHARE
from sinew.tasks.importance.settings import Settings
from sinew.tasks.sobol.settings import Settings as SobolSettings
from sinew.tasks.sobol.work import rows_of
from sinew.tasks.study.work import Given, Work

GROW_S = 7e-8  # for each tree, row and parameter, and doubling of the rows
PREDICT_S = 2e-8  # for each tree and row


def work(given: Given, settings: Settings) -> Work:
    """Growing a forest for each outcome, and predicting by it with each parameter permuted."""
    specimens = given.specimens(given.study.section(SobolSettings).specimens)
    rows = min(settings.max_rows, rows_of(given))
    free, grown, tested = len(given.model.free), (1 - TEST_SHARE) * rows, TEST_SHARE * rows
    grow = GROW_S * settings.trees * grown * free * math.log2(1 + grown) / free_cores()
    permute = PREDICT_S * settings.trees * tested * free * settings.repeats
    return Work(here_s=(grow + permute) * given.outcomes(specimens))
