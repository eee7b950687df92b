"""Results of inferences for tests of the tasks that read them, made from numbers that are known."""

from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np
import xarray as xr

from sinew.tasks.infer.abc.result import AbcResult, Distance, Marginal, Posterior, particles_group
from sinew.tasks.study.workspace import Workspace


def posterior_of(
    specimens: list[str], names: Iterable[str], mean: Iterable[float], *, half_width: float = 0.1
) -> Posterior:
    """A posterior with the given means; intervals reach ``half_width`` of the mean to both sides."""
    marginals = {
        name: Marginal(
            value, 0.05 * abs(value), value + half_width * abs(value) * np.array([-1, 1]), value, abs(value), "normal"
        )
        for name, value in zip(names, mean, strict=True)
    }
    return Posterior(specimens, marginals, 30.0, np.array([0.5]), Distance(0.1), {}, [])


def write_inference(
    workspace: Workspace,
    names: list[str],
    sites: Mapping[str, Posterior],
    particles: Mapping[str, tuple[np.ndarray, np.ndarray]],
) -> AbcResult:
    """Leave what an inference leaves; ``particles`` holds values ``[g, n, d]`` and weights ``[g, n]`` by site.

    Posteriors get the means of their particles.
    """
    for site, (values, weight) in particles.items():
        dataset = xr.Dataset(
            {
                "parameters": (("generation", "particle", "parameter"), values),
                "weight": (("generation", "particle"), weight),
            },
            coords={"parameter": names},
        )
        workspace.store.write_result(particles_group(site), dataset)
    sites = {site: _with_means(one, *particles.get(site, ())) for site, one in sites.items()}
    units = {parameter.name: parameter.unit for parameter in workspace.model.parameters}
    texts = [units.get(name, "1") for name in names], [""] * len(names)
    result = AbcResult(
        "store",
        names,
        *texts,
        paper=True,
        priors="calibrated",
        population=40,
        interval=0.95,
        sites=sites,
        inputs="known",
    )
    result.write(workspace.out)
    return result


def _with_means(posterior: Posterior, *particles: np.ndarray) -> Posterior:
    """The posterior with the means of the last generation of ``particles`` (values and weights), if there are any."""
    if not particles or not (particles[1][-1] >= 0.0).all() or not np.isfinite(particles[0][-1]).all():
        return posterior
    means = particles[1][-1] @ particles[0][-1]
    marginals = {
        name: replace(one, mean=float(mean), hdi=one.hdi - one.mean + mean)
        for (name, one), mean in zip(posterior.parameters.items(), means, strict=True)
    }
    return replace(posterior, parameters=marginals)
