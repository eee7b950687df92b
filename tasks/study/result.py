"""Results of tasks: frozen dataclasses, each the owner of its ``TASK.json``.

A result is written field by field in the order of its class; arrays become lists, and numbers that are not finite
become null. Reading checks types and says which field is wrong, so that whoever holds a result can rely on it.
"""

import dataclasses
import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self, cast

import numpy as np
from pydantic import AfterValidator, BeforeValidator, GetPydanticSchema, TypeAdapter, ValidationError
from pydantic_core import core_schema

from sinew.runner.errors import BadInput, brief, shown
from sinew.runner.files import NotReadable, parse_json, read_regular
from sinew.tasks.study.files import MAX_JSON_BYTES, write_json

#: Libraries whose version changes what any task computes.
ALWAYS = ("numpy", "scipy", "numba")

MOST_NAMES, MOST_ENTRIES = 1_000, 20_000  # parameters; specimens, protocols and the like
LONGEST_NAME, LONGEST_TEXT = 300, 5_000  # characters of names, which a page repeats, and of sentences
ROUNDING = 1e-9  # by which a number may leave its range
NAMED = ("names", "free", "bounds", "units", "meanings", "methods")  # fields with an entry for each parameter, or few

OMIT = {"omit": True}
"""Metadata of a field that is left out of the file where it is None: ``field(default=None, metadata=OMIT)``."""


def _array(value: Any) -> np.ndarray[Any, Any]:
    try:
        array = np.array(value, dtype=np.float64)  # null becomes NaN
    except (TypeError, OverflowError):
        raise ValueError("expected numbers in lists of equal lengths") from None
    if array.ndim == 0:
        raise ValueError("expected a list of numbers")
    return array


Numbers = Annotated[
    np.ndarray[Any, Any], GetPydanticSchema(lambda *_: core_schema.no_info_plain_validator_function(_array))
]
"""An array of float64; null in the file is NaN."""

_or_nan = BeforeValidator(lambda value: np.nan if value is None else value)

Number = Annotated[float, _or_nan]
"""A float; null in the file is NaN."""


def _within(low: float, high: float, words: str) -> AfterValidator:
    """Refuses what is outside, rounding aside; NaN is not."""

    def check(value: Any) -> Any:
        if np.any(value < low - ROUNDING) or np.any(value > high + ROUNDING):
            raise ValueError(f"expected {words}")
        return value

    return AfterValidator(check)


def check_lengths(names: Sequence[str], holder: object, keys: Sequence[str]) -> None:
    """Refuse names that come twice, and arrays of ``holder`` that do not have one number for each.

    Raises :class:`ValueError`.
    """
    if len(set(names)) < len(names):
        raise ValueError(f"names: {', '.join(names)}, of which one comes twice")
    for key in keys:
        if (array := getattr(holder, key)).shape != (len(names),):
            raise ValueError(f"{key}: {array.size} numbers for {len(names)} names")


Count = Annotated[int, _within(0, np.inf, "at least 0")]
"""A whole number that is not negative."""

NotNegative = Annotated[float, _or_nan, _within(0, np.inf, "at least 0")]
"""A float that is not negative; null in the file is NaN."""

NotNegatives = Annotated[Numbers, _within(0, np.inf, "at least 0")]
"""An array of numbers that are not negative."""

Share = Annotated[float, _or_nan, _within(0, 1, "0 to 1")]
"""A part or a probability, from 0 to 1; null in the file is NaN."""

Shares = Annotated[Numbers, _within(0, 1, "0 to 1")]
"""An array of them."""

AtMostOne = Annotated[float, _within(-np.inf, 1, "at most 1")]
"""The part of a variance that a model explains."""

R2 = Annotated[float, _or_nan, _within(-np.inf, 1, "at most 1")]
"""The same; null in the file is NaN."""

Correlation = Annotated[float, _or_nan, _within(-1, 1, "-1 to 1")]
"""From -1 to 1; null in the file is NaN."""


@contextmanager
def believed(path: Path) -> Iterator[None]:
    """What is done here takes the result in ``path`` for one that a task wrote: all of its fields fit each other.

    Fields of one from elsewhere, right one by one, may contradict each other, or the store: :class:`BadInput`.
    """
    try:
        yield
    except (
        LookupError,
        ValueError,
        TypeError,
        AttributeError,
        ArithmeticError,
        RecursionError,
        AssertionError,
    ) as error:
        words = brief(f"contradicts itself, or the store ({type(error).__name__}: {error})", 150)
        raise BadInput(path, words, f"what `sinew {path.stem}` writes; run it again") from error


