"""Known vulnerabilities of the locked packages: by pip-audit or, without a network, by a copy of the OSV database.

The copy is what https://osv.dev offers as ``PyPI/all.zip``, or a folder with such files: JSON, or YAML as in a checkout
of github.com/pypa/advisory-database.
"""

import json
import re
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import yaml
from packaging.markers import Marker
from packaging.utils import canonicalize_name
from packaging.version import InvalidVersion, Version

from tests.supply.lock import LOCK, Pin, all_pins

NOT_AUDITED = "not audited"
OFFLINE = "where the advisory database cannot be reached: make audit ADVISORIES=all.zip (docs/dependencies.md)"


def audit(advisories: Path | None) -> int:
    """Audit the lock file and print, in the last line, what was asked and found.

    Returns 0 if nothing is known about any package, 1 for vulnerabilities, 2 if not every package was asked about.
    """
    locked = all_pins(LOCK.read_text("utf-8"))
    return _by_pip_audit(locked) if advisories is None else _by_copy(locked, advisories)


def _by_pip_audit(locked: Sequence[Pin]) -> int:
    command = [sys.executable, "-m", "pip_audit", "--strict", "--disable-pip", "--require-hashes"]
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.json"
        options = ["--progress-spinner", "off", "--format", "json", "--output", str(report), "-r", str(LOCK)]
        code = subprocess.run([*command, *options], check=False).returncode
        try:
            asked = json.loads(report.read_bytes())["dependencies"]
        except (FileNotFoundError, ValueError, KeyError):
            asked = []
    asked = [one for one in asked if "vulns" in one]
    found = [f"{one['name']} {one['version']}: {each['id']}" for one in asked for each in one["vulns"]]
    missed = {pin.name for pin in locked if _is_for_here(pin)} - {canonicalize_name(one["name"]) for one in asked}
    if missed or (code and not found):
        some = f"without {len(missed)} of {len(locked)} packages" if asked else "it could not ask about them"
        print("\n".join([*found, f"{NOT_AUDITED}: pip-audit ended with exit code {code}, {some}; {OFFLINE}"]))
        return 2
    others = f", {len(locked) - len(asked)} for other systems not asked about" if len(locked) > len(asked) else ""
    print("\n".join([*found, f"{len(asked)} packages asked about by pip-audit: {len(found)} known{others}"]))
    return 1 if found else 0


def _is_for_here(pin: Pin) -> bool:
    """Whether a package would be installed on this system; pip-audit passes over the others."""
    markers = re.findall(r"^\S+==\S+ ; (.*?)\s*\\?$", pin.text, re.MULTILINE)
    return not markers or any(Marker(one).evaluate() for one in markers)


def _by_copy(locked: Sequence[Pin], advisories: Path) -> int:
    try:
        records = list(read(advisories))
    except (OSError, ValueError, zipfile.BadZipFile, yaml.YAMLError) as error:
        print(
            f"{NOT_AUDITED}: {advisories} cannot be read ({error}); expected a copy of the OSV database, PyPI/all.zip"
        )
        return 2
    names = {pin.name for pin in locked}
    about = sum(bool(names.intersection(name for name, _ in _affected(record))) for record in records)
    if not about:  # the whole database has hundreds: this is another one, or a part
        print(f"{NOT_AUDITED}: none of the {len(records):,} advisories of {advisories} is about any locked package")
        return 2
    found = [f"{pin.name} {pin.version}: {record['id']}" for pin, record in vulnerable(locked, records)]
    told = f"{len(records):,} advisories, {about:,} of them about some version of these: {len(found)} known"
    print("\n".join([*found, f"{len(locked)} packages against {told}"]))
    return 1 if found else 0


def read(advisories: Path) -> Iterator[dict[str, Any]]:
    """The advisories of a zip file or a folder."""
    if advisories.is_dir():
        for path in sorted(advisories.rglob("*.json")):
            yield json.loads(path.read_bytes())
        for path in sorted([*advisories.rglob("PYSEC-*.yaml"), *advisories.rglob("GHSA-*.yaml")]):
            yield yaml.load(path.read_bytes(), Loader=yaml.CSafeLoader)
        return
    with zipfile.ZipFile(advisories) as archive:
        for name in archive.namelist():
            if name.endswith(".json"):
                yield json.loads(archive.read(name))


def vulnerable(locked: Iterable[Pin], records: Iterable[dict[str, Any]]) -> list[tuple[Pin, dict[str, Any]]]:
    """The pins that an advisory is about, with it. Advisories that were withdrawn do not count."""
    by_name: dict[str, list[Pin]] = {}
    for pin in locked:
        by_name.setdefault(pin.name, []).append(pin)
    found = {}
    for record in records:
        for name, affected in _affected(record) if "withdrawn" not in record else ():
            for pin in by_name.get(name, ()):
                if _holds(pin.version, affected):
                    found[pin.name, pin.version, record["id"]] = pin, record
    return list(found.values())


def _affected(record: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    """The packages of this index that an advisory is about: name, and which versions."""
    for affected in record.get("affected", ()):
        package = affected.get("package", {})
        if package.get("ecosystem") == "PyPI":
            yield canonicalize_name(package.get("name", "")), affected


def _holds(version: Version, affected: dict[str, Any]) -> bool:
    if any(_version(each) == version for each in affected.get("versions", ())):
        return True
    ranges = [each["events"] for each in affected.get("ranges", ()) if each.get("type") == "ECOSYSTEM"]
    return any(_inside(version, events) for events in ranges)


def _inside(version: Version, events: list[dict[str, str]]) -> bool:
    """Whether a version is in the ranges that these events begin and end, as the OSV schema defines them."""
    inside = False
    kinds = {"introduced": 0, "fixed": 1, "last_affected": 2}
    steps = [(_version(text), kinds[kind], kind) for event in events for kind, text in event.items() if kind in kinds]
    for at, _, kind in sorted(steps):
        if kind == "introduced" and version >= at:
            inside = True
        elif (kind == "fixed" and version >= at) or (kind == "last_affected" and version > at):
            inside = False
    return inside


def _version(text: str) -> Version:
    try:
        return Version(text)
    except InvalidVersion:  # of the time before PEP 440; "0" is how OSV says: from the beginning
        return Version("0.dev0")
