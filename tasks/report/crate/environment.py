"""With which program and packages the results of a crate were made, and how to install them again."""

import json
import re
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, requires, version
from typing import Any

from sinew.tasks.report.crate.source import Source
from sinew.tasks.study import provenance
from sinew.tasks.study.resources import DISTRIBUTION

VERSION = re.compile(r"[A-Za-z0-9][A-Za-z0-9.+!_-]*")
SOLVER = re.compile(r"[A-Za-z0-9][A-Za-z0-9 ._+-]{0,99}")
PLAIN = re.compile(r"[A-Za-z0-9][A-Za-z0-9 .,:+_-]{0,99}")
FACTS = (
    "version",
    "code",
    "python",
    "system",
    "seed",
    "simulator",
    "study_hash",
    "template_hash",
    "cohort_hash",
    "asctime",
)


def environment(source: Source) -> dict[str, Any]:
    """Versions, hashes and the solver of the last run, as it logged them; no names of machines, people or folders."""
    facts = {name: value for name in FACTS if (value := source.run.get(name)) is not None and _plain(value)}
    return {**facts, "solver": dict(zip(("name", "version"), solver(source), strict=True)),
            "packages": direct(source.run)}  # fmt: skip


def _plain(value: object) -> bool:
    """Whether a fact of a log can be one: anybody may have written it."""
    return isinstance(value, int) or (isinstance(value, str) and PLAIN.fullmatch(value) is not None)


def as_json(source: Source) -> bytes:
    """:func:`environment` as a file."""
    return (json.dumps(environment(source), indent=1) + "\n").encode()


def solver(source: Source) -> tuple[str, str]:
    """Name and version of the simulator, as the stored rows say. Anybody may have written these: only words count."""
    for tables in source.found.tables.values():
        for table in tables:
            simulator = table.identity.get("simulator")
            about = simulator if isinstance(simulator, dict) else {}
            name, its_version = (str(about.get(key, "")) for key in ("name", "version"))
            if SOLVER.fullmatch(name):
                return name, its_version if VERSION.fullmatch(its_version) and len(its_version) <= 100 else ""
    return str(source.run["simulator"]), ""


def direct(run: Mapping[str, Any]) -> dict[str, str]:
    """Versions of the packages that sinew asks for, as the log says; whatever is no version is left out."""
    packages = run.get("packages")
    found = packages.items() if isinstance(packages, dict) else ()
    asked = {_key(_first_word(line)) for line in requires(DISTRIBUTION) or ()}
    return {name: each for name, each in found if isinstance(each, str) and _key(name) in asked
            and VERSION.fullmatch(each)}  # fmt: skip


def version_of(run: Mapping[str, Any], name: str, otherwise: str) -> str:
    """The version of ``sinew`` (``version``) or of ``python`` that the log of a run says, if it is one."""
    found = run.get(name)
    return found if isinstance(found, str) and len(found) <= 100 and VERSION.fullmatch(found) else otherwise


def requirements(source: Source) -> bytes:
    """Exact versions for pip: of what sinew asks for, and of all that this needs, if it is installed here as then."""
    asked = direct(source.run)
    here = {name: found for name in asked if (found := _version(name)) is not None}
    versions = [version_of(source.run, name, "of unknown version") for name in ("version", "python")]
    head = f"# {DISTRIBUTION} {versions[0]}, Python {versions[1]}\n"
    pins = {_key(name): each for name, each in asked.items()}
    if here == asked:
        pins = _all_below(asked) | pins
    else:
        head += "# only what sinew asks for itself: the crate was made in another environment than the results\n"
    return (head + "".join(f"{name}=={each}\n" for name, each in sorted(pins.items()))).encode()


def install(source: Source) -> str:
    """The command that installs this very program, as far as it is known here."""
    if source.run.get("code") == provenance.code():
        return provenance.install_command()
    return f"pip install {DISTRIBUTION}=={version_of(source.run, 'version', 'VERSION')}"


def _all_below(names: Mapping[str, str]) -> dict[str, str]:
    """Versions of packages and of all that they need, as installed here; extras are left out."""
    found: dict[str, str] = {}
    waiting = list(names)
    while waiting:
        name = waiting.pop()
        key, installed = _key(name), _version(name)
        if key in found or installed is None:  # the latter: for another system or Python
            continue
        found[key] = installed
        lines = [line for line in requires(name) or () if "extra ==" not in line]
        waiting += map(_first_word, lines)
    return found


def _first_word(requirement: str) -> str:
    return re.split(r"[^A-Za-z0-9_.-]", requirement, maxsplit=1)[0]


def _key(name: str) -> str:
    return name.lower().replace("_", "-")


def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None