class Result:
    """What a task found. Subclasses are dataclasses, ``@dataclass(frozen=True, eq=False)``.

    ``TASK`` names the task. ``VERSION`` is that of the method: raise it whenever the same inputs give other numbers, so
    that results of the former version are made anew. ``LIBRARIES``: packages that the numbers depend on, by
    distribution name. ``inputs``, a field of every result, is the key of everything that it was made from.
    """

    TASK: ClassVar[str]
    VERSION: ClassVar[int] = 1
    LIBRARIES: ClassVar[tuple[str, ...]] = ()
    inputs: str

    @classmethod
    def path(cls, folder: Path) -> Path:
        """Where a result folder keeps it."""
        return folder / f"{cls.TASK}.json"

    @classmethod
    def versions(cls) -> dict[str, Any]:
        """What the numbers depend on besides study and data: versions of the method and of its libraries."""
        return {"version": cls.VERSION, "libraries": {name: version(name) for name in (*ALWAYS, *cls.LIBRARIES)}}

    @classmethod
    def parse(cls, content: Any, where: Path) -> Self:
        """A result from the content of its file. Raises :class:`BadInput` for the first field that is wrong."""
        _check_version(content, where, cls.VERSION)
        _check_size(content, where)
        with believed(where):  # half a character of a text, or a number of hundreds of digits, is no ValidationError
            try:
                return cast(Self, _adapter(cls).validate_python(content))
            except ValidationError as error:
                first = error.errors(include_url=False)[0]
                field = ".".join(str(part) for part in first["loc"]) or "content"
                problem = _problem(first)
                expected = f"what this version's `sinew {cls.TASK}` writes; run it again"
                raise BadInput(f"{where}: {field}", problem, expected) from None

    @classmethod
    def read(cls, folder: Path) -> Self | None:
        """The result in a folder, or None when there is none. Raises :class:`BadInput` when it is damaged."""
        path = cls.path(folder)
        content = read_object(path, f"what `sinew {cls.TASK}` writes; run it again")
        return None if content is None else cls.parse(content, path)

    def write(self, folder: Path) -> None:
        """Write ``TASK.json``, whole or not at all."""
        write_json(self.path(folder), {**plain(self), "version": self.VERSION})


def _problem(error: Any) -> str:
    """What is wrong with a field, or with the fields together, in the words of pydantic or of a result."""
    if error["type"] == "missing":
        return "missing"
    if error["type"] == "value_error":
        words = str(error["ctx"]["error"])
        return f"{shown(error['input'])}: {words}" if error["loc"] else words
    return f"{shown(error['input'])}: {error['msg'].lower()}"


def _check_version(content: Any, where: Path, known: int) -> None:
    """Refuse a result of a later version, whose fields may mean something else. Raises :class:`BadInput`."""
    found = content.get("version", 1) if isinstance(content, dict) else 1
    if type(found) is not int or not 0 < found <= known:
        problem = f"{found}, of a later sinew" if type(found) is int and found > known else shown(found)
        raise BadInput(f"{where}: version", problem, f"at most {known}, that of this sinew; run the task again")


def _check_size(content: Any, where: Path) -> None:
    """Refuse what no task writes: a page or a figure would have as many panels and labels. Raises :class:`BadInput`."""
    for field, value in content.items() if isinstance(content, dict) else ():
        most = MOST_NAMES if field in NAMED else MOST_ENTRIES if isinstance(value, dict) else None
        if most is not None and isinstance(value, dict | list) and len(value) > most:
            raise BadInput(f"{where}: {shown(field)[1:-1]}", f"{len(value):,} entries", f"at most {most:,}")
        if long := next(_long_texts(field, value), None):
            raise BadInput(f"{where}: {shown(field)[1:-1]}", f"a text of {long:,} characters", "names and sentences")


def _long_texts(field: str, value: Any) -> Iterator[int]:
    """The lengths of names and sentences below a field that are longer than any."""
    waiting = [(field, LONGEST_NAME), (value, LONGEST_NAME if field in NAMED else LONGEST_TEXT)]
    while waiting:
        one, most = waiting.pop()
        if isinstance(one, str):
            if len(one) > most:
                yield len(one)
        elif isinstance(one, list):
            waiting += [(each, most) for each in one if isinstance(each, str | list | dict)]
        elif isinstance(one, dict):
            waiting += [(key, LONGEST_NAME) for key in one]
            waiting += [(each, most) for each in one.values() if isinstance(each, str | list | dict)]


def read_object(path: Path, expected: str) -> dict[str, Any] | None:
    """A JSON object from a file, or None when there is no file. Raises :class:`BadInput` when it is damaged."""
    try:
        content = parse_json(read_regular(path, MAX_JSON_BYTES))
    except FileNotFoundError:
        return None
    except json.JSONDecodeError as error:
        raise BadInput(f"{path}: line {error.lineno}", f"damaged, no JSON ({error.msg})", expected) from None
    except NotReadable as problem:
        raise BadInput(path, str(problem), expected) from None
    except UnicodeDecodeError:
        raise BadInput(path, "damaged, no UTF-8 text", expected) from None
    except ValueError as error:
        raise BadInput(path, str(error), expected) from None
    except RecursionError:
        raise BadInput(path, "damaged, nested without end", expected) from None
    except OSError as error:
        raise BadInput(path, error.strerror or "cannot be read", expected) from None
    if not isinstance(content, dict):
        raise BadInput(path, f"holds {shown(content)}", expected)
    return content


def plain(value: Any) -> Any:
    """Dataclasses and arrays as dictionaries and lists of plain numbers; fields of :data:`OMIT` that are None go."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        found = ((field, getattr(value, field.name)) for field in dataclasses.fields(value))
        return {field.name: plain(item) for field, item in found if not (item is None and field.metadata.get("omit"))}
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    return value


def _adapter(kind: type[Any]) -> TypeAdapter[Any]:
    if kind not in _ADAPTERS:
        _ADAPTERS[kind] = TypeAdapter(kind)
    return _ADAPTERS[kind]


_ADAPTERS: dict[type[Any], TypeAdapter[Any]] = {}
