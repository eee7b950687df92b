"""What a methods section says of this task, with the numbers of a result."""

from sinew.tasks.drawing.blocks import number
from sinew.tasks.sobol.result import SHORT, SobolResult, Surrogate
from sinew.tasks.sobol.show import correlation_words


def methods(result: SobolResult) -> str:
    """The paragraph of a methods section; ``[@key]`` cites."""
    if result.surrogate is not None:
        return _by_surrogate(result, result.surrogate)
    kinds = "First order" if result.refuses else "First and total order"
    if result.correlations:
        return _of_dependent(result, kinds)
    failed = f" {result.failures.rule}." if result.failed else ""
    varied = "groups or parameters" if result.groups else "parameters"
    return (
        f"{kinds} Sobol indices of the {result.objective} were estimated for {len(result.names)} free {varied}"
        f"{_normal(result)} from a Saltelli design on scrambled Sobol sequences [@saltelli, @salib]: "
        f"{result.base_samples:,} base samples, {result.rows:,} rows, of which {result.failed:,} failed.{failed} "
        f"{_intervals(result)} {_largest(result)}"
    )


def _of_dependent(result: SobolResult, kinds: str) -> str:
    """The same for parameters that depend on each other."""
    shapley = "" if result.refuses else " and Shapley effects [@owen, @goda]"
    failed = f" {result.failures.rule}." if result.failed else ""
    return (
        f"{kinds} Sobol indices{shapley} of the {result.objective} were estimated for {len(result.names)} free "
        f"{'groups or parameters' if result.groups else 'parameters'}{_normal(result)} that depend on each other by a "
        f"Gaussian copula with rank correlations ({correlation_words(result)}), from conditional draws on scrambled "
        f"Sobol sequences [@kucherenko]: {result.base_samples:,} base samples, {result.rows:,} rows, of which "
        f"{result.failed:,} failed.{failed} {_intervals(result)} {_largest(result)}"
    )


def _by_surrogate(result: SobolResult, surrogate: Surrogate) -> str:
    """The same for indices of polynomials."""
    varied = "groups or parameters" if result.groups else "parameters"
    return (
        f"First and total order Sobol indices of the {result.objective} were taken from sparse polynomial chaos "
        f"[@sudret, @blatman] for {len(result.names)} free {varied}{_normal(result)}, trained with {result.rows:,} "
        f"rows on scrambled Sobol sequences, of which {result.failed:,} failed{_versions(surrogate)}; the polynomials "
        f"leave at most {number(100 * max(surrogate.unexplained.values()), 2)} % of an outcome's variance unexplained "
        f"(cross-validation). Intervals are Student's at {100 * result.confidence:g} %, from the jackknife of "
        f"{result.scrambles} independent scrambles, widened by the unexplained part{_failed(result)}; they are "
        f"{'within' if surrogate.reached else 'wider than'} ± {surrogate.error:g}. {_largest(result)}"
    )


def _versions(surrogate: Surrogate) -> str:
    """What cheaper versions of the model did."""
    each = [f"{one.runs:,} runs of a {name} version" for name, one in (surrogate.versions or {}).items()]
    return f", and with those of cheaper versions of the model [@fidelities] ({', '.join(each)})" if each else ""


def _failed(result: SobolResult) -> str:
    return " and by what failed rows might hide" if result.failed else ""


def _normal(result: SobolResult) -> str:
    """Which parameters are not uniform."""
    found = (result.distributions or {}).items()
    each = [f"{name} {number(one['mean'])} ± {number(one['sd'])}" for name, one in found]
    return f" ({', '.join(each)}: normal within the range; all others uniform)" if each else ""


def _intervals(result: SobolResult) -> str:
    level = f"{100 * result.confidence:g} %"
    if result.scrambles == 1:
        return f"Intervals are bootstrap intervals at {level}."
    return f"Intervals are Student's at {level}, from the jackknife of {result.scrambles} independent scrambles."


def _largest(result: SobolResult) -> str:
    values, conf = (getattr(result, key) for key in (result.leading, f"{result.leading}_conf"))
    said = [f"{result.names[j]} {number(values[j])} ± {number(conf[j], 2)}" for j in result.largest()]
    return f"Largest {SHORT[result.leading]}: {', '.join(said)}." if said else "No index is defined, as nothing varied."
