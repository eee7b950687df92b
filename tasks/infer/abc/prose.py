"""What a methods section says of this task, with the numbers of a result."""

from sinew.tasks.drawing.blocks import number, percent, plural
from sinew.tasks.infer.abc.result import AbcResult

PRIORS = {
    "calibrated": "normal priors around the calibrated parameters of the same specimens",
    "others": "normal priors around the calibrated parameters of the other sites' specimens, within the ranges",
    "ranges": "uniform priors over the ranges",
}


def _particles(result: AbcResult) -> str:
    noise = "without noise in simulations" if result.paper else "with noise in simulated forces as in measured ones"
    return f"up to {result.population:,} particles, {noise}"


def methods(result: AbcResult) -> str:
    """The paragraph of a methods section; ``[@key]`` cites."""
    sites = "; ".join(
        f"{site}: {plural(len(one.specimens), 'specimen')}, {plural(len(one.generations), 'generation')}, "
        f"{one.judged:,} proposals, last "
        f"threshold {number(one.epsilon[-1])}, effective sample size {number(one.effective_sample_size)}"
        for site, one in result.sites.items()
    )
    few = f" Few particles carry the posterior of {', '.join(result.few)}." if result.few else ""
    return (
        f"Posteriors of {len(result.names)} parameters were inferred for each site by ABC-SMC with pyABC "
        f"[@pyabc], with "
        f"{_particles(result)}, {PRIORS[result.priors]}, and a mixture of a normal "
        f"distribution and the prior as proposals [@hesterberg]. Intervals are highest density intervals of "
        f"{percent(result.interval)}. {sites}.{few}"
    )
