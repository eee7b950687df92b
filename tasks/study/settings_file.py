"""Settings files: YAML read into strict, frozen objects. Every mistake names the file, the line and the field."""

import os
import re
from collections.abc import Iterable, Iterator, Mapping
from difflib import get_close_matches
from pathlib import Path
from types import UnionType
from typing import Any, Literal, TypeVar, Union, get_args, get_origin

import yaml
from pydantic import BaseModel, ConfigDict, ValidationError

from sinew.runner.errors import BadInput, shown
from sinew.runner.files import read_input
from sinew.tasks.study.files import refuse_other_names, write_text

MAX_BYTES = 2**18
MAX_DEPTH = 12
MAX_VALUES = 20_000  # scalars of a file


class Section(BaseModel):
    """A mapping of a settings file: no unknown keys, no silent conversions, frozen."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


class FieldError(ValueError):
    """What is wrong with a field below the one that is being validated."""

    def __init__(self, field: str, problem: str, expected: str) -> None:
        super().__init__(f"{problem}; expected {expected}")
        self.field, self.problem, self.expected = field, problem, expected


def by_name(value: Any) -> Any:
    """Let ``kind`` stand for ``{name: kind}`` where a field chooses between kinds of settings."""
    if isinstance(value, str):
        return {"name": value}
    if not isinstance(value, dict):
        raise ValueError(f"{shown(value)}; expected a name or settings with a name")
    if "name" not in value:
        raise FieldError("name", "missing", "which kind it is")
    return value


S = TypeVar("S", bound=Section)


def read_settings(path: Path, kind: type[S], what: str, overrides: Mapping[str, Any] | None = None) -> S:
    """Read ``what`` (``study``, ``profile``) from a YAML file; ``overrides`` replace top-level fields.

    Raises :class:`BadInput` for the first thing that is wrong.
    """
    return settings_in(read_text(path, what), path, kind, what, overrides)


def _a(what: str) -> str:
    return f"an {what}" if what[0] in "aeiou" else f"a {what}"


def read_text(path: Path, what: str) -> str:
    """The text of a YAML file. Raises :class:`BadInput`."""
    refuse_other_names(path)
    if path.suffix.lower() in (".pkl", ".pickle"):
        raise BadInput(path, "pickled data are never read", "a YAML file")
    if not os.path.isfile(path):  # unlike Path.is_file, it takes names of any length
        there = "is a folder" if os.path.isdir(path) else "neither file nor link"
        problem = there if os.path.exists(path) else "is not there"
        raise BadInput(path, problem, f"{_a(what)} file in YAML")
    try:
        return read_input(path, MAX_BYTES, f"{_a(what)} file of at most {MAX_BYTES // 2**10} kB").decode("utf-8-sig")
    except UnicodeDecodeError:
        raise BadInput(path, "not a text file", "YAML in UTF-8") from None


def settings_in(text: str, path: Path, kind: type[S], what: str, overrides: Mapping[str, Any] | None = None) -> S:
    """The settings in the text of the file ``path``, as :func:`read_settings` reads them. Raises :class:`BadInput`."""
    content, lines = _parse(path, text, what)
    try:
        return kind.model_validate({**content, **(overrides or {})}, context={"folder": path.parent})
    except ValidationError as error:
        raise _first_problem(path, kind, error, lines, what) from None


def fields_in(text: str, path: Path, what: str) -> dict[str, Any]:
    """Each value in the text of the file ``path``, by its field (``model.parameters.E_f.min``), unchecked.

    Raises :class:`BadInput` for what is no plain YAML.
    """
    return dict(_leaves(_parse(path, text, what)[0], ()))


def _leaves(value: Any, field: tuple[str, ...]) -> Iterator[tuple[str, Any]]:
    if isinstance(value, dict) and value:
        for key, inner in value.items():
            yield from _leaves(inner, (*field, str(key)))
    else:
        yield ".".join(field), value


def write_settings(path: Path, head: str, content: Mapping[str, Any]) -> None:
    """Write settings as YAML that :func:`read_settings` reads, below the comment ``head``."""
    write_text(path, head + as_yaml(content))


class _Loader(yaml.SafeLoader):
    """Safe YAML without the traps: no aliases, no duplicate keys, no deep nests; 1e3 is a number, ``no`` is text."""


_Loader.yaml_implicit_resolvers = {
    first: [(tag, pattern) for tag, pattern in resolvers if tag not in _OWN]
    for _OWN in [
        ("tag:yaml.org,2002:float", "tag:yaml.org,2002:int", "tag:yaml.org,2002:bool", "tag:yaml.org,2002:timestamp")
    ]
    for first, resolvers in yaml.SafeLoader.yaml_implicit_resolvers.items()
}
_Loader.add_implicit_resolver(  # without the bases of 60 and of 8, in which 4:00:00 and 020 are other numbers
    "tag:yaml.org,2002:int",
    re.compile(r"^[-+]?(0b[01_]{1,64}|[0-9][0-9_]{0,32}|0x[0-9a-fA-F_]{1,16})$"),
    list("-+0123456789"),
)
_Loader.add_constructor("tag:yaml.org,2002:int", lambda _, node: _whole_number(node.value))
_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"^[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?$|^[-+]?\.(inf|Inf|INF)$|^\.(nan|NaN|NAN)$"),
    list("-+0123456789."),
)
_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:bool", re.compile(r"^(true|True|TRUE|false|False|FALSE)$"), list("tTfF")
)


def _whole_number(text: str) -> int:
    """A whole number: 12, 012, 1_000, 0x1F or 0b11."""
    plain = text.replace("_", "")
    return int(plain, 0) if plain.lstrip("+-")[:2] in ("0x", "0b") else int(plain)


class _Dumper(yaml.SafeDumper):
    """Quotes texts that :class:`_Loader`, or any other reader of YAML, would take for something else."""


_Dumper.yaml_implicit_resolvers = {
    first: _Loader.yaml_implicit_resolvers.get(first, []) + yaml.SafeDumper.yaml_implicit_resolvers.get(first, [])
    for first in {**_Loader.yaml_implicit_resolvers, **yaml.SafeDumper.yaml_implicit_resolvers}
}


def as_yaml(content: Mapping[str, Any]) -> str:
    """YAML that is read back as it is, by this module too."""
    return yaml.dump(dict(content), Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=1000)


def from_yaml(text: str) -> dict[str, Any]:
    """The content of a file that :func:`read_settings` read before, in the same words: ``1e3`` is a number."""
    return dict(yaml.load(text, Loader=_Loader))  # noqa: S506 - it is a safe loader


def _parse(path: Path, text: str, what: str) -> tuple[dict[str, Any], dict[tuple[str, ...], int]]:
    """The content, and the line of every field."""
    try:
        _check_events(path, text, what)
        node = yaml.compose(text, Loader=_Loader)
        if node is None:
            raise BadInput(path, "empty", f"{_a(what)} with at least a name")
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


def _check_events(path: Path, text: str, what: str) -> None:
    depth = 0
    documents = values = 0
    for event in yaml.parse(text, Loader=_Loader):
        where = f"{path}: line {event.start_mark.line + 1 if event.start_mark else 1}"
        if isinstance(event, yaml.AliasEvent) or getattr(event, "anchor", None):
            raise BadInput(where, "an anchor or alias", "plain YAML, every value written out")
        if tag := getattr(event, "tag", None):
            raise BadInput(where, f"the tag {shown(tag)}", "plain YAML without tags")
        if isinstance(event, yaml.CollectionStartEvent):
            depth += 1
            if depth > MAX_DEPTH:
                raise BadInput(where, f"nested deeper than {MAX_DEPTH} levels", f"{_a(what)} file")
        elif isinstance(event, yaml.CollectionEndEvent):
            depth -= 1
        elif isinstance(event, yaml.ScalarEvent):
            values += 1
            if values > MAX_VALUES:
                raise BadInput(where, f"more than {MAX_VALUES:,} values", f"{_a(what)} file")
        elif isinstance(event, yaml.DocumentStartEvent):
            documents += 1
            if documents > 1:
                raise BadInput(where, "a second YAML document", f"one {what} in a file")


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
    "tuple_type": "a list",
    "dict_type": "a mapping of names to settings",
    "model_type": "a mapping of settings",
    "model_attributes_type": "a mapping of settings",
    "finite_number": "a finite number",
}


_UNIONS = {
    "specimens": "'all' or a list of specimen names, each once",
    "points_per_curve": "'all' or a whole number of at least 2",
}


def _first_problem(
    path: Path, kind: type[BaseModel], error: ValidationError, lines: dict[tuple[str, ...], int], what: str
) -> BadInput:
    problems = error.errors(include_url=False)
    first = next((p for p in problems if p["type"] == "extra_forbidden"), problems[0])
    location, section = _locate(kind, [str(part) for part in first["loc"]])
    field: tuple[str, ...] = ()
    for part in location:  # what is not in the file names members of unions
        if (*field, part) in lines:
            field = (*field, part)
    if first["type"] == "missing":
        field = (*field, location[-1])
    own = first.get("ctx", {}).get("error")
    if isinstance(own, FieldError):
        field = (*field, *own.field.split("."))
        problem, expected = own.problem, own.expected
    elif own is not None:
        problem, _, expected = str(own).partition("; expected ")
    elif first["type"] == "extra_forbidden":
        problem, expected = "unknown key", f"one of {', '.join(section.model_fields)}"
    elif first["type"] == "missing":
        problem, expected = "missing", "a value"
    else:
        problem, expected = shown(first["input"]), _expected(first, field)
    if first["type"] == "extra_forbidden":
        expected += _meant(location[-1], section.model_fields)
    elif first["type"] == "literal_error":
        expected += _meant(first["input"], re.findall(r"'([^']*)'", first.get("ctx", {}).get("expected", "")))
    line = next((lines[field[:n]] for n in range(len(field), -1, -1) if field[:n] in lines), 1)
    return BadInput(f"{path}: line {line}, {'.'.join(field) or what}", problem, expected)


def _meant(word: object, known: Iterable[str]) -> str:
    """What somebody who misspelled a word may have meant."""
    near = get_close_matches(word, list(known), n=1) if isinstance(word, str) else []
    return f" (did you mean '{near[0]}'?)" if near else ""


def _expected(problem: Any, field: tuple[str, ...]) -> str:
    context = problem.get("ctx", {})
    for name, words in _UNIONS.items():
        if name in field[-2:] and problem["type"] != "dict_type":  # the field itself, or an item of it
            return words
    if problem["type"] in ("literal_error", "union_tag_invalid"):
        return f"one of {context.get('expected') or context.get('expected_tags')}"
    for key, words in (("gt", "above"), ("ge", "at least"), ("lt", "below"), ("le", "at most")):
        if key in context:
            number = "a number " if problem["input"] != problem["input"] else ""  # NaN is on no side of any
            return f"{number}{words} {context[key]}"
    if problem["type"] == "string_pattern_mismatch":
        dot = "'_', '-' and '.'" if "." in context["pattern"] else "'_' and '-'"
        return f"letters, digits, {dot}" if field[-1:] == ("name",) else f"text like {context['pattern']}"
    if problem["type"] == "too_short":
        return "at least one"
    return _EXPECTED.get(problem["type"], problem["msg"])


def _locate(kind: type[BaseModel], location: list[str]) -> tuple[list[str], type[BaseModel]]:
    """The field that a location means, without the tags of unions, and the innermost section on the way to it."""
    field: list[str] = []
    section: type[BaseModel] = kind
    choices: list[Any] = [kind]
    for part in location:
        tagged = [choice for choice in choices if len(choices) > 1 and _tag(choice) == part]
        if tagged:
            choices = tagged
            section = tagged[0]
            continue
        field.append(part)
        sections = [choice for choice in choices if _is_section(choice)]
        if len(sections) == 1 and part in sections[0].model_fields:
            choices = _members(sections[0].model_fields[part].annotation)
        else:  # a key of a mapping, an item of a list
            choices = [member for choice in choices for inner in get_args(choice)[-1:] for member in _members(inner)]
        if part is not location[-1] and len(found := [choice for choice in choices if _is_section(choice)]) == 1:
            section = found[0]
    return field, section


def _members(annotation: Any) -> list[Any]:
    if get_origin(annotation) in (Union, UnionType):
        return [member for inner in get_args(annotation) for member in _members(inner)]
    return [annotation]


def _is_section(choice: Any) -> bool:
    return isinstance(choice, type) and issubclass(choice, BaseModel)


def _tag(choice: Any) -> str | None:
    if not _is_section(choice) or "name" not in choice.model_fields:
        return None
    annotation = choice.model_fields["name"].annotation
    return str(get_args(annotation)[0]) if get_origin(annotation) is Literal else None
