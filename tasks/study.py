"""The study file: one YAML file, validated into frozen objects. Every mistake names the file, line and field."""

import os
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import yaml
from pydantic import BaseModel, ConfigDict, Field, PrivateAttr, ValidationError, field_validator, model_validator

from runner.cluster import Address, ClusterSpec, Local, free_cores
from tasks.model import TENDON, Model, Parameter
from tasks.problems import BadInput, shown
from tasks.simulate import Simulator

MAX_STUDY_BYTES = 2**18
MAX_DEPTH = 12

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Seconds = Annotated[float, Field(gt=0, le=86_400 * 30, allow_inf_nan=False)]
Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,63}$")]


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


class ParameterSettings(_Section):
    """Bounds of a parameter, or one ``fixed`` value; ``unit`` guards against a slip of units."""

    min: Annotated[float, Field(allow_inf_nan=False)] | None = None
    max: Annotated[float, Field(allow_inf_nan=False)] | None = None
    reference: Annotated[float, Field(allow_inf_nan=False)] | None = None
    fixed: Annotated[float, Field(allow_inf_nan=False)] | None = None
    unit: str | None = None

    def apply(self, parameter: Parameter) -> Parameter:
        """The parameter with these settings. Raises ``ValueError`` with the field that is wrong."""
        if self.unit is not None and self.unit != parameter.unit:
            raise _FieldError("unit", shown(self.unit), f"{parameter.unit!r}, the unit of {parameter.name}")
        if self.fixed is not None:
            if self.min is not None or self.max is not None or self.reference is not None:
                raise _FieldError("fixed", "given beside min, max or reference", "either fixed, or min and max")
            low = high = reference = self.fixed
        else:
            low = parameter.minimum if self.min is None else self.min
            high = parameter.maximum if self.max is None else self.max
            if low >= high:
                raise _FieldError("max", f"{high:g} is not above min {low:g}", "min below max (or use fixed)")
            middle = parameter.reference if low <= parameter.reference <= high else (low + high) / 2
            reference = middle if self.reference is None else self.reference
            if not low <= reference <= high:
                raise _FieldError("reference", f"{reference:g}", f"a value from {low:g} to {high:g}")
        for field, value in (("fixed" if self.fixed is not None else "min", low), ("max", high)):
            # a range may touch the edge of what is possible, its inside is what is studied
            if not parameter.possible(value) and (low == high or value < parameter.floor or value >= parameter.ceiling):
                raise _FieldError(field, f"{value:g}", parameter.limits)
        return Parameter(
            parameter.name,
            parameter.unit,
            low,
            high,
            reference,
            parameter.description,
            parameter.floor,
            parameter.ceiling,
            parameter.exclusive,
        )


class ModelSettings(_Section):
    """The tissue model: what the study says differs from the published ranges."""

    parameters: dict[str, ParameterSettings] = {}
    beta: Annotated[float, Field(ge=2, le=10, allow_inf_nan=False)] = 2.0
    lambda_0: Annotated[float, Field(gt=1, le=2, allow_inf_nan=False)] = 1.01


class UniaxialSettings(_Section):
    name: Literal["uniaxial"] = "uniaxial"


class TimeSteps(_Section):
    """Where the solver steps. All steps end at measured rows; between them the force is interpolated.

    ``ramp_s``: longest step while the displacement moves (0: every row). ``hold_growth``: in a hold, a step may grow to
    this fraction of the time since the hold began (0: every row). ``still_mm``: how far the displacement may stray
    from a constant for a stretch of time to count as a hold.
    """

    ramp_s: Annotated[float, Field(ge=0, allow_inf_nan=False)] = 0.0
    hold_growth: Annotated[float, Field(ge=0, le=0.5, allow_inf_nan=False)] = 0.02
    still_mm: Annotated[float, Field(ge=0, allow_inf_nan=False)] = 0.0


