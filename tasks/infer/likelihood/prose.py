"""What a methods section says of this task, with the numbers of a result."""

from sinew.tasks.drawing.blocks import percent, plural
from sinew.tasks.infer.likelihood.result import LikelihoodResult
from sinew.tasks.infer.likelihood.show import runs_of_each


def methods(result: LikelihoodResult) -> str:
    """The paragraph of a methods section; ``[@key]`` cites."""
    sites = "; ".join(
        f"{site}: {plural(len(one.specimens), 'specimen')}, {one.sweeps:,} sweeps, smallest effective sample size "
        f"{one.smallest_ess:,.0f}, largest R-hat {one.largest_rhat:.3f}"
        for site, one in result.sites.items()
    )
    tails = "normal" if result.tails == "normal" else "Student's t (4 degrees of freedom)"
    blind = f" No curve depends on {', '.join(result.blind)}." if result.blind else ""
    wrong = (
        " An error of the model was expected beside the noise [@kennedy]: a smooth part, sums of splines over the "
        "phases of a test, and a rough part, a first-order process along each curve, each as large as had the most "
        "evidence in a specimen."
        if result.discrepancy
        else ""
    )
    runs = {name: one for site in result.sites.values() for name, one in site.runs.items()}
    emulated = (
        "a walk by Hamiltonian Monte Carlo on an emulator that is accepted or refused by the model itself [@liu]"
        if not runs
        else f"walks by Hamiltonian Monte Carlo on emulators of each specimen's errors, for which the simulator was "
        f"run {runs_of_each(result)} times for each specimen; draws were checked by the simulator, and weighted where "
        f"posterior means could have been off by more than a tenth of a standard deviation [@vihola]"
    )
    of = f" (the force, {', '.join(result.compared)})" if result.compared else ""
    return (
        f"Posteriors of {len(result.names)} parameters were inferred by a hierarchical model: the curves of each "
        f"specimen{of} have a Gaussian likelihood with autoregressive noise as estimated from the curves, and the "
        f"scores of the parameters within their ranges are {tails} distributed in each site's population, with half-t "
        f"priors of the spreads and uniform ones of the correlations [@huang]. {result.chains} chains were run by "
        f"Gibbs sampling, with specimens moved by {emulated}; convergence was judged with ArviZ [@vehtari]. Intervals "
        f"hold {percent(result.interval)}.{wrong} {sites}.{blind}"
    )
