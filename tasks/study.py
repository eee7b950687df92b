"""The study file: one YAML file, validated into frozen objects. Every mistake names the file, line and field."""

import shutil
from collections import Counter
from collections.abc import Iterable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import AfterValidator, Field, PrivateAttr, field_validator, model_validator

from runner.cluster import Address, ClusterSpec, Local, free_cores
from tasks.measurements import NAME, Cohort, read_cohort
from tasks.model import TENDON, Curve, Model, Parameter, Protocol, Specimen
from tasks.model.effect import Effect
from tasks.model.effects import library, named
from tasks.model.parameters import own_parameter
from tasks.problems import BadInput, shown
from tasks.settings import FieldError, Section, by_name, read_settings
from tasks.simulate import Simulator
from tasks.simulate.attempt import solver_version
from tasks.simulate.febio import FEBio, read_template
from tasks.simulate.febio_effects import febio_with
from tasks.simulate.template import TAKEN, Template, check_template, read_files
from tasks.simulator_settings import IDENTIFIER, FEBioSettings, Finite, TemplateSettings, UniaxialSettings
from tasks.task import Task

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,63}$")]

#: Whose results a task takes up.
NEEDS = {"importance": "sobol", "infer": "calibrate", "predict": "infer", "compare": "infer"}


def _once(value: Any) -> Any:
    if isinstance(value, list) and len(set(value)) < len(value):
        name = next(name for i, name in enumerate(value) if name in value[:i])
        raise ValueError(f"{shown(name)} is a duplicate; expected each specimen once")
    return value


Specimens = Annotated[Literal["all"] | Annotated[list[str], Field(min_length=1)], AfterValidator(_once)]


class SolverMissing(BadInput):
    """The solver is not on this machine."""


class ParameterSettings(Section):
    """Bounds of a parameter, or one ``fixed`` value; ``unit`` guards against a slip of units."""

    min: Annotated[float, Field(allow_inf_nan=False)] | None = None
    max: Annotated[float, Field(allow_inf_nan=False)] | None = None
    reference: Annotated[float, Field(allow_inf_nan=False)] | None = None
    fixed: Annotated[float, Field(allow_inf_nan=False)] | None = None
    unit: str | None = None

    def apply(self, parameter: Parameter) -> Parameter:
        """The parameter with these settings. Raises ``ValueError`` with the field that is wrong."""
        if self.unit is not None and self.unit != parameter.unit:
            raise FieldError("unit", shown(self.unit), f"{parameter.unit!r}, the unit of {parameter.name}")
        if self.fixed is not None:
            if self.min is not None or self.max is not None or self.reference is not None:
                raise FieldError("fixed", "given beside min, max or reference", "either fixed, or min and max")
            low = high = reference = self.fixed
        else:
            low = parameter.minimum if self.min is None else self.min
            high = parameter.maximum if self.max is None else self.max
            if low >= high:
                raise FieldError("max", f"{high:g} is not above min {low:g}", "min below max (or use fixed)")
            middle = parameter.reference if low <= parameter.reference <= high else (low + high) / 2
            reference = middle if self.reference is None else self.reference
            if not low <= reference <= high:
                raise FieldError("reference", f"{reference:g}", f"a value from {low:g} to {high:g}")
        for field, value in (("fixed" if self.fixed is not None else "min", low), ("max", high)):
            # a range may touch the edge of what is possible, its inside is what is studied
            if not parameter.possible(value) and (low == high or value < parameter.floor or value >= parameter.ceiling):
                raise FieldError(field, f"{value:g}", parameter.limits)
        return replace(parameter, minimum=low, maximum=high, reference=reference)

    def own(self, name: str) -> Parameter:
        """A parameter of a template, which has no published range. Raises :class:`FieldError`."""
        low, high = (self.min, self.max) if self.fixed is None else (self.fixed, self.fixed)
        if low is None or high is None:
            field = "min" if low is None else "max"
            raise FieldError(field, "missing", "min and max (or fixed), as nothing is known of this parameter")
        return self.apply(own_parameter(name, self.unit or "1", low, high))


