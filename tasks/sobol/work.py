"""How long Sobol indices will take."""

from sinew.tasks.simulate.design import base_samples
from sinew.tasks.sobol.settings import Settings
from sinew.tasks.study.work import Given, Work

ANALYSIS_S = 1.2e-7  # for each row and kept point of a curve: indices along time with their bootstrap


def work(given: Given, settings: Settings) -> Work:
    """Evaluations of the whole design, and the analysis of each specimen's curves."""
    count = len(given.model.free)
    specimens = given.specimens(settings.specimens)
    base = settings.base_samples or base_samples(settings.points or 20_000, count, settings.second_order)
    rows = base * ((2 if settings.second_order else 1) * count + 2)
    kept = given.study.store.points_per_curve
    points = sum(
        size if kept == "all" else min(kept, size)
        for one in specimens
        for size in (curve.protocol.time_s.size for curve in one.curves)
    )
    courses = len(given.can.outputs) or 1
    return Work({one.name: rows for one in specimens}, here_s=ANALYSIS_S * rows * points * courses)
