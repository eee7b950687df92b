"""How a golden comparison works: which files, what is left out, and when two numbers count as equal.

Numbers count as equal within ``RELATIVE``, so that another processor's rounding is no difference; those in ``ROUGH``
within its tolerances. Everything else must be equal: keys and their order, texts, lengths, where there is no number.
"""

import hashlib
import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from sinew.tasks.registry import TASKS

EXPECTED = Path(__file__).parent / "expected"
ACCEPTED = EXPECTED / "accepted.json"
RELATIVE, ABSOLUTE = 1e-4, 1e-9
#: ``factor`` is a quantile of left-out errors over predicted ones, of which the smallest are near rounding.
ROUGH = {"factor": 0.02}
#: Provenance: keys of what a result was made from, and what only says where and how fast. ``theta``: the likelihood of
#: a Gaussian process is flat in some directions, and where in them a search ends is rounding.
LEFT_OUT = frozenset({"inputs", "data", "version", "seconds", "path", "difference", "theta"})


def golden(content: Any) -> Any:
    """What of a result's content is compared."""
    if isinstance(content, dict):
        return {name: golden(value) for name, value in content.items() if name not in LEFT_OUT}
    return [golden(value) for value in content] if isinstance(content, list) else content


def differences(expected: Any, found: Any, where: str = "") -> Iterator[str]:
    """A line for each place where two contents differ."""
    if isinstance(expected, dict) and isinstance(found, dict):
        if list(expected) != list(found):
            yield f"{where or 'top'}: keys {list(expected)} became {list(found)}"
            return
        for name in expected:
            yield from differences(expected[name], found[name], f"{where}.{name}" if where else name)
    elif isinstance(expected, list) and isinstance(found, list):
        if len(expected) != len(found):
            yield f"{where}: {len(expected)} items became {len(found)}"
            return
        for i, (one, other) in enumerate(zip(expected, found, strict=True)):
            yield from differences(one, other, f"{where}[{i}]")
    elif not _equal(expected, found, ROUGH.get(where.rpartition(".")[2], RELATIVE)):
        yield f"{where}: {expected!r} became {found!r}"


def _equal(expected: Any, found: Any, relative: float) -> bool:
    kinds = {type(expected), type(found)}
    if kinds <= {int, float} and float in kinds:
        return math.isclose(expected, found, rel_tol=relative, abs_tol=ABSOLUTE)
    return len(kinds) == 1 and bool(expected == found)


def compare(out: Path) -> dict[str, list[str]]:
    """The differences of each task's result in the folder ``out`` from the golden one; no entry where there is none."""
    found = {}
    for task in TASKS:
        lines = list(differences(golden(_read(EXPECTED / f"{task}.json")), golden(_read(out / f"{task}.json"))))
        if lines:
            found[task] = lines
    return found


def accept(out: Path) -> list[str]:
    """Take the results in ``out`` as golden; returns the tasks that changed.

    Raises ``ValueError`` for a task whose result changed although the version of its method did not: what is accepted
    for a version stays.
    """
    accepted = json.loads(ACCEPTED.read_text("utf-8")) if ACCEPTED.exists() else {}
    EXPECTED.mkdir(exist_ok=True)
    changed = []
    for task in TASKS:
        content = _read(out / f"{task}.json")
        version, path = str(content.get("version", 1)), EXPECTED / f"{task}.json"
        if path.exists() and not list(differences(golden(_read(path)), golden(content))):
            # a new version may change the results of other studies only
            accepted.setdefault(task, {}).setdefault(version, _digest(path))
            continue
        if version in accepted.get(task, {}):
            raise ValueError(f"{task}: the result changed, version {version} did not; raise VERSION in its result.py")
        text = json.dumps(golden(content), indent=0, separators=(",", ":")) + "\n"
        path.write_text(text, "utf-8")
        accepted.setdefault(task, {})[version] = _digest(path)
        changed.append(task)
    ACCEPTED.write_text(json.dumps(accepted, indent=1, sort_keys=True) + "\n", "utf-8")
    return changed


def edited_by_hand() -> list[str]:
    """Tasks whose golden file is not what was accepted for the present version of its method."""
    accepted = json.loads(ACCEPTED.read_text("utf-8"))
    versions = {name: _version(name) for name in TASKS}
    return [
        name for name, version in versions.items()
        if accepted.get(name, {}).get(version) != _digest(EXPECTED / f"{name}.json")
    ]  # fmt: skip


def _version(task: str) -> str:
    """The declared version of a task's method: of an inference, ABC, by which the golden study infers."""
    result = TASKS[task].module("result")
    return str(getattr(result, "AbcResult", result.RESULT).VERSION)


def _digest(path: Path) -> str:
    return hashlib.blake2b(path.read_bytes(), digest_size=16).hexdigest()


def _read(path: Path) -> Any:
    return json.loads(path.read_text("utf-8"))