class FEBioSettings(_Section):
    """The real solver: ``executable`` by name or path, ``template`` beside the study file (default: the tendon)."""

    name: Literal["febio"] = "febio"
    executable: Annotated[str, Field(min_length=1, pattern=r"^[^\x00-\x1f-][^\x00-\x1f]*$")] = "febio4"
    template: str | None = None
    timeout_s: Seconds = 600.0
    max_file_mb: Annotated[int, Field(gt=0, le=1_000_000)] = 4096
    time_steps: TimeSteps = TimeSteps()
    keep_failed: Annotated[int, Field(ge=0, le=10_000)] = 20


class LocalSettings(_Section):
    name: Literal["local"] = "local"
    workers: Annotated[int, Field(ge=1, le=1024)] | None = None
    tls: bool = True


class AddressSettings(_Section):
    name: Literal["address"] = "address"
    address: Annotated[str, Field(pattern=r"^(tls|tcp)://[A-Za-z0-9_.:\[\]-]+:\d+$")]


class SobolSettings(_Section):
    """A Saltelli design of ``base_samples`` x (free parameters + 2) rows, or of at least ``points`` rows.

    ``specimens``: which to study, ``all`` or names. ``resamples``: bootstrap resamples behind the intervals.
    """

    points: Annotated[int, Field(ge=1, le=10**8)] | None = None
    base_samples: Annotated[int, Field(ge=2, le=2**26)] | None = None
    specimens: Literal["all"] | Annotated[list[str], Field(min_length=1)] = "all"
    second_order: bool = False
    resamples: Annotated[int, Field(ge=10, le=100_000)] = 200
    confidence: Annotated[float, Field(gt=0.5, lt=1)] = 0.95

    @model_validator(mode="after")
    def _one_size(self) -> Self:
        if self.points is not None and self.base_samples is not None:
            raise _FieldError("points", "given beside base_samples", "one of the two")
        if self.base_samples is not None and self.base_samples & (self.base_samples - 1):
            raise _FieldError("base_samples", str(self.base_samples), "a power of two, as the Sobol sequence needs")
        return self

    @field_validator("specimens")
    @classmethod
    def _once(cls, value: Any) -> Any:
        if isinstance(value, list) and len(set(value)) < len(value):
            name = next(name for i, name in enumerate(value) if name in value[:i])
            raise ValueError(f"{shown(name)} is a duplicate; expected each specimen once")
        return value


class ImportanceSettings(_Section):
    """Random forests on the rows of the Sobol study."""

    trees: Annotated[int, Field(ge=10, le=10_000)] = 100
    repeats: Annotated[int, Field(ge=2, le=1000)] = 10
    max_rows: Annotated[int, Field(ge=100)] = 10_000


class StoreSettings(_Section):
    """``points_per_curve``: how many points of each simulated curve are kept (``all``: every measured point)."""

    points_per_curve: Literal["all"] | Annotated[int, Field(ge=2, le=10**6)] = 96