class ModelSettings(Section):
    """The tissue model: what the study says differs from the published ranges, and ``effects`` it has besides."""

    parameters: dict[str, ParameterSettings] = Field(default_factory=dict)
    beta: Annotated[float, Field(ge=2, le=10, allow_inf_nan=False)] = 2.0
    lambda_0: Annotated[float, Field(gt=1, le=2, allow_inf_nan=False)] = 1.01
    effects: list[str] = Field(default_factory=list)


class HistorySettings(Section):
    """A displacement history by its corners, at ``points`` times evenly spread, and at the corners themselves."""

    time_s: Annotated[list[Finite], Field(min_length=2, max_length=10_000)]
    displacement_mm: Annotated[list[Finite], Field(min_length=2, max_length=10_000)]
    points: Annotated[int, Field(ge=3, le=1_000_000)] = 101

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if len(self.time_s) != len(self.displacement_mm):
            problem = f"{len(self.displacement_mm)} numbers beside {len(self.time_s)} of time_s"
            raise FieldError("displacement_mm", problem, "one displacement for each time")
        if any(later <= earlier for earlier, later in pairwise(self.time_s)):
            raise FieldError("time_s", "times do not increase", "increasing times")
        return self

    def curve(self, name: str) -> Curve:
        """Along it, nothing was measured."""
        times = np.union1d(np.linspace(self.time_s[0], self.time_s[-1], self.points), self.time_s)
        moved = np.interp(times, self.time_s, self.displacement_mm)
        return Curve(Protocol(name, times, moved), np.full(times.size, np.nan))


class SpecimenSettings(Section):
    """The size of the specimen of a study without measured curves."""

    length_mm: Positive
    width_mm: Positive
    thickness_mm: Positive


class LocalSettings(Section):
    name: Literal["local"] = "local"
    workers: Annotated[int, Field(ge=1, le=1024)] | None = None
    tls: bool = True


class AddressSettings(Section):
    name: Literal["address"] = "address"
    address: Annotated[str, Field(pattern=r"^(tls|tcp)://[A-Za-z0-9_.:\[\]-]+:\d+$")]


class SlurmSettings(Section):
    """Worker jobs under SLURM; what to ask of it is said by the profile that the command names, never by a study."""

    name: Literal["slurm"] = "slurm"


class SobolSettings(Section):
    """A Saltelli design of ``base_samples`` x (free parameters + 2) rows, or of at least ``points`` rows.

    ``specimens``: which to study, ``all`` or names. ``resamples``: bootstrap resamples behind the intervals.
    ``output``: of which of a template's outputs the indices are (left out: of the objective where there is one).
    """

    points: Annotated[int, Field(ge=1, le=10**8)] | None = None
    base_samples: Annotated[int, Field(ge=2, le=2**26)] | None = None
    specimens: Specimens = "all"
    output: str | None = None
    second_order: bool = False
    resamples: Annotated[int, Field(ge=10, le=100_000)] = 200
    confidence: Annotated[float, Field(gt=0.5, lt=1)] = 0.95

    @model_validator(mode="after")
    def _one_size(self) -> Self:
        if self.points is not None and self.base_samples is not None:
            raise FieldError("points", "given beside base_samples", "one of the two")
        if self.base_samples is not None and self.base_samples & (self.base_samples - 1):
            raise FieldError("base_samples", str(self.base_samples), "a power of two, as the Sobol sequence needs")
        return self


class ImportanceSettings(Section):
    """Random forests on the rows of the Sobol study."""

    trees: Annotated[int, Field(ge=10, le=10_000)] = 100
    repeats: Annotated[int, Field(ge=2, le=1000)] = 10
    max_rows: Annotated[int, Field(ge=100)] = 10_000


