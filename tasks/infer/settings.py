"""The section ``infer`` of a study."""

from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

from pydantic import Field, model_validator

from sinew.tasks.study.fields import Positive, Specimens, TaskSettings

if TYPE_CHECKING:
    from sinew.tasks.study.study import Study

Method = Literal["likelihood", "abc"]
OF_BOTH = {"method", "specimens", "protocols", "ess"}
PAPER: dict[str, Any] = {"population": 40, "generations": 8, "epsilon": 0.3, "smallest_acceptance": 0.005}
SOUND: dict[str, Any] = {"population": 1000, "generations": 20, "epsilon": None, "smallest_acceptance": 0.1}
OF_LIKELIHOOD = {"tails", "discrepancy", "rhat", "sweeps"}

ENOUGH_PARTICLES = 400  # of equal weight


class Settings(TaskSettings):
    """Posteriors of each site's parameters, by ``method``: ``likelihood`` or ``abc``.

    Without ``method``, it is ``abc`` where the study sets something of it, or has a simulator for which the likelihood
    is too expensive, else ``likelihood``.

    ``likelihood``: a hierarchical model of specimens and their population, whose ``tails`` are ``normal`` or ``heavy``
    (Student's t with 4 degrees of freedom). With ``discrepancy``, an error of the model is expected beside the noise,
    as large as the curves of a specimen show it. Chains go on, at most for ``sweeps``, until all effective sample sizes
    are ``ess`` and all R-hat below ``rhat``.

    ``abc``: ABC-SMC by site, with ``population`` particles in each of up to ``generations``. The first threshold is
    ``epsilon``, or the ``quantile`` of a sample of the prior; each next one is that quantile of the distances that were
    accepted, until it is below ``smallest_epsilon`` or fewer than ``smallest_acceptance`` of the proposals are
    accepted. Of protocols in ``single_cycle`` only the first load and unload is used. ``distance``: ``relative``, or
    pyABC's ``adaptive`` one (whose first threshold always comes from a sample of the prior).

    ``paper``: as in Pekedis (2025), with few particles, simulations without noise, and normal priors (mean of the same
    site's calibrated specimens, ``widening`` times their standard deviation) that leave the ranges. Otherwise noise is
    simulated, generations have so many particles that they are worth ``ess`` of equal weight, and ``priors`` are
    uniform over the ``ranges``, or normal within them from the calibrated specimens of all ``others`` sites. Without
    ``paper``, it is so for simulators that take time. ``pending``: proposals under way at a time. ``sampler``:
    ``store``, or for comparison pyABC's own on ``dask``, which stores no rows and cannot be resumed.
    """

    method: Method | None = None
    specimens: Specimens = "all"
    protocols: Literal["all"] | Annotated[list[str], Field(min_length=1)] = "all"
    tails: Literal["normal", "heavy"] = "normal"
    discrepancy: bool = True
    ess: Annotated[int, Field(ge=100, le=100_000)] | None = None
    rhat: Annotated[float, Field(gt=1.0, le=1.1)] = 1.05
    sweeps: Annotated[int, Field(ge=100, le=100_000)] = 10_000
    single_cycle: list[str] = Field(default_factory=lambda: ["cyclic"])
    paper: bool | None = None
    priors: Literal["ranges", "others"] | None = None
    population: Annotated[int, Field(ge=4, le=100_000)] | None = None
    generations: Annotated[int, Field(ge=1, le=1000)] | None = None
    epsilon: Positive | None = None
    quantile: Annotated[float, Field(gt=0, lt=1)] = 0.5
    smallest_epsilon: Annotated[float, Field(ge=0, allow_inf_nan=False)] = 0.0
    smallest_acceptance: Annotated[float, Field(gt=0, le=1)] | None = None
    widening: Annotated[float, Field(gt=0, le=100)] = 2.0
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
        if self.paper and (self.priors or self.ess):
            field = "priors" if self.priors else "ess"
            raise ValueError(f"{field} is not of the paper's mode; expected paper: false, or no {field}")
        return self

    def chosen(self, *, quick: bool) -> Method:
        """The method, given whether the simulator is the embedded one or another that takes next to no time."""
        if self.method is not None:
            return self.method
        given = self.model_fields_set - OF_BOTH
        if given & OF_LIKELIHOOD:
            return "likelihood"
        return "likelihood" if quick and not given else "abc"

    def by_likelihood(self) -> Self:
        """The same settings, with all that is left to the method filled in."""
        return self.model_copy(update={"ess": self.ess or 1000})

    def by_abc(self, *, quick: bool) -> Self:
        """The same settings, with all that is left to the mode filled in, but for a first threshold that is learned.

        ``quick`` as for :meth:`chosen`. Without ``paper``, studies that set ``priors`` or ``ess`` are not in its mode.
        """
        paper = self.paper if self.paper is not None else not (quick or self.priors or self.ess)
        rest = {name: value for name, value in (PAPER if paper else SOUND).items() if getattr(self, name) is None}
        if not paper:
            enough = 1 if self.population else ENOUGH_PARTICLES
            rest |= {"priors": self.priors or "ranges", "ess": self.ess or enough}
        return self.model_copy(update={"paper": paper, **rest})

    def of(self, method: Method) -> dict[str, Any]:
        """The settings that a method depends on."""
        others = OF_LIKELIHOOD | {"method"}
        if method == "abc":
            return self.model_dump(exclude=others)
        return self.model_dump(include=OF_LIKELIHOOD | {"specimens", "protocols", "ess"})


def needs(study: "Study") -> str | None:
    """What an inference takes up: priors of ABC may come from a calibration, a likelihood needs none."""
    quick, settings = study.simulator.name == "uniaxial", study.section(Settings)
    if settings.chosen(quick=quick) == "likelihood":
        return None
    return None if settings.by_abc(quick=quick).priors == "ranges" else "calibrate"
