"""What a discovery said of a case, read from its ``verdict.json``: nothing that a score needs may be missing."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tasks.problems import BadInput, shown
from tasks.workspace import read_result

WORDS = ("NONE", "NAMED", "AMBIGUOUS", "OUTSIDE")


@dataclass(frozen=True)
class Option:
    """A candidate. ``loss``: whitened sum of squares; ``free``: parameters of its effects over all specimens.

    ``criterion`` is the loss with the discovery's own penalty. ``held_out``: gain on held-out curves, None where that
    was not asked. ``intervals``: low and high end of the 90 % interval by specimen and parameter.
    """

    effects: tuple[str, ...]
    loss: float
    free: int
    criterion: float
    held_out: float | None = None
    intervals: Mapping[str, Mapping[str, tuple[float, float]]] = field(default_factory=dict)


@dataclass(frozen=True)
class Told:
    """A verdict: its word, the effects it names, those it cannot tell apart, and all candidates.

    ``null_loss`` and ``floor``: whitened sum of squares of the model as it is, and of a true one. ``closed``: part of
    the gap on held-out curves that the best candidate closed, None where there was none.
    """

    word: str
    effects: tuple[str, ...]
    alike: tuple[str, ...]
    null_loss: float
    floor: float
    options: tuple[Option, ...]
    closed: float | None = None


def read_told(path: Path) -> Told:
    """Read ``verdict.json``. Raises :class:`BadInput` with the key that is missing or is not what a score needs."""
    content = read_result(path)
    if content is None:
        raise BadInput(path, "cannot be read", "a verdict that `sinew discover` wrote")
    return told(content, str(path))


def told(content: Mapping[str, Any], where: str = "verdict.json") -> Told:
    """The verdict in the content of ``verdict.json``. Raises :class:`BadInput` as :func:`read_told` does."""
    word = _get(content, where, "verdict")
    if word not in WORDS:
        raise BadInput(f"{where}: verdict", shown(word), f"one of {', '.join(WORDS)}")
    null = _get(content, where, "null")
    null_loss = _number(null, f"{where}: null", "loss")
    options = _get(content, where, "candidates")
    if not isinstance(options, list) or not options:
        raise BadInput(f"{where}: candidates", shown(options), "a list of candidates")
    return Told(
        word,
        _texts(content, where, "effects"),
        _texts(content, where, "set"),
        null_loss,
        _number(null, f"{where}: null", "floor"),
        tuple(_option(one, f"{where}: candidates[{i}]", null_loss) for i, one in enumerate(options)),
        _number_or_none(_get(content, where, "gap"), f"{where}: gap", "closed"),
    )


def _option(one: Any, where: str, null_loss: float) -> Option:
    parameters = _get(one, where, "parameters")
    return Option(
        _texts(one, where, "effects"),
        _number(one, where, "loss"),
        int(_number(one, where, "free")),
        null_loss - _number(one, where, "gain"),
        _number_or_none(one, where, "held_out"),
        {
            specimen: {name: _interval(values, f"{where}.parameters.{specimen}", name) for name in values}
            for specimen, values in _items(parameters, f"{where}.parameters")
        },
    )


def _items(value: Any, where: str) -> Any:
    if not isinstance(value, Mapping):
        raise BadInput(where, shown(value), "values and intervals by specimen and parameter")
    return value.items()


def _interval(values: Any, where: str, name: str) -> tuple[float, float]:
    interval = _get(_get(values, where, name), f"{where}.{name}", "interval")
    try:
        low, high = (float(end) for end in interval)
    except (TypeError, ValueError):
        raise BadInput(f"{where}.{name}.interval", shown(interval), "two numbers") from None
    return low, high


def _get(content: Any, where: str, key: str) -> Any:
    if not isinstance(content, Mapping) or key not in content:
        raise BadInput(f"{where}: {key}", "missing", "a verdict of this version of `sinew discover`")
    return content[key]


def _number(content: Any, where: str, key: str) -> float:
    value = _get(content, where, key)
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise BadInput(f"{where}: {key}", shown(value), "a finite number")
    return float(value)


def _number_or_none(content: Any, where: str, key: str) -> float | None:
    return None if _get(content, where, key) is None else _number(content, where, key)


def _texts(content: Any, where: str, key: str) -> tuple[str, ...]:
    value = _get(content, where, key)
    if not isinstance(value, list) or not all(isinstance(one, str) for one in value):
        raise BadInput(f"{where}: {key}", shown(value), "a list of effects")
    return tuple(value)
