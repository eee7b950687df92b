"""How long Sobol indices will take."""

from sinew.tasks.simulate.block import base_samples
from sinew.tasks.sobol.settings import Settings
from sinew.tasks.study.work import Given, Work, points_kept

FIT_S, FITS_EACH = 0.1, 4  # of polynomials, and how often they are fitted anew as rows are added
FIT_OF_VERSIONS_S = 2.0  # of those of cheaper versions, which have many rows
ANALYSIS_S = 1.2e-7  # for each row and kept point of a curve: indices along time with their bootstrap


def base_of(settings: Settings, parameters: int) -> int:
    """The base samples that a study asks for, with so many free parameters or groups of them."""
    return settings.base_samples or base_samples(settings.points or 20_000, settings.block(parameters))


def rows_of(given: Given) -> int:
    """The rows of the study's design, each of which every specimen evaluates."""
    settings = given.study.section(Settings)
    if settings.method != "saltelli":
        return settings.runs
    parameters = settings.count(given.model)
    return base_of(settings, parameters) * settings.block(parameters)


def _coarse_rows(given: Given, settings: Settings) -> int:
    """Runs of a coarse version for each of the model."""
    simulator = given.study.simulator
    used = settings.method == "multifidelity" and "coarse" in simulator.cheaper
    return simulator.coarse_rows if used else 0


def work(given: Given, settings: Settings) -> Work:
    """Evaluations of the whole design, and the analysis of each specimen's curves."""
    specimens = given.specimens(settings.specimens)
    rows = rows_of(given)
    points = sum(points_kept(one, given.study.store.points_per_curve) for one in specimens)
    courses = len(given.can.outputs) or 1
    if settings.method != "saltelli":
        outcomes = courses + len(given.specimens(settings.specimens))
        of_versions = FIT_OF_VERSIONS_S * 2 * outcomes if settings.method == "multifidelity" else 0.0
        rows *= 1 + _coarse_rows(given, settings)  # at most: they take less time
        return Work({one.name: rows for one in specimens}, here_s=FIT_S * 9 * outcomes * FITS_EACH + of_versions)
    return Work({one.name: rows for one in specimens}, here_s=ANALYSIS_S * rows * points * courses)