class BayesianSettings(Section):
    """Bayesian optimisation: ``evaluations``, of which ``initial`` are random; ``pending`` are under way at a time.

    ``seeds``: how many evaluations that the store has already inform the surrogate from the start.
    """

    evaluations: Annotated[int, Field(ge=2, le=1000)] = 100
    initial: Annotated[int, Field(ge=1, le=1000)] = 10
    pending: Annotated[int, Field(ge=1, le=100)] = 1
    seeds: Annotated[int, Field(ge=0, le=1000)] = 40


class CalibrateSettings(Section):
    """``methods``, each with ``evaluations`` for each specimen; least squares uses them from up to ``starts`` points.

    ``hybrid`` polishes the best points of the Bayesian optimisation, whose evaluations count as its own.
    """

    specimens: Specimens = "all"
    methods: Annotated[list[Literal["bayesian", "hybrid", "least_squares"]], Field(min_length=1)] = Field(
        default_factory=lambda: ["bayesian", "hybrid"]  # type: ignore[arg-type]
    )
    starts: Annotated[int, Field(ge=1, le=1000)] = 5
    evaluations: Annotated[int, Field(ge=10, le=10**6)] = 600
    bayesian: BayesianSettings = BayesianSettings()


class InferSettings(Section):
    """ABC-SMC by site: ``population`` particles in each of up to ``generations``.

    The first threshold is ``epsilon``, each next one the ``quantile`` of the distances that were accepted, until it is
    below ``smallest_epsilon`` or fewer than ``smallest_acceptance`` of the proposals are accepted. Priors are normal:
    mean of the site's calibrated specimens and ``widening`` times their standard deviation. Of protocols in
    ``single_cycle`` the first load and unload is looked at. ``distance``: ``relative``, or pyABC's ``adaptive`` one
    (whose first threshold comes from a sample of the prior). ``pending``: proposals under way at the most. ``sampler``:
    ``store``, or for comparison pyABC's own on ``dask``, which stores no rows and cannot go on after an interruption.
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


class PredictSettings(Section):
    """Bands that hold ``probability`` of ``draws`` from the posterior, and of specimens that are still to come."""

    draws: Annotated[int, Field(ge=2, le=10_000)] = 40
    probability: Annotated[float, Field(gt=0.5, lt=1)] = 0.95


class CompareSettings(Section):
    """``confidence`` of all intervals; the classifier of all parameters is judged by cross-validation.

    That has ``folds``, is repeated ``repeats`` times over other ones, and set against ``permutations`` of the sites.
    """

    confidence: Annotated[float, Field(gt=0.5, lt=1)] = 0.95
    folds: Annotated[int, Field(ge=2, le=100)] = 5
    repeats: Annotated[int, Field(ge=1, le=1000)] = 5
    permutations: Annotated[int, Field(ge=20, le=100_000)] = 200


class DiscoverSettings(Section):
    """Which ``effects`` of the library are candidates, and from how many ``starts`` the model without them is fitted.

    ``chance``: how often some cell of the whole cohort may look wrong where nothing is.
    """

    specimens: Specimens = "all"
    effects: Literal["all"] | Annotated[list[str], Field(min_length=1)] = "all"
    starts: Annotated[int, Field(ge=1, le=100)] = 4
    chance: Annotated[float, Field(gt=0, lt=0.5)] = 0.05

    @field_validator("effects")
    @classmethod
    def _known(cls, value: list[str] | str) -> list[str] | str:
        if isinstance(value, list) and (unknown := [slug for slug in value if slug not in library()]):
            raise ValueError(f"{shown(unknown[0])} is no effect; expected some of {', '.join(library())}")
        return value


class StoreSettings(Section):
    """``points_per_curve``: how many points of each simulated curve are kept (``all``: every measured point)."""

    points_per_curve: Literal["all"] | Annotated[int, Field(ge=2, le=10**6)] = 96


class Study(Section):
    """A validated study. Build it by :func:`read_study`."""

    name: Name
    cohort: str | None = None
    protocols: dict[str, HistorySettings] | None = None
    specimen: SpecimenSettings | None = None
    seed: Annotated[int, Field(ge=0, lt=2**32)] = 0
    model: ModelSettings = ModelSettings()
    simulator: UniaxialSettings | FEBioSettings | TemplateSettings = Field(
        default=UniaxialSettings(), discriminator="name"
    )
    cluster: LocalSettings | AddressSettings | SlurmSettings = Field(default=LocalSettings(), discriminator="name")
    store: StoreSettings = StoreSettings()
    retries: Annotated[int, Field(ge=0, le=20)] = 1
    tasks: Annotated[list[Task], Field(min_length=1)] = Field(
        default_factory=lambda: ["sobol", "importance"]  # type: ignore[arg-type]
    )
    sobol: SobolSettings = SobolSettings(points=20_000)
    importance: ImportanceSettings = ImportanceSettings()
    calibrate: CalibrateSettings = CalibrateSettings()
    infer: InferSettings = InferSettings()
    predict: PredictSettings = PredictSettings()
    compare: CompareSettings = CompareSettings()
    discover: DiscoverSettings = DiscoverSettings()

    _path: Path = PrivateAttr(default=Path())

    @field_validator("simulator", "cluster", mode="before")
    @classmethod
    def _by_name(cls, value: Any) -> Any:
        return by_name(value)

    @field_validator("tasks")
    @classmethod
    def _tasks_once(cls, value: list[str]) -> list[str]:
        for task in value:
            if value.count(task) > 1:
                raise ValueError(f"{task} is a duplicate; expected each task once")
        for task, before in NEEDS.items():
            if task in value and before in value and value.index(task) < value.index(before):
                raise ValueError(f"{task} before {before}, whose results it uses; expected {before} first")
        return value

    @model_validator(mode="after")
    def _known_parameters(self) -> Self:
        self.tendon()
        return self

    @model_validator(mode="after")
    def _own_protocols(self) -> Self:
        if self.protocols is not None:
            if not isinstance(self.simulator, TemplateSettings):
                raise FieldError("protocols", "with the tissue model", "a cohort; only templates can do without one")
            if self.cohort is not None:
                raise FieldError("protocols", "given beside cohort", "one of the two")
            for name in self.protocols:
                if not NAME.fullmatch(name):
                    raise FieldError(f"protocols.{name}", "cannot be a name", "letters, digits, '_', '-' and '.'")
            if not self.protocols:
                raise FieldError("protocols", "none", "at least one")
        if self.specimen is not None and self.protocols is None:
            raise FieldError("specimen", "given without protocols", "the size in each specimen.json of the cohort")
        outputs = self.simulator.outputs if isinstance(self.simulator, TemplateSettings) else {}
        if self.sobol.output is not None and self.sobol.output not in outputs:
            known = f"one of {', '.join(outputs)}" if outputs else "nothing; only templates have outputs"
            raise FieldError("sobol.output", f"no output {shown(self.sobol.output)}", known)
        return self

    @property
    def path(self) -> Path:
        return self._path

    @property
    def templated(self) -> bool:
        """Whether the model is a user's own template instead of the tissue."""
        return isinstance(self.simulator, TemplateSettings)

    @property
    def force(self) -> str | None:
        """The output of a template that is the force."""
        return self.simulator.force if isinstance(self.simulator, TemplateSettings) else None

    @property
    def cohort_path(self) -> Path:
        """The cohort's folder; relative paths start at the study file."""
        if self.cohort is None:
            raise BadInput(f"{self.path}: cohort", "missing", "a cohort folder, here or by --data")
        return self.path.parent / self.cohort

    def cohort_of(self, data: Path | None = None) -> Cohort:
        """The specimens: those in ``data`` or else in the study's cohort, or one that is pulled by its protocols."""
        if data is not None or self.protocols is None:
            cohort = read_cohort(data or self.cohort_path)
        else:
            one = self.specimen
            size = (one.length_mm, one.width_mm, one.thickness_mm) if one is not None else (np.nan,) * 3
            curves = tuple(history.curve(name) for name, history in self.protocols.items())
            cohort = Cohort(self.path, (Specimen(self.name, *size, curves),))
        if isinstance(self.simulator, TemplateSettings):
            self._check_names(self.simulator.outputs, cohort)
        return cohort

    def _check_names(self, outputs: Iterable[str], cohort: Cohort) -> None:
        """Raises :class:`BadInput` when two arrays of the store, or two lines of a table, would have one name."""
        for specimen in cohort.specimens:
            protocols = [curve.name for curve in specimen.curves]
            names = ["total", *outputs, *protocols, *(f"summary_{name}" for name in outputs)]
            for kind in ("time", "displacement", "measured", "conf", *outputs, *(f"conf_{name}" for name in outputs)):
                names += [f"{kind}_{protocol}" for protocol in protocols]
            if twice := [name for name, count in Counter(names).items() if count > 1]:
                problem = f"two things are called {twice[0]} in the store"
                raise BadInput(f"{self.path}: simulator.outputs", problem, "other names of outputs or protocols")

    def tendon(self) -> Model:
        """The model with this study's bounds: the tissue, or the parameters of a template."""
        if isinstance(self.simulator, TemplateSettings):
            return self._own_model()
        added = [parameter for effect in self.effects() for parameter in effect.parameters]
        known = {parameter.name: parameter for parameter in (*TENDON, *added)}
        for name in self.model.parameters:
            if name not in known:
                raise FieldError(f"model.parameters.{name}", "unknown parameter", f"one of {', '.join(known)}")
        parameters = []
        for name, parameter in known.items():
            try:
                settings = self.model.parameters.get(name, ParameterSettings())
                parameters.append(settings.apply(parameter))
            except FieldError as error:
                raise FieldError(f"model.parameters.{name}.{error.field}", error.problem, error.expected) from None
        model = Model(tuple(parameters), self.model.beta, self.model.lambda_0)
        if not model.free:
            raise FieldError("model.parameters", "every parameter is fixed", "at least one with min and max")
        return model

    def _own_model(self) -> Model:
        for field in ("beta", "lambda_0", "effects"):
            if field in self.model.model_fields_set:
                expected = "it in the template: it is a part of sinew's own tissue"
                raise FieldError(f"model.{field}", "with a template", expected)
        parameters = []
        for name, settings in self.model.parameters.items():
            if not IDENTIFIER.fullmatch(name) or name in TAKEN:
                problem = "is taken by the template language" if name in TAKEN else "cannot be a name"
                expected = "another name: letters, digits and '_', beginning with a letter"
                raise FieldError(f"model.parameters.{name}", problem, expected)
            try:
                parameters.append(settings.own(name))
            except FieldError as error:
                raise FieldError(f"model.parameters.{name}.{error.field}", error.problem, error.expected) from None
        model = Model(tuple(parameters), law="template")
        if not model.free:
            raise FieldError("model.parameters", "no parameter with min and max", "at least one")
        return model

    def effects(self) -> tuple[Effect, ...]:
        """The effects that the model has besides the baseline, as the study orders them."""
        known = named()
        for name in self.model.effects:
            if name not in known:
                raise FieldError("model.effects", f"no effect {shown(name)}", f"one of {', '.join(known)}")
        chosen = tuple(known[name] for name in self.model.effects)
        slugs = [effect.slug for effect in chosen]
        for i, slug in enumerate(slugs):
            if slug in slugs[:i]:
                raise FieldError("model.effects", f"{slug} is a duplicate", "each effect once")
        return chosen

    def cluster_spec(self, workers: int | None = None) -> ClusterSpec:
        """Where evaluations run; ``workers`` overrides the number of local workers."""
        if isinstance(self.cluster, AddressSettings):
            return Address(self.cluster.address)
        if isinstance(self.cluster, SlurmSettings):
            problem, expected = "slurm without a profile", "`sinew submit STUDY --profile PROFILE.yaml`"
            raise BadInput(f"{self.path}: cluster", problem, expected)
        return Local(workers or self.cluster.workers or free_cores(), self.cluster.tls)

    def simulator_object(self, name: str | None, scratch: Path) -> Simulator:
        """The simulator, or the one called ``name``; FEBio's attempts live below ``scratch``.

        Raises :class:`BadInput` when the solver or its template cannot be found.
        """
        from tasks.simulate.effects import UniaxialWith
        from tasks.simulate.uniaxial import Uniaxial

        settings = self.simulator
        if isinstance(settings, TemplateSettings):
            if name not in (None, "template"):
                raise BadInput("--simulator", f"{name} cannot run a study with a template", "no --simulator")
            template = self.template(settings, scratch)
            found = self._found(settings.executable)
            return replace(template, executable=str(found), version=solver_version(found))
        if name is not None and name != settings.name:
            settings = UniaxialSettings() if name == "uniaxial" else FEBioSettings()
        if isinstance(settings, UniaxialSettings):
            return UniaxialWith(tuple(self.model.effects)) if self.model.effects else Uniaxial()
        found = self._found(settings.executable)
        return febio_with(self._solver(settings, found, solver_version(found), scratch), self.effects())

    def template(self, settings: TemplateSettings, scratch: Path) -> Template:
        """The study's own template, read and checked; no solver is needed. Raises :class:`BadInput`."""
        main, files = read_files(self.path.parent, settings.file)
        steps = settings.time_steps
        template = Template(
            executable="",
            version="",
            files=files,
            main=main,
            outputs=tuple(output.logged(name) for name, output in settings.outputs.items()),
            scratch=scratch,
            force=settings.force,
            timeout_s=settings.timeout_s,
            max_file_bytes=settings.max_file_mb * 2**20,
            ramp_s=steps.ramp_s,
            hold_growth=steps.hold_growth,
            still_mm=steps.still_mm,
            settle_s=settings.settle_s,
            keep_failed=settings.keep_failed,
        )
        sized = self.protocols is None or self.specimen is not None
        check_template(self.path, template, self.tendon(), sized=sized, moved=settings.force is not None)
        return template

    def _found(self, executable: str) -> Path:
        found = shutil.which(executable)
        if found is None:
            raise SolverMissing(
                f"{self.path}: simulator.executable",
                f"{shown(executable)} was not found",
                "febio4 on the PATH, or the path of the solver",
            )
        return Path(found).resolve()

    def solver_with(self, effects: tuple[Effect, ...], scratch: Path) -> FEBio:
        """FEBio with ``effects``, to render its input and, if it is on the PATH, to run it; by the study's settings.

        Raises :class:`BadInput` for effects that it does not have.
        """
        settings = self.simulator if isinstance(self.simulator, FEBioSettings) else FEBioSettings()
        found = shutil.which(settings.executable)
        version = solver_version(Path(found).resolve()) if found else ""
        return febio_with(self._solver(settings, Path(found or settings.executable), version, scratch), effects)

    def _solver(self, settings: FEBioSettings, executable: Path, version: str, scratch: Path) -> FEBio:
        steps = settings.time_steps
        return FEBio(
            executable=str(executable),
            version=version,
            template=read_template(self.path.parent, settings.template),
            scratch=scratch,
            timeout_s=settings.timeout_s,
            max_file_bytes=settings.max_file_mb * 2**20,
            ramp_s=steps.ramp_s,
            hold_growth=steps.hold_growth,
            still_mm=steps.still_mm,
            keep_failed=settings.keep_failed,
        )


def read_study(path: str | Path, *, seed: int | None = None) -> Study:
    """Read and validate a study file; ``seed`` replaces the study's.

    Raises :class:`BadInput` for the first thing that is wrong.
    """
    path = Path(path)
    study = read_settings(path, Study, "study", {} if seed is None else {"seed": seed})
    study._path = path
    return study
