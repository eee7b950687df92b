"""The section ``infer`` of a study."""

from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

from pydantic import Field, model_validator

from sinew.tasks.study.fields import Positive, Specimens, TaskSettings

if TYPE_CHECKING:
    from sinew.tasks.study.study import Study

Method = Literal["likelihood", "abc"]
OF_BOTH = {"method", "specimens", "protocols"}
OF_LIKELIHOOD = {"tails", "ess", "rhat", "sweeps"}


class Settings(TaskSettings):
    """Posteriors of each site's parameters, by ``method``: ``likelihood`` or ``abc``.

    Without ``method``, it is ``abc`` where the study sets something of it, or has a simulator for which the likelihood
    is too expensive, else ``likelihood``.

    ``likelihood``: a hierarchical model of specimens and their population, whose ``tails`` are ``normal`` or ``heavy``
    (Student's t with 4 degrees of freedom). Chains go on, at most for ``sweeps``, until all effective sample sizes are
    ``ess`` and all R-hat below ``rhat``.

    ``abc``: ABC-SMC by site, as in Pekedis (2025): ``population`` particles in each of up to ``generations``.
    The first threshold is ``epsilon``, each next one the ``quantile`` of the distances that were accepted, until it is
    below ``smallest_epsilon`` or fewer than ``smallest_acceptance`` of the proposals are accepted. Priors are normal:
    mean of the site's calibrated specimens and ``widening`` times their standard deviation. Of protocols in
    ``single_cycle`` only the first load and unload is used. ``distance``: ``relative``, or pyABC's ``adaptive`` one
    (whose first threshold comes from a sample of the prior). ``pending``: proposals under way at a time. ``sampler``:
    ``store``, or for comparison pyABC's own on ``dask``, which stores no rows and cannot be resumed.
    """

    method: Method | None = None
    specimens: Specimens = "all"
    protocols: Literal["all"] | Annotated[list[str], Field(min_length=1)] = "all"
    tails: Literal["normal", "heavy"] = "normal"
    ess: Annotated[int, Field(ge=100, le=100_000)] = 1000
    rhat: Annotated[float, Field(gt=1.0, le=1.1)] = 1.05
    sweeps: Annotated[int, Field(ge=100, le=100_000)] = 2000
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

    @model_validator(mode="after")
    def _one_method(self) -> Self:
        given = self.model_fields_set - OF_BOTH
        of_abc, of_likelihood = sorted(given - OF_LIKELIHOOD), sorted(given & OF_LIKELIHOOD)
        if of_abc and of_likelihood:
            raise ValueError(f"{of_likelihood[0]} is of the method likelihood, {of_abc[0]} of abc")
        if self.method == "likelihood" and of_abc:
            raise ValueError(f"{of_abc[0]} is of the method abc; method is likelihood")
        if self.method == "abc" and of_likelihood:
            raise ValueError(f"{of_likelihood[0]} is of the method likelihood; method is abc")
        return self

    def chosen(self, *, quick: bool) -> Method:
        """The method, given whether the simulator is the embedded one or another that takes next to no time."""
        if self.method is not None:
            return self.method
        given = self.model_fields_set - OF_BOTH
        if given & OF_LIKELIHOOD:
            return "likelihood"
        return "likelihood" if quick and not given else "abc"

    def of(self, method: Method) -> dict[str, Any]:
        """The settings that a method depends on."""
        others = OF_LIKELIHOOD | {"method"}
        if method == "abc":
            return self.model_dump(exclude=others)
        return self.model_dump(include=OF_LIKELIHOOD | {"specimens", "protocols"})


def needs(study: "Study") -> str | None:
    """What an inference takes up: priors of ABC come from the calibration, a likelihood needs none."""
    quick = study.simulator.name == "uniaxial"
    return "calibrate" if study.section(Settings).chosen(quick=quick) == "abc" else None
