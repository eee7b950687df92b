"""Known vulnerabilities of the locked packages: by pip-audit or, without a network, by a copy of the OSV database.

The copy is what https://osv.dev offers as ``PyPI/all.zip``, or a folder with such JSON files.
"""

import json
import subprocess
import sys
import zipfile
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from packaging.utils import canonicalize_name
from packaging.version import InvalidVersion, Version

from tests.supply.lock import LOCK, Pin, pins


def audit(advisories: Path | None) -> int:
    """Audit the lock file; returns 0 if nothing is known, 1 for vulnerabilities, or if the database cannot be asked."""
    if advisories is None:
        command = ["-m", "pip_audit", "--strict", "--disable-pip", "--require-hashes", "--progress-spinner", "off"]
        code = subprocess.run([sys.executable, *command, "-r", str(LOCK)], check=False).returncode
        if code:
            print(
                "If the advisory database cannot be reached from here: make audit ADVISORIES=all.zip (CONTRIBUTING.md)"
            )
        return code
    locked = pins(LOCK.read_text("utf-8"))
    records = list(read(advisories))
    found = [f"{pin.name} {pin.version}: {record['id']}" for pin, record in vulnerable(locked.values(), records)]
    print("\n".join([*found, f"{len(locked)} packages against {len(records)} advisories: {len(found)} known"]))
    return 1 if found or not records else 0


def read(advisories: Path) -> Iterator[dict[str, Any]]:
    """The advisories of a zip file or a folder."""
    if advisories.is_dir():
        for path in sorted(advisories.rglob("*.json")):
            yield json.loads(path.read_bytes())
        return
    with zipfile.ZipFile(advisories) as archive:
        for name in archive.namelist():
            if name.endswith(".json"):
                yield json.loads(archive.read(name))


def vulnerable(locked: Iterable[Pin], records: Iterable[dict[str, Any]]) -> list[tuple[Pin, dict[str, Any]]]:
    """The pins that an advisory is about, with it. Advisories that were withdrawn do not count."""
    by_name = {pin.name: pin for pin in locked}
    found = {}
    for record in records:
        for affected in record.get("affected", ()) if "withdrawn" not in record else ():
            package = affected.get("package", {})
            pin = by_name.get(canonicalize_name(package.get("name", "")))
            if pin is not None and package.get("ecosystem") == "PyPI" and _holds(pin.version, affected):
                found[pin.name, record["id"]] = pin, record
    return list(found.values())


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
