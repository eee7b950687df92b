"""How long PAWN indices will take."""

from sinew.tasks.pawn.settings import Settings
from sinew.tasks.sobol.settings import Settings as SobolSettings
from sinew.tasks.sobol.work import rows_of
from sinew.tasks.study.work import Given, Work

CUT_S = 2.4e-7  # for each row, resample and parameter


def work(given: Given, settings: Settings) -> Work:
    """Resampling of the independent rows of the Sobol study, for each outcome."""
    specimens = given.specimens(given.study.section(SobolSettings).specimens)
    free = len(given.model.free)
    of_saltelli = given.study.section(SobolSettings).method == "saltelli"
    rows = rows_of(given) * (2 / (free + 2) if of_saltelli else 1)
    return Work(here_s=CUT_S * rows * settings.resamples * free * given.outcomes(specimens))
