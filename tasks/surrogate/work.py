"""How long emulators will take."""

from sinew.tasks.study.work import Given, Work
from sinew.tasks.surrogate.settings import Settings

TRAINED_S = 30.0  # of a specimen, with the usual number of runs


def work(given: Given, settings: Settings) -> Work:
    """Runs of each specimen, at most, and the training of its emulators."""
    specimens = given.specimens(settings.specimens)
    return Work({one.name: settings.runs for one in specimens}, here_s=TRAINED_S * len(specimens))
