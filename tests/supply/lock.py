"""The lock file: which packages at which versions, and which of them the program needs when it runs."""

import re
import tomllib
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from packaging.version import Version

ROOT = Path(__file__).resolve().parents[2]
LOCK = ROOT / "requirements.lock"


@dataclass(frozen=True)
class Pin:
    """A locked package: ``text`` is its entry in the lock file; ``needed_by`` names other pins, or the project."""

    name: str
    version: Version
    hashes: int
    needed_by: tuple[str, ...]
    text: str


def project() -> dict[str, tuple[str, ...]]:
    """The names of the direct dependencies: ``run`` and ``dev``."""
    table = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    groups = {"run": table["dependencies"], "dev": table["optional-dependencies"]["dev"]}
    return {
        group: tuple(canonicalize_name(Requirement(each).name) for each in names) for group, names in groups.items()
    }


def version() -> str:
    """The project's version."""
    return str(tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["version"])


def pins(text: str) -> dict[str, Pin]:
    """The pins of a lock file by name, the last one of each. Raises ``ValueError`` for one that is no exact version."""
    return {pin.name: pin for pin in all_pins(text)}


def all_pins(text: str) -> list[Pin]:
    """The pins of a lock file; a package has several where its version depends on that of Python. Raises as above."""
    found = []
    for entry in _entries(text):
        head = re.match(r"([A-Za-z0-9._-]+)==([^\s;\\]+)", entry)
        if head is None:
            raise ValueError(f"{entry.splitlines()[0]!r} is no exact version")
        _, _, via = entry.partition("# via")
        needed_by = [canonicalize_name(word) for word in re.findall(r"([A-Za-z0-9._-]+)(?: \([^)]*\))?", via)]
        name = canonicalize_name(head[1])
        found.append(Pin(name, Version(head[2]), entry.count("--hash=sha256:"), tuple(needed_by), entry))
    return found


def needed(locked: dict[str, Pin], names: Iterable[str]) -> list[Pin]:
    """The pins of ``names`` and of all that they need, on any platform, in the order of the lock file."""
    chosen = set(names)
    while True:
        more = {pin.name for pin in locked.values() if chosen.intersection(pin.needed_by)} - chosen
        if not more:
            return [pin for pin in locked.values() if pin.name in chosen]
        chosen |= more


def of_the_run(text: str) -> str:
    """The part of a lock file that the program needs when it runs: for ``pip install --require-hashes``."""
    run = {pin.name for pin in needed(pins(text), project()["run"])}
    chosen = [entry.rstrip("\n") for entry in _entries(text) if canonicalize_name(entry.partition("==")[0]) in run]
    return "\n".join(chosen) + "\n"


def _entries(text: str) -> list[str]:
    """The entries of a lock file; a package has several where its version depends on the version of Python."""
    return re.split(r"\n(?=[A-Za-z0-9])", re.sub(r"\A(#.*\n)*", "", text))
