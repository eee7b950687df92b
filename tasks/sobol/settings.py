"""The section ``sobol`` of a study."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from sinew.runner.errors import BadInput, shown
from sinew.tasks.simulate.block import block_of
from sinew.tasks.simulate.inputs import Inputs, Normal
from sinew.tasks.study.fields import Name, Positive, Specimens, TaskSettings
from sinew.tasks.study.files import read_json
from sinew.tasks.study.model import model_of
from sinew.tasks.study.settings_file import FieldError, Section

if TYPE_CHECKING:
    from sinew.tasks.model import Model
    from sinew.tasks.study.study import Study


MOST_RUNS, MOST_BASE_SAMPLES, MOST_SCRAMBLES = 10_000, 2**26, 64
OF_SALTELLI, OF_SURROGATE = {"points", "base_samples", "scrambles", "resamples"}, {"error", "runs"}
OF_SEVERAL = {"first"}


class NormalSettings(Section):
    """A normal distribution within the range of a parameter."""

    mean: Annotated[float, Field(allow_inf_nan=False)]
    sd: Positive


Correlation = Annotated[float, Field(gt=-1, lt=1)]


class Settings(TaskSettings):
    """A Saltelli design of ``base_samples`` x (free parameters + 2) rows, or of at least ``points`` rows.

    They come from ``scrambles`` independent scrambles of the Sobol sequence, whose scatter gives the intervals; with
    one, the intervals come from ``resamples`` of a bootstrap. ``groups``: parameters that move as one and have one
    index, by the group's name. ``distributions``: of parameters that are not uniform over their ranges, each normal
    with a ``mean`` and an ``sd``, cut off at the ends. ``correlations``: rank correlations of parameters that depend on
    each other (a Gaussian copula); Shapley effects come beside the indices then. ``specimens``: which to study, ``all``
    or names.
    ``output``: of which of a template's outputs the indices are (left out: of the objective where there is one).

    With ``method: surrogate``, indices are those of polynomials that are trained with plain rows: more and more of
    them, at most ``runs``, until no interval of the total and of each protocol is wider than ``error`` to either side.
    ``method: multifidelity`` is the same with the cheaper versions of the model that ``simulator.fidelities`` names;
    it begins with ``first`` runs of the model itself.
    """

    method: Literal["saltelli", "surrogate", "multifidelity"] = "saltelli"
    error: Annotated[float, Field(gt=0, lt=1)] = 0.02
    runs: Annotated[int, Field(ge=32, le=MOST_RUNS)] = 400
    first: Annotated[int, Field(ge=16, le=MOST_RUNS)] = 32
    points: Annotated[int, Field(ge=1, le=10**8)] | None = None
    base_samples: Annotated[int, Field(ge=2, le=MOST_BASE_SAMPLES)] | None = None
    specimens: Specimens = "all"
    output: str | None = None
    groups: dict[Name, Annotated[list[str], Field(min_length=1)]] = Field(default_factory=dict)
    distributions: dict[str, NormalSettings] = Field(default_factory=dict)
    correlations: dict[str, Annotated[dict[str, Correlation], Field(min_length=1)]] = Field(default_factory=dict)
    second_order: bool = False
    scrambles: Annotated[int, Field(ge=1, le=MOST_SCRAMBLES)] = 8
    resamples: Annotated[int, Field(ge=10, le=100_000)] = 200
    confidence: Annotated[float, Field(gt=0.5, lt=1)] = 0.95

    @model_validator(mode="after")
    def _of_one_method(self) -> Self:
        of_the_other = OF_SURROGATE if self.method == "saltelli" else OF_SALTELLI
        of_the_other = of_the_other if self.method == "multifidelity" else of_the_other | OF_SEVERAL
        if given := sorted(self.model_fields_set & of_the_other):
            raise FieldError(given[0], f"given with method: {self.method}", f"no {given[0]}, or the other method")
        if self.correlations and self.method != "saltelli":
            raise FieldError("correlations", f"given with method: {self.method}", "method: saltelli")
        if self.correlations and self.second_order:
            raise FieldError("second_order", "given beside correlations", "false: it is of independent parameters")
        return self

    @model_validator(mode="after")
    def _one_size(self) -> Self:
        if self.points is not None and self.base_samples is not None:
            raise FieldError("points", "given beside base_samples", "one of the two")
        if self.base_samples is not None and self.base_samples & (self.base_samples - 1):
            raise FieldError("base_samples", str(self.base_samples), "a power of two, as the Sobol sequence needs")
        if self.scrambles & (self.scrambles - 1):
            raise FieldError("scrambles", str(self.scrambles), "a power of two: 1, 4, 8, 16")
        return self

    def check_study(self, study: Study) -> None:
        if self.method == "multifidelity" and not study.simulator.cheaper:
            raise FieldError("method", "multifidelity", "simulator.fidelities, or method: surrogate")
        outputs = study.simulator.output_names
        if self.output is not None and self.output not in outputs:
            known = f"one of {', '.join(outputs)}" if outputs else "nothing; only templates have outputs"
            raise FieldError("output", f"no output {shown(self.output)}", known)
        if self.groups or self.distributions or self.correlations:
            self._check_inputs(model_of(study.model, study.simulator.law))

    def _check_inputs(self, model: Model) -> None:
        free = {parameter.name: parameter for parameter in model.free}
        seen: set[str] = set()
        for title, members in self.groups.items():
            for name in members:
                if name not in free:
                    raise FieldError(f"groups.{title}", shown(name), f"free parameters: {', '.join(free)}")
                if name in seen:
                    raise FieldError(f"groups.{title}", f"{shown(name)} is in a group twice", "one group for each")
                seen.add(name)
            if title in free and title not in members:
                raise FieldError("groups", f"{shown(title)} is a parameter", "another name for the group")
        for name, one in self.distributions.items():
            if name not in free:
                raise FieldError("distributions", shown(name), f"free parameters: {', '.join(free)}")
            low, high = free[name].minimum, free[name].maximum
            if not low - FAR * one.sd < one.mean < high + FAR * one.sd:
                expected = f"within {FAR:g} standard deviations of the range, {low:g} to {high:g}"
                raise FieldError(f"distributions.{name}.mean", f"{one.mean:g}", expected)
        self._check_correlations(list(free))

    def _check_correlations(self, free: list[str]) -> None:
        seen: set[frozenset[str]] = set()
        for one, others in self.correlations.items():
            for other in others:
                for name in (one, other):
                    if name not in free:
                        raise FieldError("correlations", shown(name), f"free parameters: {', '.join(free)}")
                pair = frozenset((one, other))
                if len(pair) < 2 or pair in seen:
                    problem = f"{shown(one)} with {shown(other)}" + (" twice" if pair in seen else "")
                    raise FieldError("correlations", problem, "each pair of different parameters once")
                seen.add(pair)
        if seen and np.linalg.eigvalsh(self.inputs.of_scores(free))[0] < SMALLEST:
            raise FieldError(
                "correlations", "contradict each other, or one parameter is nearly a function of others",
                "weaker ones: no parameter may follow from the others",
            )  # fmt: skip

    def block(self, parameters: int) -> int:
        """The rows of one base sample of so many parameters or groups of them."""
        return block_of(parameters, self.second_order, bool(self.correlations))

    def count(self, model: Model) -> int:
        """How many free parameters or groups of them a model has."""
        return len(self.inputs.factors([parameter.name for parameter in model.free]))

    @property
    def inputs(self) -> Inputs:
        """What is varied, and how."""
        normals = {name: Normal(one.mean, one.sd) for name, one in self.distributions.items()}
        return Inputs({title: tuple(members) for title, members in self.groups.items()}, normals, self.correlations)


DEFAULT = Settings(points=20_000)
SMALLEST = 1e-3  # eigenvalue of the correlations of scores
FAR = 4.0  # standard deviations: a mean farther from the range leaves hardly any of the distribution


def check(study: Study, out: Path, *, extend: bool = False) -> None:
    """Refuse a study with one free parameter or group, and ``extend`` where there is nothing to extend."""
    model = model_of(study.model, study.simulator.law)
    if len(model.free) < 2:
        raise BadInput(f"{study.path}: model.parameters", "one free parameter", "at least two for Sobol indices")
    if study.section(Settings).count(model) < 2:
        raise BadInput(
            f"{study.path}: sobol.groups", "one group of all parameters", "two groups or parameters at least"
        )
    if extend and (method := study.section(Settings).method) != "saltelli":
        raise BadInput("--extend", f"the method is {method}", "a smaller sobol.error, or more sobol.runs")
    last = read_json(out / "sobol.json") if extend else None
    if extend and last is None:
        raise BadInput(out / "sobol.json", "is not there", "a finished `sinew sobol` to extend")
    if isinstance(last, dict) and last.get("surrogate"):
        raise BadInput(out / "sobol.json", "is by surrogate", "a design of Saltelli's to extend: `sinew sobol` first")
