"""How long elementary effects will take."""

from sinew.tasks.morris.settings import Settings
from sinew.tasks.study.work import Given, Work


def work(given: Given, settings: Settings) -> Work:
    """Evaluations of all trajectories."""
    rows = settings.trajectories * (len(given.model.free) + 1)
    return Work({one.name: rows for one in given.specimens(settings.specimens)}, here_s=0.3)