class Study(_Section):
    """A validated study. Build it by :func:`read_study`."""

    name: Name
    cohort: str | None = None
    seed: Annotated[int, Field(ge=0, lt=2**32)] = 0
    model: ModelSettings = ModelSettings()
    simulator: UniaxialSettings | FEBioSettings = Field(default=UniaxialSettings(), discriminator="name")
    cluster: LocalSettings | AddressSettings = Field(default=LocalSettings(), discriminator="name")
    store: StoreSettings = StoreSettings()
    retries: Annotated[int, Field(ge=0, le=20)] = 1
    tasks: Annotated[list[Literal["sobol", "importance"]], Field(min_length=1)] = ["sobol", "importance"]
    sobol: SobolSettings = SobolSettings(points=20_000)
    importance: ImportanceSettings = ImportanceSettings()

    _path: Path = PrivateAttr(default=Path())

    @field_validator("simulator", "cluster", mode="before")
    @classmethod
    def _by_name(cls, value: Any) -> Any:
        return {"name": value} if isinstance(value, str) else {"name": cls._default_name(value), **value}

    @staticmethod
    def _default_name(value: Any) -> Any:
        if not isinstance(value, dict):
            raise ValueError(f"{shown(value)}; expected a name or settings with a name")
        if "name" not in value:
            raise _FieldError("name", "missing", "which kind it is")
        return value["name"]

    @field_validator("tasks")
    @classmethod
    def _tasks_once(cls, value: list[str]) -> list[str]:
        for task in value:
            if value.count(task) > 1:
                raise ValueError(f"{task} is a duplicate; expected each task once")
        if "importance" in value and "sobol" in value and value.index("importance") < value.index("sobol"):
            raise ValueError("importance before sobol, whose rows it uses; expected sobol first")
        return value

    @model_validator(mode="after")
    def _known_parameters(self) -> Self:
        self.tendon()
        return self

    @property
    def path(self) -> Path:
        return self._path

    @property
    def cohort_path(self) -> Path:
        """The cohort's folder; relative paths start at the study file."""
        if self.cohort is None:
            raise BadInput(f"{self.path}: cohort", "missing", "a cohort folder, here or by --data")
        return self.path.parent / self.cohort

    def tendon(self) -> Model:
        """The model with this study's bounds."""
        known = {parameter.name: parameter for parameter in TENDON}
        for name in self.model.parameters:
            if name not in known:
                raise _FieldError(f"model.parameters.{name}", "unknown parameter", f"one of {', '.join(known)}")
        parameters = []
        for name, parameter in known.items():
            try:
                settings = self.model.parameters.get(name, ParameterSettings())
                parameters.append(settings.apply(parameter))
            except _FieldError as error:
                raise _FieldError(f"model.parameters.{name}.{error.field}", error.problem, error.expected) from None
        model = Model(tuple(parameters), self.model.beta, self.model.lambda_0)
        if not model.free:
            raise _FieldError("model.parameters", "every parameter is fixed", "at least one with min and max")
        return model

    def cluster_spec(self, workers: int | None = None) -> ClusterSpec:
        """Where evaluations run; ``workers`` overrides the number of local workers."""
        if isinstance(self.cluster, AddressSettings):
            return Address(self.cluster.address)
        return Local(workers or self.cluster.workers or free_cores(), self.cluster.tls)

    def simulator_object(self, name: str | None, scratch: Path) -> Simulator:
        """The simulator, or the one called ``name``; FEBio's attempts live below ``scratch``.

        Raises :class:`BadInput` when the solver or its template cannot be found.
        """
        from tasks.simulate.febio import FEBio, read_template, solver_version
        from tasks.simulate.uniaxial import Uniaxial

        settings = self.simulator
        if name is not None and name != settings.name:
            settings = UniaxialSettings() if name == "uniaxial" else FEBioSettings()
        if isinstance(settings, UniaxialSettings):
            return Uniaxial()
        executable = shutil.which(settings.executable)
        if executable is None:
            raise BadInput(
                f"{self.path}: simulator.executable",
                f"{shown(settings.executable)} was not found",
                "febio4 on the PATH, or the path of the solver",
            )
        template = read_template(self.path.parent, settings.template)
        steps = settings.time_steps
        return FEBio(
            executable=str(Path(executable).resolve()),
            version=solver_version(Path(executable).resolve()),
            template=template,
            scratch=scratch,
            timeout_s=settings.timeout_s,
            max_file_bytes=settings.max_file_mb * 2**20,
            ramp_s=steps.ramp_s,
            hold_growth=steps.hold_growth,
            still_mm=steps.still_mm,
            keep_failed=settings.keep_failed,
        )


class _FieldError(ValueError):
    def __init__(self, field: str, problem: str, expected: str) -> None:
        super().__init__(f"{problem}; expected {expected}")
        self.field, self.problem, self.expected = field, problem, expected


