"""Small files of a result folder: JSON and text, written whole or not at all; keys of what results are made from."""

import hashlib
import json
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from sinew.runner.errors import BadInput
from sinew.runner.files import NotReadable, parse_json, read_regular, write_whole

MAX_JSON_BYTES = 2**24


def digest(*parts: Any) -> str:
    """A key for inputs of an analysis, so that an unchanged one is not done again."""
    hashed = hashlib.blake2b(digest_size=16)
    for part in parts:
        if isinstance(part, np.ndarray):
            hashed.update(np.ascontiguousarray(part).tobytes())
        else:
            hashed.update(json.dumps(part, sort_keys=True, default=str).encode())
    return hashed.hexdigest()


def refuse_other_names(path: Path, option: str = "") -> None:
    """Raises :class:`BadInput` for a path that is not UTF-8, which neither JSON nor another process can be told."""
    try:
        str(path.absolute()).encode("utf-8")
    except UnicodeEncodeError:
        raise BadInput(f"{option}{path}", "its path is not UTF-8", "other names of the file and its folders") from None


def write_json(path: Path, content: dict[str, Any]) -> None:
    """Write JSON, whole or not at all; numbers that are not finite become null."""
    write_text(path, json.dumps(_finite(content), indent=1, allow_nan=False) + "\n")


def write_text(path: Path, text: str) -> None:
    """Write a file, whole or not at all."""
    write_whole(path, as_bytes(text))


def as_bytes(text: str) -> bytes:
    """Text in UTF-8. JSON may hold half a character, which has no bytes: a question mark stands for it."""
    return text.encode("utf-8", "replace")


def read_json(path: Path) -> dict[str, Any] | None:
    """A JSON object that was written before, or None when there is none that can be read."""
    try:
        content = parse_json(read_regular(path, MAX_JSON_BYTES))
    except (OSError, NotReadable, ValueError, RecursionError):
        return None
    return content if isinstance(content, dict) else None


def last_events(folder: Path, size: int) -> Iterator[dict[str, Any]]:
    """The events in the last ``size`` bytes of a result folder's log, the oldest first; none where it cannot be read.

    The first line may be cut, the last one not yet whole: what is no event is passed over.
    """
    try:
        lines = read_regular(folder / "log.jsonl", size, last=size).splitlines()
    except (OSError, NotReadable):
        return
    for line in lines:
        with suppress(ValueError, RecursionError):
            event = parse_json(line)
            if isinstance(event, dict):
                yield event


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(key): _finite(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return _finite(value.tolist())
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    if isinstance(value, np.generic):
        return _finite(value.item())
    if isinstance(value, float):
        return value if np.isfinite(value) else None
    return value
