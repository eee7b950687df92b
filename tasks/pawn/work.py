"""How long PAWN indices will take."""

from sinew.tasks.pawn.settings import Settings
from sinew.tasks.sobol.settings import Settings as SobolSettings
from sinew.tasks.sobol.work import work as of_sobol
from sinew.tasks.study.work import Given, Work

CUT_S = 2.4e-7  # for each row, resample and parameter


def work(given: Given, settings: Settings) -> Work:
    """Resampling of the independent rows of the Sobol study, for each outcome."""
    sobol = given.study.section(SobolSettings)
    specimens = given.specimens(sobol.specimens)
    free = len(given.model.free)
    rows = 2 * of_sobol(given, sobol).rows[specimens[0].name] / (free + 2)
    return Work(here_s=CUT_S * rows * settings.resamples * free * given.outcomes(specimens))
