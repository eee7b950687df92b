"""The section ``infer`` of a study."""

from typing import Annotated, Literal

from pydantic import Field

from sinew.tasks.study.fields import Positive, Specimens, TaskSettings


class Settings(TaskSettings):
    """ABC-SMC by site: ``population`` particles in each of up to ``generations``.

    The first threshold is ``epsilon``, each next one the ``quantile`` of the distances that were accepted, until it is
    below ``smallest_epsilon`` or fewer than ``smallest_acceptance`` of the proposals are accepted. Priors are normal:
    mean of the site's calibrated specimens and ``widening`` times their standard deviation. Of protocols in
    ``single_cycle`` only the first load and unload is used. ``distance``: ``relative``, or pyABC's ``adaptive`` one
    (whose first threshold comes from a sample of the prior). ``pending``: proposals under way at a time. ``sampler``:
    ``store``, or for comparison pyABC's own on ``dask``, which stores no rows and cannot be resumed.
    """

    specimens: Specimens = "all"
    protocols: Literal["all"] | Annotated[list[str], Field(min_length=1)] = "all"
    single_cycle: list[str] = Field(default_factory=lambda: ["cyclic"])
    population: Annotated[int, Field(ge=4, le=100_000)] = 40
    generations: Annotated[int, Field(ge=1, le=1000)] = 8
    epsilon: Positive = 0.3
    quantile: Annotated[float, Field(gt=0, lt=1)] = 0.5
    smallest_epsilon: Annotated[float, Field(ge=0, allow_inf_nan=False)] = 0.0
    smallest_acceptance: Annotated[float, Field(gt=0, le=1)] = 0.005
    widening: Positive = 2.0
    distance: Literal["relative", "adaptive"] = "relative"
    sampler: Literal["store", "dask"] = "store"
    pending: Annotated[int, Field(ge=1, le=100_000)] = 64
