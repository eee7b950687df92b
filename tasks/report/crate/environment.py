"""With which program and packages the results of a crate were made, and how to install them again."""

import json
import re
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, requires, version
from typing import Any

from sinew.runner.errors import one_line
from sinew.tasks.report.crate.source import Source
from sinew.tasks.study import provenance
from sinew.tasks.study.resources import DISTRIBUTION

NAME, VERSION = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*"), re.compile(r"[A-Za-z0-9][A-Za-z0-9.+!_-]*")
SOLVER = re.compile(r"[A-Za-z0-9][A-Za-z0-9 ._+-]{0,99}")
FACTS = ("version", "code", "python", "system", "seed", "simulator", "study_hash", "cohort_hash", "asctime")


def environment(source: Source) -> dict[str, Any]:
    """Versions, hashes and the solver of the last run, as it logged them; no names of machines, people or folders."""
    facts = {name: source.run[name] for name in FACTS if name in source.run}
    return {**facts, "solver": dict(zip(("name", "version"), solver(source), strict=True)),
            "packages": direct(source.run)}  # fmt: skip


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
    return {name: each for name, each in found if isinstance(each, str) and NAME.fullmatch(name)
            and VERSION.fullmatch(each)}  # fmt: skip


def requirements(source: Source) -> bytes:
    """Exact versions for pip: of what sinew asks for, and of all that this needs, if it is installed here as then."""
    asked = direct(source.run)
    here = {name: found for name in asked if (found := _version(name)) is not None}
    versions = [one_line(str(source.run.get(key, ""))) for key in ("version", "python")]  # from a log of anybody's
    head = f"# {DISTRIBUTION} {versions[0]}, Python {versions[1]}\n"
    pins = {name.lower().replace("_", "-"): each for name, each in asked.items()}
    if here == asked:
        pins = _all_below(asked) | pins
    else:
        head += "# only what sinew asks for itself: the crate was made in another environment than the results\n"
    return (head + "".join(f"{name}=={each}\n" for name, each in sorted(pins.items()))).encode()


def install(source: Source) -> str:
    """The command that installs this very program, as far as it is known here."""
    if source.run.get("code") == provenance.code():
        return provenance.install_command()
    found = source.run.get("version")
    return f"pip install {DISTRIBUTION}=={found if isinstance(found, str) and VERSION.fullmatch(found) else 'VERSION'}"


def _all_below(names: Mapping[str, str]) -> dict[str, str]:
    """Versions of packages and of all that they need, as installed here; extras are left out."""
    found: dict[str, str] = {}
    waiting = list(names)
    while waiting:
        name = waiting.pop()
        key, installed = name.lower().replace("_", "-"), _version(name)
        if key in found or installed is None:  # the latter: for another system or Python
            continue
        found[key] = installed
        lines = [line for line in requires(name) or () if "extra ==" not in line]
        waiting += [re.split(r"[^A-Za-z0-9_.-]", line, maxsplit=1)[0] for line in lines]
    return found


def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None