def read_study(path: Path, *, seed: int | None = None) -> Study:
    """Read and validate a study file; ``seed`` replaces the study's.

    Raises :class:`BadInput` for the first thing that is wrong.
    """
    if path.suffix.lower() in (".pkl", ".pickle"):
        raise BadInput(path, "pickled data are never read", "a YAML file")
    if not os.path.isfile(path):  # unlike Path.is_file, it takes names of any length
        there = "is a folder" if os.path.isdir(path) else "neither file nor link"
        problem = there if os.path.exists(path) else "is not there"
        raise BadInput(path, problem, "a study file in YAML")
    try:
        if (size := path.stat().st_size) > MAX_STUDY_BYTES:
            raise BadInput(path, f"{size / 2**20:,.0f} MB", "a study file of at most 256 kB")
        text = path.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError:
        raise BadInput(path, "not a text file", "YAML in UTF-8") from None
    except OSError as error:
        raise BadInput(path, (error.strerror or "cannot be read").lower(), "a readable file") from None
    content, lines = _parse(path, text)
    try:
        study = Study.model_validate(content if seed is None else {**content, "seed": seed})
    except ValidationError as error:
        raise _first_problem(path, error, lines) from None
    study._path = path
    return study


class _Loader(yaml.SafeLoader):
    """Safe YAML without the traps: no aliases, no duplicate keys, no deep nests; 1e3 is a number, ``no`` is text."""


_Loader.yaml_implicit_resolvers = {
    first: [(tag, pattern) for tag, pattern in resolvers if tag not in _OWN]
    for _OWN in [("tag:yaml.org,2002:float", "tag:yaml.org,2002:bool", "tag:yaml.org,2002:timestamp")]
    for first, resolvers in yaml.SafeLoader.yaml_implicit_resolvers.items()
}
_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"^[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?$|^[-+]?\.(inf|Inf|INF)$|^\.(nan|NaN|NAN)$"),
    list("-+0123456789."),
)
_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:bool", re.compile(r"^(true|True|TRUE|false|False|FALSE)$"), list("tTfF")
)


def _parse(path: Path, text: str) -> tuple[dict[str, Any], dict[tuple[str, ...], int]]:
    """The content, and the line of every field."""
    try:
        _check_events(path, text)
        node = yaml.compose(text, Loader=_Loader)
        if node is None:
            raise BadInput(path, "empty", "a study with at least a name")
        if not isinstance(node, yaml.MappingNode):
            raise BadInput(f"{path}: line {node.start_mark.line + 1}", "not a mapping", "fields such as 'name: demo'")
        lines = dict(_lines(path, node, ()))
        return _Loader(text).construct_document(node), lines
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None) or getattr(error, "context_mark", None)
        where = f"{path}: line {mark.line + 1}" if mark else str(path)
        problem = getattr(error, "problem", None) or getattr(error, "reason", None) or "cannot be parsed"
        raise BadInput(where, f"not valid YAML ({problem})", "plain YAML without tags") from None
    except (ValueError, OverflowError, RecursionError):
        raise BadInput(path, "not valid YAML", "plain YAML without tags") from None


def _check_events(path: Path, text: str) -> None:
    depth = 0
    documents = 0
    for event in yaml.parse(text, Loader=_Loader):
        where = f"{path}: line {event.start_mark.line + 1 if event.start_mark else 1}"
        if isinstance(event, yaml.AliasEvent) or getattr(event, "anchor", None):
            raise BadInput(where, "an anchor or alias", "plain YAML, every value written out")
        if tag := getattr(event, "tag", None):
            raise BadInput(where, f"the tag {shown(tag)}", "plain YAML without tags")
        if isinstance(event, yaml.CollectionStartEvent):
            depth += 1
            if depth > MAX_DEPTH:
                raise BadInput(where, f"nested deeper than {MAX_DEPTH} levels", "a study file")
        elif isinstance(event, yaml.CollectionEndEvent):
            depth -= 1
        elif isinstance(event, yaml.DocumentStartEvent):
            documents += 1
            if documents > 1:
                raise BadInput(where, "a second YAML document", "one study in a file")


