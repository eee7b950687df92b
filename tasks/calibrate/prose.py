"""What a methods section says of this task, with the numbers of a result."""

from sinew.tasks.calibrate.result import CalibrateResult, Correlations
from sinew.tasks.calibrate.show import often_on_bound
from sinew.tasks.drawing.blocks import plural, span

METHODS = {
    "bayesian": "Bayesian optimisation of residuals with a Gaussian process [@jones, @astudillo]",
    "least_squares": "a Levenberg-Marquardt iteration from several starts [@marquardt]",
    "hybrid": "a Levenberg-Marquardt iteration that begins where Bayesian optimisation ended [@marquardt, @jones]",
}


def methods(result: CalibrateResult) -> str:
    """The paragraph of a methods section; ``[@key]`` cites."""
    totals = [fit.total for fit in result.specimens.values()]
    unit = "" if _compared(result) else " N"  # of several quantities, it is a sum of RMSEs over noise
    ways = " and ".join(METHODS[name] for name in result.methods)
    descends = {"least_squares", "hybrid"} & set(result.methods)
    limits = [f"up to {result.evaluations:,} evaluations of each specimen by every method"] if descends else []
    limits += [f"{result.bayesian_evaluations:,} in each Bayesian search"] if result.has_search else []
    cost = f" ({', '.join(limits)})" if limits else ""
    return (
        f"The {len(result.free)} free parameters of {plural(len(totals), 'specimen')} were fitted within their "
        f"ranges by {ways}{cost}. {_objective(result)} [@pekedis]. "
        f"At the best fits it is {span(totals)}{unit}.{_noise(result)}{_bounds(result)}"
        f"{_correlations(result)}"
    )


def _compared(result: CalibrateResult) -> list[str]:
    """The quantities that are compared, where there are several."""
    return sorted({name for fit in result.specimens.values() for name in fit.quantities or ()})


def _objective(result: CalibrateResult) -> str:
    if names := _compared(result):
        listed = ", ".join(name.replace("_", " ") for name in names)
        return (
            "The objective is the sum over protocols and measured quantities of the root mean square error over the "
            f"standard deviation of the noise of the quantity ({listed})"
        )
    return "The objective is the sum over protocols of the root mean square error of the force"


def _noise(result: CalibrateResult) -> str:
    floors = [fit.floor for fit in result.specimens.values() if fit.floor is not None]
    if not floors:
        return ""
    if _compared(result):
        return f" Noise alone would leave {span(floors)}."
    return (
        " The noise of the curves, estimated from the curves alone by restricted maximum likelihood [@patterson], is "
        f"{span(floors)} N by the same measure."
    )


def _bounds(result: CalibrateResult) -> str:
    told = often_on_bound(result)
    return f" {told}" if told else ""


def _correlations(result: CalibrateResult) -> str:
    found = result.correlations
    if not isinstance(found, Correlations):
        return ""
    return (
        f" Repeated-measures correlations [@bakdash] of {plural(found.tests, 'pair')} of parameters were "
        f"computed across "
        f"{plural(len(found.sites), 'site')} of {plural(len(found.donors), 'donor')}, with p values adjusted by "
        f"Holm's method."
    )