def _lines(path: Path, node: yaml.Node, field: tuple[str, ...]) -> Iterator[tuple[tuple[str, ...], int]]:
    yield field, node.start_mark.line + 1
    if isinstance(node, yaml.MappingNode):
        seen: set[str] = set()
        for key, value in node.value:
            name = str(key.value)
            if not isinstance(key, yaml.ScalarNode) or not key.tag.endswith(":str"):
                raise BadInput(f"{path}: line {key.start_mark.line + 1}", f"the key {shown(name)}", "a name as key")
            if name in seen:
                raise BadInput(
                    f"{path}: line {key.start_mark.line + 1}, {'.'.join((*field, name))}",
                    "given twice",
                    "each key once",
                )
            seen.add(name)
            yield from _lines(path, value, (*field, name))
    elif isinstance(node, yaml.SequenceNode):
        for i, value in enumerate(node.value):
            yield from _lines(path, value, (*field, str(i)))


_EXPECTED = {
    "float_type": "a number",
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "string_type": "text",
    "bool_type": "true or false",
    "list_type": "a list",
    "dict_type": "a mapping of names to settings",
    "model_type": "a mapping of settings",
    "model_attributes_type": "a mapping of settings",
    "finite_number": "a finite number",
}


_UNIONS = {
    "specimens": "'all' or a list of specimen names, each once",
    "points_per_curve": "'all' or a whole number of at least 2",
}


def _first_problem(path: Path, error: ValidationError, lines: dict[tuple[str, ...], int]) -> BadInput:
    problems = error.errors(include_url=False)
    first = next((p for p in problems if p["type"] == "extra_forbidden"), problems[0])
    location = [str(part) for part in first["loc"]]
    kind = location.pop(1) if location[:1] in (["simulator"], ["cluster"]) and len(location) > 1 else ""
    field: tuple[str, ...] = ()
    for part in location:  # what is not in the file names members of unions
        if (*field, part) in lines:
            field = (*field, part)
    if first["type"] == "missing":
        field = (*field, location[-1])
    own = first.get("ctx", {}).get("error")
    if isinstance(own, _FieldError):
        field = (*field, *own.field.split("."))
        problem, expected = own.problem, own.expected
    elif own is not None:
        problem, _, expected = str(own).partition("; expected ")
    elif first["type"] == "extra_forbidden":
        problem, expected = "unknown key", f"one of {', '.join(_known_keys(field[:-1], kind))}"
    elif first["type"] == "missing":
        problem, expected = "missing", "a value"
    else:
        problem, expected = shown(first["input"]), _expected(first, field)
    line = next((lines[field[:n]] for n in range(len(field), -1, -1) if field[:n] in lines), 1)
    return BadInput(f"{path}: line {line}, {'.'.join(field) or 'study'}", problem, expected)


def _expected(problem: Any, field: tuple[str, ...]) -> str:
    context = problem.get("ctx", {})
    for name, words in _UNIONS.items():
        if name in field:
            return words
    if problem["type"] in ("literal_error", "union_tag_invalid"):
        return f"one of {context.get('expected') or context.get('expected_tags')}"
    for key, words in (("gt", "above"), ("ge", "at least"), ("lt", "below"), ("le", "at most")):
        if key in context:
            return f"{words} {context[key]}"
    if problem["type"] == "string_pattern_mismatch":
        return "letters, digits, '_', '-' and '.'" if field[-1:] == ("name",) else f"text like {context['pattern']}"
    if problem["type"] == "too_short":
        return "at least one"
    return _EXPECTED.get(problem["type"], problem["msg"])


def _known_keys(field: tuple[str, ...], kind: str) -> list[str]:
    sections: dict[tuple[str, ...], type[BaseModel]] = {
        (): Study,
        ("model",): ModelSettings,
        ("simulator",): FEBioSettings if kind == "febio" else UniaxialSettings,
        ("simulator", "time_steps"): TimeSteps,
        ("cluster",): AddressSettings if kind == "address" else LocalSettings,
        ("sobol",): SobolSettings,
        ("importance",): ImportanceSettings,
        ("store",): StoreSettings,
    }
    return list(sections.get(field, ParameterSettings).model_fields)
